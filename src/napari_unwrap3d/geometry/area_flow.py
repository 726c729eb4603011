"""Moving a mesh without flips until its faces have the areas that they should have.

One iteration solves a Poisson equation for the potential whose gradient carries the excess
of area away, moves the vertices along it and back to where they belong (the sphere, the
circle around a disk), and shortens the step until no face flips. The source is the logarithm
of wanted over present area, limited to ±1, so that a map whose areas are wrong by many
orders of magnitude is brought home in steps that each stay small.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .laplacian import ReusedFactor, cotangent_laplacian, faces_to_vertices, pinned
from .mesh import face_areas

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

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


def share_of(areas: Floats) -> Floats:
    """Areas (m,) as parts of their sum."""
    share: Floats = areas / areas.sum()
    return share


def area_error(points: Floats, faces: Ints, target: Floats) -> float:
    """Mean over the faces of |log(share of the area / target)|."""
    share = np.maximum(share_of(face_areas(points, faces)), 1e-300)
    return float(np.abs(np.log(share / target)).mean())


def has_stalled(history: list[float]) -> bool:
    """Whether the last iteration gained too little for another."""
    gain = SMALLEST_GAIN if history[-1] < FAR else SMALLEST_GAIN_FAR
    return len(history) > 3 and history[-1] > (1.0 - gain) * history[-2]


def area_velocity(points: Floats, faces: Ints, target: Floats, solver: ReusedFactor) -> Floats:
    """Vectors (n, 3) whose divergence turns the current areas into the target.

    On a mesh with a border nothing flows through it.
    """
    size = len(points)
    areas = face_areas(points, faces)
    mass = faces_to_vertices(share_of(areas) / 3.0, faces, size)
    wanted = faces_to_vertices(target / 3.0, faces, size)
    right = mass * LARGEST_LOG * np.tanh(np.log(wanted / mass) / LARGEST_LOG) * areas.sum()
    right -= mass * right.sum()
    potential = -solver.solve(pinned(cotangent_laplacian(points, faces)), right)
    gradient = face_gradient(points, faces, potential)
    weighted = faces_to_vertices(areas[:, None] * gradient, faces, size)
    velocity: Floats = weighted / faces_to_vertices(areas, faces, size)[:, None]
    return velocity


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


def move_unflipped(
    current: Floats,
    displaced: Callable[[Floats], Floats],
    determinants: Callable[[Floats], Floats],
    faces: Ints,
) -> Floats | None:
    """Move as far as no face flips; None if that is nowhere.

    The step is shortened for all; where a few faces still object, for their vertices alone.

    Parameters
    ----------
    current : ndarray, (n, k)
    displaced : callable
        Gives the points for a step (n, 1) per vertex, 1 = all the way.
    determinants : callable
        Gives (m,) of points; positive where a face is not flipped.
    """
    before = KEPT_DETERMINANT * determinants(current)
    step = np.ones((len(current), 1))
    for shortening in range(SHORTENINGS):
        moved = displaced(step)
        bad: npt.NDArray[np.bool_] = ~(determinants(moved) > before)
        if not bad.any():
            return moved
        if shortening < SHORTENED_FOR_ALL or bad.mean() > FEW_FACES:
            step *= 0.6
        else:
            step[np.unique(faces[bad])] *= 0.5
    return None
