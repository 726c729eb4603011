"""A plot of measurements that is drawn in a thread, and whose curves can be clicked.

Drawing hundreds of curves takes longer than a window may stand still. What is shown is a picture
of the last figure that was drawn; clicks are looked up in that figure.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from qtpy.QtGui import (
    QColor,
    QHelpEvent,
    QImage,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPen,
    QResizeEvent,
    QShowEvent,
)
from qtpy.QtWidgets import QApplication, QSizePolicy, QToolTip, QWidget

from ..common.connections import disconnect
from ..common.threads import Task, tell
from ..common.turns import soon
from ..steps.plots import CHOSEN, theme_colours

if TYPE_CHECKING:
    from ...measuring.measurements import Measurements

LEAST_HEIGHT = 160
OVER_TIME = "series"
RESIZED_MS = 80
DPI = 100.0
# A curve is hit so many points beside it.
REACH_POINTS = 4.0
# How high a plot is, at most, for its width; and those of several axes above each other.
SINGLE, TALL, SEVERAL = 0.95, 2.2, ("aligned",)
# How much of what is drawn thinly is the text's colour, the rest the background's.
THIN = 0.55
ADD = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier


@dataclass(frozen=True)
class Wanted:
    """What is to be drawn.

    Attributes
    ----------
    name : str
        Of the kind of plot, in :data:`~napari_unwrap3d.measuring.plots.PLOTS`.
    measurements : Measurements
    selection : frozenset of int
    choice : str
    colours : mapping
    size : (int, int)
        Width and height in pixels of the screen.
    ratio : float
        Of them to Qt's pixels.
    """

    name: str
    measurements: Measurements
    selection: frozenset[int]
    choice: str
    colours: Mapping[str, str]
    size: tuple[int, int]
    ratio: float


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure, its picture (height, width, 4) and what of it can be clicked."""

    wanted: Wanted
    figure: Any
    picture: np.ndarray
    curves: list[tuple[int, Any]] = field(default_factory=list)


class DrawnPlot(QWidget):
    """Shows a plot of the registry in the viewer's theme.

    Signals
    -------
    picked(int, bool)
        A track was clicked, and whether it is added to those that are selected.
    cleared()
        A place without a track was clicked.
    time_picked(float)
        A time in s was double-clicked, in a plot over time.
    drawn()
        What was wanted last is shown.
    """

    picked = Signal(int, bool)
    cleared = Signal()
    time_picked = Signal(float)
    drawn = Signal()

    def __init__(self, viewer: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._viewer = viewer
        self._what: tuple[str, Measurements, frozenset[int], str] | None = None
        self._wanted: Wanted | None = None
        self._shown: Drawn | None = None
        self._image: QImage | None = None
        self._task: Task | None = None
        self._time_s: float | None = None
        self._rest = soon(self, self._draw, 0)
        self._resized = soon(self, self._draw, RESIZED_MS)
        self._clear = soon(self, self.cleared.emit, QApplication.doubleClickInterval())
        self.setMinimumHeight(LEAST_HEIGHT)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Expanding)
        self._connections: list[tuple[Any, Any]] = [(viewer.events.theme, self._on_theme)]
        viewer.events.theme.connect(self._on_theme)
        self.destroyed.connect(partial(disconnect, self._connections))

    # What is wanted -------------------------------------------------------------------

    def show_plot(
        self,
        name: str,
        measurements: Measurements,
        selection: Collection[int] = (),
        choice: str = "",
    ) -> None:
        """Draw something else."""
        self._what = name, measurements, frozenset(selection), choice
        self._rest.start()

    def show_nothing(self) -> None:
        """Forget what was drawn."""
        self._what = self._wanted = self._shown = self._image = None
        self.update()

    def show_time(self, time_s: float) -> None:
        """Put a line at a time, in plots over time."""
        self._time_s = time_s
        self.update()

    @property
    def busy(self) -> bool:
        """Whether something else will be shown soon."""
        return self._task is not None or self._rest.isActive() or self._resized.isActive()

    def _on_theme(self, _: Any = None) -> None:
        self._rest.start()

    def _draw(self) -> None:
        if self._what is None or not self.isVisible() or self._task is not None:
            return
        name, measurements, selection, choice = self._what
        ratio, area = self.devicePixelRatioF(), self._area(name, choice)
        size = max(round(area.width() * ratio), 40), max(round(area.height() * ratio), 40)
        wanted = Wanted(
            name, measurements, selection, choice, plot_colours(self._viewer), size, ratio
        )
        if wanted == self._wanted:
            return
        self._wanted = wanted
        self._task = Task(_drawn, wanted)
        self._task.returned.connect(self._on_drawn)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_drawn(self, drawn: Drawn) -> None:
        self._task = None
        if self._what is None:
            return
        self._shown = drawn
        height, width = drawn.picture.shape[:2]
        image = QImage(drawn.picture.data, width, height, QImage.Format.Format_RGBA8888)
        image.setDevicePixelRatio(drawn.wanted.ratio)
        self._image = image
        self.update()
        # Something else may have been asked for meanwhile.
        self._draw()
        if self._task is None:
            self.drawn.emit()

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self._shown = self._image = None
        self.update()
        tell(error)

    # What is shown --------------------------------------------------------------------

    def paintEvent(self, _: QPaintEvent | None) -> None:
        """The last picture, stretched until one of this size is there; and the time."""
        if self._image is None or self._shown is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(self._shown_area(), self._image)
        line = self._time_line()
        if line is not None:
            painter.setPen(QPen(QColor(CHOSEN), 1.5))
            painter.drawLine(*line)
        painter.end()

    def _time_line(self) -> tuple[QPointF, QPointF] | None:
        axes = self._axes_of_time()
        if axes is None or self._time_s is None or self._shown is None:
            return None
        low, high = sorted(axes.get_xlim())
        if not low <= self._time_s <= high:
            return None
        x, _ = axes.transData.transform((self._time_s, 0.0))
        box = axes.bbox
        height = self._shown.picture.shape[0]
        scale_x, scale_y = self._scales()
        return (
            QPointF(x / scale_x, (height - box.y1) / scale_y),
            QPointF(x / scale_x, (height - box.y0) / scale_y),
        )

    def _axes_of_time(self) -> Any:
        """The axes over the time of the movie, of plots that have them."""
        if self._shown is None or self._shown.wanted.name != OVER_TIME:
            return None
        return self._shown.figure.axes[0] if self._shown.figure.axes else None

    def _scales(self) -> tuple[float, float]:
        """Pixels of the picture in one of Qt's."""
        assert self._shown is not None
        (height, width), area = self._shown.picture.shape[:2], self._shown_area()
        return width / max(area.width(), 1), height / max(area.height(), 1)

    def _area(self, name: str, choice: str) -> QRectF:
        """Where a plot is drawn: at the top, and not much higher than it is wide."""
        tallest = TALL if name in SEVERAL and not choice else SINGLE
        height = min(self.height(), max(round(tallest * self.width()), LEAST_HEIGHT))
        return QRectF(0, 0, self.width(), height)

    def _shown_area(self) -> QRectF:
        assert self._shown is not None
        return self._area(self._shown.wanted.name, self._shown.wanted.choice)

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Draw in the new size, when it has come to rest."""
        super().resizeEvent(event)
        self._resized.start()

    def showEvent(self, event: QShowEvent | None) -> None:
        """Draw what changed while nobody saw it."""
        super().showEvent(event)
        self._rest.start()

    # The mouse ------------------------------------------------------------------------

    def track_at(self, place: QPointF) -> int | None:
        """The track whose curve is nearest to a place, if one is near."""
        if self._shown is None:
            return None
        event = self._mouse_at(place)
        reach = REACH_POINTS * self._shown.figure.dpi / 72
        best, nearest = None, reach
        for track, artist in self._shown.curves:
            distance = _distance(artist, event.x, event.y)
            # What is drawn later lies above.
            if distance <= nearest:
                best, nearest = track, distance
        return best

    def _mouse_at(self, place: QPointF) -> Any:
        from matplotlib.backend_bases import MouseEvent

        assert self._shown is not None
        scale_x, scale_y = self._scales()
        height = self._shown.picture.shape[0]
        x, y = place.x() * scale_x, height - place.y() * scale_y
        return MouseEvent("button_press_event", self._shown.figure.canvas, x, y)

    def mousePressEvent(self, event: QMouseEvent | None) -> None:
        """Select the track under the mouse; with Ctrl or Shift, add it."""
        if event is None or event.button() != Qt.MouseButton.LeftButton or self._shown is None:
            super().mousePressEvent(event)
            return
        add = bool(event.modifiers() & ADD)
        track = self.track_at(event.position())
        if track is not None:
            self.picked.emit(track, add)
        elif not add:
            # Unless a double click follows, which goes to a time.
            self._clear.start()

    def mouseDoubleClickEvent(self, event: QMouseEvent | None) -> None:
        """Go to the time under the mouse."""
        self._clear.stop()
        axes = self._axes_of_time()
        if event is None or axes is None:
            return
        mouse = self._mouse_at(event.position())
        if mouse.inaxes is axes:
            self.time_picked.emit(float(mouse.xdata))

    def event(self, event: QEvent | None) -> bool:
        """Say which track is under the mouse when it rests."""
        if event is not None and event.type() == QEvent.Type.ToolTip:
            assert isinstance(event, QHelpEvent)
            track = self.track_at(QPointF(event.pos()))
            if track is None:
                QToolTip.hideText()
            else:
                QToolTip.showText(event.globalPos(), f"track {track}", self)
            return True
        return bool(super().event(event))


def plot_colours(viewer: Any) -> dict[str, str]:
    """In the theme of a viewer; thin lines are between its text and its background."""
    colours = theme_colours(viewer)
    text, background = QColor(colours["text"]), QColor(colours["background"])
    mixed = [
        THIN * one + (1 - THIN) * other
        for one, other in zip(text.getRgbF()[:3], background.getRgbF()[:3], strict=True)
    ]
    return colours | {"secondary": QColor.fromRgbF(*mixed).name()}


def _drawn(wanted: Wanted) -> Drawn:
    """In a thread."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ...measuring.plots import PLOTS, track_of

    dpi = DPI * wanted.ratio
    inches = wanted.size[0] / dpi, wanted.size[1] / dpi
    figure = Figure(inches, dpi=dpi, facecolor=wanted.colours["background"], layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)
    PLOTS[wanted.name].draw(
        figure, wanted.measurements, wanted.selection, wanted.colours, wanted.choice
    )
    canvas.draw()
    picture = np.array(canvas.buffer_rgba())
    curves = [
        (track, artist)
        for axes in figure.axes
        for artist in axes.lines
        if (track := track_of(artist)) is not None
    ]
    return Drawn(wanted, figure, picture, curves)


def _distance(line: Any, x: float, y: float) -> float:
    """Pixels between a place and a line of matplotlib, or its markers where it has no line."""
    points = line.get_transform().transform(line.get_xydata())
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.inf
    place = np.array([x, y])
    if len(points) == 1 or line.get_linestyle() in ("None", "", " "):
        size = 0.5 * line.get_markersize()
        return max(float(np.linalg.norm(points - place, axis=1).min()) - size, 0.0)
    start, step = points[:-1], np.diff(points, axis=0)
    length = np.maximum((step**2).sum(axis=1), 1e-12)
    along = np.clip(((place - start) * step).sum(axis=1) / length, 0.0, 1.0)
    return float(np.linalg.norm(start + along[:, None] * step - place, axis=1).min())
