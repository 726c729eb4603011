"""From smooth shapes to voxels: signed distances, smooth unions, labels, topology.

Fields are negative inside and in µm, nearly distances where they change sign. The
smooth union is the polynomial one of Quilez (https://iquilezles.org/articles/smin).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.interpolate import make_interp_spline

from ..charts import Floats
from .bodies import Body
from .protrusions import Shape

Field = npt.NDArray[np.float32]
Solid = npt.NDArray[np.bool_]
Box = tuple[slice, slice, slice]

BODY_STEP = 3  # voxels between the nodes on which the body is evaluated
NOISE_STEP = 5


@dataclass(frozen=True, eq=False)
class Solids:
    """A cell on the working grid.

    Attributes
    ----------
    field : ndarray, (z, y, x) float32
        Signed distance in µm to the cell's surface, negative inside.
    mask, body : ndarray, (z, y, x) bool
        The cell; the body alone, without protrusions and without holes.
    labels : ndarray, (z, y, x) int32
        k + 1 in the mask outside the body where protrusion k is the nearest, else 0.
    """

    field: Field
    mask: Solid
    body: Solid
    labels: npt.NDArray[np.int32]


def build(
    body: Body,
    protrusions: Sequence[Shape],
    holes: Sequence[Shape],
    size: int,
    voxel_um: float,
    displacement: Field | None = None,
    report: Callable[[float], None] = lambda fraction: None,
) -> Solids:
    """Unite the body with the protrusions and cut the holes.

    `displacement` (z, y, x) in µm moves the boundary of the cell and of the body outward.
    """
    field = body_field(body, size, voxel_um)
    solid_body = _inside(field, displacement)
    union = Union.of(field)
    for number, shape in enumerate(protrusions, start=1):
        union.add(number, shape, *shape_field(shape, field.shape, voxel_um))
        report(number / len(protrusions))
    for shape in holes:
        box, distance = shape_field(shape, field.shape, voxel_um)
        field[box] = -smooth_minimum(-field[box], distance, shape.blend_um)
    mask = _inside(field, displacement)
    if displacement is not None:
        field -= displacement
    return Solids(field, mask, solid_body, union.labels(mask, solid_body))


@dataclass(frozen=True, eq=False)
class Union:
    """A field while shapes are united with it, and which of them is the nearest."""

    field: Field
    owner: npt.NDArray[np.int32]
    nearest: Field

    @classmethod
    def of(cls, field: Field) -> Union:
        """Without any shape yet; `field` is changed in place."""
        return cls(field, np.zeros(field.shape, np.int32), np.full_like(field, np.inf))

    def add(self, number: int, shape: Shape, box: Box, distance: Field) -> None:
        """Unite with a shape, whose distances in a box are given."""
        self.field[box] = smooth_minimum(self.field[box], distance, shape.blend_um)
        closer = distance < self.nearest[box]
        self.nearest[box][closer] = distance[closer]
        self.owner[box][closer] = number

    def labels(self, mask: Solid, body: Solid) -> npt.NDArray[np.int32]:
        """The nearest shape's number in the mask outside the body, else 0."""
        self.owner[~mask | body] = 0
        return self.owner


def _inside(field: Field, displacement: Field | None) -> Solid:
    inside: Solid = field < (0.0 if displacement is None else displacement)
    return inside


def body_field(body: Body, size: int, voxel_um: float) -> Field:
    """The body's signed distance, to first order, on a cubic grid of `size` voxels.

    Evaluated on every third voxel and interpolated by cubic splines.
    """
    nodes = np.arange(-BODY_STEP, size + 2 * BODY_STEP, BODY_STEP)
    axis = nodes * voxel_um
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    level = np.concatenate([body.level(plane)[None] for plane in points])
    slopes = np.gradient(level, BODY_STEP * voxel_um)
    steepness = np.sqrt(sum(slope**2 for slope in slopes))
    distance = level / np.clip(steepness, 0.7, 3.0)
    return refined(distance, nodes, size)


def smooth_noise(rng: np.random.Generator, size: int, step: int = NOISE_STEP) -> Field:
    """Noise (size, size, size) of unit variance that is smooth over `step` voxels."""
    nodes = np.arange(-step, size + 2 * step, step)
    noise = refined(rng.normal(size=(len(nodes),) * 3), nodes, size)
    unit: Field = noise / noise.std()
    return unit


def refined(values: Floats, nodes: npt.NDArray[np.int64], size: int) -> Field:
    """Cubic spline interpolation from nodes (on all three axes) to all voxels."""
    weights = make_interp_spline(nodes, np.eye(len(nodes)), k=3)(np.arange(size))
    return weighted(values, [weights] * 3)


def weighted(values: npt.NDArray[np.floating], weights: Sequence[Floats]) -> Field:
    """Weighted sums along each axis, with weights (new length, length) that are mostly zero.

    Sparse products, whose result does not depend on the number of threads.
    """
    result = values.astype(np.float32)
    for matrix in weights:  # each turn replaces the first axis and makes it the last
        kept = np.where(np.abs(matrix) > 1e-7, matrix, 0.0).astype(np.float32)
        rest = result.shape[1:]
        sums = sparse.csr_array(kept) @ result.reshape(len(result), -1)
        result = np.ascontiguousarray(np.moveaxis(sums.reshape(-1, *rest), 0, -1))
    return result


def shape_field(
    shape: Shape, grid: tuple[int, ...], voxel_um: float, reach_um: float = 0.0
) -> tuple[Box, Field]:
    """A box around a swept shape, and the distance in µm to it there, cut off far from it.

    The box reaches as far as the shape blends into others, or `reach_um` where that is more.
    """
    reach = max(shape.blend_um + 2 * voxel_um, reach_um)
    around = (shape.radii + reach)[:, None]
    low = np.floor((shape.points - around).min(axis=0) / voxel_um).astype(int)
    high = np.ceil((shape.points + around).max(axis=0) / voxel_um).astype(int) + 1
    low, high = np.maximum(low, 0), np.minimum(high, grid)
    box = (slice(low[0], high[0]), slice(low[1], high[1]), slice(low[2], high[2]))
    distance = np.full(tuple(np.maximum(high - low, 0)), reach, np.float32)
    _sweep(distance, shape.points - low * voxel_um, shape.radii, reach, voxel_um)
    return box, distance


@numba.njit(nogil=True, cache=True)
def _sweep(distance, points, radii, reach, voxel):  # type: ignore[no-untyped-def]
    """Lower `distance` to the distance to the nearest ball, for every ball in turn."""
    depth, height, width = distance.shape
    for n in range(len(points)):
        z, y, x = points[n] / voxel
        radius = radii[n]
        extent = (radius + reach) / voxel
        for i in range(max(0, int(np.ceil(z - extent))), min(depth, int(z + extent) + 1)):
            for j in range(max(0, int(np.ceil(y - extent))), min(height, int(y + extent) + 1)):
                plane = (i - z) ** 2 + (j - y) ** 2
                span = extent * extent - plane
                if span < 0:
                    continue
                span = np.sqrt(span)
                for k in range(max(0, int(np.ceil(x - span))), min(width, int(x + span) + 1)):
                    squared = (plane + (k - x) ** 2) * voxel * voxel
                    best = distance[i, j, k] + radius
                    if best > 0 and squared < best * best:
                        distance[i, j, k] = np.sqrt(squared) - radius


def smooth_minimum(a: Field, b: Field, width: float) -> Field:
    """The minimum of two fields, rounded off where they differ by less than `width`."""
    overlap = np.maximum(np.float32(width) - np.abs(a - b), np.float32(0))
    smooth: Field = np.minimum(a, b) - overlap * overlap * np.float32(0.25 / width)
    return smooth


def genus(solid: Solid) -> int | None:
    """Number of handles of a solid; None where it is not one clean solid.

    Clean means: one component, no cavity, and the same number of handles whether voxels
    touch by faces only or also by edges and corners.
    """
    occupied = ndimage.find_objects(solid.view(np.uint8))
    if not occupied:
        return None
    crop = np.pad(solid[occupied[0]], 1)
    if ndimage.label(crop)[1] != 1 or ndimage.label(~crop)[1] != 1:
        return None
    closed = _euler(crop, np.logical_or)
    # With voxels as points and cubes between them the same sum counts 6-connectivity.
    opened = _euler(crop, np.logical_and)
    return 1 - closed if closed == opened else None


def _euler(solid: Solid, combine: Callable[[Solid, Solid], Solid]) -> int:
    """Corners − edges + faces − cubes of the union of closed cubes, or of its dual."""
    dual = combine is np.logical_and
    total = 0
    for joined in range(8):  # the axes along which neighbours are combined, as bits
        part = solid
        for axis in range(3):
            if joined >> axis & 1:
                lower = (slice(None),) * axis + (slice(None, -1),)
                upper = (slice(None),) * axis + (slice(1, None),)
                part = combine(part[lower], part[upper])
        dimension = joined.bit_count() if dual else 3 - joined.bit_count()
        total += (-1) ** dimension * int(np.count_nonzero(part))
    return total
