"""Shapes that stay editable: polygons on an image, boxes and half-spaces in space, and points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..errors import ParameterError

Overhang = Literal["column", "outermost"]
OVERHANGS: tuple[Overhang, ...] = ("column", "outermost")
FLAT_KINDS = ("polygon", "rectangle", "ellipse")
SPACE_KINDS = ("box", "half-space")
FLAT_CHARTS = ("uv", "direct", "plane")
LARGEST_LABEL = 65535
ELLIPSE_CORNERS = 256
BESIDE = 0.05


@dataclass(frozen=True, eq=False)
class Shape:
    """A region that marks what lies in it for as long as it is there.

    Attributes
    ----------
    chart : str
        "uv", "direct" or "plane", or "volume" for regions in space.
    kind : str
        "polygon", "rectangle" or "ellipse" on an image; "box" or "half-space" in space.
    vertices : ndarray
        On an image (k, 2) as (v, u) in pixels: the corners, and of an ellipse the four
        corners of the rectangle around it. They may lie up to a turn beyond the seam and
        half a turn over a pole. In space (2, 3) as (z, y, x) in µm: two opposite corners
        of a box; a point of the border of a half-space, and the direction into it.
    label : int
        0 to 65535.
    overhang : str
        What a shape in uv marks: the whole "column" or the "outermost" sheet of it.
    """

    chart: str
    kind: str
    vertices: Floats
    label: int
    overhang: Overhang = "column"

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64)
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "label", check_label(self.label))
        self._check()

    def _check(self) -> None:
        kinds = SPACE_KINDS if self.chart == "volume" else FLAT_KINDS
        if self.chart not in (*FLAT_CHARTS, "volume") or self.kind not in kinds:
            raise ParameterError(
                f"There is no {self.kind!r} in {self.chart!r}.",
                hint="Draw polygons, rectangles and ellipses in uv, direct and plane; boxes "
                "and half-spaces in the volume.",
            )
        checked_overhang(self.overhang)
        shape = self.vertices.shape
        if self.chart == "volume":
            good = shape == (2, 3)
        else:
            good = len(shape) == 2 and shape[1] == 2 and shape[0] >= 3
            good = good and (self.kind == "polygon" or shape[0] == 4)
        if not good or not np.isfinite(self.vertices).all():
            raise ParameterError(
                f"The vertices of a {self.kind} are not these.",
                shape=shape,
                hint="A polygon has three or more (v, u), a rectangle or an ellipse four; a "
                "box or half-space two (z, y, x).",
            )

    def plain(self) -> dict[str, Any]:
        """As what JSON can hold."""
        return {
            "chart": self.chart,
            "kind": self.kind,
            "vertices": self.vertices.tolist(),
            "label": self.label,
            "overhang": self.overhang,
        }

    @classmethod
    def from_plain(cls, given: Mapping[str, Any]) -> Shape:
        """Undo :meth:`plain`."""
        return cls(
            str(given["chart"]),
            str(given["kind"]),
            np.asarray(given["vertices"], dtype=np.float64),
            given["label"],
            given["overhang"],
        )


def checked_overhang(value: str) -> Overhang:
    """Whether drawing in uv marks the whole column, or only its outermost sheet.

    Raises
    ------
    ParameterError
        It is neither "column" nor "outermost".
    """
    for known in OVERHANGS:
        if value == known:
            return known
    raise ParameterError(f"Overhangs are drawn as {' or '.join(OVERHANGS)}, not {value!r}.")


def check_label(label: Any) -> int:
    """A label as int.

    Raises
    ------
    ParameterError
        It is no whole number of 0 to 65535.
    """
    if isinstance(label, bool) or not isinstance(label, int | np.integer):
        raise ParameterError(f"A label is a whole number, not {label!r}.")
    if not 0 <= label <= LARGEST_LABEL:
        raise ParameterError(
            "A label is out of its range.", label=int(label), largest=LARGEST_LABEL
        )
    return int(label)


def pixels_inside(shape: Shape, rows: int) -> Ints:
    """Flat indices, sorted, of the pixels of an image (N, 2N) whose centres lie in a shape.

    What reaches over the seam or a pole is continued there.

    Raises
    ------
    ParameterError
        It reaches more than a turn beyond the seam or half a turn over a pole.
    """
    from skimage.draw import polygon

    corners, (low, high) = shape.vertices, check_reach(shape, rows)
    if shape.kind == "ellipse":
        corners = _ellipse(corners)
    v, u = polygon(corners[:, 0] - low[0], corners[:, 1] - low[1], tuple(high - low))
    return np.unique(wrapped(v + low[0], u + low[1], rows))


def check_reach(shape: Shape, rows: int) -> tuple[Ints, Ints]:
    """The lowest and the highest (v, u) that a shape on an image (N, 2N) may reach.

    Raises
    ------
    ParameterError
        It reaches beyond.
    """
    low, high = np.array([-rows, -2 * rows]), np.array([2 * rows, 4 * rows])
    corners = shape.vertices
    if (corners < low).any() or (corners >= high).any():
        raise ParameterError(
            "A shape reaches too far beyond the image.",
            lowest=tuple(float(c) for c in corners.min(axis=0)),
            highest=tuple(float(c) for c in corners.max(axis=0)),
            hint="Keep it within one turn of the seam and half a turn of a pole.",
        )
    return low, high


def wrapped(v: npt.NDArray[Any], u: npt.NDArray[Any], rows: int) -> Ints:
    """Flat indices of pixels (v, u) of which some lie beyond the seam or a pole."""
    v = np.mod(v, 2 * rows)
    beyond = v >= rows
    v = np.where(beyond, 2 * rows - 1 - v, v)
    u = np.mod(np.where(beyond, u + rows, u), 2 * rows)
    return np.asarray(v * 2 * rows + u, np.int64)


def _ellipse(corners: Floats) -> Floats:
    """The ellipse in a rectangle (4, 2), as a polygon."""
    turn = np.linspace(0.0, 2.0 * np.pi, ELLIPSE_CORNERS, endpoint=False)[:, None]
    one, other = 0.5 * (corners[1] - corners[0]), 0.5 * (corners[3] - corners[0])
    centre = corners.mean(axis=0)
    return np.asarray(centre + np.cos(turn) * one + np.sin(turn) * other)


def vertices_inside(shape: Shape, vertices: Floats) -> Ints:
    """Those of vertices (n, 3) in µm that lie in a box or half-space."""
    first, second = shape.vertices
    if shape.kind == "box":
        low, high = np.minimum(first, second), np.maximum(first, second)
        inside = ((vertices >= low) & (vertices <= high)).all(axis=1)
    else:
        inside = (vertices - first) @ second >= 0
    return np.flatnonzero(inside)


def edges_in_space(shape: Shape, low: Floats, high: Floats) -> Floats:
    """The edges (12, 2, 3) of a box; of a half-space those of its part of a cell's box.

    Parameters
    ----------
    shape : Shape
        A box, or a half-space along one of the axes.
    low, high : ndarray, (3,)
        Corners of the cell's box, in µm; the edges of a half-space lie a little outside it.
    """
    corners = np.sort(shape.vertices, axis=0)
    if shape.kind == "half-space":
        point, inwards = shape.vertices
        axis, room = int(np.abs(inwards).argmax()), BESIDE * float((high - low).max())
        corners = np.stack([low - room, high + room])
        corners[0 if inwards[axis] > 0 else 1, axis] = point[axis]
    ends = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for sides in ((0, 0), (0, 1), (1, 0), (1, 1)):
            edge = corners.copy()
            edge[:, others] = [corners[side, k] for side, k in zip(sides, others, strict=True)]
            ends.append(edge)
    return np.array(ends)
