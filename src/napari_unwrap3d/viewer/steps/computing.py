"""One run of the pipeline in a thread: progress and charts come out as Qt signals.

The thread holds the pipeline and this object, never the viewer, so that a window
closed during a run can be freed.
"""

from __future__ import annotations

import importlib
import itertools
import time
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject, Signal

from ...atlas import Atlas
from ...charts import Size3, Stack, Surface
from ...geometry.apart import apart
from ...parameters import Parameters
from ...pipeline import ON_REQUEST, STEP_NAMES, Pipeline
from ...progress import Progress
from ..common.threads import Task
from ..views.layers import LayerData, Layout, atlas_charts, chart_layers, chart_of_step
from ..views.sources import LayerSource

REPORT_SECONDS = 0.05


@dataclass(frozen=True)
class Outcome:
    """How a run ended: with an atlas, or with an error (cancelling is one)."""

    atlas: Atlas | None = None
    error: BaseException | None = None


@dataclass
class Known:
    """A pipeline with the results that it keeps, and what its source was.

    Attributes
    ----------
    pipeline : Pipeline
    identity : tuple
        The :func:`fingerprint` of the source.
    origin : (float, float, float)
        Where the pipeline's coordinate zero lies in the viewer, (z, y, x) in µm.
    shown : dict
        The charts that were sent to the viewer, by name: they need not be sent again.
    """

    pipeline: Pipeline
    identity: tuple[Any, ...]
    origin: Size3 = (0.0, 0.0, 0.0)
    shown: dict[str, Any] = field(default_factory=dict)


class Computation(QObject):
    """A run of the pipeline on a source.

    Parameters
    ----------
    source : LayerSource
    parameters : Parameters
    box : ndarray, (2, 3)
        Corners of the source in the viewer in µm: the charts are laid out around it.
    known : Known, optional
        The last run's; its results are used when the source is still the same.
    until : str
        The last step to run.

    Signals
    -------
    source_changed(object)
        The source is new, and so is this :class:`Known`; comes before any progress.
    progressed(str, float, str)
        Step, fraction 0..1 and message, at most twenty times a second.
    charts_ready(object, object)
        Layers (list) of a chart that is done, made in the thread, and a dict of all known charts.
    ended(object)
        An :class:`Outcome`.
    """

    source_changed = Signal(object)
    progressed = Signal(str, float, str)
    charts_ready = Signal(object, object)
    ended = Signal(object)

    def __init__(
        self,
        source: LayerSource,
        parameters: Parameters,
        box: npt.ArrayLike,
        known: Known | None = None,
        until: str = STEP_NAMES[-1],
    ) -> None:
        super().__init__()
        self._source = source
        self._parameters = parameters
        self._box = box
        self._known = known
        self._until = until
        self._progress = Progress(self._report)
        self._step = ""
        self._reported = 0.0
        self._task = Task(self._compute)
        self._task.returned.connect(self._on_returned)
        self._task.failed.connect(self._on_failed)

    def start(self) -> None:
        """Start the thread."""
        self._task.start()

    def cancel(self) -> None:
        """Ask the pipeline to stop."""
        self._progress.cancel()

    def wait(self, seconds: float) -> bool:
        """Wait for the thread; True when it has ended."""
        return self._task.wait(seconds)

    def _on_returned(self, atlas: Atlas) -> None:
        self.ended.emit(Outcome(atlas=atlas))

    def _on_failed(self, error: BaseException) -> None:
        self.ended.emit(Outcome(error=error))

    # In the thread -----------------------------------------------------------

    def _compute(self) -> Atlas:
        pipeline = self._pipeline()
        with apart():
            pipeline.run(self._parameters, self._progress, until=self._until)
        atlas = self._complete(pipeline)
        charts = atlas_charts(atlas)
        self._show(charts, tuple(charts))
        return atlas

    def _complete(self, pipeline: Pipeline) -> Atlas:
        """The atlas with later steps that still hold, too; nothing is computed for it."""
        states = pipeline.state(self._parameters)
        held = list(itertools.takewhile(lambda name: states[name] == "done", STEP_NAMES))
        groups = self._parameters.model_dump()
        for step in ON_REQUEST:
            groups[step.name]["compute"] = states.get(step.name) == "done"
        holding = Parameters.from_dict(groups)
        atlas = pipeline.run(holding, self._progress, until=held[-1])
        return atlas.replaced(parameters=self._parameters)

    def _pipeline(self) -> Pipeline:
        """The last run's pipeline, or a new one when the source is another."""
        identity = fingerprint(self._source)
        if self._known is None or self._known.identity != identity:
            self._known = Known(Pipeline(self._source.data), identity, self._source.origin)
            self.source_changed.emit(self._known)
        return self._known.pipeline

    def _report(self, step: str, fraction: float, message: str) -> None:
        now = time.monotonic()
        if step != self._step:
            self._send_chart(self._step)
            self._step = step
        elif now - self._reported < REPORT_SECONDS:
            return
        self._reported = now
        self.progressed.emit(step, fraction, message)

    def _send_chart(self, step: str) -> None:
        """Show a chart as soon as it is there, coloured by what is known so far."""
        if step not in STEP_NAMES or step == "stack" or self._known is None:
            return
        results = self._known.pipeline.results
        known = STEP_NAMES[: STEP_NAMES.index(step) + 1]
        charts = {chart_of_step(name): results[name] for name in known if name in results}
        shown = ("mask", "surface") if step == "surface" else (chart_of_step(step),)
        self._show(charts, shown)

    def _show(self, charts: dict[str, Any], names: tuple[str, ...]) -> None:
        """Send the layers of those charts that are not in the viewer as they are."""
        assert self._known is not None
        # Layers with features and plots need them; importing would hold up the window. Not
        # before the first progress, which would wait for it.
        importlib.import_module("pandas")
        importlib.import_module("matplotlib.figure")
        shown = self._known.shown
        layout = Layout.of(charts, self._known.origin, self._box)
        layers: list[LayerData] = []
        for name in reversed(charts):
            if name in names and shown.get(name) is not charts[name]:
                layers += chart_layers(name, charts, layout)
                shown[name] = charts[name]
        if layers:
            self.charts_ready.emit(layers, dict(charts))


def fingerprint(source: LayerSource) -> tuple[Any, ...]:
    """What tells two sources apart, also after a layer was painted on in place."""
    data = source.data
    # Whoever divides by the scale and multiplies again gets the last bits wrong.
    origin = tuple(round(place, 9) for place in source.origin)
    if isinstance(data, Surface):
        return (origin, _checksum(data.vertices), _checksum(data.faces))
    axes = data.axes if isinstance(data, Stack) else "mask"
    values = data.data
    content = _checksum(values) if isinstance(values, np.ndarray) else (id(values),)
    return (origin, axes, data.voxel_size, content)


def _checksum(array: npt.NDArray[Any]) -> tuple[Any, ...]:
    contiguous = np.ascontiguousarray(array)
    return (contiguous.shape, str(contiguous.dtype), zlib.crc32(contiguous.view(np.uint8).data))
