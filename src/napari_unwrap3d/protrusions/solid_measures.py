"""What a protrusion measures as a solid: its volume, base, necks, extents."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import ConvexHull

from ..charts import Floats, Ints
from ..geometry.distance import distance_to

Labels = npt.NDArray[np.int32]
Solid = npt.NDArray[np.bool_]

# In voxels: how smooth the cortex is whose normals the base has, and what that reaches.
NORMAL_SMOOTHING, AROUND = 2.0, 9
SECTIONS_AVERAGED = 3
# Of the axes of an ellipsoid, against the standard deviation along them.
AXIS_PER_DEVIATION = 2 * math.sqrt(5)

EMPTY: dict[str, float] = {
    "volume_um3": 0.0,
    "base_area_um2": 0.0,
    "width_um": 0.0,
    "neck_um": 0.0,
    "base_elongation": np.nan,
    "length_um": 0.0,
    "breadth_um": 0.0,
    "thickness_um": 0.0,
    "sheetness": np.nan,
    "solidity": np.nan,
    "axis_z": np.nan,
    "axis_y": np.nan,
    "axis_x": np.nan,
}


def measure_solids(
    volume: Labels, cortex: Solid, voxel_um: float, labels: Ints
) -> dict[str, Floats]:
    """Measures of labelled solids on a cortex.

    Parameters
    ----------
    volume : ndarray, (z, y, x) int32
        0 = none.
    cortex : ndarray, (z, y, x) bool
        Where `volume` is 0.
    voxel_um : float
        Edge of a voxel.
    labels : ndarray, (k,) int64
        Which to measure; they need not be there.

    Returns
    -------
    dict of str to ndarray, (k,)
        The columns of :data:`EMPTY`; see :data:`.columns.COLUMNS`.
    """
    boxes = ndimage.find_objects(volume, max_label=int(labels.max(initial=0)))
    rows = []
    for label in labels:
        box = boxes[label - 1]
        if box is None:
            rows.append(EMPTY)
            continue
        around = tuple(
            slice(max(part.start - AROUND, 0), min(part.stop + AROUND, size))
            for part, size in zip(box, volume.shape, strict=True)
        )
        rows.append(_measure(volume[around] == label, cortex[around], voxel_um))
    return {name: np.array([row[name] for row in rows], dtype=np.float64) for name in EMPTY}


def _measure(solid: Solid, cortex: Solid, voxel_um: float) -> dict[str, float]:
    """Of one solid, on a part of the grid around it."""
    points = np.argwhere(solid).astype(np.float64)
    base = _base(solid, cortex)
    widths = 2 * np.sqrt(_sections(solid, base) / math.pi)
    extents = AXIS_PER_DEVIATION * _deviations(points)
    length, breadth, thickness = extents.tolist()
    axis = _axis(points, base)
    return {
        "volume_um3": len(points) * voxel_um**3,
        "base_area_um2": base.area * voxel_um**2,
        "width_um": 2 * math.sqrt(base.area / math.pi) * voxel_um,
        "neck_um": float(widths[: int(widths.argmax()) + 1].min()) * voxel_um,
        "base_elongation": _elongation(base),
        "length_um": length * voxel_um,
        "breadth_um": breadth * voxel_um,
        "thickness_um": thickness * voxel_um,
        "sheetness": (breadth - thickness) / length,
        "solidity": len(points) / _hull_volume(solid),
        "axis_z": axis[0],
        "axis_y": axis[1],
        "axis_x": axis[2],
    }


@dataclass(frozen=True, eq=False)
class _Base:
    """The faces between a solid's voxels and the cortex's.

    Attributes
    ----------
    voxels : ndarray, (z, y, x) bool
        The solid's voxels with such a face.
    centres : ndarray, (n, 3)
        Of the faces.
    areas : ndarray, (n,)
        In voxels².
    normal : ndarray, (3,)
        Sum of the faces' normals out of the cortex.
    """

    voxels: Solid
    centres: Floats
    areas: Floats
    normal: Floats

    @property
    def area(self) -> float:
        return float(self.areas.sum())

    @property
    def middle(self) -> Floats:
        middle: Floats = self.areas @ self.centres / self.area
        return middle


def _base(solid: Solid, cortex: Solid) -> _Base:
    """Where a solid stands on the cortex.

    Faces between voxels make stairs, whose area is up to √3 times that of the plane they
    follow: every face counts by its projection along the cortex's normal.
    """
    voxels = np.zeros_like(solid)
    smooth = ndimage.gaussian_filter(cortex.astype(np.float64), NORMAL_SMOOTHING)
    normals = -np.stack(np.gradient(smooth))
    centres, areas, total = [], [], np.zeros(3)
    for axis in range(3):
        here, there = [slice(None)] * 3, [slice(None)] * 3
        here[axis], there[axis] = slice(1, None), slice(None, -1)
        for upper, lower, sign in ((here, there, 1), (there, here, -1)):
            # The solid lies on the side `upper` of the face, the cortex on the other.
            a, b = tuple(upper), tuple(lower)
            faces = solid[a] & cortex[b]
            voxels[a] |= faces
            at = 0.5 * (normals[(slice(None), *a)][:, faces] + normals[(slice(None), *b)][:, faces])
            size = np.linalg.norm(at, axis=0)
            along = np.divide(at[axis], size, out=np.zeros_like(size), where=size > 0)
            areas.append(np.clip(sign * along, 0.0, None))
            centres.append(np.argwhere(faces) + 0.5 * np.eye(3)[axis])
            total[axis] += sign * int(faces.sum())
    return _Base(voxels, np.concatenate(centres), np.concatenate(areas), total)


def _sections(solid: Solid, base: _Base) -> Floats:
    """Areas in voxels² of the cross sections from the base outwards."""
    if not base.voxels.any():
        return np.zeros(1)
    shell = np.rint(distance_to(base.voxels)[solid]).astype(np.int64)
    # The base's own voxels follow its stairs: its area is known better.
    counts = np.bincount(shell)[1:].astype(np.float64)
    if len(counts) < SECTIONS_AVERAGED:
        return np.array([base.area, *counts])
    mean = np.convolve(counts, np.full(SECTIONS_AVERAGED, 1 / SECTIONS_AVERAGED), mode="valid")
    return np.array([base.area, *mean])


def _deviations(points: Floats, weights: Floats | None = None) -> Floats:
    """Standard deviations of cubes of edge 1 along their principal axes, largest first."""
    part = np.full(len(points), 1 / len(points)) if weights is None else weights / weights.sum()
    apart = points - part @ points
    covariance = (apart * part[:, None]).T @ apart + np.eye(3) / 12.0
    deviations: Floats = np.sqrt(np.linalg.eigvalsh(covariance)[::-1])
    return deviations


def _elongation(base: _Base) -> float:
    if base.area <= 0:
        return np.nan
    first, second, _ = _deviations(base.centres, base.areas)
    return float(first / second)


def _axis(points: Floats, base: _Base) -> Floats:
    """Unit vector out of the cortex; NaN for a solid that does not touch it."""
    outward = base.normal
    if base.area > 0:
        chord = points.mean(axis=0) - base.middle
        outward = chord if chord @ chord > 1.0 else outward
    length = float(np.linalg.norm(outward))
    return outward / length if length > 0 else np.full(3, np.nan)


def _hull_volume(solid: Solid) -> float:
    """Volume in voxels of the convex hull of the centres of all faces of a solid's voxels.

    The hull of the voxels' corners, or of their centres, is up to a third too large, or too
    small, for a tube of a few voxels.
    """
    ends = []
    for axis in range(3):
        # In every line the two ends are enough.
        lines = np.moveaxis(solid, axis, 2)
        a, b = np.nonzero(lines.any(axis=2))
        first = lines[a, b].argmax(axis=1) - 0.5
        last = lines.shape[2] - lines[a, b, ::-1].argmax(axis=1) - 0.5
        line = np.column_stack([a, b]).astype(np.float64)
        ends += [np.insert(line, axis, first, axis=1), np.insert(line, axis, last, axis=1)]
    return float(ConvexHull(np.concatenate(ends)).volume)
