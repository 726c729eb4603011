"""Move the vertices of a spherical mesh to wanted places: turned as one, then smoothly, no flip."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from ..progress import Progress
from .distortion import spherical_determinants
from .fit import nearest_rotations
from .laplacian import Floats, Ints, ReusedFactor, cotangent_laplacian, vertex_mass
from .mesh import unit

KABSCH_ITERATIONS = 30
SAME_ROTATION = 1e-12
# Details of the displacement smaller than this many radians are smoothed away, first and last:
# finer ones are those of the targets' own mesh.
SMOOTHNESSES = (0.5, 0.25)
ITERATIONS = 4
# A step may shrink a face's determinant to this fraction at the most.
KEPT_DETERMINANT = 0.3
HALVINGS = 12
# A median below this many radians counts as one place.
LEAST_ANGLE = 1e-6


def angles(one: Floats, other: Floats) -> Floats:
    """Angles (n,) in radians between unit vectors (n, 3)."""
    # The arccosine loses half of the digits of small angles.
    found: Floats = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(one - other, axis=1), 0.0, 1.0))
    return found


def best_rotation(directions: Floats, targets: Floats, weights: Floats) -> Floats:
    """The rotation (3, 3) R that brings ``directions @ R.T`` closest to the targets, robustly.

    Kabsch's rotation, again and again with less weight for what stays far away (Cauchy), so
    that a part that was pulled aside does not turn the whole.

    Parameters
    ----------
    directions, targets : ndarray, (n, 3)
        Unit vectors.
    weights : ndarray, (n,)
        Of each pair: its area, and how far it is to be believed.
    """
    rotation, trust = np.eye(3), weights
    for _ in range(KABSCH_ITERATIONS):
        before = rotation
        spread = np.einsum("i,ij,ik->jk", trust, directions, targets)
        rotation = nearest_rotations(spread[None])[0]
        far = angles(directions @ rotation.T, targets)
        scale = max(float(np.median(far)), LEAST_ANGLE)
        trust = weights / (1.0 + (far / (2.0 * scale)) ** 2)
        if np.abs(rotation - before).max() < SAME_ROTATION:
            break
    return rotation


def move_towards(
    directions: Floats,
    faces: Ints,
    targets: Floats,
    weights: Floats,
    progress: Progress,
    smoothnesses: tuple[float, ...] = SMOOTHNESSES,
) -> Floats:
    """Unit vectors (n, 3) moved smoothly towards their targets, without a flip.

    Every step is the tangential way to the targets, smoothed by a screened Poisson equation on
    the spherical mesh, and halved until every determinant stays positive.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors of a mesh without flips.
    faces : ndarray, (m, 3)
    targets : ndarray, (n, 3)
        Unit vectors.
    weights : ndarray, (n,)
        How far each target is to be believed, 0 … 1.
    progress : Progress
    smoothnesses : tuple of float
        One after the other: lengths in radians over which the displacement is smooth.
    """
    current = directions
    for index, smoothness in enumerate(smoothnesses):
        solver = ReusedFactor()
        for iteration in range(ITERATIONS):
            done = (index * ITERATIONS + iteration) / (len(smoothnesses) * ITERATIONS)
            progress(done, "aligning the sphere")
            way = _tangential(current, targets)
            way = progress.run(_smoothed, current, faces, way, weights, smoothness, solver)
            moved = _stepped(current, way, faces)
            if moved is None:
                break
            current = moved
    return current


def _tangential(current: Floats, targets: Floats) -> Floats:
    """Tangent vectors (n, 3) along the great circles to the targets, in radians."""
    along = targets - np.einsum("ij,ij->i", targets, current)[:, None] * current
    way: Floats = unit(along) * angles(current, targets)[:, None]
    return way


def _smoothed(
    current: Floats,
    faces: Ints,
    way: Floats,
    weights: Floats,
    smoothness: float,
    solver: ReusedFactor,
) -> Floats:
    mass = weights * vertex_mass(current, faces)
    matrix = sparse.diags_array(mass) - smoothness**2 * cotangent_laplacian(current, faces)
    held = sparse.csr_array(matrix + 1e-9 * float(mass.mean()) * sparse.eye_array(len(mass)))
    smooth = solver.solve(held, mass[:, None] * way)
    tangent: Floats = smooth - np.einsum("ij,ij->i", smooth, current)[:, None] * current
    return tangent


def _stepped(current: Floats, way: Floats, faces: Ints) -> Floats | None:
    """A step along the way as far as no face comes near to a flip; None if that is nowhere."""
    least = KEPT_DETERMINANT * spherical_determinants(current, faces)
    step = 1.0
    for _ in range(HALVINGS):
        moved = unit(current + step * way)
        if (spherical_determinants(moved, faces) > least).all():
            return moved
        step *= 0.5
    return None
