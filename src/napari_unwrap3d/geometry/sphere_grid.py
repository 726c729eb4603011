"""Differential operators of the unit sphere on the pixels of a uv image.

Finite volumes: every pixel is a cell of the latitude-longitude grid, fluxes go through its
four edges. The edge at a pole has no length, so nothing flows through it: the poles need no
boundary condition and u is periodic. Images are (n, 2n) with the convention of the package,
rows half a pixel away from the poles.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse

from .laplacian import Factor
from .padding import pad_sphere

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

# Pixels around that a cubic spline sees.
SPLINE_MARGIN = 6
# Where no pixel has a weight the solution is only determined up to a constant.
TIE = 1e-9


def pixel_areas(rows: int) -> Floats:
    """Solid angle (n, 2n) of every pixel; together 4π."""
    edges = np.cos(np.arange(rows + 1) * np.pi / rows)
    return np.repeat((-np.diff(edges) * np.pi / rows)[:, None], 2 * rows, axis=1)


def sphere_stiffness(rows: int) -> sparse.csr_array:
    """K (2n², 2n²), symmetric and positive semidefinite: the integral of |∇f|² is fᵀ K f.

    The Laplacian is −M⁻¹ K with the areas of the pixels M. Rows sum to zero.
    """
    step = np.pi / rows
    middle = np.sin((np.arange(rows) + 0.5) * step)
    between = np.sin(np.arange(1, rows) * step)
    index = np.arange(2 * rows * rows).reshape(rows, 2 * rows)
    along = np.repeat(1.0 / middle, 2 * rows)
    down = np.repeat(between, 2 * rows)
    first = np.concatenate([index.ravel(), index[:-1].ravel()])
    second = np.concatenate([np.roll(index, -1, axis=1).ravel(), index[1:].ravel()])
    flux = np.concatenate([along, down])
    half = sparse.coo_array((flux, (first, second)), shape=(index.size,) * 2).tocsr()
    full = half + half.T
    return sparse.csr_array(sparse.diags_array(np.asarray(full.sum(axis=1)).ravel()) - full)


def bending_energy(rows: int) -> sparse.csr_array:
    """K M⁻¹ K (2n², 2n²): the integral of (Δf)² over the unit sphere is fᵀ (K M⁻¹ K) f."""
    stiffness = sphere_stiffness(rows)
    inverse = sparse.diags_array(1.0 / pixel_areas(rows).ravel())
    return sparse.csr_array(stiffness @ inverse @ stiffness)


def smoothing_spline(image: Floats, weights: Floats, energy: sparse.csr_array) -> Floats:
    """The image z that minimises ``∫ w (y − z)² + zᵀ E z``.

    Parameters
    ----------
    image, weights : ndarray, (n, 2n)
        y and w ≥ 0; y is ignored (and may be NaN) where w is 0.
    energy : sparse array, (2n², 2n²)
        Positive semidefinite, constants in its null space.
    """
    areas = pixel_areas(len(image))
    pull = (areas * weights).ravel()
    known = np.where(weights > 0, image, 0.0).ravel()
    matrix = energy + sparse.diags_array(pull + TIE * areas.ravel())
    return Factor(matrix).solve(pull * known).reshape(image.shape)


def fill_harmonic(image: Floats, known: Bools) -> Floats:
    """An image (n, 2n) whose unknown pixels solve Laplace's equation between the known ones.

    Without any known pixel it is 0.
    """
    unknown = ~known.ravel()
    if not unknown.any():
        return image.copy()
    if unknown.all():
        return np.zeros_like(image)
    stiffness = sphere_stiffness(len(image))[unknown]
    values = np.where(known, image, 0.0).ravel()
    values[unknown] = Factor(stiffness[:, unknown]).solve(-(stiffness @ values))
    return values.reshape(image.shape)


def shrink(image: Floats, rows: int, weights: Floats) -> tuple[Floats, Floats]:
    """A smaller image (n, 2n) of the weighted means over its pixels, and of the weights' means.

    Parameters
    ----------
    image, weights : ndarray, (N, 2N)
        `image` is ignored where the weight is 0.
    rows : int
        n ≤ N, not necessarily a divisor.
    """
    down, along = _overlaps(len(image), rows), _overlaps(image.shape[1], 2 * rows)
    areas = pixel_areas(len(image))
    mass = down @ (areas * weights) @ along.T
    total = down @ (areas * np.where(weights > 0, image, 0.0) * weights) @ along.T
    mean = np.divide(total, mass, out=np.zeros_like(total), where=mass > 0)
    return mean, mass / (down @ areas @ along.T)


def enlarge(image: Floats, rows: int) -> Floats:
    """A larger image (N, 2N) of an image (n, 2n) by cubic splines, over poles and seam."""
    margin = min(SPLINE_MARGIN, len(image))
    padded = pad_sphere(image, margin)
    scale = len(image) / rows
    down = (np.arange(rows) + 0.5) * scale - 0.5 + margin
    along = (np.arange(2 * rows) + 0.5) * scale - 0.5 + margin
    places = np.meshgrid(down, along, indexing="ij")
    return np.asarray(ndimage.map_coordinates(padded, places, order=3, mode="nearest"))


def _overlaps(fine: int, coarse: int) -> sparse.csr_array:
    """How much (coarse, fine) of each fine pixel lies in each coarse one, by length."""
    edges = np.union1d(np.arange(fine + 1) / fine, np.arange(coarse + 1) / coarse)
    middle = 0.5 * (edges[1:] + edges[:-1])
    first, second = (middle * coarse).astype(np.int64), (middle * fine).astype(np.int64)
    length = np.diff(edges) * fine
    return sparse.csr_array((length, (first, second)), shape=(coarse, fine))
