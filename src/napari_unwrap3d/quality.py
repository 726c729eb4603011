"""Which numbers of an atlas are good, fair or bad, and why: the one place for the limits.

``atlas.quality`` holds the measured numbers, by chart. Here they become rows with a mark,
for the command line, the tables and the interface.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Mark = Literal["green", "amber", "red", ""]


@dataclass(frozen=True)
class Limit:
    """When a number is good (green), fair (amber) or bad (red), and what it means.

    A value up to `green` is good and up to `amber` fair; with `least`, a value from
    `green` up is good and from `amber` up fair; with `absolute`, the sign does not count.
    `when` names other numbers of the chart and the values for which the limit holds.
    """

    title: str
    green: float
    amber: float
    meaning: str
    least: bool = False
    absolute: bool = False
    when: tuple[tuple[str, Any], ...] = ()

    def mark(self, value: float) -> Mark:
        """The colour of a value; NaN is bad."""
        value = abs(value) if self.absolute else value
        sign = -1.0 if self.least else 1.0
        if sign * value <= sign * self.green:
            return "green"
        return "amber" if sign * value <= sign * self.amber else "red"

    def reason(self, value: float) -> str:
        """Why the value has its mark."""
        word = "at least" if self.least else "at most"
        return f"{self.meaning}; good: {word} {self.green:g}, fair: {word} {self.amber:g}"


@dataclass(frozen=True)
class Row:
    """One number of one chart.

    Attributes
    ----------
    chart : str
    quantity : str
        The key in ``atlas.quality``, with its unit, e.g. ``"area_um2"``.
    value : object
    mark : str
        "green", "amber", "red", or "" where there is nothing to judge.
    title, reason : str
        In words.
    """

    chart: str
    quantity: str
    value: Any
    mark: Mark = ""
    title: str = ""
    reason: str = ""


_HANDLES = "a surface with handles is no sphere; the sealed surface closes them"
_OPEN = "an open edge leaves inside and outside undefined"
_FLIPS = "where a face is flipped the map is not one to one"
_Q = "1 means that angles are kept"
_LAMBDA = "0 means that areas are kept"
_EQUIAREAL = (("blend", 1.0), ("criterion", "equiareal"), ("target", "reference"))

LIMITS: dict[tuple[str, str], Limit] = {
    ("surface", "genus"): Limit("handles", 0, 1e9, _HANDLES),
    ("surface", "components"): Limit("parts", 1, 1, "a cell is one piece"),
    ("surface", "boundary_edges"): Limit("open edges", 0, 0, _OPEN),
    ("surface", "nonmanifold_edges"): Limit("non-manifold edges", 0, 0, _OPEN),
    ("surface", "degenerate_faces"): Limit("degenerate faces", 0, 100, "they have no normal"),
    ("surface", "self_intersecting_voxels"): Limit(
        "voxels enclosed twice or inside out", 0, 1e9, "the mesh intersects itself there"
    ),
    ("sealed", "genus"): Limit("handles", 0, 0, "it must be a topological sphere"),
    ("sealed", "components"): Limit("parts", 1, 1, "a cell is one piece"),
    ("sealed", "boundary_edges"): Limit("open edges", 0, 0, _OPEN),
    ("reference", "genus"): Limit("handles", 0, 0, "it must be a topological sphere"),
    ("reference", "components"): Limit("parts", 1, 1, "a cell is one piece"),
    ("reference", "boundary_edges"): Limit("open edges", 0, 0, _OPEN),
    ("reference", "radius_ratio_min"): Limit(
        "worst face (radius ratio)", 0.2, 0.05, "thin faces make maps inexact", least=True
    ),
    ("sphere", "conformal_flipped_faces"): Limit("flipped faces (conformal)", 0, 0, _FLIPS),
    ("sphere", "conformal_mean_q"): Limit("mean Q (conformal)", 1.01, 1.05, _Q),
    ("sphere", "flipped_faces"): Limit("flipped faces", 0, 0, _FLIPS),
    ("sphere", "mean_abs_log_lambda"): Limit("mean |log λ|", 0.005, 0.05, _LAMBDA, when=_EQUIAREAL),
    ("uv", "unlocated_pixels"): Limit("pixels without a place", 0, 0, "every pixel has one"),
    ("topography", "folded_fraction"): Limit(
        "cells that would fold (fraction)",
        0,
        0.001,
        "the map ends before them, so that it is one to one",
    ),
    ("topography", "unmapped_fraction"): Limit(
        "vertices without an image (fraction)", 0, 0.001, "they lie outside of the mapped shell"
    ),
    ("topography", "round_trip_fraction"): Limit(
        "vertices that come back within 0.01 voxel", 0.999, 0.99, "there and back", least=True
    ),
    ("topography", "chamfer_voxels"): Limit(
        "distance of S_topo to the surface (voxels)", 0.6, 1.3, "Chamfer distance"
    ),
    ("topography", "area_difference"): Limit(
        "area of S_topo against the surface", 0.04, 0.10, "relative difference", absolute=True
    ),
    ("topography", "volume_difference"): Limit(
        "volume of S_topo against the surface", 0.01, 0.03, "relative difference", absolute=True
    ),
    ("direct", "flipped_faces"): Limit("flipped faces (direct)", 0, 0, _FLIPS),
    ("direct", "mean_abs_log_lambda"): Limit("mean |log λ| (direct)", 0.2, 0.8, _LAMBDA),
    ("direct", "cortex_displacement_p95_rad"): Limit(
        "cortex off its place (95th percentile, rad)",
        0.15,
        0.5,
        "the direct image shows the cortex where the reference's image does",
    ),
    ("plane", "certified"): Limit(
        "certified one to one", 1, 1, "otherwise the plane is refused", least=True
    ),
    ("plane", "flipped_faces"): Limit("flipped faces", 0, 0, _FLIPS),
    ("plane", "covered_once_fraction"): Limit(
        "pixels covered exactly once (fraction)", 1, 1, "one to one", least=True
    ),
    ("plane", "round_trip_fraction"): Limit(
        "vertices that come back within 0.05 pixel", 0.999, 0.99, "there and back", least=True
    ),
    ("protrusions", "parts_difference"): Limit(
        "cortex and protrusions against the cell's volume",
        0.005,
        0.02,
        "the parts are to add up to the cell",
        absolute=True,
    ),
}


# Shown beside the judged numbers: what the cell and its charts are like.
KEY_NUMBERS = {
    ("surface", "vertices"): "vertices",
    ("surface", "area_um2"): "area (µm²)",
    ("surface", "volume_um3"): "volume (µm³)",
    ("sealed", "sealed_parts"): "handles, holes and cavities closed",
    ("reference", "iteration"): "stopped at iteration",
    ("sphere", "blend"): "blend (0 conformal, 1 equiareal)",
    ("topography", "outward_um"): "mapped outwards (µm)",
    ("topography", "inward_um"): "mapped inwards (µm)",
    ("plane", "mean_abs_log_lambda"): "mean |log λ|",
    ("protrusions", "protrusions"): "protrusions",
    ("protrusions", "protrusions_um3"): "volume of all protrusions (µm³)",
}


def quality_rows(quality: Mapping[str, Any]) -> list[Row]:
    """Every number of ``atlas.quality``, in the order of the charts, with its mark."""
    return [
        _row(chart, quantity, value, numbers)
        for chart, numbers in quality.items()
        for quantity, value in _flat(numbers)
    ]


def worst_mark(rows: list[Row]) -> Mark:
    """The worst mark among rows."""
    marks = {row.mark for row in rows}
    order: tuple[Mark, ...] = ("red", "amber", "green")
    return next((mark for mark in order if mark in marks), "")


UNITS = {
    "_per_um": " (1/µm)",
    "_um3": " (µm³)",
    "_um2": " (µm²)",
    "_um": " (µm)",
    "_s": " (s)",
    "_voxels": " (voxels)",
}


def in_words(quantity: str) -> str:
    """The name of a quantity with its unit: ``area_um2`` is "area (µm²)"."""
    for suffix, unit in UNITS.items():
        if quantity.endswith(suffix):
            quantity = quantity.removesuffix(suffix) + unit
            break
    return quantity.replace("_", " ")


def _row(chart: str, quantity: str, value: Any, numbers: Mapping[str, Any]) -> Row:
    limit = LIMITS.get((chart, quantity))
    title = KEY_NUMBERS.get((chart, quantity), in_words(quantity))
    title = limit.title if limit is not None else title
    if limit is not None and any(numbers.get(key, value) != value for key, value in limit.when):
        limit = None
    if limit is None or value is None or isinstance(value, str):
        return Row(chart, quantity, value, title=title)
    number = float(value)
    return Row(chart, quantity, value, limit.mark(number), title, limit.reason(number))


def _flat(numbers: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested names joined by dots; a list of parts counts as their number."""
    for key, value in numbers.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}.")
        elif isinstance(value, list | tuple) and any(isinstance(v, Mapping) for v in value):
            yield name, len(value)
        elif isinstance(value, list | tuple):
            yield name, " ".join(str(v) for v in value)
        else:
            yield name, value
