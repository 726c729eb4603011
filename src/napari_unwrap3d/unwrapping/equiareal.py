"""Step 3: from the conformal to the equiareal sphere by a Poisson (Moser) flow.

Each iteration solves a Poisson equation for the potential whose gradient carries the
excess of area away, moves the vertices along it and back onto the sphere, and shortens
the step until no triangle flips. The source is the logarithm of wanted over present
area, limited to ±1, so that a map whose areas are wrong by many orders of magnitude is
brought home in steps that each stay small. What a flow of the vertices cannot see, the
differences between neighbouring faces, is then removed vertex by vertex; the two take
turns. The target area of a face, ``A_ref^t · A_sphere^(1 − t)``, blends from conformal
(t = 0) to equiareal (t = 1).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..geometry.area_polish import VertexStars, polish_areas
from ..geometry.distortion import spherical_determinants
from ..geometry.laplacian import (
    Factor,
    ReusedFactor,
    cotangent_laplacian,
    faces_to_vertices,
    pinned,
)
from ..geometry.mesh import face_areas
from ..progress import Progress

# A step may shrink a face's determinant to this fraction at the most.
KEPT_DETERMINANT = 0.1
SHORTENINGS, SHORTENED_FOR_ALL = 30, 6
# Up to this fraction of bad faces only their own vertices are slowed down.
FEW_FACES = 0.01
LARGEST_LOG = 1.0
# The flow has done its part when an iteration gains less than this fraction: close to the
# goal the faces' own differences are left, far from it slow progress is progress.
SMALLEST_GAIN, SMALLEST_GAIN_FAR = 0.08, 0.02
FAR = 0.05
CYCLES = 4
POLISH_ROUNDS = 4
POLISH_SWEEPS = 5


def equiareal_sphere(
    vertices: Floats,
    conformal: Floats,
    faces: Ints,
    progress: Progress,
    *,
    blend: float = 1.0,
    iterations: int = 100,
    tolerance: float = 0.003,
    wanted: Floats | None = None,
    start: Floats | None = None,
    factor: Factor | None = None,
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
    wanted : ndarray, (m,), optional
        Shares of the area of an equiareal map; by default those of `vertices`.
    start : ndarray, (n, 3), optional
        Unit vectors without flips to begin with, by default `conformal`.
    factor : Factor, optional
        Of the pinned Laplacian of `vertices`, or of another mesh of nearly the same angles
        as `conformal`.

    Returns
    -------
    directions : ndarray, (n, 3)
        Unit vectors, never flipped where `conformal` is not.
    history : ndarray
        Mean |log(area / target)| before every iteration and at the end.
    """
    if blend == 0.0:
        return conformal, np.zeros(1)
    wanted = share_of(face_areas(vertices, faces)) if wanted is None else wanted
    target = blended_target(wanted, conformal, faces, blend)
    current = conformal if start is None else start
    history = [area_error(current, faces, target)]
    stars = VertexStars(faces, len(current))
    solver = ReusedFactor(factor)
    for cycle in range(CYCLES):
        part = progress.part(cycle / CYCLES, (cycle + 1) / CYCLES)
        current = _flow(current, faces, target, history, iterations, tolerance, solver, part)
        for round_ in range(POLISH_ROUNDS):
            if history[-1] <= tolerance:
                return current, np.array(history)
            part(0.8 + 0.2 * round_ / POLISH_ROUNDS, "equalising neighbouring faces")
            current = progress.run(polish_areas, current, faces, stars, target, POLISH_SWEEPS)
            history.append(area_error(current, faces, target))
    return current, np.array(history)


def blended_target(wanted: Floats, conformal: Floats, faces: Ints, blend: float) -> Floats:
    """Shares (m,) of the area between those of the conformal map (0) and the wanted ones (1)."""
    return share_of(wanted**blend * share_of(face_areas(conformal, faces)) ** (1.0 - blend))


def _flow(
    current: Floats,
    faces: Ints,
    target: Floats,
    history: list[float],
    iterations: int,
    tolerance: float,
    solver: ReusedFactor,
    progress: Progress,
) -> Floats:
    """Poisson flow until it is good enough or stalls; the errors are appended to `history`."""
    start = len(history)
    for iteration in range(iterations):
        if history[-1] <= tolerance or _has_stalled(history[start - 1 :]):
            break
        progress(0.8 * iteration / iterations, f"equalising areas: |log λ| {history[-1]:.4f}")
        velocity = progress.run(_velocity, current, faces, target, solver)
        moved = _move(current, velocity, faces)
        if moved is None:
            break
        current = moved
        history.append(area_error(current, faces, target))
    return current


def area_error(directions: Floats, faces: Ints, target: Floats) -> float:
    """Mean over the faces of |log(share of the area / target)|."""
    share = np.maximum(share_of(face_areas(directions, faces)), 1e-300)
    return float(np.abs(np.log(share / target)).mean())


def share_of(areas: Floats) -> Floats:
    """Areas (m,) as parts of their sum."""
    share: Floats = areas / areas.sum()
    return share


def _has_stalled(history: list[float]) -> bool:
    gain = SMALLEST_GAIN if history[-1] < FAR else SMALLEST_GAIN_FAR
    return len(history) > 3 and history[-1] > (1.0 - gain) * history[-2]


def _velocity(directions: Floats, faces: Ints, target: Floats, solver: ReusedFactor) -> Floats:
    """Tangent vectors (n, 3) whose divergence turns the current areas into the target."""
    size = len(directions)
    areas = face_areas(directions, faces)
    mass = faces_to_vertices(share_of(areas) / 3.0, faces, size)
    wanted = faces_to_vertices(target / 3.0, faces, size)
    right = mass * LARGEST_LOG * np.tanh(np.log(wanted / mass) / LARGEST_LOG) * areas.sum()
    right -= mass * right.sum()
    potential = -solver.solve(pinned(cotangent_laplacian(directions, faces)), right)
    gradient = face_gradient(directions, faces, potential)
    weighted = faces_to_vertices(areas[:, None] * gradient, faces, size)
    velocity = weighted / faces_to_vertices(areas, faces, size)[:, None]
    radial = np.einsum("ij,ij->i", velocity, directions)
    tangential: Floats = velocity - radial[:, None] * directions
    return tangential


def face_gradient(vertices: Floats, faces: Ints, values: Floats) -> Floats:
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


def _move(current: Floats, velocity: Floats, faces: Ints) -> Floats | None:
    """Move along the velocity as far as no face flips; None if that is nowhere.

    The step is shortened for all; where a few faces still object, for their vertices alone.
    """
    before = KEPT_DETERMINANT * spherical_determinants(current, faces)
    step = np.ones((len(current), 1))
    for shortening in range(SHORTENINGS):
        moved = current + step * velocity
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        bad: npt.NDArray[np.bool_] = ~(spherical_determinants(moved, faces) > before)
        if not bad.any():
            return moved
        if shortening < SHORTENED_FOR_ALL or bad.mean() > FEW_FACES:
            step *= 0.6
        else:
            step[np.unique(faces[bad])] *= 0.5
    return None
