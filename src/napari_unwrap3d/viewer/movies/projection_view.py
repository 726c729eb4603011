"""The dock "Surface projection": what is bright near the surface along an axis, following time."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from qtpy.QtGui import QShowEvent
from qtpy.QtWidgets import QComboBox, QDoubleSpinBox, QFormLayout, QLabel, QSizePolicy, QVBoxLayout

from ...charts import Stack
from ...imaging.surface_projection import REACH_UM, STATISTICS, VIEWS, SurfaceProjection
from ...motion.projections import Projections
from ..common.connections import end_with_dock
from ..steps.plots import FONT, Plot
from .computing_dock import ComputingDock
from .session import MovieSession, movie_session_of

if TYPE_CHECKING:
    import napari
    from qtpy.QtWidgets import QWidget

    from ...motion.movie import Movie

LEAST_HEIGHT = 220
LARGEST = 16_777_215
NO_STACK = "A projection needs a movie that was opened with its stack."
BRIGHTNESS_PERCENT = (1.0, 99.8)

Wanted = tuple[int, float, str, str]


class ProjectionPlot(Plot):
    """A projection with µm on both axes."""

    def __init__(self, session: MovieSession, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.setMinimumHeight(LEAST_HEIGHT)
        self.setMaximumHeight(LARGEST)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Expanding)
        self.found: SurfaceProjection | None = None
        self._limits = (0.0, 1.0)
        self._title = ""

    def show_projection(
        self, found: SurfaceProjection, limits: tuple[float, float], title: str
    ) -> None:
        """Draw another projection between limits of grey."""
        self.found, self._limits, self._title = found, limits, title
        self.show()
        self.redraw()

    def _draw(self, colours: dict[str, str]) -> None:
        if self.found is None:
            return
        axes = self.figure.add_subplot()
        axes.imshow(
            np.ma.masked_invalid(self.found.image),
            cmap="gray",
            vmin=self._limits[0],
            vmax=self._limits[1],
            extent=self.found.extent,
            interpolation="antialiased",
        )
        self.style(axes, colours, self._title)
        axes.set_facecolor("black")
        axes.set_xlabel("µm", fontsize=FONT, color=colours["text"], labelpad=1)


class ProjectionDock(ComputingDock):
    """A channel within ± µm of the surface (paper, Fig. 4c), at the timepoint that is shown.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.session = movie_session_of(getattr(napari_viewer, "__wrapped__", napari_viewer))
        self._projections: tuple[Movie, Wanted, Projections] | None = None
        self._limits: tuple[float, float] | None = None
        self._build()
        for box in (self.channel_box, self.axis_box, self.statistic_box):
            box.currentIndexChanged.connect(self._later)
        self.reach_box.valueChanged.connect(self._later)
        self.session.movie_changed.connect(self._on_movie)
        self.session.frame_changed.connect(self._later)
        self._on_movie(self.session.movie)
        end_with_dock(self)

    def _build(self) -> None:
        self.channel_box, self.axis_box, self.statistic_box = (QComboBox() for _ in range(3))
        self.axis_box.addItems(list(VIEWS))
        self.statistic_box.addItems(list(STATISTICS))
        self.reach_box = QDoubleSpinBox()
        self.reach_box.setRange(0.05, 100.0)
        self.reach_box.setSingleStep(0.1)
        self.reach_box.setValue(REACH_UM)
        self.reach_box.setPrefix("± ")
        self.reach_box.setSuffix(" µm")
        self.reach_box.setKeyboardTracking(False)
        self.plot = ProjectionPlot(self.session)
        self.status = QLabel()
        self.status.setWordWrap(True)
        form = QFormLayout()
        form.addRow("Channel", self.channel_box)
        form.addRow("Near the surface", self.reach_box)
        form.addRow("Along", self.axis_box)
        form.addRow("Statistic", self.statistic_box)
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addWidget(self.plot, 1)
        column.addWidget(self.status)
        column.addStretch(0)

    def _on_movie(self, movie: Movie | None) -> None:
        self._projections = None
        self.plot.hide()
        self.channel_box.clear()
        lapse = None if movie is None or movie.work is None else movie.work.lapse
        there = lapse is not None and isinstance(lapse.at(0), Stack)
        if lapse is not None and there:
            self.channel_box.addItems(list(lapse.channels))
        self.status.setText("" if there else NO_STACK)
        self._later()

    def showEvent(self, event: QShowEvent) -> None:
        """Show what changed while nobody saw it."""
        super().showEvent(event)
        self._later()

    def _compute(self) -> None:
        """Compute in a thread; what changes meanwhile is computed after it."""
        movie, frame = self.session.movie, self.session.frame
        channel = self.channel_box.currentIndex()
        if movie is None or frame is None or channel < 0 or not self.isVisible():
            return
        if self._postponed():
            return
        wanted = (
            channel,
            self.reach_box.value(),
            self.axis_box.currentText(),
            self.statistic_box.currentText(),
        )
        kept = self._projections
        known = kept[2] if kept is not None and kept[:2] == (movie, wanted) else None
        show = partial(self._on_computed, movie, wanted, frame.time_s)
        self._start(show, _projected, movie, wanted, known, frame.timepoint)

    def _on_computed(
        self,
        movie: Movie,
        wanted: Wanted,
        time_s: float,
        result: tuple[Projections, SurfaceProjection],
    ) -> None:
        projections, found = result
        if movie is self.session.movie:
            # The greys of the first picture are those of all that follow it.
            if self._limits is None or self._projections is None or self._projections[1] != wanted:
                self._limits = _greys(found)
            self._projections = (movie, wanted, projections)
            self.plot.show_projection(found, self._limits, f"{time_s:g} s")
            self.status.setText("")


def _projected(
    movie: Movie, wanted: Wanted, known: Projections | None, timepoint: int
) -> tuple[Projections, SurfaceProjection]:
    """Runs in a thread."""
    if known is None:
        channel, reach_um, axis, statistic = wanted
        known = Projections.of(movie, channel, reach_um, axis, statistic=statistic)  # type: ignore[arg-type]
    return known, known.at(timepoint)


def _greys(found: SurfaceProjection) -> tuple[float, float]:
    values = found.image[np.isfinite(found.image)]
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, BRIGHTNESS_PERCENT)
    return float(low), float(high) if high > low else float(low) + 1.0
