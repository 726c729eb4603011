"""Annotations in a project, and what a viewer wants back: written, and read without trust.

Layout of the group ``annotations``::

    attributes     type, overhang, axis (z, y, x, or null), points (name, position_um) and
                   annotations: for each its name, colours, shapes, and whether it has an
                   image of uv (JSON)
    labels_0, labels_1, ...    (n,) uint16, painted, per vertex of the surface
    image_0, ...               (N, 2N) uint16, painted in uv
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..annotations.annotation import checked_colours, checked_name
from ..annotations.annotations import Annotations
from ..annotations.shapes import Shape, check_reach, checked_overhang
from ..annotations.state import Drawn, State, checked_axis
from ..errors import FileFormatError, InputError, ParameterError
from ..progress import Progress
from .arrays import read_array, write_array
from .atomic import from_plain, plain

if TYPE_CHECKING:
    import zarr

GROUP = "annotations"
LARGEST_VIEW = 256 * 2**10


def state_of(annotations: Annotations | State | None) -> State | None:
    """The state of annotations, if there are any."""
    return annotations.state() if isinstance(annotations, Annotations) else annotations


def checked_view(view: Any) -> dict[str, Any]:
    """What a viewer wants back, as what JSON can hold.

    Raises
    ------
    InputError
        It is no mapping, or is too large.
    """
    kept = plain(view)
    size = len(json.dumps(kept))
    if not isinstance(kept, dict) or size > LARGEST_VIEW:
        raise InputError(
            "What a viewer keeps is a small mapping.", characters=size, limit=LARGEST_VIEW
        )
    return kept


def write_annotations(root: zarr.Group, state: State, report: Progress) -> None:
    """Write the group."""
    attributes = {
        "type": GROUP,
        "overhang": state.overhang,
        "axis": None if state.axis is None else list(state.axis),
        "points": [{"name": n, "position_um": list(p)} for n, p in state.points.items()],
        "annotations": [
            {
                "name": part.name,
                "colours": [[label, *colour] for label, colour in part.colours.items()],
                "shapes": [shape.plain() for shape in part.shapes],
                "has_image": part.image is not None,
            }
            for part in state.drawn
        ],
    }
    group = root.create_group(GROUP, attributes=plain(attributes))
    for index, part in enumerate(state.drawn):
        write_array(group, f"labels_{index}", part.labels, report)
        if part.image is not None:
            write_array(group, f"image_{index}", part.image, report)


def read_annotations(group: Any, charts: Mapping[str, Any], report: Progress) -> State:
    """Read the group, and check that it belongs to the charts of the file.

    Raises
    ------
    FileFormatError
        It does not, or says something that no annotation can be.
    """
    attributes = from_plain(group.attrs.asdict())
    described = attributes["annotations"]
    flags = [part["has_image"] for part in described]
    _require(all(type(flag) is bool for flag in flags), "It is not said what was drawn in uv")
    expected = {f"labels_{i}" for i in range(len(described))}
    expected |= {f"image_{i}" for i, flag in enumerate(flags) if flag}
    _require(set(group) == expected, "Labels are missing, or belong to no annotation")
    try:
        drawn = [
            Drawn(
                checked_name(part["name"]),
                _labels(group[f"labels_{i}"], _vertices(charts), report),
                _labels(group[f"image_{i}"], _pixels(charts), report) if flags[i] else None,
                tuple(_shape(shape, charts) for shape in part["shapes"]),
                checked_colours({label: tuple(colour) for label, *colour in part["colours"]}),
            )
            for i, part in enumerate(described)
        ]
        _require(len({part.name for part in drawn}) == len(drawn), "A name comes twice")
        points = {
            checked_name(point["name"]): _position(point["position_um"])
            for point in attributes["points"]
        }
        overhang = checked_overhang(attributes["overhang"])
        return State(tuple(drawn), points, overhang, checked_axis(attributes.get("axis")))
    except ParameterError as error:
        raise FileFormatError(f"Its annotations are damaged: {error}") from error


def _vertices(charts: Mapping[str, Any]) -> tuple[int, ...]:
    _require(charts.get("surface") is not None, "There is no surface to be annotated")
    return (len(charts["surface"].vertices),)


def _pixels(charts: Mapping[str, Any]) -> tuple[int, ...]:
    there = charts.get("uv") is not None and charts.get("topography") is not None
    _require(there, "There is no uv to be annotated")
    shape: tuple[int, ...] = charts["uv"].shape
    return shape


def _labels(array: Any, shape: tuple[int, ...], report: Progress) -> Any:
    good = array.shape == shape and np.dtype(str(array.attrs["dtype"])) == np.uint16
    _require(good, "Labels have another size", found=array.shape, expected=shape)
    return read_array(array, report)


def _shape(described: Mapping[str, Any], charts: Mapping[str, Any]) -> Shape:
    shape = Shape.from_plain(described)
    if shape.chart == "volume":
        return shape
    if shape.chart == "uv":
        _pixels(charts)
    _require(charts.get(shape.chart) is not None, f"There is no {shape.chart} for a shape")
    check_reach(shape, charts[shape.chart].shape[0])
    return shape


def _position(given: Any) -> tuple[float, float, float]:
    point = np.asarray(given, dtype=np.float64)
    _require(point.shape == (3,) and bool(np.isfinite(point).all()), "A point has no position")
    z, y, x = point.tolist()
    return z, y, x


def _require(holds: bool, what: str, **measured: Any) -> None:
    if not holds:
        raise FileFormatError(
            f"{what}: the annotations of this file do not belong to it.",
            **measured,
            hint="The file is damaged: get it anew from its source.",
        )
