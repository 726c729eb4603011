"""Small plots of a step, in napari's colours: where the flow stops, and how maps distort."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.utils.theme import get_theme
from qtpy.QtCore import Signal
from qtpy.QtGui import QShowEvent
from qtpy.QtWidgets import QSizePolicy, QVBoxLayout, QWidget

from ...protrusions.heights import height_histogram
from ..common.connections import disconnect
from ..common.threads import Task, tell

if TYPE_CHECKING:
    from ...charts import Floats, Protrusions, Surface
    from ...unwrapping.histograms import Histogram
    from ..session import Session

HEIGHT = 130
INCHES = (3.2, 1.3)
FONT = 7
LINE, CHOSEN = "#42a5f5", "#ffa000"


def theme_colours(viewer: Any) -> dict[str, str]:
    """Colours of a plot in the theme of a viewer: "background", "text" and "secondary"."""
    theme = get_theme("dark" if viewer is None else viewer.theme)
    return {name: getattr(theme, name).as_hex() for name in ("background", "text", "secondary")}


class Plot(QWidget):
    """A figure that follows the viewer's theme. It is made when there is something to draw."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session = session
        self.canvas: Any = None
        self.figure: Any = None
        self._stale = False
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(0, 2, 0, 0)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setFixedHeight(HEIGHT)
        self.hide()
        self._connections: list[tuple[Any, Any]] = []
        viewer = session.viewer
        if viewer is not None:
            viewer.events.theme.connect(self._on_theme)
            self._connections.append((viewer.events.theme, self._on_theme))
        self.destroyed.connect(partial(disconnect, self._connections))

    def _on_theme(self, _: Any = None) -> None:
        if self.canvas is not None:
            self.redraw()

    def redraw(self) -> None:
        """Draw everything anew; what is drawn is said by `_draw`.

        What is not seen is drawn when it is.
        """
        self._stale = not self.isVisibleTo(self.window())
        if self._stale:
            return
        if self.canvas is None:
            self._make_canvas()
        self.figure.clear()
        colours = self._colours()
        self.figure.set_facecolor(colours["background"])
        self._draw(colours)
        self.canvas.draw_idle()

    def showEvent(self, event: QShowEvent | None) -> None:
        """Draw what has changed while nobody saw it."""
        super().showEvent(event)
        if self._stale:
            self.redraw()

    def _make_canvas(self) -> None:
        # Matplotlib takes long to import; a run has done so in its thread already.
        from matplotlib.backends.backend_qtagg import FigureCanvasQTAgg
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=INCHES, layout="constrained")
        self.canvas = FigureCanvasQTAgg(self.figure)
        self.canvas.setMinimumSize(40, 40)
        self._column.addWidget(self.canvas)
        self._on_canvas()

    def _on_canvas(self) -> None:
        """The canvas has been made."""

    def _draw(self, colours: dict[str, str]) -> None:
        raise NotImplementedError

    def _colours(self) -> dict[str, str]:
        return theme_colours(self.session.viewer)

    @staticmethod
    def style(axes: Any, colours: dict[str, str], title: str, where: str = "center") -> None:
        """Axes in the theme's colours, with a title "center" or "left"."""
        axes.set_facecolor(colours["background"])
        axes.tick_params(colors=colours["text"], labelsize=FONT, length=2)
        axes.set_title(title, fontsize=FONT + 1, color=colours["text"], pad=3, loc=where)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(colours["secondary"])


class LinePlot(Plot):
    """A plot with a line that can be dragged."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self._axes: Any = None
        self._line: Any = None
        self._dragging = False

    def _dragged(self, x: float) -> None:
        """The line is dragged to x."""
        raise NotImplementedError

    def _dropped(self) -> None:
        """The line was let go."""

    def _on_canvas(self) -> None:
        self.canvas.mpl_connect("button_press_event", self._on_press)
        self.canvas.mpl_connect("motion_notify_event", self._on_motion)
        self.canvas.mpl_connect("button_release_event", self._on_release)

    def _on_press(self, event: Any) -> None:
        if event.inaxes is self._axes and event.button == 1 and self._line is not None:
            self._dragging = True
            self._on_motion(event)

    def _on_motion(self, event: Any) -> None:
        if self._dragging and event.xdata is not None:
            self._dragged(float(event.xdata))

    def _on_release(self, _: Any) -> None:
        if self._dragging:
            self._dragging = False
            self._dropped()


class FlowPlot(LinePlot):
    """Total |K| against the iteration, with the stop as a line that can be dragged.

    Signals
    -------
    stop_moved(int)
        The line was dragged to another iteration.
    """

    stop_moved = Signal(int)

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.curve = np.zeros(0)
        self.stop = 0
        self.setToolTip("Drag the line to the iteration whose shape you want as the reference.")

    def show_flow(self, curve: Floats, stop: int) -> None:
        """Total |K| / 4π at iterations 0, 1, ... and the iteration that is the reference."""
        self.curve, self.stop = np.asarray(curve, dtype=float), int(stop)
        self.setVisible(len(self.curve) > 1)
        if len(self.curve) > 1:
            self.redraw()

    def show_stop(self, stop: int) -> None:
        """Move the line."""
        if self._line is not None and stop != self.stop:
            self.stop = stop
            self._line.set_xdata([stop, stop])
            self._widen(stop)
            self.canvas.draw_idle()

    def _draw(self, colours: dict[str, str]) -> None:
        axes = self.figure.add_subplot()
        axes.plot(self.curve, color=LINE, marker=".", markersize=4, linewidth=1)
        self._line = axes.axvline(self.stop, color=CHOSEN, linewidth=2)
        axes.set_xlabel("iteration", fontsize=FONT, color=colours["text"], labelpad=1)
        self.style(axes, colours, "total |K| / 4π; drag the line to stop elsewhere")
        self._axes = axes
        self._widen(self.stop)

    def _widen(self, stop: int) -> None:
        """Room to drag the line beyond the iterations that were computed."""
        self._axes.set_xlim(-0.5, max(len(self.curve) + 9, stop + 5))

    def _dragged(self, x: float) -> None:
        stop = max(round(x), 1)
        if stop != self.stop:
            self.show_stop(stop)
            self.stop_moved.emit(stop)


class HeightPlot(LinePlot):
    """Heights of the surface over the cortex, with the threshold as a line to drag.

    Signals
    -------
    threshold_moved(float)
        The line was let go at another height, in µm.
    """

    threshold_moved = Signal(float)

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.histogram: Any = None
        self.threshold_um = float("nan")
        self._task: Task | None = None
        self.setToolTip("Drag the line to where protrusions are to begin.")

    def show_heights(self, found: Protrusions, surface: Surface) -> None:
        """Show what was found; the line is where protrusions begin."""
        self.threshold_um = float(found.numbers.get("threshold_um", float("nan")))
        self._task = Task(height_histogram, found, surface)
        self._task.returned.connect(self._on_computed)
        self._task.failed.connect(tell)
        self._task.start()

    def _on_computed(self, histogram: Histogram) -> None:
        self.histogram = histogram
        self.show()
        self.redraw()

    def _draw(self, colours: dict[str, str]) -> None:
        axes = self._axes = self.figure.add_subplot()
        axes.stairs(self.histogram.shares, self.histogram.edges, fill=True, color=LINE)
        axes.set_yscale("log")
        axes.set_yticks([])
        axes.minorticks_off()
        axes.set_xlabel("µm", fontsize=FONT, color=colours["text"], labelpad=1)
        self.style(axes, colours, "height over the cortex; drag the threshold")
        self._line = None
        if np.isfinite(self.threshold_um):
            self._line = axes.axvline(self.threshold_um, color=CHOSEN, linewidth=2)

    def _dragged(self, x: float) -> None:
        self.threshold_um = max(round(x, 2), 0.0)
        self._line.set_xdata([self.threshold_um] * 2)
        self.canvas.draw_idle()

    def _dropped(self) -> None:
        self.threshold_moved.emit(self.threshold_um)


class DistortionPlot(Plot):
    """Histograms of log λ and of Q, computed in a thread."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.histograms: dict[str, Any] = {}
        self._task: Task | None = None
        self.setToolTip("log λ is 0 where areas are kept, Q is 1 where angles are kept.")

    def compute(self, function: Any, *charts: Any) -> None:
        """Show the histograms that a function gives for some charts."""
        self._task = Task(function, *charts)
        self._task.returned.connect(self._on_computed)
        self._task.failed.connect(tell)
        self._task.start()

    def _on_computed(self, histograms: dict[str, Any]) -> None:
        self.histograms = histograms
        self.show()
        self.redraw()

    def _draw(self, colours: dict[str, str]) -> None:
        titles = {"log_lambda": "log λ (areas)", "q": "Q (angles)"}
        every = self.figure.subplots(1, 2)
        for axes, (name, title) in zip(every, titles.items(), strict=True):
            found = self.histograms[name]
            axes.stairs(found.shares, found.edges, fill=True, color=LINE)
            axes.axvline(found.mean, color=CHOSEN, linewidth=1)
            axes.set_yticks([])
            axes.locator_params(axis="x", nbins=4)
            self.style(axes, colours, f"{title}, mean {round(found.mean, 3) + 0.0:.3f}")
