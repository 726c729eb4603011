"""The parts of the dock "Tracks": what is run with its parameters, the gate, and the numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from ...charts import Frame, Tracks
from ...errors import Unwrap3DError
from ...parameters import Parameters
from ...tracking.summary import summary
from ..common.forms import ParametersForm
from ..common.section import Section
from ..common.threads import tell
from ..common.turns import soon
from ..steps.states import DONE, FAILED, NOT_READY, READY, RUNNING, STALE
from ..steps.texts import COLOURS, MARKS
from .gate import TrackGate, track_gate_of
from .run import TrackRun, Work, counted, run_or_tell

TITLES: dict[str, str] = {
    "protrusions": "Protrusions over time",
    "flow": "Regions carried by flow",
    "measure": "Measurements",
}
DESCRIPTIONS: dict[Work, str] = {
    "protrusions": "Finds the protrusions of every timepoint, as step 10 of Cell does, and joins "
    "those that are one.",
    "flow": "Covers the surface with small regions, and carries them with the motion of a field.",
    "measure": "Series along the tracks that are shown, events, lifetimes, correlations and "
    "speeds.",
}
# Groups of parameters that a section asks for.
ASKED: dict[Work, tuple[str, ...]] = {
    "protrusions": ("tracking", "boxes"),
    "flow": ("flow",),
    "measure": ("measurement",),
}
# What is shown first; "More" shows all.
MAIN = (
    "tracking.method",
    "tracking.longest_step_um",
    "tracking.gap_s",
    "tracking.least_lifetime_s",
    "boxes.flow",
    "boxes.least_iou",
    "flow.field",
    "flow.method",
    "flow.regions",
    "flow.least_lifetime_s",
    "measurement.fields",
    "measurement.event_series",
    "measurement.prominence",
    "measurement.distance_s",
    "measurement.window_s",
    "measurement.correlate",
    "measurement.plane",
)
# Asked for elsewhere: which tracks are shown, and the gate.
ELSEWHERE = tuple(f"measurement.{name}" for name in ("tracks", "inside", "outside", "share"))
OF_FIELDS = ("boxes.field", "flow.field", "measurement.fields", "measurement.correlate")
OF_ANNOTATIONS = ("measurement.plane",)
# What the description of a parameter says if only one method has it.
_METHOD = re.compile(r"\(method = (\w+)\)")
EVERYWHERE, NOWHERE = "everywhere", "nothing"
NUMBERS_MS = 100


class WorkSection(Section):
    """One piece of work: its parameters, Run, and what came of it.

    Parameters
    ----------
    run : TrackRun
    work : str
        "protrusions", "flow" or "measure".
    """

    def __init__(self, run: TrackRun, work: Work, parent: QWidget | None = None) -> None:
        super().__init__(TITLES[work], DESCRIPTIONS[work], parent)
        self.run, self.work = run, work
        self.form = ParametersForm(Parameters(), MAIN, steps=ASKED[work], without=ELSEWHERE)
        self.more = QCheckBox("More")
        self.more.setToolTip("Show every parameter of this part.")
        self.more.setVisible(self.form.has_more())
        self.reset_button = QPushButton("Reset")
        self.reset_button.setToolTip("Back to the values that the plugin proposes.")
        self.run_button.setToolTip(f"{TITLES[work]}: run with these parameters.")
        self.cancel_button.setToolTip("Stop; the tracks stay as they were.")
        self.fields_button = QPushButton("Fields on the surface")
        self.fields_button.setToolTip(
            "Show the mean flow over the movie as layers: speed, direction, divergence."
        )
        self.fields_button.setVisible(work == "flow")
        row = QHBoxLayout()
        row.addWidget(self.more)
        row.addWidget(self.fields_button)
        row.addStretch(1)
        row.addWidget(self.reset_button)
        self.column.addWidget(self.form)
        self.column.addLayout(row)
        self.expand(False)
        self._connect()
        self._on_parameters(run.session.parameters)
        self._on_state()

    def _connect(self) -> None:
        self.run_button.clicked.connect(self.start)
        self.cancel_button.clicked.connect(self.run.cancel)
        self.reset_button.clicked.connect(self.reset)
        self.fields_button.clicked.connect(self.show_fields)
        self.more.toggled.connect(self.form.show_all)
        self.form.changed.connect(self._on_form)
        self.run.session.parameters_changed.connect(self._on_parameters)
        self.run.state_changed.connect(self._on_state)
        self.run.progressed.connect(self._on_progress)
        self.run.tracks.measured.connect(self._on_state)

    def offer(self, fields: Iterable[str], annotations: Iterable[str]) -> None:
        """Offer the names of the movie's fields and annotations where one is typed."""
        for paths, names in ((OF_FIELDS, fields), (OF_ANNOTATIONS, annotations)):
            for path in paths:
                if path in self.form.entries:
                    self.form.offer(path, list(names))

    # What the user does -----------------------------------------------------------------

    def start(self) -> None:
        """Run; what is wrong is shown as a notification."""
        run_or_tell(self.run, self.work)

    def show_fields(self) -> None:
        """Show the flow of these parameters as fields of the surface."""
        try:
            self.run.show_fields()
        except Unwrap3DError as error:
            tell(error)

    def reset(self) -> None:
        """Take the defaults again."""
        defaults = Parameters()
        for group in ASKED[self.work]:
            values = getattr(defaults, group).model_dump()
            kept = {name: values[name] for name in values if f"{group}.{name}" not in ELSEWHERE}
            self.run.session.set_values(group, kept)

    def _on_form(self) -> None:
        for group, values in self.form.values().items():
            self.run.session.set_values(group, values)

    # What the run says ------------------------------------------------------------------

    def _on_parameters(self, parameters: Parameters) -> None:
        self.form.show_values(parameters)
        if self.work == "protrusions":
            self.form.hide_entries(_of_other_methods(parameters))

    def _on_state(self) -> None:
        state, reason = self._state()
        sign, meaning = MARKS[state]
        colour = COLOURS["green"] if state == DONE else COLOURS[state]
        self.show_mark(sign, colour, f"{meaning}\n{reason}".strip())
        running = state == RUNNING
        if not running:
            self.status.setText("Belongs to other parameters or tracks." if state == STALE else "")
            self.progress_bar.setValue(0)
        self.status.setVisible(bool(self.status.text()) or running)
        self.progress_bar.setVisible(running)
        self.cancel_button.setVisible(running)
        self.run_button.setVisible(not running)
        can_begin = not self.run.busy_with and not self.run.blocked(self.work)
        self.run_button.setEnabled(can_begin)
        self.fields_button.setEnabled(can_begin)
        self.highlight(self._is_next())

    def _state(self) -> tuple[str, str]:
        run = self.run
        if run.busy_with == self.work:
            return RUNNING, ""
        if run.failure is not None and run.failure[0] == self.work:
            return FAILED, run.failure[1]
        if reason := run.blocked(self.work):
            return NOT_READY, reason
        if run.is_done(self.work):
            return (STALE if run.is_stale(self.work) else DONE), ""
        return READY, ""

    def _is_next(self) -> bool:
        """What is sensible to run now: track, and then measure."""
        run = self.run
        if run.busy_with or run.blocked(self.work):
            return False
        if self.work == "measure":
            return not run.is_done("measure")
        return self.work == "protrusions" and run.tracks.tracks is None

    def _on_progress(self, what: str, fraction: float, message: str) -> None:
        if what == self.work == self.run.busy_with:
            self.progress_bar.setValue(round(1000 * fraction))
            self.status.setText(message)
            self.status.setVisible(True)


class GateSection(QWidget):
    """Which tracks are kept by where they are; both choices hold."""

    def __init__(self, viewer: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.gate: TrackGate = track_gate_of(viewer)
        self.inside_box, self.outside_box = QComboBox(), QComboBox()
        self.inside_box.setToolTip(
            "Keep only tracks that stay inside this annotation. Draw one in any view "
            "(dock Annotations): the tracks follow as you draw."
        )
        self.outside_box.setToolTip("Keep only tracks that stay outside this annotation.")
        self.share_box = QSpinBox()
        self.share_box.setRange(1, 100)
        self.share_box.setSuffix(" % of the life")
        self.share_box.setToolTip("For which part of its life a track has to be there.")
        self.status = QLabel()
        self.status.setWordWrap(True)
        self._arrange()
        self.inside_box.activated.connect(self._on_inside)
        self.outside_box.activated.connect(self._on_outside)
        self.share_box.valueChanged.connect(self._on_share)
        self.gate.listed.connect(self.fill)
        self.gate.changed.connect(self._on_gate)
        self.gate.session.parameters_changed.connect(self.fill)
        self.gate.tracks.shown_changed.connect(self._on_gate)
        self.fill()
        self._on_gate()

    def _arrange(self) -> None:
        form = QFormLayout(self)
        form.setContentsMargins(24, 0, 4, 4)
        form.setVerticalSpacing(3)
        for box in (self.inside_box, self.outside_box):
            box.setSizeAdjustPolicy(
                QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
            )
            box.setMinimumContentsLength(8)
        form.addRow("Keep those inside", self.inside_box)
        form.addRow("Keep those outside", self.outside_box)
        form.addRow("For at least", self.share_box)
        form.addRow(self.status)

    def fill(self, _: Any = None) -> None:
        """List the annotations; a name that nothing is drawn for yet stays chosen."""
        inside, outside, share = self.gate.chosen
        for box, first, chosen in (
            (self.inside_box, EVERYWHERE, inside),
            (self.outside_box, NOWHERE, outside),
        ):
            names = list(self.gate.names)
            if chosen and chosen not in names:
                names.append(chosen)
            wanted = [(first, ""), *((name, name) for name in names)]
            if [(box.itemText(i), box.itemData(i)) for i in range(box.count())] != wanted:
                box.clear()
                for text, data in wanted:
                    box.addItem(text, data)
            box.setCurrentIndex(box.findData(chosen))
        self.share_box.blockSignals(True)
        self.share_box.setValue(max(round(100 * share), 1))
        self.share_box.blockSignals(False)
        self.share_box.setEnabled(bool(inside or outside))

    def _on_inside(self, _: int) -> None:
        self.gate.choose(inside=self.inside_box.currentData())

    def _on_outside(self, _: int) -> None:
        self.gate.choose(outside=self.outside_box.currentData())

    def _on_share(self, percent: int) -> None:
        self.gate.choose(share=percent / 100)

    def _on_gate(self) -> None:
        tracks, shown = self.gate.tracks.tracks, self.gate.tracks.shown
        self.status.setStyleSheet(f"color: {COLOURS['amber']};" if self.gate.reason else "")
        if self.gate.reason:
            self.status.setText(self.gate.reason)
        elif tracks is None or shown is None:
            self.status.setText("")
        else:
            self.status.setText(f"{len(shown.ids)} of {counted(len(tracks.ids), 'track')} shown.")


class Numbers(QLabel):
    """Key numbers of the tracks that are shown, and of what was measured along them."""

    def __init__(self, run: TrackRun, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.run = run
        self.setTextFormat(Qt.TextFormat.RichText)
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.setWordWrap(True)
        self.setContentsMargins(24, 0, 4, 4)
        self._rest = soon(self, self.fill, NUMBERS_MS)
        for signal in (run.tracks.tracks_changed, run.tracks.shown_changed, run.tracks.measured):
            signal.connect(self._later)
        self.fill()

    def _later(self, *_: Any) -> None:
        self._rest.start()

    def fill(self) -> None:
        """Say them."""
        shown, measurements = self.run.tracks.shown, self.run.tracks.measurements
        rows = [] if shown is None else _rows_of_tracks(shown)
        if measurements is not None:
            rows += _rows_of_numbers(measurements.numbers)
        self.setText("<table>" + "".join(_table_row(*row) for row in rows) + "</table>")
        self.setVisible(bool(rows))


def headed(title: str, widget: QWidget) -> QWidget:
    """A widget under a heading, as wide as what the sections hold."""
    part = QWidget()
    column = QVBoxLayout(part)
    column.setContentsMargins(0, 3, 0, 0)
    column.setSpacing(3)
    heading = QLabel(f"<b>{title}</b>")
    heading.setContentsMargins(24, 0, 0, 0)
    column.addWidget(heading)
    column.addWidget(widget)
    return part


def _of_other_methods(parameters: Parameters) -> set[str]:
    """Paths of what the chosen method of tracking does not use."""
    method = parameters.tracking.method
    hidden = set()
    for name, info in type(parameters.tracking).model_fields.items():
        only = _METHOD.search(info.description or "")
        if only is not None and only.group(1) != method:
            hidden.add(f"tracking.{name}")
    if method != "boxes":
        hidden |= {f"boxes.{name}" for name in type(parameters.boxes).model_fields}
    return hidden


def _rows_of_tracks(tracks: Tracks) -> list[tuple[str, str]]:
    found = summary(tracks)
    lifetime = f"{number(found['lifetime_mean_s'])} ± {number(found['lifetime_sd_s'])} s"
    rows = [
        ("tracks", f"{found['tracks']:.0f}, {number(found['at_a_time'])} at a time"),
        ("lifetime", f"{lifetime}, median {number(found['lifetime_median_s'])} s"),
    ]
    if found["splits"] or found["merges"]:
        rows.append(("splits, merges", f"{found['splits']:.0f}, {found['merges']:.0f}"))
    for name, title, unit in (
        ("area_mean_um2", "mean area", "µm²"),
        ("height_mean_um", "mean height", "µm"),
        ("speed_mean_um_per_min", "mean speed", "µm/min"),
    ):
        if not math.isnan(found.get(name, math.nan)):
            rows.append((title, f"{number(found[name])} {unit}"))
    return rows


def _rows_of_numbers(numbers: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Single numbers that were measured; their names carry the units."""
    return [
        spoken(name, float(value))
        for name, value in numbers.items()
        if name not in SAID and isinstance(value, int | float) and not isinstance(value, bool)
    ]


# Of the tracks themselves, which are said before.
SAID = ("tracks", "mean_lifetime_s", "median_lifetime_s")
UNITS = {
    "_um_per_min": "µm/min",
    "_per_um": "1/µm",
    "_um2": "µm²",
    "_um": "µm",
    "_per_min": "1/min",
    "_s": "s",
    "_px": "pixels",
    "_percent": "%",
}


def spoken(name: str, value: float) -> tuple[str, str]:
    """A name with a unit at its end, and its value, as people read them."""
    unit = next((end for end in UNITS if name.endswith(end)), "")
    title = name.removesuffix(unit).replace("_", " ")
    return title, f"{number(value)} {UNITS.get(unit, '')}".strip()


def number(value: float) -> str:
    """Three digits; a dash for what cannot be said."""
    if math.isnan(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _table_row(title: str, text: str) -> str:
    return f"<tr><td>{title}&nbsp;&nbsp;</td><td>{text}</td></tr>"


def offered_fields(frame: Frame | None) -> tuple[str, ...]:
    """Names of the fields of a movie, from the frame that is shown."""
    return () if frame is None else tuple(frame.uv)
