"""Step 3 as the paper does it: advection along the gradient of the area distortion.

Paper, Methods, "Equiareal spherical parameterization by mesh relaxation". It is the
reference for :mod:`.equiareal`, which needs fewer iterations and never flips a face. Each
iteration computes, on the sphere as it is at t,

- λ = a_ref / a_sphere per face, from shares of the area, and its mean over the faces
  around each vertex;
- V = −∇ log λ per face, scaled so that the median of its length is the mean length of the
  edges; its mean over the faces around each vertex, and of that the tangential part;
- v(t + 1) = (M − δ L)⁻¹ M (v + ε V), which the paper calls active contour cMCF, with the
  cotangent Laplacian and the barycentric masses of iteration t, then put back onto the
  unit sphere.

The algorithm as printed takes L(t), the section on active contours L(0). Only L(t) can
become equiareal: L(0) pulls back to the conformal map for ever.

Its boundary: the length of the step does not shrink with the error, so that the error
falls, hovers and rises again until a face collapses. Flipped faces are therefore counted in
every iteration, and the best map without any is returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from ..charts import Floats, Ints
from ..geometry.distortion import flipped_faces
from ..geometry.laplacian import (
    ReusedFactor,
    cotangent_laplacian,
    faces_to_vertices,
    vertex_mass,
)
from ..geometry.mesh import face_areas, vertex_normals
from ..progress import Progress
from .criteria import Criterion
from .equiareal import area_error, face_gradient, share_of

# The best map is taken when so many iterations after it have not been better.
PATIENCE = 20


@dataclass(frozen=True, eq=False)
class Advected:
    """The best map of an advection, and how it went.

    Attributes
    ----------
    directions : ndarray, (n, 3)
        Unit vectors; no face is flipped.
    iteration : int
        When it was reached; 0 is the map at the beginning.
    errors : ndarray, (k,)
        Mean |log λ| of iterations 0, 1, ...
    values : ndarray, (k,)
        The criterion, infinite where faces are flipped.
    flips : ndarray, (k,)
        Flipped faces.
    """

    directions: Floats
    iteration: int
    errors: Floats
    values: Floats
    flips: Ints


def advected_sphere(
    start: Floats,
    faces: Ints,
    target: Floats,
    criterion: Criterion,
    progress: Progress,
    *,
    iterations: int = 100,
    tolerance: float = 0.003,
    step: float = 1.0,
    delta: float = 0.1,
) -> Advected:
    """Relax the area distortion of a spherical map as the paper does.

    Parameters
    ----------
    start : ndarray, (n, 3)
        Unit vectors without flips, the conformal map.
    faces : ndarray, (m, 3)
    target : ndarray, (m,)
        Wanted shares of the area.
    criterion : Criterion
        Which iteration is the best.
    iterations : int
        Stop after so many, or after :data:`PATIENCE` without a better map, or when mean
        |log λ| is below `tolerance`.
    tolerance : float
    step : float
        ε, in mean lengths of an edge.
    delta : float
        δ, the stiffness: what is smaller than about √δ on the unit sphere is smoothed.
    """
    current = best = start
    solver = ReusedFactor()
    errors, values, flips = [area_error(start, faces, target)], [criterion(start)], [0]
    for iteration in range(1, iterations + 1):
        found = int(np.argmin(values))
        if errors[-1] <= tolerance or iteration > found + PATIENCE:
            break
        progress((iteration - 1) / iterations, f"advection: |log λ| {errors[-1]:.4f}")
        current = progress.run(_advected, current, faces, target, step, delta, solver)
        if not np.isfinite(current).all():
            break
        flips.append(flipped_faces(current, faces))
        errors.append(area_error(current, faces, target))
        values.append(np.inf if flips[-1] else criterion(current))
        if values[-1] < values[found]:
            best = current
    return Advected(
        best, int(np.argmin(values)), np.array(errors), np.array(values), np.array(flips)
    )


def _advected(
    directions: Floats,
    faces: Ints,
    target: Floats,
    step: float,
    delta: float,
    solver: ReusedFactor,
) -> Floats:
    """One iteration of the paper's algorithm."""
    velocity = _velocity(directions, faces, target)
    mass = vertex_mass(directions, faces)
    matrix = sparse.diags_array(mass) - delta * cotangent_laplacian(directions, faces)
    right = mass[:, None] * (directions + step * velocity)
    moved = solver.solve(sparse.csr_array(matrix), right)
    unit: Floats = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    return unit


def _velocity(directions: Floats, faces: Ints, target: Floats) -> Floats:
    """−∇ log λ at the vertices (n, 3), tangential, in mean lengths of an edge."""
    share = share_of(np.maximum(face_areas(directions, faces), 1e-300))
    log_distortion = np.log(_around(target / share, faces, len(directions)))
    descent = -face_gradient(directions, faces, log_distortion)
    median = np.median(np.linalg.norm(descent, axis=1))
    corners = directions[faces]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()
    velocity = _around(descent * (edge / max(median, 1e-300)), faces, len(directions))
    normals = vertex_normals(directions, faces)
    along = np.einsum("ij,ij->i", velocity, normals)
    tangential: Floats = velocity - along[:, None] * normals
    return tangential


def _around(values: Floats, faces: Ints, size: int) -> Floats:
    """Mean of a value per face, (m,) or (m, k), over the faces around each vertex."""
    count = np.bincount(faces.ravel(), minlength=size)
    total = faces_to_vertices(values, faces, size)
    mean: Floats = total / (count[:, None] if values.ndim == 2 else count)
    return mean
