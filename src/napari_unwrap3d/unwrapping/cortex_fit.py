"""Where the flowed surface lies: on the cortex that it came from.

The flow has its own size and no position, and it rounds the body. What it has smoothed is
brought back by an affine map, so that it keeps the position, the size and the proportions
of the cortex; protrusions, which lie far from it, have no say.
"""

from __future__ import annotations

import logging

import numpy as np
from scipy.spatial import cKDTree

from ..charts import Floats, Ints
from ..geometry.laplacian import vertex_mass
from ..geometry.mesh import vertex_normals

logger = logging.getLogger(__name__)

FIT_ROUNDS = 10
# The affine map has twelve numbers: so many vertices tell them.
SAMPLES = 8_000
AFFINE_ROUNDS = 12
# How stiff the map is where the cortex does not tell it (a sphere may turn as it likes).
DAMPING = 1e-3
SMALLEST_STEP = 0.01
# A map that stretches more has lost the cortex, or there is none to be seen.
LARGEST_STRETCH = 1.25


def fit_to(moved: Floats, original: Floats, mass: Floats, *, scale: float | None = None) -> Floats:
    """Scale and shift flowed vertices back onto the cortex they came from.

    Vertices of the cortex hardly move, those of protrusions move far; minimising the sum of
    distances (not of squares), by iteratively reweighted least squares, follows the cortex.
    A given `scale` is kept.
    """
    weights = mass.copy()
    scale_length = np.sqrt(mass.sum())
    result = moved
    for _ in range(FIT_ROUNDS):
        share = weights / weights.sum()
        centre_moved, centre = share @ moved, share @ original
        a, b = moved - centre_moved, original - centre
        size = scale or float(
            share @ np.einsum("ij,ij->i", a, b) / (share @ np.einsum("ij,ij->i", a, a))
        )
        result = size * a + centre
        distance = np.linalg.norm(result - original, axis=1)
        weights = mass / np.maximum(distance, 1e-3 * scale_length)
    return result


def fit_to_cortex(placed: Floats, original: Floats, faces: Ints, reach: float) -> Floats:
    """An affine map of flowed vertices that are about in place onto the cortex.

    Point-to-plane registration: Gauss–Newton steps on the distances to the tangent planes of
    the nearest vertices, with the weights of Geman and McClure, ``1 / (1 + (d / reach)²)²``.

    Parameters
    ----------
    placed, original : ndarray, (n, 3)
        The flowed and the given vertices of one closed mesh.
    faces : ndarray, (m, 3)
    reach : float
        Distance, in the vertices' unit, beyond which a vertex is no cortex.

    Returns
    -------
    ndarray, (n, 3)
        `placed` itself where the fit would stretch it by more than a quarter.
    """
    every = max(1, len(placed) // SAMPLES)
    normals = vertex_normals(original, faces)
    tree = cKDTree(original)
    mass = vertex_mass(placed, faces)[::every]
    centre = mass @ placed[::every] / mass.sum()
    size = float(np.sqrt(mass @ ((placed[::every] - centre) ** 2).sum(axis=1) / mass.sum()))
    # In units in which the body is about 1 across, so that turns and shifts weigh alike.
    arms = (placed - centre) / size
    shift, linear = np.zeros(3), np.eye(3)
    for _ in range(AFFINE_ROUNDS):
        points = centre + size * (arms[::every] @ linear.T + shift)
        _, nearest = tree.query(points)
        normal = normals[nearest]
        distance = np.einsum("ij,ij->i", points - original[nearest], normal) / size
        weights = mass / (1.0 + (distance * size / reach) ** 2) ** 2
        by_linear = (normal[:, :, None] * arms[::every][:, None, :]).reshape(-1, 9)
        jacobian = np.concatenate([normal, by_linear], axis=1)
        matrix = jacobian.T @ (weights[:, None] * jacobian)
        matrix[np.diag_indices(12)] += DAMPING * np.trace(matrix) / 12.0
        step = np.linalg.solve(matrix, -jacobian.T @ (weights * distance))
        shift += step[:3]
        linear += step[3:].reshape(3, 3)
        if np.abs(step).max() * size < SMALLEST_STEP * reach:
            break
    stretches = np.linalg.svd(linear, compute_uv=False)
    if stretches[0] > LARGEST_STRETCH or stretches[-1] < 1.0 / LARGEST_STRETCH:
        logger.info("no cortex was found to fit to: the stretches would be %s", stretches)
        return placed
    fitted: Floats = centre + size * (arms @ linear.T + shift)
    return fitted
