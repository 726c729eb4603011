"""Charts that not everyone needs and that take time, made from the other charts of a cell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..errors import NotCertifiedError
from ..parameters import Parameters
from ..progress import Progress
from . import measure
from .direct import direct
from .plane import plane

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


REQUESTED_CHARTS = {"direct": direct_chart_of, "plane": plane_of}
