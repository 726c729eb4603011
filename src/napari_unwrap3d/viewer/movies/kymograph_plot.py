"""The plot of a kymograph, in which a click goes to a timepoint."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import Signal
from qtpy.QtGui import QShowEvent
from qtpy.QtWidgets import QSizePolicy, QWidget

from ..steps.plots import CHOSEN, FONT, Plot

if TYPE_CHECKING:
    from ...motion.kymograph import Kymograph
    from .session import MovieSession

LEAST_HEIGHT = 180
LARGEST = 16_777_215
MISSING = "#808080"


class KymographPlot(Plot):
    """Position in µm to the right, time in s downwards, and a line at the time that is shown.

    Signals
    -------
    chosen(int)
        A timepoint was clicked.
    """

    chosen = Signal(int)

    def __init__(self, session: MovieSession, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.setMinimumHeight(LEAST_HEIGHT)
        self.setMaximumHeight(LARGEST)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Expanding)
        self.setToolTip("Click or drag to go to a time.")
        self.found: Kymograph | None = None
        self._title = ""
        self._colours_of_field: tuple[Any, float, float] = ("viridis", 0.0, 1.0)
        self._time_s = 0.0
        self._axes: Any = None
        self._now: Any = None
        self._pressed = False

    def show_kymograph(
        self, found: Kymograph, title: str, colours: tuple[Any, float, float]
    ) -> None:
        """Draw another kymograph; `colours` are a colormap and its limits."""
        self.found, self._title, self._colours_of_field = found, title, colours
        self.show()
        self.redraw()

    def show_time(self, time_s: float) -> None:
        """Put the line at another time."""
        self._time_s = time_s
        if self._now is not None:
            self._now.set_ydata([time_s, time_s])
            if self.isVisible():
                self.canvas.draw_idle()

    def showEvent(self, event: QShowEvent) -> None:
        """Draw what changed while nobody saw it."""
        super().showEvent(event)
        if self.canvas is not None:
            self.canvas.draw_idle()

    def _on_canvas(self) -> None:
        self.canvas.mpl_connect("button_press_event", self._on_press)
        self.canvas.mpl_connect("motion_notify_event", self._on_motion)
        self.canvas.mpl_connect("button_release_event", self._on_release)

    def _draw(self, colours: dict[str, str]) -> None:
        found = self.found
        if found is None:
            return
        axes = self._axes = self.figure.add_subplot()
        colormap, low, high = self._colours_of_field
        times, step = found.times_s, found.line.step_um
        half = 0.5 * float(times[1] - times[0]) if len(times) > 1 else 0.5
        image = axes.imshow(
            np.ma.masked_invalid(found.values),
            cmap=colormap.with_extremes(bad=MISSING),
            vmin=low,
            vmax=high,
            extent=(-step / 2, found.line.length_um + step / 2, times[-1] + half, times[0] - half),
            aspect="auto",
            interpolation="nearest",
        )
        self._now = axes.axhline(self._time_s, color=CHOSEN, linewidth=1.5)
        axes.set_xlabel("position (µm)", fontsize=FONT, color=colours["text"], labelpad=1)
        axes.set_ylabel("time (s)", fontsize=FONT, color=colours["text"], labelpad=1)
        self.style(axes, colours, self._title)
        bar = self.figure.colorbar(image, ax=axes, pad=0.02, fraction=0.05)
        bar.ax.tick_params(colors=colours["text"], labelsize=FONT, length=2)
        bar.outline.set_edgecolor(colours["secondary"])

    def _on_press(self, event: Any) -> None:
        if event.inaxes is self._axes and event.button == 1 and self.found is not None:
            self._pressed = True
            self._on_motion(event)

    def _on_motion(self, event: Any) -> None:
        if self._pressed and event.ydata is not None and self.found is not None:
            self.chosen.emit(int(np.abs(self.found.times_s - event.ydata).argmin()))

    def _on_release(self, _: Any) -> None:
        self._pressed = False
