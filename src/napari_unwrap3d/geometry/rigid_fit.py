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
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from .interpolate import value_at
from .rigid import Rigid

Floats = npt.NDArray[np.float64]

# Beyond so many standard deviations a point counts as one that does not correspond. Tukey's
# constant is 4.7 where errors are rare; what differs only a little here is many points wide, and
# pulls more than leaving out some noise costs.
REJECTED = 3.0
NORMAL_MAD = 1.4826
# The noise is told at so many levels of brightness.
LEVELS = 12
# However little noise there is, blur and interpolation leave differences of this part of the range.
LEAST_SPREAD = 0.005
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
    light : ndarray, (5,)
        Gain, offset and slope (z, y, x) that make the moving volume as bright as the fixed one.
    noise : ndarray, (3,)
        Where the two correspond, what is left has the variance noise[0] + noise[1] × the fixed
        volume's value, of which noise[2] is the least that counts.
    centre : ndarray, (3,)
        Where the slope is 0, in µm.
    radius : float
        Length in µm per which the slope is.
    """

    pose: Rigid
    light: Floats
    noise: Floats
    centre: Floats
    radius: float

    def weights(self, values: Floats, found: Floats, points: Floats) -> Floats:
        """How far (n,) two volumes correspond at points: 1 fully, 0 not at all.

        Parameters
        ----------
        values, found : ndarray, (n,)
            Of the fixed and of the moved volume.
        points : ndarray, (n, 3)
            In µm of the fixed volume's world.
        """
        gain, offset, *slope = self.light
        expected = gain * found + offset + (points - self.centre) @ slope / self.radius
        return _biweight(values - expected, values, self.noise)


def _biweight(wrong: Floats, values: Floats, noise: Floats) -> Floats:
    """Tukey's weights of residuals."""
    level, slope, least = noise
    variance = np.maximum(level + slope * np.maximum(values, least), 1e-24)
    weights: Floats = np.clip(1.0 - wrong**2 / (REJECTED**2 * variance), 0.0, None) ** 2
    return weights


def _noise(wrong: Floats, values: Floats) -> Floats:
    """The variance of residuals, which grows with brightness as that of light does."""
    ends = np.quantile(values, np.linspace(0, 1, LEVELS + 1))
    middles = (ends[1:] + ends[:-1]) / 2
    which = np.clip(np.searchsorted(ends, values, side="right") - 1, 0, LEVELS - 1)
    spread = np.zeros(LEVELS)
    for level in np.unique(which):
        spread[level] = NORMAL_MAD * np.median(np.abs(wrong[which == level]))
    spread = np.hypot(spread, LEAST_SPREAD * (ends[-1] - ends[0]))
    known = spread > 0
    if not known.any():
        return np.array([0.0, 0.0, middles[0]])
    variance = spread[known] ** 2
    brightness = middles[known] - middles[0]
    # Relative errors count, as a spread is known to a part of itself.
    design = np.column_stack([np.ones(len(variance)), brightness]) / variance[:, None]
    (level, slope), _ = nnls(design, np.ones(len(variance)))
    return np.array([level - slope * middles[0], slope, middles[0]])


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
    light, noise = np.array([1.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(3)
    for _ in range(ITERATIONS):
        design[:, count], inside = sampled(moving, origin, edge, samples.points, pose)
        unknowns = solved(*_normal_equations(design, samples.values, np.where(inside, weights, 0)))
        if unknowns is None:
            break
        light = unknowns[count:]
        wrong = samples.values - design @ unknowns
        noise = _noise(wrong[inside], samples.values[inside])
        weights = _biweight(wrong, samples.values, noise)
        step = unknowns[:count].copy()
        length = float(np.linalg.norm(step))
        step *= min(1.0, LONGEST_STEP * edge / max(length, 1e-12))
        pose = moved_back(step, centre, radius) @ pose
        if length < CONVERGED * edge:
            break
    return Fit(pose, light, noise, centre, radius)


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


def moved_back(step: Floats, centre: Floats, radius: float) -> Rigid:
    """The motion that undoes a displacement by a shift and, divided by the radius, a rotation."""
    turn = np.zeros(3) if len(step) == 3 else step[3:] / radius
    return Rigid.about(centre, Rotation.from_rotvec(-turn).as_matrix(), -step[:3])


def solved(normal: Floats, right: Floats) -> Floats | None:
    """Solve normal equations; None where there is not enough to go by."""
    size = np.sqrt(np.abs(np.diag(normal)))
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
        values[n] = value_at(volume, z, y, x) if inside[n] else 0.0
