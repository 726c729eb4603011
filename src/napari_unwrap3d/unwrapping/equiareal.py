"""Step 3: from the conformal to the equiareal sphere by a Poisson (Moser) flow.

Each iteration solves a Poisson equation for the potential whose gradient carries the
excess of area away, moves the vertices along it and back onto the sphere, and halves
the step until no triangle flips and the error falls. The target area of a face,
``A_ref^t · A_sphere^(1 − t)``, blends from conformal (t = 0) to equiareal (t = 1).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from ..charts import Floats, Ints
from ..geometry.distortion import spherical_determinants
from ..geometry.laplacian import (
    Factor,
    conjugate_gradient,
    cotangent_laplacian,
    faces_to_vertices,
)
from ..geometry.mesh import face_areas
from ..progress import Progress

KEPT_DETERMINANT = 0.1
HALVINGS = 14


def equiareal_sphere(
    vertices: Floats,
    conformal: Floats,
    faces: Ints,
    progress: Progress,
    *,
    blend: float = 1.0,
    iterations: int = 30,
    tolerance: float = 0.002,
) -> tuple[Floats, Floats]:
    """Relax the area distortion of a spherical map (paper, Step 3).

    Parameters
    ----------
    vertices : ndarray, (n, 3)
        The mesh whose areas are to be kept (the reference).
    conformal : ndarray, (n, 3)
        Unit vectors without flips.
    faces : ndarray, (m, 3)
    blend : float
        0 returns `conformal`, 1 is equiareal.
    iterations, tolerance
        Stop after so many, or when mean |log(area / target)| is below the tolerance.

    Returns
    -------
    directions : ndarray, (n, 3)
        Unit vectors, never flipped where `conformal` is not.
    history : ndarray
        Mean |log(area / target)| before every iteration and at the end.
    """
    target = _share(face_areas(vertices, faces)) ** blend
    target = _share(target * _share(face_areas(conformal, faces)) ** (1.0 - blend))
    current = conformal
    history = [_error(current, faces, target)[0]]
    step = 1.0
    solver = _PoissonSolver()
    for iteration in range(iterations):
        progress(iteration / iterations, f"equalising areas, mean |log λ| {history[-1]:.4f}")
        if history[-1] <= tolerance:
            break
        velocity = progress.run(_velocity, current, faces, target, solver)
        moved, step = _line_search(current, velocity, faces, target, min(1.0, 2.0 * step))
        if moved is None:
            break
        current = moved
        history.append(_error(current, faces, target)[0])
    return current, np.array(history)


def _share(areas: Floats) -> Floats:
    share: Floats = areas / areas.sum()
    return share


def _error(directions: Floats, faces: Ints, target: Floats) -> tuple[float, float]:
    """Mean |log ratio| (reported) and target-weighted squared log ratio (descended)."""
    log_ratio = np.log(np.maximum(_share(face_areas(directions, faces)), 1e-300) / target)
    return float(np.abs(log_ratio).mean()), float(target @ log_ratio**2)


class _PoissonSolver:
    """Solves with slowly changing matrices: the factor of an early one preconditions."""

    def __init__(self) -> None:
        self._factor: Factor | None = None

    def solve(self, matrix: sparse.csr_array, right: Floats) -> Floats:
        if self._factor is not None:
            solution, solved = conjugate_gradient(
                matrix, right[:, None], self._factor, tolerance=1e-8, iterations=25
            )
            if solved:
                return solution[:, 0]
        self._factor = Factor(matrix)
        return self._factor.solve(right)


def _velocity(directions: Floats, faces: Ints, target: Floats, solver: _PoissonSolver) -> Floats:
    """Tangent vectors (n, 3) whose divergence turns the current areas into the target."""
    size = len(directions)
    areas = face_areas(directions, faces)
    mass = faces_to_vertices(_share(areas) / 3.0, faces, size)
    wanted = faces_to_vertices(target / 3.0, faces, size)
    laplacian = cotangent_laplacian(directions, faces)
    right = (wanted - mass) * areas.sum()
    right -= mass * right.sum() / mass.sum()
    # The tiny mass term removes the constant from the null space.
    matrix = sparse.csr_array(sparse.diags_array(1e-9 * mass) - laplacian)
    potential = -solver.solve(matrix, right)
    gradient = _gradient(directions, faces, potential)
    weighted = faces_to_vertices(areas[:, None] * gradient, faces, size)
    velocity = weighted / faces_to_vertices(areas, faces, size)[:, None]
    radial = np.einsum("ij,ij->i", velocity, directions)
    tangential: Floats = velocity - radial[:, None] * directions
    return tangential


def _gradient(vertices: Floats, faces: Ints, values: Floats) -> Floats:
    """Gradient (m, 3) on every face of a function given at the vertices."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    normal = np.cross(b - a, c - a)
    squared = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    total = (
        values[faces[:, 0], None] * np.cross(normal, c - b)
        + values[faces[:, 1], None] * np.cross(normal, a - c)
        + values[faces[:, 2], None] * np.cross(normal, b - a)
    )
    gradient: Floats = total / squared[:, None]
    return gradient


def _line_search(
    current: Floats, velocity: Floats, faces: Ints, target: Floats, step: float
) -> tuple[Floats | None, float]:
    """The longest halved step that flips nothing and lowers the error; None if there is none."""
    before = spherical_determinants(current, faces)
    error = _error(current, faces, target)[1]
    for halving in range(HALVINGS):
        moved = current + step * velocity
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        after = spherical_determinants(moved, faces)
        keeps = bool((after > KEPT_DETERMINANT * before).all())
        if (keeps or (halving > 4 and bool((after > 0).all()))) and _error(moved, faces, target)[
            1
        ] < error:
            return moved, step
        step *= 0.5
    return None, step
