"""Charts and protrusions: what not everyone needs and takes time, made from the other charts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .errors import NotCertifiedError
from .parameters import Parameters
from .progress import Progress
from .protrusions.segment import segment_cell
from .unwrapping import measure
from .unwrapping.direct import direct
from .unwrapping.plane import plane

# Gives a chart by its name.
Charts = Callable[[str], Any]
ChartAndNumbers = tuple[Any, dict[str, Any]]


def direct_chart_of(
    charts: Charts, voxel_um: float, parameters: Parameters, progress: Progress
) -> ChartAndNumbers:
    """The direct chart and its numbers."""
    chart = direct(
        charts("sealed"),
        charts("surface"),
        charts("uv"),
        charts("topography"),
        voxel_um,
        parameters.direct,
        progress.part(0.0, 0.95),
    )
    progress(0.95, "measuring the direct chart")
    return chart, progress.run(measure.measure_direct, charts("sealed"), chart)


def plane_of(
    charts: Charts, voxel_um: float, parameters: Parameters, progress: Progress
) -> ChartAndNumbers:
    """The plane and its numbers; one that is not certified is None, and the numbers say why."""
    cell, sealed = charts("surface"), charts("sealed")
    try:
        chart = plane(
            cell,
            sealed,
            charts("uv"),
            charts("topography"),
            voxel_um,
            parameters.plane,
            progress.part(0.0, 0.9),
        )
    except NotCertifiedError as error:
        return None, measure.measure_refusal(error)
    progress(0.9, "measuring the plane")
    return chart, progress.run(measure.measure_plane, cell, sealed, chart, voxel_um)


def protrusions_of(
    charts: Charts, voxel_um: float, parameters: Parameters, progress: Progress
) -> ChartAndNumbers:
    """The protrusions of the cell and their numbers."""
    found = segment_cell(charts, parameters, progress)
    return found, dict(found.numbers)


@dataclass(frozen=True)
class Requested:
    """Something that is computed on request.

    Attributes
    ----------
    function : callable
        Gives it and its numbers.
    parameters : tuple of str
        The groups of parameters that it depends on.
    needs : tuple of str
        The steps that it depends on.
    """

    function: Callable[[Charts, float, Parameters, Progress], ChartAndNumbers]
    parameters: tuple[str, ...]
    needs: tuple[str, ...] = ("topography", "sealed")


ON_REQUEST = {
    "direct": Requested(direct_chart_of, ("direct",)),
    "plane": Requested(plane_of, ("plane",)),
    "protrusions": Requested(
        protrusions_of, ("protrusions", "topographic", "refinement"), ("topography",)
    ),
}
