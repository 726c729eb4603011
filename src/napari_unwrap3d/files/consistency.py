"""Whether the charts of a file fit together: every index points at something that is there.

Charts check themselves when they are made. What one says about another is checked here, so
that no kernel is ever given an index out of a file that lies outside of an array.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_type_hints

import numpy as np
import numpy.typing as npt

from ..annotations.shapes import LARGEST_LABEL
from ..charts import (
    MOTIFS,
    UV,
    Direct,
    Mask,
    Plane,
    Protrusions,
    Reference,
    SealedSurface,
    Sphere,
    Surface,
    Topography,
)
from ..errors import FileFormatError


def check_charts(charts: Mapping[str, Any]) -> None:
    """Raise unless charts that were read from a file are of one atlas.

    Parameters
    ----------
    charts : mapping
        Name to chart; None for those that are not there.

    Raises
    ------
    FileFormatError
        A chart is of another kind, has another size than those it belongs to, or points at
        what does not exist.
    """
    from ..atlas import Atlas

    kinds = {
        **get_type_hints(Atlas),
        "direct": Direct,
        "plane": Plane,
        "protrusions": Protrusions,
    }
    for name, chart in charts.items():
        if chart is not None:
            _require(isinstance(chart, kinds[name]), f"The {name} is of another kind")
    surface, reference, sphere = (charts.get(n) for n in ("surface", "reference", "sphere"))
    uv, topography = charts.get("uv"), charts.get("topography")
    if sphere is not None:
        _check_sphere(sphere, reference)
    if uv is not None:
        _check_uv(uv, reference)
    if topography is not None:
        _check_topography(topography, uv, surface)
    if charts.get("direct") is not None:
        _check_direct(charts["direct"], charts.get("sealed"))
    if charts.get("plane") is not None:
        _check_plane(charts["plane"], charts.get("sealed"))
    if charts.get("protrusions") is not None:
        _check_protrusions(charts["protrusions"], surface, charts.get("mask"))


def _check_sphere(sphere: Sphere, reference: Reference | None) -> None:
    _shape("conformal sphere", sphere.conformal, sphere.vertices.shape)
    if reference is not None:
        same = np.array_equal(sphere.faces, reference.faces)
        _require(same, "The sphere has other faces than the reference")
        _shape("sphere", sphere.vertices, reference.vertices.shape)


def _check_uv(uv: UV, reference: Reference | None) -> None:
    _shape("rotation", uv.rotation, (3, 3))
    for name in ("weights", "positions"):
        _shape(name, getattr(uv, name), (*uv.shape, 3))
    for name, values in uv.fields.items():
        _shape(name, values, uv.shape)
    if reference is not None:
        _within("face of a pixel", uv.face, -1, len(reference.faces))


def _check_topography(chart: Topography, uv: UV | None, surface: Surface | None) -> None:
    layers, rows, columns = chart.shape
    if uv is not None:
        _shape("topography", chart.mask[0], uv.shape)
    _shape("nodes", chart.nodes, (layers, rows + 2, columns, 3))
    _shape("mask of the topography", chart.mask, (layers, rows, columns))
    for name in ("first_layer", "last_layer"):
        _shape(name, getattr(chart, name), (rows + 2, columns))
        _within(name, getattr(chart, name), -1, layers + 1)
    for kind in ("cut", "meshed"):
        vertices, faces = getattr(chart, f"{kind}_vertices"), getattr(chart, f"{kind}_faces")
        _shape(f"{kind} vertices", vertices, (len(vertices), 3))
        _shape(f"{kind} faces", faces, (len(faces), 3))
        _within(f"{kind} face", faces, 0, len(vertices))
    _shape("origins of the cut", chart.cut_origin, (len(chart.cut_vertices),))
    if surface is not None:
        _shape("image of the surface", chart.surface, surface.vertices.shape)
        _within("origin of the cut", chart.cut_origin, 0, len(surface.vertices))


def _check_direct(chart: Direct, sealed: SealedSurface | None) -> None:
    size = len(chart.vertices)
    _shape("rotation", chart.rotation, (3, 3))
    _shape("weights", chart.weights, (*chart.shape, 3))
    _shape("owner", chart.owner, chart.shape)
    _shape("registered", chart.registered, (size, 3))
    for name in ("spokesman", "cortex"):
        _shape(name, getattr(chart, name), (size,))
    _within("face of a pixel", chart.face, 0, len(chart.faces))
    for name in ("owner", "spokesman"):
        _within(name, getattr(chart, name), 0, size)
    if sealed is not None:
        same = np.array_equal(chart.faces, sealed.faces)
        _require(same, "The direct chart has other faces than the sealed surface")
        _shape("direct chart", chart.vertices, sealed.vertices.shape)


def _check_plane(chart: Plane, sealed: SealedSurface | None) -> None:
    _shape("vertices of the plane", chart.vertices, (len(chart.vertices), 2))
    _shape("turns", chart.turns, (len(chart.turns), 3))
    _shape("faces at the poles", chart.pole_faces, (2,))
    _shape("weights of the poles", chart.pole_weights, (2, 3))
    for name in ("weights", "positions"):
        _shape(name, getattr(chart, name), (*chart.face.shape, 3))
    for name in ("face", "pole_faces"):
        _within(f"{name} of the plane", getattr(chart, name), 0, len(chart.turns))
    if sealed is not None:
        _shape("turns", chart.turns, sealed.faces.shape)
        _shape("plane", chart.vertices, (len(sealed.vertices), 2))


def _check_protrusions(found: Protrusions, surface: Surface | None, mask: Mask | None) -> None:
    if surface is not None:
        _shape("labels of the protrusions", found.labels, (len(surface.vertices),))
    if mask is not None:
        _shape("volumes of the protrusions", found.volume.data, mask.shape)
    for name, labels in (("vertex", found.labels), ("voxel", found.volume.data)):
        _within(f"label of a {name}", labels, 0, LARGEST_LABEL + 1)
    _within("label of a row", found.columns["label"], 1, LARGEST_LABEL + 1)
    if "motif" in found.columns:
        _within("motif", found.columns["motif"], 0, len(MOTIFS))


def _require(holds: bool, what: str, **measured: Any) -> None:
    if not holds:
        raise FileFormatError(
            f"{what}: the charts of this file do not belong together.",
            **measured,
            hint="The file is damaged: get it anew from its source.",
        )


def _shape(name: str, values: npt.NDArray[Any], expected: tuple[int, ...]) -> None:
    found = np.shape(values)
    _require(found == expected, f"The {name} has another size", found=found, expected=expected)


def _within(name: str, values: npt.NDArray[Any], low: int, high: int) -> None:
    """Integers of low ≤ value < high."""
    _require(values.dtype.kind in "iu", f"The {name} is no integer")
    if values.size:
        least, largest = int(values.min()), int(values.max())
        found = f"{least} to {largest}"
        _require(low <= least and largest < high, f"A {name} does not exist", found=found)
