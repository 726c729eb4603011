"""Annotations as plain data: what a project keeps, and what moves to another atlas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import ParameterError
from .charts import nearest_corners
from .lookup import Labels
from .shapes import Overhang, Shape

if TYPE_CHECKING:
    from ..atlas import Atlas
    from .annotations import Annotations

Colour = tuple[float, float, float, float]
Position = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Drawn:
    """What was drawn in one annotation.

    Attributes
    ----------
    name : str
    labels : ndarray, (n,) uint16
        Painted, per vertex of the surface.
    image : ndarray, (N, 2N) uint16, or None
        Painted, per pixel of uv, where that keeps what was drawn there.
    shapes : tuple of Shape
    colours : mapping of int to (r, g, b, a)
    """

    name: str
    labels: Labels
    image: Labels | None = None
    shapes: tuple[Shape, ...] = ()
    colours: Mapping[int, Colour] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class DrawnInTime:
    """What was drawn in one annotation of a movie that is another one at every timepoint.

    Attributes
    ----------
    name : str
    drawn : mapping of int to Drawn
        By timepoint; those without anything drawn are left out.
    colours : mapping of int to (r, g, b, a)
    """

    name: str
    drawn: Mapping[int, Drawn]
    colours: Mapping[int, Colour] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class State:
    """Everything that was drawn on a cell.

    Attributes
    ----------
    drawn : tuple of Drawn
    points : mapping of str to (z, y, x)
        In µm.
    overhang : str
        "column" or "outermost".
    axis : (z, y, x) or None
        The axis of lateral speeds, a unit vector.
    timed : tuple of DrawnInTime
        Of a movie; these are kept with the movie, not in a project.
    """

    drawn: tuple[Drawn, ...] = ()
    points: Mapping[str, Position] = field(default_factory=dict)
    overhang: Overhang = "column"
    axis: Position | None = None
    timed: tuple[DrawnInTime, ...] = ()


def checked_axis(direction: npt.ArrayLike | None) -> Position | None:
    """A direction as a unit vector; None stays None.

    Raises
    ------
    ParameterError
        It is no direction (z, y, x).
    """
    if direction is None:
        return None
    vector = np.asarray(direction, dtype=np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not np.isfinite(length) or length <= 0:
        raise ParameterError("An axis has three components (z, y, x), and not only zeros.")
    if abs(length - 1.0) > 1e-12:  # else it comes back from a file as it was
        vector = vector / length
    z, y, x = vector.tolist()
    return z, y, x


def moved(annotations: Annotations, atlas: Atlas) -> State:
    """What was drawn, as it is to be on another atlas of the same cell.

    What was drawn stays on the surface: where its mesh is another, every vertex takes the
    label of the nearest one. Images and shapes stay as they are on charts that are the same;
    shapes on others become painted labels.
    """
    old, state = annotations.atlas, annotations.state()
    same = {name: _same(old, atlas, name) for name in ("surface", "uv", "direct", "plane")}
    same["volume"] = True
    nearest = None
    if not same["surface"]:
        face, weights, _ = old._surface_locator.closest(atlas.surface.vertices)
        nearest = nearest_corners(old.surface.faces, face, weights)
    drawn = []
    for part in state.drawn:
        labels, image = part.labels, part.image
        for shape in part.shapes:
            if not same[shape.chart]:
                labels[annotations.marked_by(shape)] = shape.label
                image = None
        drawn.append(
            Drawn(
                part.name,
                labels if nearest is None else labels[nearest],
                image if same["uv"] and same["surface"] else None,
                tuple(shape for shape in part.shapes if same[shape.chart]),
                part.colours,
            )
        )
    timed = state.timed if same["uv"] and same["surface"] else ()
    return State(tuple(drawn), state.points, state.overhang, state.axis, timed)


# What a chart's pixels depend on.
PARTS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "surface": (("surface", "vertices"), ("surface", "faces")),
    "uv": (("uv", "face"), ("topography", "surface")),
    "direct": (("direct", "owner"),),
    "plane": (("plane", "face"),),
}


def _same(old: Atlas, new: Atlas, chart: str) -> bool:
    """Whether two atlases have the same chart, or both do not."""
    for name, part in PARTS[chart]:
        if old.has(name) != new.has(name):
            return False
        if old.has(name):
            one, other = (_part(atlas, name, part) for atlas in (old, new))
            if one is not other and not np.array_equal(one, other, equal_nan=True):
                return False
    return True


def _part(atlas: Atlas, chart: str, part: str) -> Any:
    return getattr(getattr(atlas, chart), part)
