"""The dock "Polar view": the uv image as a disc around one pole, following field and time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtGui import QShowEvent
from qtpy.QtWidgets import QButtonGroup, QHBoxLayout, QSizePolicy, QVBoxLayout, QWidget

from ...motion.uv_stacks import field_label
from ...unwrapping.uv_views import Pole, polar_to_pixel, to_polar
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.notice import small_button
from ..common.turns import soon
from ..steps.plots import FONT, Plot
from ..views.canvas import canvas_of
from ..views.shown_colours import shown_colours
from .session import MovieSession, movie_session_of

if TYPE_CHECKING:
    import napari

    from ..views.colouring import Colouring

POLES: tuple[Pole, ...] = ("north", "south")
LEAST_HEIGHT = 220
LARGEST = 16_777_215
# More pixels would be drawn smaller than a screen shows them.
LARGEST_VIEW = 384
RINGS = (0.25, 0.5, 0.75, 1.0)
TIPS = {
    "north": "The first row of the image in the middle, the south pole as the rim.",
    "south": "The last row of the image in the middle, the north pole as the rim.",
}


class PolarPlot(Plot):
    """A uv image around a pole; rings at 45°, 90° and 135° from it."""

    def __init__(self, session: MovieSession, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.setMinimumHeight(LEAST_HEIGHT)
        self.setMaximumHeight(LARGEST)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Expanding)
        self.view: npt.NDArray[Any] = np.zeros((1, 1))
        self._pole: Pole = "north"
        self._title = ""
        self._colours_of_field: tuple[Any, float, float] = ("viridis", 0.0, 1.0)
        self._image: Any = None
        self._drawn: Any = None

    def show_image(
        self,
        image: npt.NDArray[Any],
        pole: Pole,
        title: str,
        colours: tuple[Any, float, float],
    ) -> None:
        """Show a uv image (N, 2N); `colours` are a colormap and its limits."""
        size = min(2 * len(image), LARGEST_VIEW)
        self.view = to_polar(np.asarray(image, np.float64), pole, size)
        self._pole, self._title, self._colours_of_field = pole, title, colours
        self.show()
        if self._drawn == (pole, title, size) and self._image is not None:
            self._image.set_data(np.ma.masked_invalid(self.view))
            self._image.set_cmap(colours[0])
            self._image.set_clim(*colours[1:])
            self.canvas.draw_idle()
        else:
            self.redraw()

    def _draw(self, colours: dict[str, str]) -> None:
        size, ink = len(self.view), colours["text"]
        axes = self.figure.add_subplot()
        colormap, low, high = self._colours_of_field
        self._image = axes.imshow(
            np.ma.masked_invalid(self.view), cmap=colormap, vmin=low, vmax=high
        )
        turn = np.linspace(-np.pi, np.pi, 181)
        for r in RINGS:
            ring = polar_to_pixel(np.column_stack([np.full_like(turn, r), turn]), size, self._pole)
            style = "-" if r == 1.0 else "--" if r == 0.5 else ":"
            axes.plot(ring[:, 1], ring[:, 0], color=ink, linewidth=0.6, linestyle=style)
        for text, phi in (("0°", 0.0), ("90°", np.pi / 2), ("180°", np.pi), ("−90°", -np.pi / 2)):
            ((down, right),) = polar_to_pixel([[1.07, phi]], size, self._pole)
            axes.text(right, down, text, fontsize=FONT, color=ink, ha="center", va="center")
        margin = 0.1 * size
        axes.set_xlim(-margin, size + margin)
        axes.set_ylim(size + margin, -margin)
        axes.set_aspect("equal")
        axes.set_title(self._title, fontsize=FONT + 1, color=ink, pad=3)
        axes.set_axis_off()
        bar = self.figure.colorbar(self._image, ax=axes, pad=0.02, fraction=0.05)
        bar.ax.tick_params(colors=ink, labelsize=FONT, length=2)
        bar.outline.set_edgecolor(colours["secondary"])
        self._drawn = (self._pole, self._title, size)


class PolarDock(Docked):
    """The field that colours the views, around the north or the south pole.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.session = movie_session_of(viewer)
        self.colouring: Colouring = canvas_of(viewer).colouring
        self.pole: Pole = "north"
        self.plot = PolarPlot(self.session)
        self.buttons = {}
        row = QHBoxLayout()
        group = QButtonGroup(self)
        for pole in POLES:
            button = small_button(f"Around the {pole} pole", TIPS[pole], checkable=True)
            button.clicked.connect(lambda _=False, pole=pole: self.show_pole(pole))
            group.addButton(button)
            row.addWidget(button)
            self.buttons[pole] = button
        row.addStretch(1)
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addWidget(self.plot, 1)
        column.addStretch(0)
        self.buttons[self.pole].setChecked(True)
        self._later = soon(self, self._update)
        for signal in (
            self.session.movie_changed,
            self.session.frame_changed,
            self.colouring.changed,
        ):
            signal.connect(self._start)
        end_with_dock(self)

    def show_pole(self, pole: Pole) -> None:
        """Have another pole in the middle."""
        self.pole = pole
        self.buttons[pole].setChecked(True)
        self._update()

    @property
    def image(self) -> npt.NDArray[Any] | None:
        """The uv image of the field that is shown: of the timepoint, else of the common space."""
        frame = self.session.frame
        if frame is not None and self.colouring.field in frame.uv:
            return frame.uv[self.colouring.field]
        return self.colouring.values("uv")

    def showEvent(self, event: QShowEvent) -> None:
        """Show what changed while nobody saw it."""
        super().showEvent(event)
        self._later.start()

    def _start(self, _: Any = None) -> None:
        self._later.start()

    def _update(self) -> None:
        if not self.isVisible():
            return
        image = self.image
        if image is None:
            self.plot.hide()
            return
        field = self.colouring.field
        fields = self.colouring.fields
        known = fields is not None and field in fields.names
        title = fields.field(field).label if fields is not None and known else field_label(field)
        colours = shown_colours(self.colouring, field, image)
        self.plot.show_image(image, self.pole, f"{title}, (r, φ)", colours)
