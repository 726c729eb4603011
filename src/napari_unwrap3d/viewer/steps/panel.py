"""The panel of one step: its state, its parameters, Run, Reset and Cancel.

The wizard stacks these panels; each is also a dock widget of its own. All of them show
the one session of their viewer.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QCheckBox,
    QFrame,
    QHBoxLayout,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from ...errors import Unwrap3DError
from ...parameters import Parameters
from ...unwrapping.histograms import sphere_histograms, uv_histograms
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.forms import ParametersForm
from ..common.section import Section
from ..common.threads import tell
from ..session import Session, session_of
from ..views.sources import senseless_parameters
from .plots import DistortionPlot, FlowPlot, HeightPlot, Plot
from .source_chooser import SourceChooser
from .states import DONE, RUNNING, STEPS, TITLES, StepState, groups_of
from .texts import DESCRIPTIONS, IMPLIED, MAIN, all_numbers, mark_of, senseless, status_of

if TYPE_CHECKING:
    import napari

WIDTH = 360


class StepPanel(Section):
    """One step of the pipeline.

    Parameters
    ----------
    session : Session
    step : str
        One of :data:`napari_unwrap3d.viewer.steps.states.STEPS`.
    expanded : bool
        Whether its parameters are shown at first.
    """

    def __init__(
        self, session: Session, step: str, *, expanded: bool = False, parent: QWidget | None = None
    ) -> None:
        name = f"{STEPS.index(step) + 1}  {TITLES[step]}"
        super().__init__(name, DESCRIPTIONS[step], parent)
        self.session, self.step = session, step
        self.initial = Parameters()
        self._plotted: Any = None
        self._shown: StepState | None = None
        self._build()
        self._arrange()
        self._connect()
        self.expand(expanded)
        self._on_parameters(session.parameters)
        self._on_source()
        self._on_steps()
        self._on_charts(session.charts)

    # Building ----------------------------------------------------------------

    def _build(self) -> None:
        self.run_button.setToolTip(f"Compute everything up to this step: {TITLES[self.step]}.")
        self.cancel_button.setToolTip("Stop; finished steps are kept.")
        self.groups = groups_of(self.step)
        self.form = ParametersForm(Parameters(), MAIN, steps=self.groups, without=IMPLIED)
        self.more = QCheckBox("More")
        self.more.setToolTip("Show every parameter of this step.")
        self.reset_button = QPushButton("Reset")
        self.reset_button.setToolTip("Back to the values of the preset.")
        self.plot = self._make_plot()

    def _make_plot(self) -> Plot | None:
        if self.step == "reference":
            plot = FlowPlot(self.session)
            plot.stop_moved.connect(self._on_stop_moved)
            return plot
        if self.step == "protrusions":
            heights = HeightPlot(self.session)
            heights.threshold_moved.connect(self._on_threshold_moved)
            return heights
        return DistortionPlot(self.session) if self.step in ("sphere", "uv") else None

    def _arrange(self) -> None:
        self.column.addWidget(self.form)
        if self.plot is not None:
            self.column.addWidget(self.plot)
        row = QHBoxLayout()
        row.addWidget(self.more)
        row.addStretch(1)
        row.addWidget(self.reset_button)
        self.column.addLayout(row)

    def _connect(self) -> None:
        self.run_button.clicked.connect(self.run)
        self.cancel_button.clicked.connect(self.session.cancel_by_user)
        self.reset_button.clicked.connect(self.reset)
        self.more.toggled.connect(self._on_more)
        self.form.changed.connect(self._on_form)
        self.session.parameters_changed.connect(self._on_parameters)
        self.session.source_changed.connect(self._on_source)
        self.session.steps_changed.connect(self._on_steps)
        self.session.running_changed.connect(self._on_running)
        self.session.progressed.connect(self._on_progress)
        self.session.charts_changed.connect(self._on_charts)
        self.session.finished.connect(self._on_charts)

    # What the user does ------------------------------------------------------

    def expand(self, expanded: bool) -> None:
        """Show or hide the parameters."""
        super().expand(expanded)
        self._plot_charts()

    def run(self) -> None:
        """Compute up to this step; what is wrong is shown as a notification."""
        try:
            self.session.run(until=self.step)
        except Unwrap3DError as error:
            self.status.setText(str(error))
            self.status.show()
            tell(error)

    def reset(self) -> None:
        """Back to the values of the preset."""
        for group in self.groups:
            self._reset(group)

    def _reset(self, group: str) -> None:
        values = getattr(self.initial, group).model_dump()
        now = getattr(self.session.parameters, group).model_dump()
        kept = {path.removeprefix(f"{group}.") for path in (*IMPLIED, "stack.label")}
        values |= {name: now[name] for name in kept if name in values}
        self.form.show_values(
            self.session.parameters.model_copy(
                update={group: type(getattr(self.initial, group))(**values)}
            )
        )
        self.session.set_values(group, values)

    def _on_more(self, more: bool) -> None:
        self.form.show_all(more)

    def _on_form(self) -> None:
        for group, values in self.form.values().items():
            if group == "reference":
                self._imply_fixed(values)
            self.session.set_values(group, values)

    def _imply_fixed(self, values: dict[str, Any]) -> None:
        """Who moves the iteration wants to stop there."""
        before = self.session.parameters.reference
        if values["fixed_iteration"] != before.fixed_iteration and values["stop"] == before.stop:
            values["stop"] = "fixed"

    def _on_stop_moved(self, iteration: int) -> None:
        chosen = {"stop": "fixed", "fixed_iteration": iteration, "extra_iterations": 0}
        self.session.set_values("reference", chosen)

    def _on_threshold_moved(self, threshold_um: float) -> None:
        if self.session.parameters.protrusions.method == "cortex":
            self.session.set_values("protrusions", {"threshold_um": threshold_um})
        else:
            chosen = {"threshold": "value", "threshold_um": threshold_um}
            self.session.set_values("topographic", chosen)

    # What the session says ---------------------------------------------------

    def _on_parameters(self, parameters: Parameters) -> None:
        self.form.show_values(parameters)
        if len(self.groups) > 1:
            self.form.hide_entries(senseless(self.step, parameters))
            self.more.setVisible(self.form.has_more())
        if isinstance(self.plot, FlowPlot) and parameters.reference.stop == "fixed":
            self.plot.show_stop(parameters.reference.fixed_iteration)

    def _on_source(self) -> None:
        if self.step == "stack":
            self.form.hide_entries(senseless_parameters(self.session.source))
        self.more.setVisible(self.form.has_more())

    def _on_steps(self) -> None:
        step = self.session.steps[self.step]
        if step != self._shown:
            self._shown = replace(step)
            self._show(step)
        self._on_running(self.session.running)

    def _show(self, step: StepState) -> None:
        self.show_mark(*mark_of(self.step, step))
        done = step.state == DONE and step.seconds is not None
        self.seconds.setText(f"{step.seconds:.1f} s" if done else step.brief)
        self.seconds.setToolTip("" if done else step.reason)
        running = step.state == RUNNING
        if not running:
            self.progress_bar.setValue(0)
        self.status.setText("starting" if running else status_of(self.step, step))
        self.status.setVisible(bool(self.status.text()))
        self.status.setToolTip(all_numbers(self.step, step) if done else "")
        self.progress_bar.setVisible(running)

    def _on_running(self, running: bool) -> None:
        here = running and self.session.steps[self.step].state == RUNNING
        self.run_button.setVisible(not here)
        self.seconds.setVisible(not here)
        self.cancel_button.setVisible(here)
        self.run_button.setEnabled(not running and not self.session.blocked())
        self.highlight(self.session.next_step() == self.step and not running)

    def _on_progress(self, step: str, fraction: float, message: str) -> None:
        if step == self.step:
            self.progress_bar.setValue(round(1000 * fraction))
            if message:
                self.status.setText(message)

    # The plot ----------------------------------------------------------------

    def _on_charts(self, _: Any) -> None:
        self._plot_charts()

    def _chart(self) -> Any:
        """What the plot is of; protrusions are no chart that has layers of its own."""
        atlas = self.session.atlas
        if self.step == "protrusions" and atlas is not None:
            return atlas.on_request.get(self.step)
        return self.session.charts.get(self.step)

    def _plot_charts(self) -> None:
        """Draw what is new, once it can be seen."""
        chart = self._chart()
        if self.plot is None or not self.title.isChecked() or chart is self._plotted:
            return
        if chart is None:
            # While a run is on its way here, the last result stays in sight.
            self.plot.setVisible(bool(self.session.charts) and self._plotted is not None)
            return
        self._plotted = chart
        if isinstance(self.plot, FlowPlot):
            self.plot.show_flow(chart.total_curvature, chart.iteration)
        elif isinstance(self.plot, HeightPlot):
            self.plot.show_heights(chart, self.session.charts["surface"])
        elif isinstance(self.plot, DistortionPlot):
            if self.step == "sphere":
                self.plot.compute(sphere_histograms, self.session.charts["reference"], chart)
            else:
                self.plot.compute(uv_histograms, chart)


class StepDock(Docked):
    """A dock widget with the panel of one step, for those who want that step only."""

    step = "stack"

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.session = session_of(napari_viewer)
        self.chooser = SourceChooser(self.session)
        self.panel = StepPanel(self.session, self.step, expanded=True)
        content = QWidget()
        column = QVBoxLayout(content)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.panel)
        column.addStretch(1)
        layout = QVBoxLayout(self)
        layout.addWidget(self.chooser)
        layout.addWidget(scrolling(content), 1)
        self.setMinimumWidth(WIDTH)
        end_with_dock(self)


def scrolling(content: QWidget) -> QScrollArea:
    """Up and down only: a panel is never wider than the dock."""
    scroll = QScrollArea()
    scroll.setWidgetResizable(True)
    scroll.setFrameShape(QFrame.Shape.NoFrame)
    scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    scroll.setWidget(content)
    return scroll


class StackDock(StepDock):
    """Segment the cell."""


class SurfaceDock(StepDock):
    """Mesh the cell."""

    step = "surface"


class SealedDock(StepDock):
    """Close handles and holes."""

    step = "sealed"


class ReferenceDock(StepDock):
    """Smooth protrusions away."""

    step = "reference"


class SphereDock(StepDock):
    """Lay the reference on the sphere."""

    step = "sphere"


class UVDock(StepDock):
    """Unwrap the sphere."""

    step = "uv"


class TopographyDock(StepDock):
    """Measure from the reference."""

    step = "topography"


class DirectDock(StepDock):
    """The direct chart."""

    step = "direct"


class PlaneDock(StepDock):
    """The plane."""

    step = "plane"


class ProtrusionsDock(StepDock):
    """Find protrusions."""

    step = "protrusions"
