"""The stages of a movie in a dock: parameters, Run, what came of it, and plots."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QPushButton, QSpinBox, QWidget

from ...errors import Unwrap3DError
from ...motion.stages import Stage
from ...motion.state import DONE as PIECE_DONE
from ...motion.state import MISSING
from ...motion.state import STALE as PIECE_STALE
from ...parameters import MovieParameters, Parameters, UVParameters
from ..common.forms import ParametersForm
from ..common.section import Section
from ..common.threads import tell
from ..steps.states import DONE, FAILED, NOT_READY, READY, RUNNING, STALE
from ..steps.texts import COLOURS, MARKS
from ..views.sources import senseless_parameters
from .plots import Row, TimePlot, drift_rows, outside_rows, size_rows
from .run import STAGES, MovieRun
from .session import movie_session_of

TITLES = {
    "register": "Registration",
    "segment": "Cell at every timepoint",
    "common": "Common space",
    "frame": "Frames",
}
DESCRIPTIONS = {
    "register": "Moves every timepoint onto the first, so that drift is no motion of the surface.",
    "segment": "Finds the cell in the image of every timepoint.",
    "common": "Chooses and unwraps the one space in which a place on the cell keeps its (u, v). "
    "The parameters of its surface, reference and sphere are those of the steps of Unwrap.",
    "frame": "Brings the surface of every timepoint into the common space, with its fields.",
}
# Groups of parameters of a stage, those that are shown first, and those that are not asked for.
GROUPS: dict[str, tuple[str, ...]] = {
    "register": ("registration",),
    "segment": ("stack",),
    "common": ("movie", "uv"),
    "frame": ("movie",),
}
MAIN = (
    "registration.method",
    "registration.channels",
    "stack.channel",
    "stack.label",
    "stack.smoothing_voxels",
    "stack.threshold",
    "movie.common",
    "movie.timepoint",
    "movie.largest_outside",
    "uv.rows",
    "movie.projection",
    "movie.signals",
    "movie.depth_um",
    "movie.statistic",
    "movie.percentile",
    "movie.normalize",
)
OF_SPACE = ("movie.common", "movie.timepoint", "movie.largest_outside")
OF_SIGNALS = (
    "movie.signals",
    "movie.depth_um",
    "movie.statistic",
    "movie.percentile",
    "movie.normalize",
)
STATES = {PIECE_DONE: DONE, PIECE_STALE: STALE, MISSING: READY}
METHODS = {
    "mean": "the temporal mean",
    "timepoint": "one timepoint",
    "each": "an atlas for each timepoint",
}


class StageSection(Section):
    """One stage of a movie.

    Parameters
    ----------
    run : MovieRun
    stage : str
        "register", "segment", "common" or "frame".
    """

    picked = Signal(int)

    def __init__(self, run: MovieRun, stage: Stage, parent: QWidget | None = None) -> None:
        title = f"{STAGES.index(stage) + 1}  {TITLES[stage]}"
        super().__init__(title, DESCRIPTIONS[stage], parent)
        self.run, self.stage = run, stage
        self._current = ""
        self.run_button.setToolTip(f"Make what is missing up to this stage: {TITLES[stage]}.")
        self.cancel_button.setToolTip("Stop; what was made stays.")
        self.form = ParametersForm(Parameters(), MAIN, steps=GROUPS[stage], without=_not_of(stage))
        self.more = QCheckBox("More")
        self.more.setToolTip("Show every parameter of this stage.")
        self.more.setVisible(self.form.has_more())
        self.column.addWidget(self.form)
        self.plot = TimePlot(run.session)
        self.expand(False)
        self._fill()
        self._connect()
        self._on_parameters(run.session.parameters)
        self._on_state()
        self._on_tables()

    def _fill(self) -> None:
        """What stands below the form."""
        self.column.addWidget(self.more)
        self.column.addWidget(self.plot)

    def _connect(self) -> None:
        self.run_button.clicked.connect(self.run_stage)
        self.cancel_button.clicked.connect(self.run.cancel)
        self.more.toggled.connect(self.form.show_all)
        self.form.changed.connect(self._on_form)
        self.plot.picked.connect(self.picked)
        self.run.session.parameters_changed.connect(self._on_parameters)
        self.run.source_changed.connect(self._on_state)
        self.run.state_changed.connect(self._on_state)
        self.run.running_changed.connect(self._on_running)
        self.run.progressed.connect(self._on_progress)
        self.run.tables_changed.connect(self._on_tables)

    # What the user does ------------------------------------------------------

    def run_stage(self) -> None:
        """Make what is missing up to this stage; what is wrong is shown as a notification."""
        run_or_tell(self.run, self.stage)

    def _on_form(self) -> None:
        for group, values in self.form.values().items():
            self.run.session.set_values(group, values)

    # What the run says -------------------------------------------------------

    def _on_parameters(self, parameters: Parameters) -> None:
        self.form.show_values(parameters)
        self.form.hide_entries(self._senseless(parameters))

    def _senseless(self, parameters: Parameters) -> set[str]:
        """What makes no sense for the timelapse, or with the other parameters."""
        source = self.run.chosen.source
        layer = None if source is None else source.layers[0]
        if self.stage == "segment":
            return senseless_parameters(layer) if layer is not None else set()
        if self.stage == "common" and parameters.movie.common != "timepoint":
            return {"movie.timepoint"}
        if self.stage == "frame":
            if layer is not None and not _has_intensities(layer):
                return set(OF_SIGNALS)
            if parameters.movie.statistic == "mean":
                return {"movie.percentile"}
        return set()

    def _on_state(self) -> None:
        self._on_parameters(self.run.session.parameters)
        state, reason = self._state()
        sign, meaning = MARKS[state]
        colour = COLOURS["green"] if state == DONE else COLOURS[state]
        self.show_mark(sign, colour, f"{meaning}\n{reason}".strip())
        self.seconds.setText(self._count())
        running = state == RUNNING
        if not running:
            self.status.setText(self._status(state))
        self.status.setVisible(bool(self.status.text()) or running)
        self.progress_bar.setVisible(running)
        self.cancel_button.setVisible(running)
        self.run_button.setVisible(not running)
        self.run_button.setEnabled(not self.run.running and not self.run.chosen.blocked())
        self.highlight(self._is_next() and not self.run.running)

    def _state(self) -> tuple[str, str]:
        if self.run.running and self._current == self.stage:
            return RUNNING, ""
        failed = [each for each in self.run.failures if each.stage == self.stage]
        if failed and not self.run.running:
            return FAILED, failed[0].reason
        if self.run.state is not None:
            state = STATES[self.run.state.of(self.stage)]
            if state != READY:
                return state, ""
        if self.run.chosen.source is None or self.run.chosen.blocked():
            return NOT_READY, self.run.chosen.blocked()
        return READY, ""

    def _is_next(self) -> bool:
        """Whether this is the first stage with something left to do."""
        if self.run.chosen.blocked():
            return False
        state = self.run.state
        left = (s for s in STAGES if state is None or state.of(s) != PIECE_DONE)
        return next(left, "") == self.stage

    def _count(self) -> str:
        state = self.run.state
        if state is None or self.stage == "common":
            return ""
        pieces = state.pieces.get(self.stage, [])
        return f"{state.count(self.stage)} of {len(pieces)}"

    def _status(self, state: str) -> str:
        """A line below the title."""
        if state == STALE and self.run.state is not None:
            stale = self.run.state.count(self.stage, PIECE_STALE)
            if self.stage == "common":
                return "What is shown belongs to other parameters."
            return f"{stale} belong to other parameters."
        failed = sum(each.stage == self.stage for each in self.run.failures)
        return f"{failed} failed, see below." if failed else ""

    def _on_running(self, _: bool) -> None:
        self._current = ""
        self.progress_bar.setValue(0)
        self._on_state()

    def _on_progress(self, stage: str, timepoint: int, fraction: float, message: str) -> None:
        if not stage:
            return
        another, self._current = stage != self._current, stage
        if another:
            self._on_state()
        if stage == self.stage:
            self.progress_bar.setValue(round(1000 * fraction))
            where = "" if stage == "common" else f"timepoint {timepoint}"
            self.status.setText(": ".join(part for part in (where, message) if part))

    # The plot ----------------------------------------------------------------

    def _on_tables(self) -> None:
        tables = self.run.tables
        if tables is None:
            self.plot.hide()
            return
        times = tables.check["time_s"].to_numpy(float)
        self.plot.show_rows(times, self._rows())

    def _rows(self) -> list[Row]:
        tables = self.run.tables
        if self.stage == "register" and tables is not None:
            return drift_rows(tables.registration)
        return []


class SpaceSection(StageSection):
    """The common space: which one, why, and what leaves it."""

    def __init__(self, run: MovieRun, parent: QWidget | None = None) -> None:
        super().__init__(run, "common", parent)

    def _fill(self) -> None:
        self.reason = QLabel()
        self.reason.setWordWrap(True)
        self.proposal = QLabel()
        self.proposal.setWordWrap(True)
        self.proposal.setStyleSheet(f"color: {COLOURS['amber']};")
        self.each_button = QPushButton("Use an atlas for each timepoint")
        self.each_button.setToolTip('Sets the common space to "each"; press Run afterwards.')
        self.each_button.clicked.connect(self.choose_each)
        super()._fill()
        for widget in (self.reason, self.proposal, self.each_button):
            self.column.addWidget(widget)

    def choose_each(self) -> None:
        """Every timepoint gets its own atlas at the next run."""
        self.run.session.set_values("movie", {"common": "each"})

    def _on_tables(self) -> None:
        super()._on_tables()
        tables = self.run.tables
        record: Any = {} if tables is None else tables.record
        advice = record.get("recommendation", {})
        method = str(record.get("method", ""))
        proposal = "" if tables is None else tables.proposal
        lines = []
        if method:
            which = METHODS.get(method, method)
            if method == "timepoint":
                which = f"timepoint {record.get('timepoint')}"
            lines.append(f"Shown: <b>{which}</b>.")
        if advice:
            recommended = METHODS.get(advice["method"], advice["method"])
            lines.append(f"Recommended: <b>{recommended}</b>. {advice['reason']}")
        self.reason.setText("<br>".join(lines))
        self.reason.setVisible(bool(lines))
        self.proposal.setText(proposal)
        self.proposal.setVisible(bool(proposal))
        self.each_button.setVisible(bool(proposal) and method != "each")
        self.status.setText(self._status(""))
        self.status.setVisible(bool(self.status.text()))

    def _status(self, state: str) -> str:
        said = super()._status(state)
        tables = self.run.tables
        if said or tables is None or not tables.record:
            return said
        method = str(tables.record["method"])
        return METHODS.get(method, method)

    def _rows(self) -> list[Row]:
        tables = self.run.tables
        if tables is None or not tables.record:
            return []
        return outside_rows(tables.record, tables.check, tables.limit)


class FramesSection(StageSection):
    """The frames: all, or the one that is looked at; volume and area over time."""

    def __init__(self, run: MovieRun, parent: QWidget | None = None) -> None:
        super().__init__(run, "frame", parent)

    def _fill(self) -> None:
        self.timepoint = QSpinBox()
        self.timepoint.setPrefix("timepoint ")
        self.one_button = QPushButton("Run this one")
        self.one_button.setToolTip("Make the frame of this timepoint only.")
        self.one_button.clicked.connect(self.run_one)
        row = QHBoxLayout()
        row.addWidget(self.timepoint, 1)
        row.addWidget(self.one_button)
        super()._fill()
        self.column.addLayout(row)

    def run_one(self) -> None:
        """Make the frame of the chosen timepoint; what is wrong is shown as a notification."""
        run_or_tell(self.run, "frame", [self.timepoint.value()])

    def show_timepoint(self, timepoint: int) -> None:
        """Choose the one that is looked at."""
        self.timepoint.setValue(timepoint)

    def _on_state(self) -> None:
        super()._on_state()
        source, state = self.run.chosen.source, self.run.state
        count = len(state.pieces["frame"]) if state is not None else 0
        count = source.timepoints if source is not None else count
        self.timepoint.setMaximum(max(count - 1, 0))
        self.one_button.setEnabled(self.run_button.isEnabled())

    def _rows(self) -> list[Row]:
        return [] if self.run.tables is None else size_rows(self.run.tables.check)


def make_section(run: MovieRun, stage: Stage) -> StageSection:
    """The section of a stage."""
    if stage == "common":
        return SpaceSection(run)
    return FramesSection(run) if stage == "frame" else StageSection(run, stage)


def run_or_tell(run: MovieRun, until: Stage, timepoints: list[int] | None = None) -> None:
    """Run; what is wrong is shown as a notification."""
    try:
        run.run(until, timepoints)
    except Unwrap3DError as error:
        run.told.emit(str(error))
        tell(error)


def go_to(run: MovieRun, timepoint: int) -> None:
    """Show a timepoint in the views."""
    if run.viewer is not None:
        movie_session_of(run.viewer).set_timepoint(timepoint)


def _not_of(stage: str) -> set[str]:
    """Parameters of the groups of a stage that are asked for elsewhere, or not at all."""
    movie = {f"movie.{name}" for name in MovieParameters.model_fields}
    uv = {f"uv.{name}" for name in UVParameters.model_fields}
    if stage == "common":
        return (movie - set(OF_SPACE)) | (uv - {"uv.rows"})
    return set(OF_SPACE) if stage == "frame" else {"stack.timepoint"}


def _has_intensities(layer: Any) -> bool:
    return type(layer).__name__ == "Image" and layer.dtype.kind != "b"
