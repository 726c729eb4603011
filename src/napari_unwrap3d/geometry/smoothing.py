"""Smoothing of a closed mesh that keeps its volume."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from ..progress import Progress
from .laplacian import Factor, laplacian_from_weights
from .mesh import face_areas, signed_volume

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def smooth_keeping_volume(
    vertices: Floats, faces: Ints, progress: Progress, *, iterations: int, step: float = 0.5
) -> Floats:
    """Implicit Laplacian smoothing, scaled to the volume of the start after every iteration.

    The Laplacian counts the neighbours: every vertex moves towards their mean (paper, analysis
    of ruffles: 15 iterations of a time step of 0.5).

    Parameters
    ----------
    vertices, faces : ndarray, (n, 3) and (m, 3)
        A closed mesh, outward.
    step : float
        0 moves nothing, 1 as far as to the mean of the moved neighbours and the vertex itself.

    Returns
    -------
    ndarray, (n, 3)
    """
    laplacian = laplacian_from_weights(np.full(faces.shape, 0.5), faces, len(vertices))
    valence = -laplacian.diagonal()
    matrix = sparse.csr_array(sparse.diags_array(valence) - step * laplacian)
    factor = progress.run(Factor, matrix)
    volume = signed_volume(vertices, faces)
    points = vertices
    for iteration in range(iterations):
        progress(iteration / iterations, "smoothing the mesh")
        points = factor.solve(valence[:, None] * points)
        area = face_areas(points, faces)
        centre = area @ points[faces].mean(axis=1) / area.sum()
        points = centre + np.cbrt(volume / signed_volume(points, faces)) * (points - centre)
    return points
