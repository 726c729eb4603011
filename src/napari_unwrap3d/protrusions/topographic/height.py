"""Height over a smooth baseline of the surface in (d, u, v) (paper, "Reference surface inference").

The height image is the surface seen from above; asymmetric least squares (Eilers 2003) draw
a smooth image under it. Both live on the sphere, whose operator knows the seam and the poles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ...charts import Floats, Surface, Topography
from ...geometry.padding import sample_uv_linear
from ...geometry.sphere_grid import bending_energy, enlarge, shrink, smoothing_spline
from ...parameters import TopographicParameters
from ...progress import Progress

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Heights:
    """The surface's height over a baseline.

    Attributes
    ----------
    image : ndarray, (N, 2N)
        d in µm of the surface as a function of (v, u), NaN where a column is empty.
    baseline_um : ndarray, (N, 2N)
        d_ref.
    vertex_um : ndarray, (n,)
        h = d − d_ref of every vertex.
    without_image : int
        Vertices without a place in (d, u, v), that have the height of the nearest with one.
    """

    image: Floats
    baseline_um: Floats
    vertex_um: Floats
    without_image: int


def heights(
    surface: Surface, topography: Topography, parameters: TopographicParameters, progress: Progress
) -> Heights:
    """Height of every vertex over the baseline, or over d = 0."""
    image = height_image(topography)
    if parameters.zero == "plane":
        base = np.zeros_like(image)
    else:
        base = baseline(image, parameters, progress)
    places = topography.surface
    found = np.isfinite(places).all(axis=1)
    height = np.zeros(len(places))
    height[found] = places[found, 0] - sample_uv_linear(base, places[found, 1:])
    if found.any() and not found.all():
        _, nearest = cKDTree(surface.vertices[found]).query(surface.vertices[~found])
        height[~found] = height[found][nearest]
    return Heights(image, base, height, int((~found).sum()))


def height_image(topography: Topography) -> Floats:
    """The top of the longest contiguous stretch of the cell along every column.

    Where the stretch begins at the bottom, as it does unless the cell is hollow there, its
    length is the paper's pixel value.

    Returns
    -------
    ndarray, (N, 2N)
        d in µm, half a layer above the last layer in the cell; NaN in a column without any.
    """
    inner = slice(1, -1)
    mask = topography.mask
    length, top = np.zeros(mask.shape[1:], np.int64), np.zeros(mask.shape[1:], np.int64)
    _longest_stretches(mask, topography.last_layer[inner], length, top)
    step = topography.d_um[1] - topography.d_um[0]
    image: Floats = topography.d_um[0] + (top + 0.5) * step
    image[length == 0] = np.nan
    return image


@numba.njit(nogil=True, cache=True)
def _longest_stretches(mask, last, length, top):  # type: ignore[no-untyped-def]
    """Length and last layer of the longest run of True in every column up to a layer."""
    run = np.zeros(length.shape, np.int64)
    for k in range(mask.shape[0]):
        for i in range(mask.shape[1]):
            for j in range(mask.shape[2]):
                if not mask[k, i, j] or k > last[i, j]:
                    run[i, j] = 0
                    continue
                run[i, j] += 1
                if run[i, j] > length[i, j]:
                    length[i, j] = run[i, j]
                    top[i, j] = k


def baseline(image: Floats, parameters: TopographicParameters, progress: Progress) -> Floats:
    """Asymmetric least squares under a height image, (N, 2N) in µm (paper, Ext. Fig. 4b).

    On the unit sphere it minimises ``∫ w (d − z)² + λ δ⁴ ∫ (Δz)²`` with w = p above z and
    1 − p below. δ = π / n is a pixel at the equator of the grid of n rows, so that λ is the
    paper's, whose Laplacian differences pixels; away from the equator, where the paper's
    pixels become narrow, the sphere's own Laplacian keeps the same stiffness everywhere.
    Empty columns have no weight.
    """
    rows = min(parameters.baseline_rows, len(image))
    small, known = shrink(image, rows, np.isfinite(image).astype(float))
    if not known.any():
        return np.zeros_like(image)
    energy = parameters.smoothness * (np.pi / rows) ** 4 * bending_energy(rows)
    weights = known
    for iteration in range(parameters.iterations):
        progress(iteration / parameters.iterations, "fitting the baseline")
        smooth = smoothing_spline(small, weights, energy)
        above = small > smooth
        changed = known * np.where(above, parameters.asymmetry, 1.0 - parameters.asymmetry)
        if np.array_equal(changed, weights):
            break
        weights = changed
    return enlarge(smooth, len(image))
