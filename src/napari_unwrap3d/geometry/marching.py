"""Marching cubes that cannot make a degenerate triangle.

A level-set value close to zero puts a vertex next to a grid point and makes needles
and zero-area triangles. Clamping the values away from zero keeps every vertex at
least that fraction of an edge away from the grid points.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..errors import EmptyMaskError
from . import apart

CLAMP = 0.02


def clamped_marching_cubes(
    field: npt.NDArray[np.floating], clamp: float = CLAMP
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Mesh of the zero level set of a field that is positive inside.

    Parameters
    ----------
    field : ndarray, (z, y, x) float
        Positive inside, negative outside, of order 1 where it changes sign; must be
        negative on the border of the grid for the mesh to be closed.
    clamp : float
        Magnitudes below are pushed up to this.

    Returns
    -------
    vertices : ndarray, (n, 3) float64
        Index coordinates (z, y, x).
    faces : ndarray, (m, 3) int64
        With positive signed volume.

    Raises
    ------
    EmptyMaskError
        The field does not change sign.
    """
    values = np.asarray(field, dtype=np.float32)
    if not (values.max() > 0 > values.min()):
        raise EmptyMaskError(
            "There is no surface in this volume: the field does not change sign.",
            minimum=float(values.min()),
            maximum=float(values.max()),
            hint="Check the threshold, or the mask, of the segmentation.",
        )
    limit = np.float32(clamp)
    values = np.where(values > 0, np.maximum(values, limit), np.minimum(values, -limit))
    vertices, faces = apart.call("marched", values)
    return vertices.astype(np.float64), faces.astype(np.int64)


def field_with_sign(
    smooth: npt.NDArray[np.floating], solid: npt.NDArray[np.bool_], clamp: float = CLAMP
) -> npt.NDArray[np.float32]:
    """A smooth field whose sign is forced to agree with a solid.

    With a well-composed solid the topology of the mesh is then the topology of the
    solid, and the position of the mesh comes from the smooth field wherever they agree.
    """
    values = np.asarray(smooth, dtype=np.float32)
    limit = np.float32(clamp)
    result: npt.NDArray[np.float32] = np.where(
        solid, np.maximum(values, limit), np.minimum(values, -limit)
    )
    return result
