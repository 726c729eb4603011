"""A shell over the sphere as two overlapping patches without poles: the Yin-Yang grid.

Two identical parts of latitude-longitude grids cover the sphere, one around its axis, the
other around an axis at right angles (Kageyama, Sato 2004, doi:10.1029/2004GC000734). Within
them a step of u is never shorter than 0.7 of a step of v, so that filters and connected
parts mean the same everywhere; at a pole of the uv image they would not.

Volumes are (layers, rows, columns), with one step between layers as between rows.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.sparse import coo_array, csgraph

from .parallel import ranges, run_blocks

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]

PATCHES = (0, 1)
LAYERS_PER_BLOCK = 4
CORNERS_TOO = np.ones((3, 3, 3), bool)


class SpherePatches:
    """Where the pixels of both patches lie, and which patch has which part of the sphere.

    Parameters
    ----------
    rows : int
        From pole to pole of a whole grid with the same step, so the step is π / rows.
    margin : int
        Pixels beyond the part that a patch must have, on every side; at most rows / 8.
    """

    def __init__(self, rows: int, margin: int) -> None:
        self.step = np.pi / rows
        self.margin = min(margin, rows // 8)
        self.shape = (-(-rows // 2) + 2 * self.margin, -(-3 * rows // 2) + 2 * self.margin)
        centred = [np.arange(size) - 0.5 * (size - 1) for size in self.shape]
        self._inclination = 0.5 * np.pi + centred[0] * self.step
        self._azimuth = centred[1] * self.step
        self.sines: Floats = np.sin(self._inclination)

    def directions(self, patch: int) -> Floats:
        """Unit vectors (rows, columns, 3) (z, y, x) of the pixels of a patch."""
        sine, cosine = self.sines[:, None], np.cos(self._inclination)[:, None]
        y, x = sine * np.sin(self._azimuth), sine * np.cos(self._azimuth)
        own = np.stack([np.broadcast_to(cosine, self.shape), y, x], axis=-1)
        return own if patch == 0 else _turned(own)

    def owned(self, patch: int) -> Bools:
        """The pixels (rows, columns) that no other patch stands for; a partition of the sphere."""
        inside: Bools = self._in_core(self.directions(patch).reshape(-1, 3)).reshape(self.shape)
        return inside if patch == 0 else ~inside & self._around_core()

    def locate(self, patch: int, directions: Floats) -> Floats:
        """Rows and columns (n, 2), fractional, of directions (n, 3); they may lie outside."""
        z, y, x = (directions if patch == 0 else _turned(directions)).T
        row = (np.arctan2(np.hypot(y, x), z) - self._inclination[0]) / self.step
        column = (np.arctan2(y, x) - self._azimuth[0]) / self.step
        return np.stack([row, column], axis=1)

    def _in_core(self, directions: Floats) -> Bools:
        _, y, x = directions.T
        low = np.hypot(y, x) >= np.sin(0.25 * np.pi) * np.linalg.norm(directions, axis=1)
        return np.asarray(low & (np.abs(np.arctan2(y, x)) <= 0.75 * np.pi))

    def _around_core(self) -> Bools:
        """Without the margins beyond the core, which only continue it."""
        m = self.margin
        inner = np.zeros(self.shape, bool)
        inner[m : self.shape[0] - m, m : self.shape[1] - m] = True
        return inner


def _turned(directions: Floats) -> Floats:
    """Between the frames of both patches, the same both ways: (z, y, x) → (y, z, −x)."""
    turned = directions[..., [1, 0, 2]].copy()
    turned[..., 2] *= -1.0
    return turned


def label_patches(
    patches: SpherePatches, solids: tuple[Bools, Bools], smallest: int
) -> tuple[list[npt.NDArray[np.int32]], int]:
    """Connected parts (also over corners) of a volume on both patches, over their border.

    Parameters
    ----------
    patches : SpherePatches
    solids : two ndarrays, (layers, rows, columns) bool
    smallest : int
        Parts with fewer voxels are left out. A voxel counts in the patch that owns it.

    Returns
    -------
    labels : two ndarrays, (layers, rows, columns) int32
        From 1, 0 = none.
    count : int
    """
    labelled = [ndimage.label(solid, CORNERS_TOO) for solid in solids]
    volumes, counts = zip(*labelled, strict=True)
    start = counts[0]
    pairs = _same_part(patches, volumes)
    graph = coo_array(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1] + start)), shape=(sum(counts) + 1,) * 2
    )
    _, part = csgraph.connected_components(graph, directed=False)
    size = np.zeros(part.max() + 1, np.int64)
    of_label = []
    for patch in PATCHES:
        names = np.append(-1, part[1 + patch * start : 1 + patch * start + counts[patch]])
        of_label.append(names)
        inside = volumes[patch][:, patches.owned(patch)]
        number = np.bincount(inside.ravel(), minlength=counts[patch] + 1)[1:]
        np.add.at(size, names[1:], number)
    kept = np.flatnonzero(size >= max(smallest, 1))
    new = np.zeros(len(size) + 1, np.int32)
    new[kept] = np.arange(1, len(kept) + 1)
    return [new[of_label[patch]][volumes[patch]] for patch in PATCHES], len(kept)


def _same_part(patches: SpherePatches, volumes: tuple[Ints, ...]) -> Ints:
    """Pairs (k, 2) of labels of both patches that share a voxel beyond the second's own."""
    beyond = ~patches.owned(1)
    places = patches.locate(0, patches.directions(1)[beyond])
    row, column = np.rint(places).astype(np.int64).T
    inside = (row >= 0) & (row < patches.shape[0]) & (column >= 0) & (column < patches.shape[1])
    first = volumes[0][:, row[inside], column[inside]]
    second = volumes[1][:, beyond][:, inside]
    both = (first > 0) & (second > 0)
    return np.unique(np.stack([first[both], second[both]], axis=1), axis=0).astype(np.int64)


def sample_columns(volume: Bools, layers: Floats, v: Floats, u: Floats) -> Bools:
    """A binary volume resampled along columns: where its linear interpolation exceeds ½.

    Parameters
    ----------
    volume : ndarray, (D, rows, columns) bool
        Continued over its borders as far as `v` and `u` reach.
    layers : ndarray, (k,)
        Fractional layers, clamped to the volume.
    v, u : ndarray, (a, b)
        Fractional rows and columns.

    Returns
    -------
    ndarray, (k, a, b) bool
    """
    layers = np.clip(layers, 0.0, len(volume) - 1.0)
    out = np.empty((len(layers), *v.shape), np.bool_)
    blocks = ranges(len(layers), LAYERS_PER_BLOCK)
    run_blocks(lambda part: _sample_columns(volume, layers[part], v, u, out[part]), blocks)
    return out


@numba.njit(nogil=True, cache=True)
def _sample_columns(volume, layers, v, u, out):  # type: ignore[no-untyped-def]
    for k in range(len(layers)):
        low = int(layers[k])
        high = min(low + 1, volume.shape[0] - 1)
        part = layers[k] - low
        for i in range(v.shape[0]):
            for j in range(v.shape[1]):
                r, c = int(np.floor(v[i, j])), int(np.floor(u[i, j]))
                fv, fu = v[i, j] - r, u[i, j] - c
                total = 0.0
                for a in range(2):
                    for b in range(2):
                        weight = (fv if a else 1.0 - fv) * (fu if b else 1.0 - fu)
                        below = volume[low, r + a, c + b]
                        above = volume[high, r + a, c + b]
                        total += weight * (below * (1.0 - part) + above * part)
                out[k, i, j] = total > 0.5


def shell_mean_curvature(level: Floats32, sines: Floats) -> Floats32:
    """Mean curvature H = ½ div (∇φ / |∇φ|) of the level sets of φ over a patch, convex > 0.

    In the metric of sphere × height, where a layer d = constant is flat.

    Parameters
    ----------
    level : ndarray, (layers, rows, columns) float32
        φ, growing outwards.
    sines : ndarray, (rows,)
        Length of a step along the columns, in steps along the rows.

    Returns
    -------
    ndarray, (layers, rows, columns) float32
        Per step.
    """
    normals = np.empty((*level.shape, 3), np.float32)
    curvature = np.empty(level.shape, np.float32)
    sine = sines.astype(np.float32)
    blocks = [(part.start, part.stop) for part in ranges(len(level), LAYERS_PER_BLOCK)]
    run_blocks(lambda part: _unit_gradients(level, sine, *part, normals), blocks)
    run_blocks(lambda part: _half_divergence(normals, sine, *part, curvature), blocks)
    return curvature


@numba.njit(nogil=True, cache=True)
def _around(index, size):  # type: ignore[no-untyped-def]
    return max(index - 1, 0), min(index + 1, size - 1)


@numba.njit(nogil=True, cache=True)
def _unit_gradients(level, sine, begin, stop, out):  # type: ignore[no-untyped-def]
    layers, rows, columns = level.shape
    for k in range(begin, stop):
        k0, k1 = _around(k, layers)
        for i in range(rows):
            i0, i1 = _around(i, rows)
            for j in range(columns):
                j0, j1 = _around(j, columns)
                d = (level[k1, i, j] - level[k0, i, j]) / np.float32(k1 - k0)
                v = (level[k, i1, j] - level[k, i0, j]) / np.float32(i1 - i0)
                u = (level[k, i, j1] - level[k, i, j0]) / (np.float32(j1 - j0) * sine[i])
                length = np.sqrt(d * d + v * v + u * u)
                if length < np.float32(1e-6):
                    length = np.float32(1)
                out[k, i, j, 0] = d / length
                out[k, i, j, 1] = v / length
                out[k, i, j, 2] = u / length


@numba.njit(nogil=True, cache=True)
def _half_divergence(normals, sine, begin, stop, out):  # type: ignore[no-untyped-def]
    layers, rows, columns = normals.shape[:3]
    for k in range(begin, stop):
        k0, k1 = _around(k, layers)
        for i in range(rows):
            i0, i1 = _around(i, rows)
            for j in range(columns):
                j0, j1 = _around(j, columns)
                d = (normals[k1, i, j, 0] - normals[k0, i, j, 0]) / np.float32(k1 - k0)
                v = sine[i1] * normals[k, i1, j, 1] - sine[i0] * normals[k, i0, j, 1]
                v /= np.float32(i1 - i0)
                u = (normals[k, i, j1, 2] - normals[k, i, j0, 2]) / np.float32(j1 - j0)
                out[k, i, j] = np.float32(0.5) * (d + (v + u) / sine[i])
