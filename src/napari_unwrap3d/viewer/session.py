"""The hub of one viewer: the source, its pipeline, the run in progress, the charts shown.

Widgets read the state of the steps here and listen to the signals; they hold none of
their own, so closing and opening a dock loses nothing.
"""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QEvent, QObject, QTimer, Signal

from ..atlas import Atlas
from ..errors import Cancelled, Unwrap3DError
from ..parameters import Parameters
from ..pipeline import STEP_NAMES, Source
from .canvas import canvas_of, open_canvas
from .computing import Computation, Known, Outcome
from .layers import LayerData, split_layers
from .placing import chart_of, placing, remove_charts
from .showing import fit_visible, show_charts_only
from .sources import layer_box, layer_source, layer_voxel_size, set_voxel_size
from .threads import tell

if TYPE_CHECKING:
    from collections.abc import Mapping

    from napari.components import ViewerModel
    from napari.layers import Layer

CLOSE_SECONDS = 5.0

READY, RUNNING, DONE, STALE, FAILED = "ready", "running", "done", "stale", "failed"
STATES = {"done": DONE, "stale": STALE, "missing": READY}


@dataclass
class StepState:
    """How far a step is.

    Attributes
    ----------
    state : str
        "ready" (never run), "running", "done", "stale" (what is shown belongs to
        other parameters) or "failed".
    seconds : float or None
        What the last computation took; None before it.
    quality : mapping
        The numbers of ``atlas.quality`` for this step.
    """

    state: str = READY
    seconds: float | None = None
    quality: Mapping[str, Any] = field(default_factory=dict)


class Session(QObject):
    """What one viewer knows about its cell. Get it with :func:`session_of`.

    Signals
    -------
    progressed(str, float, str)
        Step, fraction 0..1 and message of the run in progress.
    steps_changed()
        The state of one or more steps changed.
    running_changed(bool)
        A run started or ended.
    finished(object)
        A run ended well, with its :class:`Atlas`.
    stopped(str)
        A run ended otherwise; says why.
    """

    progressed = Signal(str, float, str)
    steps_changed = Signal()
    running_changed = Signal(bool)
    finished = Signal(object)
    stopped = Signal(str)

    def __init__(self, viewer: ViewerModel, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self.atlas: Atlas | None = None
        self.steps = {name: StepState() for name in STEP_NAMES}
        self._known: Known | None = None
        self._parameters = Parameters()
        self._computation: Computation | None = None
        self._work: deque[Iterator[None]] = deque()
        self._timer = QTimer(self)
        self._timer.setInterval(0)
        self._timer.timeout.connect(self._do_next)
        self._closed = False
        # The view is set for the first charts; afterwards it belongs to the user.
        self._turn_to_3d = self._fit_at_end = False

    # Running -----------------------------------------------------------------

    @property
    def source_data(self) -> Source | None:
        """The stack, mask or mesh of the last run."""
        return None if self._known is None else self._known.pipeline.source

    @property
    def running(self) -> bool:
        return self._computation is not None

    def run(
        self,
        layer: Layer,
        parameters: Parameters,
        voxel_size: tuple[float, float, float] | None = None,
    ) -> None:
        """Start the pipeline on a layer; only what changed since the last run is computed.

        Parameters
        ----------
        layer : Image, Labels or Surface layer
        parameters : Parameters
        voxel_size : (float, float, float), optional
            (z, y, x) in µm; given to a layer in pixels, ignored for others.

        Raises
        ------
        Unwrap3DError
            The layer cannot be a source; or a run is in progress.
        """
        if self.running:
            raise Unwrap3DError("A run is in progress.", hint="Cancel it first.")
        source = layer_source(layer, voxel_size)
        if layer_voxel_size(layer) is None and voxel_size is not None:
            set_voxel_size(layer, voxel_size)
        self._parameters = parameters
        self._update_states()
        self._forget_removed()
        computation = Computation(source, parameters, layer_box(layer), self._known)
        computation.source_changed.connect(self._on_source)
        computation.progressed.connect(self._on_progress)
        computation.charts_ready.connect(self._on_charts)
        computation.ended.connect(self._on_ended)
        self._computation = computation
        self._closed = False
        self._turn_to_3d = self._fit_at_end = not self._has_charts()
        computation.start()
        self.running_changed.emit(True)

    def cancel(self) -> None:
        """Stop the run in progress; returns at once, `stopped` follows."""
        if self._computation is not None:
            self._computation.cancel()

    def parameters_changed(self, parameters: Parameters) -> None:
        """Mark what a run with these parameters would compute anew."""
        self._parameters = parameters
        if not self.running:
            self._update_states()

    def close(self) -> None:
        """Cancel and wait for the computing thread, which ends within half a second."""
        self._closed = True
        self._timer.stop()
        self._work.clear()
        if self._computation is not None:
            self._computation.cancel()
            self._computation.wait(CLOSE_SECONDS)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes: leave no thread behind."""
        if event.type() == QEvent.Type.Close:
            self.close()
        return super().eventFilter(watched, event)

    def _has_charts(self) -> bool:
        return any(chart_of(layer) for each in self._viewers() for layer in each.layers)

    def _viewers(self) -> list[Any]:
        """The viewer, and its second canvas if it is open."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        return [] if viewer is None else [viewer] if canvas is None else [viewer, canvas.model]

    def _forget_removed(self) -> None:
        """Charts whose layers the user removed are shown again by the next run."""
        if self._known is not None:
            present = {chart_of(layer) for each in self._viewers() for layer in each.layers}
            self._known.shown = {
                name: chart for name, chart in self._known.shown.items() if name in present
            }

    def _later(self, work: Iterator[None]) -> None:
        """Do work in the viewer piece by piece, in order, between other events."""
        self._work.append(work)
        self._timer.start()

    def _do_next(self) -> None:
        if not self._work:
            self._timer.stop()
            return
        try:
            next(self._work[0])
        except StopIteration:
            self._work.popleft()

    # What the computing thread sends -----------------------------------------

    def _on_source(self, known: Known) -> None:
        """The run is about another cell: nothing of the last one stays."""
        for each in self._viewers():
            remove_charts(each)
        self._known = known
        self.atlas = None
        self.steps = {name: StepState() for name in STEP_NAMES}
        self.steps_changed.emit()

    def _on_progress(self, step: str, fraction: float, message: str) -> None:
        if step in self.steps and self.steps[step].state != RUNNING:
            self._update_states()
            self.steps[step].state = RUNNING
            self.steps_changed.emit()
        self.progressed.emit(step, fraction, message)

    def _on_charts(self, layers: list[LayerData]) -> None:
        self._later(self._place(layers))

    def _place(self, layers: list[LayerData]) -> Iterator[None]:
        viewer = self._viewer()
        if viewer is None or self._closed:
            return
        own, unwrapped = split_layers(layers)
        yield from placing(viewer, own)
        if unwrapped:
            # Opening it takes a tenth of a second: a turn of its own.
            canvas = canvas_of(viewer)
            yield
            yield from canvas.place(unwrapped)
        if self._turn_to_3d:
            self._turn_to_3d = False
            viewer.dims.ndisplay = 3
            viewer.reset_view()
            show_charts_only(viewer)

    def _on_ended(self, outcome: Outcome) -> None:
        self._later(self._end(outcome))

    def _end(self, outcome: Outcome) -> Iterator[None]:
        yield
        self._computation = None
        if outcome.atlas is not None:
            self._finish(outcome.atlas)
        elif isinstance(outcome.error, Cancelled):
            self._update_states()
            self.stopped.emit("Cancelled. Run again to continue from the last finished step.")
        elif outcome.error is not None:
            self._fail(outcome.error)
        self.running_changed.emit(False)

    def _finish(self, atlas: Atlas) -> None:
        self.atlas = atlas
        self._update_states()
        viewer = self._viewer()
        if self._fit_at_end and viewer is not None:
            fit_visible(viewer)
        self.finished.emit(atlas)

    def _fail(self, error: BaseException) -> None:
        self._update_states()
        # The step that failed is the first one without a result.
        for step in self.steps.values():
            if step.state != DONE:
                step.state = FAILED
                break
        self.steps_changed.emit()
        ours = isinstance(error, Unwrap3DError)
        self.stopped.emit(str(error) if ours else f"{type(error).__name__}: {error}")
        tell(error)

    def _update_states(self) -> None:
        """Ask the pipeline which results still hold for the current parameters."""
        if self._known is None:
            return
        pipeline = self._known.pipeline
        for name, state in pipeline.state(self._parameters).items():
            kept = pipeline.kept.get(name)
            self.steps[name] = StepState(
                STATES[state],
                None if kept is None else kept.seconds,
                {} if kept is None else kept.numbers,
            )
        self.steps_changed.emit()


_SESSIONS: weakref.WeakKeyDictionary[Any, Session] = weakref.WeakKeyDictionary()


def session_of(viewer: Any) -> Session:
    """The one session of a viewer; made when it is first asked for.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the proxy of it that napari hands to plugins.
    """
    viewer = getattr(viewer, "__wrapped__", viewer)
    session = _SESSIONS.get(viewer)
    if session is None:
        # napari has no public signal for a closing window; its documentation uses this too.
        window = viewer.window._qt_window
        session = Session(viewer, window)
        window.installEventFilter(session)
        _SESSIONS[viewer] = session
    return session
