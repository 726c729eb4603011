"""How different two surfaces are: Chamfer distance, area and volume.

Paper, "Assessment of geometrical difference between two meshes".
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from .mesh import face_areas, signed_volume

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def chamfer_distance(first: Floats, second: Floats) -> float:
    """Mean distance from the vertices of each mesh to the nearest of the other, summed.

    Parameters
    ----------
    first, second : ndarray, (n, 3) and (m, 3)

    Returns
    -------
    float
        In the unit of the vertices. Never 0 for two samplings of one surface: it includes
        the spacing of the vertices.
    """
    to_second = cKDTree(second).query(first)[0].mean()
    to_first = cKDTree(first).query(second)[0].mean()
    return float(to_second + to_first)


def area_difference(
    vertices: Floats, faces: Ints, other_vertices: Floats, other_faces: Ints
) -> float:
    """Area of the first mesh over that of the second, minus 1."""
    other = face_areas(other_vertices, other_faces).sum()
    return float(face_areas(vertices, faces).sum() / other - 1.0)


def volume_difference(
    vertices: Floats, faces: Ints, other_vertices: Floats, other_faces: Ints
) -> float:
    """Volume of the first mesh over that of the second, minus 1."""
    return signed_volume(vertices, faces) / signed_volume(other_vertices, other_faces) - 1.0
