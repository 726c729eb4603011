"""The hub of one viewer: the source, the parameters, the pipeline, the run in progress.

Widgets read everything here and listen to the signals; they hold no state of their own,
so several of them show the same, and closing and opening a dock loses nothing.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject, Signal

from ..atlas import Atlas
from ..errors import Cancelled, ParameterError, Unwrap3DError
from ..parameters import Parameters
from ..pipeline import ON_REQUEST, STEP_NAMES, Pipeline, Source
from .annotations.keeping import keeping
from .common.binding import warn_of_binding
from .common.per_viewer import OfViewer, PerViewer
from .common.threads import Task, quiet_collector, tell
from .common.turns import Turns, soon
from .steps.computing import Computation, Known, Outcome
from .steps.previews import Previews
from .steps.states import (
    DONE,
    RUNNING,
    STALE,
    STEPS,
    StepState,
    first_open_step,
    pipeline_states,
    states_now,
)
from .views.layers import LayerData, atlas_charts
from .views.picture import Picture
from .views.sources import is_source, layer_box, layer_source, layer_voxel_size, set_voxel_size

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer

    from ..charts import Size3

CLOSE_SECONDS = 5.0
# A slider that rests this long has been moved where it should be.
DEBOUNCE_MS = 300
# Between two layers the window draws the first one, and takes what the user does.
TURN_MS = 10
REQUESTED = tuple(step.name for step in ON_REQUEST)

NO_LAYER = "Open a stack, a label image or a mesh (File > Open, or File > Open Sample)."
ASK_VOXEL_SIZE = "The layer is in pixels. Fill in its voxel size (z, y, x) in µm."


class Session(OfViewer):
    """What one viewer knows about its cell. Get it with :func:`session_of`.

    Attributes
    ----------
    atlas : Atlas or None
        The charts of the last run that ended well.
    charts : dict
        Every chart that is known, by name; during a run, those that are done.
    steps : dict
        Step → :class:`StepState`, in the order of the pipeline, Direct and Plane included.

    Signals
    -------
    source_changed()
        Another layer, or another voxel size of it.
    parameters_changed(object)
        The new :class:`Parameters`.
    steps_changed()
        The state of one or more steps changed.
    charts_changed(object)
        `charts` changed: comes during a run, as soon as a chart is done.
    progressed(str, float, str)
        Step, fraction 0..1 and message of the run in progress.
    running_changed(bool)
        A run started or ended.
    finished(object)
        A run ended well, with its :class:`Atlas`.
    stopped(str)
        A run ended otherwise; says why.
    settled()
        Parameters came to rest where everything is known: nothing runs.
    told(str)
        What goes on beside the pipeline; empty when it is over.
    closing()
        The window closes.
    """

    source_changed = Signal()
    parameters_changed = Signal(object)
    steps_changed = Signal()
    charts_changed = Signal(object)
    progressed = Signal(str, float, str)
    running_changed = Signal(bool)
    finished = Signal(object)
    stopped = Signal(str)
    settled = Signal()
    told = Signal(str)
    closing = Signal()

    def __init__(self, viewer: ViewerModel, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.atlas: Atlas | None = None
        self.charts: dict[str, Any] = {}
        self.steps = {name: StepState() for name in STEPS}
        self.update_automatically = True
        self.opening: Task | None = None  # of a project, in a thread
        self.saving: Task | None = None  # of the cell, in a thread
        self.project_path: Path | None = None  # where the cell was saved, or opened from
        self._source: weakref.ref[Layer] | None = None
        self._voxel_size: Size3 | None = None
        self._known: Known | None = None
        self._parameters = Parameters()
        self._problems: dict[str, str] = {}
        self._failed: tuple[str, str] | None = None
        self._computation: Computation | None = None
        # Its thread may be about to end: the last reference must not be dropped there.
        self._ended: Computation | None = None
        self._until = ""  # of the last run: what a changed parameter computes anew
        self._again = False  # the run in progress is cancelled to start anew
        self.turns = Turns(self, TURN_MS, quiet_collector.renew)
        self._rest = soon(self, self._update, DEBOUNCE_MS)
        self._closed = False
        self._picture = Picture(viewer)
        self.previews: Previews | None = None
        self._update_states()

    # The source --------------------------------------------------------------

    @property
    def source(self) -> Layer | None:
        """The layer of the cell."""
        return None if self._source is None else self._source()

    @property
    def voxel_size(self) -> Size3 | None:
        """(z, y, x) in µm: the layer's own, or what was filled in for a layer in pixels."""
        layer = self.source
        known = None if layer is None else layer_voxel_size(layer)
        return known if known is not None else self._voxel_size

    def set_source(self, layer: Layer | None, voxel_size: Size3 | None = None) -> None:
        """Choose the layer of the cell; `voxel_size` (z, y, x) in µm is for one in pixels."""
        another = layer is not self.source
        if not another and voxel_size == self._voxel_size:
            return
        self._source = None if layer is None else weakref.ref(layer)
        self._voxel_size = voxel_size
        if another:
            self._until, self._failed = "", None
            self._choose_label(layer)
        self._update_states()
        self.source_changed.emit()

    def sources(self) -> list[Layer]:
        """The layers that can be unwrapped."""
        viewer = self._viewer()
        return [] if viewer is None else [layer for layer in viewer.layers if is_source(layer)]

    def blocked(self) -> str:
        """Why nothing can run, in words for the user; empty if it can."""
        if self.source is None:
            return NO_LAYER
        return "" if self.voxel_size is not None else ASK_VOXEL_SIZE

    def source_was_edited(self) -> None:
        """The layer's scale or units changed."""
        self._update_states()
        self.source_changed.emit()

    def _choose_label(self, layer: Layer | None) -> None:
        """A label image starts with the label that is selected in it; others have none."""
        labels = type(layer).__name__ == "Labels"
        chosen = max(int(layer.selected_label), 1) if labels else None  # type: ignore[union-attr]
        if chosen != self._parameters.stack.label:
            self.set_parameters(self._parameters.changed("stack", {"label": chosen}))

    # The parameters ----------------------------------------------------------

    @property
    def parameters(self) -> Parameters:
        """What the next run uses; set them with :meth:`set_parameters`."""
        return self._parameters

    def set_parameters(self, parameters: Parameters) -> None:
        """Use other parameters; after a first run what they change is computed anew."""
        if parameters == self._parameters:
            return
        self._parameters = parameters
        self._failed = None
        if self.update_automatically and self._until:
            self._rest.start()
        self._update_states()
        self.parameters_changed.emit(parameters)

    def set_values(self, step: str, values: dict[str, Any]) -> None:
        """Set some parameters of one step, as a form gives them.

        What is out of range is kept as this step's problem, and said when it should run.
        """
        try:
            parameters = self._parameters.changed(step, values)
        except ParameterError as error:
            self._problems[step] = str(error)
            self._update_states()
            return
        solved = self._problems.pop(step, None)
        self.set_parameters(parameters)
        if solved is not None:
            self._update_states()

    def _update(self) -> None:
        """The parameters have come to rest: compute what they changed."""
        if self._closed or not self.update_automatically or self._problems or self.blocked():
            return
        if self.running:
            self._again = True
            self.cancel()
        elif any(self.steps[name].state != DONE for name in self._reached()):
            self._start_or_tell(self._until)
        else:
            self.settled.emit()

    def _reached(self) -> list[str]:
        """The steps of the last run."""
        if self._until in STEP_NAMES[:-1]:
            return list(STEPS[: STEPS.index(self._until) + 1])
        asked = [name for name in REQUESTED if getattr(self._parameters, name).compute]
        return [*STEP_NAMES, *asked]

    # Running -----------------------------------------------------------------

    @property
    def run_origin(self) -> Size3:
        """Where the source of the last run lies in the viewer, (z, y, x) in µm."""
        return (0.0, 0.0, 0.0) if self._known is None else self._known.origin

    @property
    def source_data(self) -> Source | None:
        """The stack, mask or mesh of the last run."""
        return None if self._known is None else self._known.pipeline.source

    @property
    def pipeline(self) -> Pipeline | None:
        """What computed the charts, and keeps them."""
        return None if self._known is None else self._known.pipeline

    def edited(self) -> None:
        """A person changed what a step found, and its numbers with it."""
        self._update_states()

    @property
    def running(self) -> bool:
        return self._computation is not None

    def run(self, until: str = "") -> None:
        """Compute what is missing or stale, up to a step.

        Parameters
        ----------
        until : str
            A step of :data:`STEPS`; by default all of them, and of those on request
            (Direct, Plane) the ones that the parameters ask for.

        Raises
        ------
        Unwrap3DError
            There is no source, or the layer cannot be one; a parameter is out of range;
            or a run is in progress.
        """
        if self.running:
            raise Unwrap3DError("A run is in progress.", hint="Cancel it first.")
        if reason := self.blocked():
            raise Unwrap3DError("There is nothing to run on.", hint=reason)
        if self._problems:
            raise ParameterError(next(iter(self._problems.values())))
        if until in REQUESTED:
            # From now on it is one of the steps that a changed parameter computes anew.
            self.set_parameters(self._parameters.changed(until, {"compute": True}))
            until = STEP_NAMES[-1]
        self._start(until or STEP_NAMES[-1])

    def _start(self, until: str) -> None:
        layer = self.source
        assert layer is not None
        voxel_size = self.voxel_size
        source = layer_source(layer, voxel_size)
        if layer_voxel_size(layer) is None and voxel_size is not None:
            set_voxel_size(layer, voxel_size)
        self._rest.stop()
        self._until, self._again, self._failed = until, False, None
        self._update_states()
        self._forget_removed()
        computation = Computation(source, self._parameters, layer_box(layer), self._known, until)
        computation.source_changed.connect(self._on_source)
        computation.progressed.connect(self._on_progress)
        computation.charts_ready.connect(self._on_charts)
        computation.ended.connect(self._on_ended)
        self._computation = computation
        self._closed = False
        self._picture.begin()
        quiet_collector.hold(self)
        computation.start()
        self.running_changed.emit(True)

    def _start_or_tell(self, until: str) -> None:
        try:
            self._start(until)
        except Unwrap3DError as error:
            self.stopped.emit(str(error))
            tell(error)

    def cancel(self) -> None:
        """Stop the run in progress; returns at once, `stopped` follows."""
        if self._computation is not None:
            self._computation.cancel()

    def cancel_by_user(self) -> None:
        """Stop the run in progress, and what a moved slider would start after it."""
        self._again = False
        self._rest.stop()
        self.cancel()

    def close(self) -> None:
        """Cancel and wait for the computing thread, which ends within half a second."""
        self._closed = True
        self._rest.stop()
        self.turns.clear()
        self.closing.emit()
        if self._computation is not None:
            self._computation.cancel()
            self._computation.wait(CLOSE_SECONDS)
        quiet_collector.release(self)

    def _forget_removed(self) -> None:
        """Charts whose layers the user removed are shown again by the next run."""
        if self._known is not None:
            present = self._picture.charts
            self._known.shown = {
                name: chart for name, chart in self._known.shown.items() if name in present
            }

    # What the computing thread sends -----------------------------------------

    def _on_source(self, known: Known) -> None:
        """The run is about another cell: nothing of the last one stays."""
        self._picture.clear()
        self._known = known
        self.atlas = None
        self._update_states()
        self.charts = {}
        self.charts_changed.emit(self.charts)

    def _on_progress(self, step: str, fraction: float, message: str) -> None:
        if step in self.steps and self.steps[step].state != RUNNING:
            self._update_states(running=step)
        self.progressed.emit(step, fraction, message)

    def _on_charts(self, layers: list[LayerData], charts: dict[str, Any]) -> None:
        self.turns.add(self._place(layers, charts))

    def _place(self, layers: list[LayerData], charts: dict[str, Any]) -> Iterator[None]:
        if self._viewer() is None or self._closed:
            return
        yield from self._picture.place(layers)
        yield
        self.charts = charts
        self.charts_changed.emit(charts)

    def _on_ended(self, outcome: Outcome) -> None:
        self.turns.add(self._end(outcome))

    def _end(self, outcome: Outcome) -> Iterator[None]:
        yield
        self._ended, self._computation = self._computation, None
        cancelled = isinstance(outcome.error, Cancelled)
        if cancelled and self._again:
            self._start_or_tell(self._until)
            if self.running:
                return
        quiet_collector.release(self)
        if outcome.atlas is not None:
            atlas = outcome.atlas
            if self.atlas is not None and self.atlas.completed(atlas):
                # What was drawn, and what can be undone, stays with it.
                atlas = self.atlas
            yield from keeping(self.atlas, atlas)
            self._finish(atlas)
        elif cancelled:
            self._update_states()
            self.stopped.emit("Cancelled. Run again to continue from the last finished step.")
        elif outcome.error is not None:
            self._fail(outcome.error)
        self.running_changed.emit(False)
        if self._again or any(self.steps[name].state == STALE for name in self._reached()):
            # A slider was moved so late that the run came to its end.
            self._rest.start()

    def adopt(
        self,
        known: Known,
        atlas: Atlas,
        layer: Layer | None,
        layers: list[LayerData],
        until: str = STEP_NAMES[-1],
    ) -> None:
        """Go on with a cell that was unwrapped before, as after a run.

        Parameters
        ----------
        known : Known
            Its pipeline, whose steps are done.
        atlas : Atlas
        layer : Layer or None
            The source, in the viewer.
        layers : list of LayerData
            Of every chart.
        until : str
            Up to which step changed parameters compute it anew; empty: not by themselves.
        """
        self._on_source(known)
        self.set_source(layer)
        self._parameters, self._problems, self._failed = atlas.parameters, {}, None
        self._until, self._closed = until, False
        self._picture.begin()
        self.parameters_changed.emit(self._parameters)
        self.turns.add(self._place(layers, dict(atlas_charts(atlas))))
        self.turns.add(self._adopted(atlas))

    def _adopted(self, atlas: Atlas) -> Iterator[None]:
        self._finish(atlas)
        yield

    def _finish(self, atlas: Atlas) -> None:
        self.atlas = atlas
        self._update_states()
        self._picture.finish()
        self.finished.emit(atlas)

    def _fail(self, error: BaseException) -> None:
        ours = isinstance(error, Unwrap3DError)
        reason = str(error) if ours else f"{type(error).__name__}: {error}"
        self._update_states()
        # The step that failed is the first one without a result.
        failed = next((name for name in self._reached() if self.steps[name].state != DONE), "")
        self._failed = (failed, reason)
        self._update_states()
        self.stopped.emit(reason)
        tell(error)

    def next_step(self) -> str:
        """The step that is sensible to run next; empty if there is none."""
        return "" if self.blocked() else first_open_step(self.steps)

    def _update_states(self, running: str = "") -> None:
        """Which results hold for the current parameters, and what keeps a step from running."""
        pipeline = None if self._known is None else self._known.pipeline
        self.steps = states_now(
            pipeline_states(pipeline, self._parameters, self.blocked()),
            self._problems,
            self._failed,
            running,
        )
        self.steps_changed.emit()


def _begin(_: Any, session: Session) -> None:
    session.previews = Previews(session)
    warn_of_binding()


_SESSIONS = PerViewer(Session, _begin)


def session_of(viewer: Any) -> Session:
    """The one session of a viewer (or of napari's proxy of it); made when first asked for."""
    return _SESSIONS.of(viewer)
