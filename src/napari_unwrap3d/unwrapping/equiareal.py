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

from ..charts import Floats, Ints
from ..geometry.area_flow import (
    area_error,
    area_velocity,
    has_stalled,
    move_unflipped,
    share_of,
)
from ..geometry.area_polish import VertexStars, polish_areas
from ..geometry.distortion import spherical_determinants
from ..geometry.laplacian import Factor, ReusedFactor
from ..geometry.mesh import face_areas
from ..progress import Progress

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
        if history[-1] <= tolerance or has_stalled(history[start - 1 :]):
            break
        progress(0.8 * iteration / iterations, f"equalising areas: |log λ| {history[-1]:.4f}")
        velocity = progress.run(area_velocity, current, faces, target, solver)
        radial = np.einsum("ij,ij->i", velocity, current)
        velocity = velocity - radial[:, None] * current
        moved = _move(current, velocity, faces)
        if moved is None:
            break
        current = moved
        history.append(area_error(current, faces, target))
    return current


def _move(current: Floats, velocity: Floats, faces: Ints) -> Floats | None:
    """Move along the velocity on the sphere as far as no face flips."""

    def displaced(step: Floats) -> Floats:
        moved = current + step * velocity
        on_sphere: Floats = moved / np.linalg.norm(moved, axis=1, keepdims=True)
        return on_sphere

    return move_unflipped(current, displaced, lambda x: spherical_determinants(x, faces), faces)
