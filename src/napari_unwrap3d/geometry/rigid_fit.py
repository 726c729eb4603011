"""The rigid motion of one volume onto another, when parts of them do not correspond.

Gauss-Newton steps on the squared difference of the two volumes, in which points that do not
fit lose their weight (iteratively reweighted least squares with Tukey's biweight; Beaton and
Tukey 1974, doi:10.1080/00401706.1974.10489171). The moving volume may be brighter or darker
as a whole, and have another background, level or sloping: gain, offset and slope are unknowns
beside the motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from .rigid import Rigid

Floats = npt.NDArray[np.float64]

# Tukey's constant: 95 % efficient with normal errors.
REJECTED = 4.685
NORMAL_MAD = 1.4826
ITERATIONS = 60
# Iterations end when no point within the radius moves by this part of a voxel.
CONVERGED = 2e-4
# A step is never longer than this many voxels, as the linearisation holds no farther.
LONGEST_STEP = 2.0


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted motion.

    Attributes
    ----------
    pose : Rigid
        From the moving volume's world to the fixed one's.
    weights : ndarray, (n,)
        Of the points, 0 to 1; 0 where the volumes do not correspond.
    iterations : int
    """

    pose: Rigid
    weights: Floats
    iterations: int


@dataclass(frozen=True, eq=False)
class Samples:
    """Points at which the fixed volume is compared with the moving one.

    Attributes
    ----------
    points : ndarray, (n, 3)
        (z, y, x) in µm.
    values : ndarray, (n,)
        Of the fixed volume.
    gradients : ndarray, (n, 3)
        Of the fixed volume, per µm.
    """

    points: Floats
    values: Floats
    gradients: Floats


def fit_motion(
    samples: Samples,
    moving: npt.NDArray[np.float32],
    origin: npt.ArrayLike,
    edge: float,
    start: Rigid,
    *,
    rotate: bool,
) -> Fit:
    """Refine a motion that is right to within the width of the volumes' edges.

    Parameters
    ----------
    samples : Samples
        Of the fixed volume.
    moving : ndarray, (z, y, x) float32
        Smooth over a few voxels.
    origin : (float, float, float)
        Centre of its first voxel in µm.
    edge : float
        Of its voxels in µm.
    start : Rigid
    rotate : bool
        Whether the rotation is fitted, too.

    Returns
    -------
    Fit
        The motion where it does not change any more. The same on any number of threads.
    """
    centre = samples.points.mean(axis=0)
    offset = samples.points - centre
    radius = float(np.sqrt((offset**2).sum(axis=1).mean()))
    motions = [samples.gradients]
    if rotate:
        motions.append(np.cross(offset, samples.gradients) / radius)
    count = 3 * len(motions)
    ones = np.ones(len(offset))
    # Unknowns: the motion, the gain of what is found in the moving volume, offset and slope.
    design = np.column_stack([*motions, ones, ones, offset / radius])
    pose, weights = start, ones
    for iteration in range(1, ITERATIONS + 1):
        design[:, count], inside = sampled(moving, origin, edge, samples.points, pose)
        weighing = np.where(inside, weights, 0.0)
        unknowns = _solved(design, samples.values, weighing)
        if unknowns is None:
            return Fit(pose, weighing, iteration)
        wrong = np.abs(samples.values - design @ unknowns)
        spread = NORMAL_MAD * float(np.median(wrong[inside]))
        weights = np.clip(1.0 - (wrong / max(REJECTED * spread, 1e-12)) ** 2, 0.0, None) ** 2
        step = unknowns[:count].copy()
        length = float(np.linalg.norm(step))
        step *= min(1.0, LONGEST_STEP * edge / max(length, 1e-12))
        pose = _step(step, centre, radius) @ pose
        if length < CONVERGED * edge:
            break
    return Fit(pose, np.where(inside, weights, 0.0), iteration)


def sampled(
    moving: npt.NDArray[np.float32],
    origin: npt.ArrayLike,
    edge: float,
    points: Floats,
    pose: Rigid,
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """What a motion brings to points: trilinear values (n,), 0 outside, and what is inside.

    Parameters
    ----------
    moving : ndarray, (z, y, x) float32
    origin : (float, float, float)
        Centre of its first voxel in µm.
    edge : float
        Of its voxels in µm.
    points : ndarray, (n, 3)
        In µm of the fixed volume's world.
    pose : Rigid
        From the moving volume's world to the fixed one's.
    """
    back = pose.inverse()
    offset = (back.translation - np.asarray(origin, float)) / edge
    values, inside = np.empty(len(points)), np.empty(len(points), bool)
    _sample(moving, np.ascontiguousarray(back.rotation / edge), offset, points, values, inside)
    return values, inside


def _step(step: Floats, centre: Floats, radius: float) -> Rigid:
    turn = np.zeros(3) if len(step) == 3 else step[3:] / radius
    # Rotation vectors are the same about (z, y, x) axes as long as all of it is in this order;
    # what seems displaced by the step is moved back by it.
    return Rigid.about(centre, Rotation.from_rotvec(-turn).as_matrix(), -step[:3])


def _solved(design: Floats, values: Floats, weights: Floats) -> Floats | None:
    """Least squares with weights; None where there is not enough to go by."""
    normal, right = _normal_equations(design, values, weights)
    size = np.sqrt(np.diag(normal))
    if not (size > 0).all():
        return None
    unknowns: Floats = np.linalg.lstsq(normal / np.outer(size, size), right / size, 1e-9)[0] / size
    return unknowns if np.isfinite(unknowns).all() else None


# Compiled: one order of summation, whatever the number of threads.


@numba.njit(nogil=True, cache=True)
def _normal_equations(design, values, weights):  # type: ignore[no-untyped-def]
    count, columns = design.shape
    normal = np.zeros((columns, columns))
    right = np.zeros(columns)
    for n in range(count):
        weight = weights[n]
        if weight == 0.0:
            continue
        for i in range(columns):
            scaled = weight * design[n, i]
            right[i] += scaled * values[n]
            for j in range(i + 1):
                normal[i, j] += scaled * design[n, j]
    for i in range(columns):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return normal, right


@numba.njit(nogil=True, cache=True)
def _sample(volume, matrix, offset, points, values, inside):  # type: ignore[no-untyped-def]
    nz, ny, nx = volume.shape
    for n in range(points.shape[0]):
        p, q, r = points[n, 0], points[n, 1], points[n, 2]
        z = matrix[0, 0] * p + matrix[0, 1] * q + matrix[0, 2] * r + offset[0]
        y = matrix[1, 0] * p + matrix[1, 1] * q + matrix[1, 2] * r + offset[1]
        x = matrix[2, 0] * p + matrix[2, 1] * q + matrix[2, 2] * r + offset[2]
        inside[n] = 0 <= z <= nz - 1 and 0 <= y <= ny - 1 and 0 <= x <= nx - 1
        if not inside[n]:
            values[n] = 0.0
            continue
        a, b, c = min(int(z), nz - 2), min(int(y), ny - 2), min(int(x), nx - 2)
        fz, fy, fx = z - a, y - b, x - c
        low = (volume[a, b, c] * (1 - fx) + volume[a, b, c + 1] * fx) * (1 - fy) + (
            volume[a, b + 1, c] * (1 - fx) + volume[a, b + 1, c + 1] * fx
        ) * fy
        high = (volume[a + 1, b, c] * (1 - fx) + volume[a + 1, b, c + 1] * fx) * (1 - fy) + (
            volume[a + 1, b + 1, c] * (1 - fx) + volume[a + 1, b + 1, c + 1] * fx
        ) * fy
        values[n] = low * (1 - fz) + high * fz
