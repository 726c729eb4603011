"""The steps in order, what each depends on, and what has to run again.

A step is a pure function of earlier results and of its own parameters. Its key is the
hash of both; a result is kept until its key changes, so that a changed parameter runs
its step and what follows, and nothing else.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .atlas import Atlas
from .charts import Mask, Stack, Surface, TemporalMask
from .errors import InputError, ParameterError
from .imaging.segment import check_mask, segment
from .parameters import Parameters
from .progress import Progress
from .provenance import content_hash, environment, repairs
from .quality import quality_rows
from .requested import ON_REQUEST as REQUESTED
from .unwrapping import measure
from .unwrapping.axis import with_field_of
from .unwrapping.outermost import OutermostSurface, with_outermost
from .unwrapping.reference import reference
from .unwrapping.solid import closed_mesh, mask_of_mesh
from .unwrapping.sphere import sphere
from .unwrapping.surface import sealed_surface, surface
from .unwrapping.topography import topography
from .unwrapping.uv import uv

logger = logging.getLogger(__name__)

Source = Stack | Mask | Surface
ProgressLike = Progress | Callable[[str, float, str], None] | None

# Part of every key: raise it when a step computes something else from the same input.
STEP_VERSION = 5


@dataclass(frozen=True)
class Step:
    """One step: its function, the groups of parameters and the results it needs."""

    name: str
    function: Callable[[Pipeline, Parameters, Progress], Any]
    parameters: tuple[str, ...]
    needs: tuple[str, ...]


@dataclass
class Kept:
    """A result, the key it was computed for, its numbers and how long it took."""

    key: str
    value: Any
    numbers: dict[str, Any]
    seconds: float


@dataclass
class Pipeline:
    """Runs the steps for one source and keeps their results.

    Attributes
    ----------
    source : Stack, Mask or Surface
    kept : dict
        Results of the steps so far.
    """

    source: Source
    kept: dict[str, Kept] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.source, Stack | Mask | Surface):
            raise InputError(
                "The input is a Stack, a Mask or a Surface.",
                type=type(self.source).__name__,
                hint="Read it with read_stack or read_mesh, or wrap an array in Mask.",
            )
        self._source_key = _source_key(self.source)

    @classmethod
    def resumed(cls, atlas: Atlas, source: Source | None = None) -> Pipeline:
        """The pipeline of an atlas that was computed before: its steps need not run again.

        Parameters
        ----------
        atlas : Atlas
            Whose charts are the results of the steps with its own parameters.
        source : Stack, Mask or Surface, optional
            What it was unwrapped from; its mask unless given.
        """
        pipeline = cls(atlas.mask if source is None else source)
        steps = atlas.provenance.get("steps", {})
        for name, step in _BY_NAME.items():
            chart = "mask" if name == "stack" else name
            if atlas.has(chart):
                seconds = float(steps.get(name, {}).get("seconds", 0.0))
                numbers = dict(atlas.quality.get(name, {}))
                key = pipeline._key(step, atlas.parameters)
                pipeline.kept[name] = Kept(key, getattr(atlas, chart), numbers, seconds)
        return pipeline

    @property
    def results(self) -> dict[str, Any]:
        """Step → what it computed."""
        return {name: kept.value for name, kept in self.kept.items()}

    def run(
        self,
        parameters: Parameters | None = None,
        progress: ProgressLike = None,
        until: str = "topography",
    ) -> Atlas:
        """Run what is missing or stale up to a step, and return the atlas.

        Parameters
        ----------
        parameters : Parameters, optional
        progress : Progress, or callable(step, fraction, message), optional
        until : str
            The last step to run. Steps that are run on request (:data:`ON_REQUEST`) run when
            they are named here or asked for by a parameter.

        Raises
        ------
        Cancelled
            The user asked to stop; finished steps are kept.
        Unwrap3DError
            A step could not do its work; the error names what and why.
        """
        chosen = parameters if parameters is not None else Parameters()
        report = progress if isinstance(progress, Progress) else Progress(progress)
        if until not in _BY_NAME:
            raise ParameterError(f"There is no step {until!r}.", hint=f"Steps: {[*_BY_NAME]}.")
        for step in _wanted(until, chosen):
            key = self._key(step, chosen)
            if step.name in self.kept and self.kept[step.name].key == key:
                continue
            part = report.named(step.name)
            part(0.0, "starting")
            start = time.perf_counter()
            # In a thread, so that a cancellation need not wait for the next check within it.
            value, numbers = part.run(step.function, self, chosen, part)
            seconds = time.perf_counter() - start
            self.kept[step.name] = Kept(key, value, numbers, seconds)
            logger.info("%s took %.2f s", step.name, seconds)
            part(1.0, "done")
        return self._atlas(chosen, until)

    def state(self, parameters: Parameters) -> dict[str, str]:
        """Step → "done", "stale" (a parameter or an input changed) or "missing".

        A step that is run on request appears once it was asked for.
        """
        states: dict[str, str] = {}
        for step in (*STEPS, *ON_REQUEST):
            if step in ON_REQUEST and not (step.name in self.kept or _asked(step, parameters)):
                continue
            if step.name not in self.kept:
                states[step.name] = "missing"
            else:
                fresh = self.kept[step.name].key == self._key(step, parameters)
                states[step.name] = "done" if fresh else "stale"
        return states

    def _key(self, step: Step, parameters: Parameters) -> str:
        """Depends on the source, this step's parameters and, recursively, its inputs'."""
        own = [
            getattr(parameters, group).model_dump_json(exclude={"compute"})
            for group in step.parameters
        ]
        if "stack" in step.parameters and parameters.stack.psf:
            own.append(_file_state(parameters.stack.psf))
        inputs = [self._key(_BY_NAME[name], parameters) for name in step.needs]
        return content_hash(STEP_VERSION, step.name, self._source_key, own, inputs)

    def keep(self, name: str, value: Any, numbers: Mapping[str, Any]) -> None:
        """Put a result that a person edited in the place of what the step computed, if it ran."""
        if name in self.kept:
            self.kept[name] = replace(self.kept[name], value=value, numbers=dict(numbers))

    def provide(
        self, name: str, value: Any, numbers: Mapping[str, Any], parameters: Parameters
    ) -> None:
        """Put what was made elsewhere in the place of a step's result: it need not run."""
        key = self._key(_BY_NAME[name], parameters)
        self.kept[name] = Kept(key, value, dict(numbers), 0.0)

    def value(self, name: str) -> Any:
        """Result of a step that has run."""
        return self.kept[name].value

    def _atlas(self, parameters: Parameters, until: str) -> Atlas:
        shown = [step.name for step in _wanted(until, parameters)]
        charts: dict[str, Any] = {
            name: self.kept[name].value if name in shown else None for name in _BY_NAME
        }
        mask = charts.pop("stack")
        requested = {step.name: charts.pop(step.name) for step in ON_REQUEST}
        if charts["topography"] is not None:
            charts |= _with_heights(charts)
        kept = {name: self.kept[name] for name in _BY_NAME if name in self.kept}
        numbers = {name: item.numbers for name, item in kept.items() if name in shown}
        return Atlas(
            mask=mask,
            parameters=parameters,
            quality=numbers,
            provenance=self._provenance(kept, numbers),
            on_request={name: chart for name, chart in requested.items() if chart is not None},
            **charts,
        )

    def _provenance(
        self, kept: dict[str, Kept], numbers: dict[str, dict[str, Any]]
    ) -> dict[str, Any]:
        warnings = [
            f"{row.chart}: {row.title} is {row.value}; {row.reason}"
            for row in quality_rows(numbers)
            if row.mark == "red"
        ]
        for warning in warnings:
            logger.warning(warning)
        return {
            "versions": environment(),
            "source": {
                "name": getattr(self.source, "name", ""),
                "kind": type(self.source).__name__.lower(),
                "hash": self._source_key,
            },
            "steps": {
                name: {"seconds": round(item.seconds, 3), "key": item.key}
                for name, item in kept.items()
            },
            "warnings": warnings,
            "repairs": repairs(
                {name: numbers[name] for name in ("stack", "surface", "sealed") if name in numbers}
            ),
        }


def unwrap(
    source: Source, parameters: Parameters | None = None, progress: ProgressLike = None
) -> Atlas:
    """Unwrap one cell: from a stack, a mask or a mesh to the atlas of all its charts.

    Parameters
    ----------
    source : Stack, Mask or Surface
    parameters : Parameters, optional
        Defaults, or ``Parameters.preset("blebs")`` and the like.
    progress : Progress, or callable(step, fraction, message), optional

    Returns
    -------
    Atlas
    """
    return Pipeline(source).run(parameters, progress)


def _wanted(until: str, parameters: Parameters) -> list[Step]:
    """The steps to run: those up to `until`, and after the last of them what was asked for."""
    if until in STEP_NAMES[:-1]:
        return list(STEPS[: STEP_NAMES.index(until) + 1])
    asked = [step for step in ON_REQUEST if step.name == until or _asked(step, parameters)]
    return [*STEPS, *asked]


def _asked(step: Step, parameters: Parameters) -> bool:
    return any(getattr(getattr(parameters, g), "compute", False) for g in step.parameters)


def _source_key(source: Source) -> str:
    if isinstance(source, Surface):
        fields = [part for field in source.fields.items() for part in field]
        return content_hash("surface", source.vertices, source.faces, *fields)
    if isinstance(source, TemporalMask):
        held = (source.ever, source.always)
        return content_hash("mask", source.data, source.voxel_size, source.origin, *held)
    if isinstance(source, Mask):
        return content_hash("mask", source.data, source.voxel_size, source.origin)
    # A stack is lazy and may not fit into memory: it is known by where it came from.
    token = getattr(source.data, "name", None)
    content = token if token is not None else np.asarray(source.data)
    return content_hash("stack", source.axes, source.voxel_size, content)


def _file_state(path: str) -> str:
    """What changes when a file is replaced under the same name; empty if there is none."""
    try:
        state = Path(path).stat()
    except OSError:
        return ""
    return f"{state.st_mtime_ns} {state.st_size}"


def _with_heights(charts: dict[str, Any]) -> dict[str, Any]:
    """The charts with the fields that need the topography."""
    chart = charts["topography"]
    images = {f"surface_{name}": image for name, image in chart.fields.items()}
    return {
        "surface": charts["surface"].with_fields(height_um=chart.surface[:, 0]),
        "uv": charts["uv"].with_fields(**images),
    }


# The steps -----------------------------------------------------------------------------


def _stack(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    source = pipeline.source
    if isinstance(source, Surface):
        return mask_of_mesh(closed_mesh(source), parameters.stack.working_voxel_um)
    if isinstance(source, Stack):
        return segment(source, parameters.stack, progress)
    return check_mask(source, parameters.stack, progress)


def _surface(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    given = closed_mesh(pipeline.source) if isinstance(pipeline.source, Surface) else None
    chart = surface(pipeline.value("stack"), parameters.surface, given, progress)
    return chart, dict(chart.report)


def _sealed(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    chart = sealed_surface(
        pipeline.value("stack"),
        pipeline.value("surface"),
        parameters.surface,
        parameters.sealed,
        progress,
    )
    return chart, measure.measure_sealed(pipeline.value("surface"), chart)


def _reference(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    chart = reference(pipeline.value("sealed"), parameters.reference, progress)
    return chart, measure.measure_reference(chart)


def _sphere(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    chart = sphere(pipeline.value("reference"), parameters.sphere, progress)
    return chart, measure.measure_sphere(pipeline.value("reference"), chart)


def _uv(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    base = pipeline.value("reference")
    weighed = base
    if parameters.uv.axis_weight == "field":
        weighed = with_field_of(base, pipeline.value("surface"), parameters.uv.axis_field)
    chart = uv(weighed, pipeline.value("sphere"), parameters.uv, progress)
    return chart, measure.measure_uv(base, chart)


def _topography(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
    cell, mask = pipeline.value("surface"), pipeline.value("stack")
    source = pipeline.source
    chart = topography(
        cell,
        mask,
        pipeline.value("reference"),
        pipeline.value("sphere"),
        pipeline.value("uv"),
        parameters.topography,
        parameters.surface,
        progress.part(0.0, 0.9),
        source.reach() if isinstance(source, TemporalMask) else None,
    )
    progress(0.9, "measuring the maps")
    chart = with_outermost(chart, OutermostSurface(cell, chart), cell)
    return chart, measure.measure_topography(cell, chart, mask.voxel_size[0])


def _on_request(name: str) -> Callable[[Pipeline, Parameters, Progress], Any]:
    """The function of a step that makes a chart from other charts, when it is asked for."""

    def step(pipeline: Pipeline, parameters: Parameters, progress: Progress) -> Any:
        def charts(chart: str) -> Any:
            return pipeline.value("stack" if chart == "mask" else chart)

        return REQUESTED[name].function(charts, charts("mask").voxel_size[0], parameters, progress)

    return step


STEPS = (
    Step("stack", _stack, ("stack",), ()),
    Step("surface", _surface, ("surface",), ("stack",)),
    Step("sealed", _sealed, ("sealed", "surface"), ("surface",)),
    Step("reference", _reference, ("reference",), ("sealed",)),
    Step("sphere", _sphere, ("sphere",), ("reference",)),
    Step("uv", _uv, ("uv",), ("sphere",)),
    Step("topography", _topography, ("topography", "surface"), ("uv",)),
)
STEP_NAMES = tuple(step.name for step in STEPS)
# Not everyone needs these, and they take time.
ON_REQUEST = tuple(
    Step(name, _on_request(name), asked.parameters, asked.needs)
    for name, asked in REQUESTED.items()
)
_BY_NAME = {step.name: step for step in (*STEPS, *ON_REQUEST)}
