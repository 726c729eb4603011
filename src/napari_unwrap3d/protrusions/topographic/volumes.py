"""Which voxel is in which protrusion (paper, "Topography guided decomposition of cell surface").

The cortex under the protrusions is filled in where they were taken away; above it labels go
from the surface inwards, slice by slice from the top. The paper fills in by fast marching
over the plane, which knows neither seam nor poles; here it is Laplace's equation on the
sphere. The paper lets labels spread in the whole cell and then takes the cortex away; here
they spread outside of the cortex only, so that none takes a way through it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from skimage.segmentation import watershed

from ...charts import UV, Floats, Mask, Surface, Topography
from ...geometry.distance import distance_to
from ...geometry.padding import pad_sphere, sample_uv_linear
from ...geometry.sphere_grid import enlarge, fill_harmonic, shrink
from ...geometry.topology import largest_parts
from ...progress import Progress
from ...unwrapping.outermost import OutermostSurface
from ...unwrapping.topography import TopographyLocator

Bools = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]

# The cortex is smooth under a protrusion: more rows than these make it no better.
FILL_ROWS = 256
# Pixels by which a slice is continued over seam and poles.
MARGIN = 16
# Voxels beyond the nearest labelled node that may still be a protrusion's.
REACH = 1.5


@dataclass(frozen=True, eq=False)
class LabelledShell:
    """Labels in (d, v, u) above the cortex.

    Attributes
    ----------
    labels : ndarray, (layers, N, 2N) int32
        0 = none.
    first : int
        The layer of the topography that is the lowest one here.
    cortex_um : ndarray, (N, 2N)
        d of the cortex.
    """

    labels: Labels
    first: int
    cortex_um: Floats


def protrusion_volumes(
    mask: Mask,
    surface: Surface,
    uv: UV,
    topography: Topography,
    labels: Labels,
    image: Floats,
    reach: int,
    progress: Progress,
) -> Labels:
    """The label (z, y, x) of every voxel of the mask, 0 in the cortex and outside.

    Parameters
    ----------
    labels : ndarray, (n,) int32
        Of the surface's vertices.
    image : ndarray, (N, 2N)
        d in µm of the surface as seen from above, NaN in empty columns.
    reach : int
        How many nodes labels of the surface reach into the cell before the watershed.
    """
    if not labels.any():
        return np.zeros(mask.shape, np.int32)
    progress(0.0, "filling in the cortex")
    cortex = progress.run(cortex_height, surface, topography, labels, image)
    shell = labelled_shell(topography, labels, cortex, reach, progress.part(0.15, 0.6))
    progress(0.6, "carrying the labels into the cell")
    return _in_voxels(mask, uv, topography, shell, progress.part(0.6, 1.0))


def cortex_height(
    surface: Surface, topography: Topography, labels: Labels, image: Floats
) -> Floats:
    """Height d in µm (N, 2N) of the cortex: the surface, or what lies between protrusions' rims."""
    face = OutermostSurface(surface, topography).face
    on_protrusion = np.append((labels[surface.faces] > 0).sum(axis=1) >= 2, True)
    known = ~on_protrusion[face] & np.isfinite(image)
    rows = min(FILL_ROWS, len(image))
    small, share = shrink(image, rows, known.astype(float))
    filled = enlarge(fill_harmonic(small, share > 0), len(image))
    return np.where(known, image, filled)


def labelled_shell(
    topography: Topography, labels: Labels, cortex_um: Floats, reach: int, progress: Progress
) -> LabelledShell:
    """Labels of the surface, propagated through the cell above the cortex from the top."""
    step = topography.d_um[1] - topography.d_um[0]
    base = (cortex_um - topography.d_um[0]) / step
    first = int(np.clip(np.floor(base.min()), 0, len(topography.d_um) - 1))
    layer = np.arange(first, len(topography.d_um))[:, None, None]
    last = topography.last_layer[1:-1]
    inside = topography.mask[first:] & (layer > base) & (layer <= last)
    shell = np.zeros(inside.shape, np.int32)
    found = np.isfinite(topography.surface).all(axis=1) & (labels > 0)
    places = topography.surface[found].copy()
    places[:, 0] = (places[:, 0] - topography.d_um[0]) / step - first
    index = np.rint(places).astype(np.int64)
    index[:, 2] %= shell.shape[2]
    limit = np.array(shell.shape) - 1
    index = np.clip(index, 0, limit)
    shell[tuple(index.T)] = labels[found]
    progress.run(_expand, shell, inside, index, reach)
    _from_the_top(shell, inside, progress)
    return LabelledShell(shell, first, cortex_um)


@numba.njit(nogil=True, cache=True)
def _expand(labels, inside, sources, reach):  # type: ignore[no-untyped-def]
    """Labels grow from the sources by `reach` steps between neighbours, inside only; in place.

    Columns are periodic, and over a pole the same row follows half a turn away.
    """
    layers, rows, columns = labels.shape
    front = sources
    for _ in range(reach):
        following = np.empty((6 * len(front), 3), np.int64)
        count = 0
        for n in range(len(front)):
            k, i, j = front[n]
            for axis in range(3):
                for way in (-1, 1):
                    a, b, c = k, i, j
                    if axis == 0:
                        a += way
                    elif axis == 1:
                        b += way
                    else:
                        c += way
                    if a < 0 or a >= layers:
                        continue
                    if b < 0 or b >= rows:
                        b, c = i, j + columns // 2
                    c %= columns
                    if inside[a, b, c] and labels[a, b, c] == 0:
                        labels[a, b, c] = labels[k, i, j]
                        following[count, 0], following[count, 1] = a, b
                        following[count, 2] = c
                        count += 1
        front = following[:count]
    for k in range(layers):
        for i in range(rows):
            for j in range(columns):
                if not inside[k, i, j]:
                    labels[k, i, j] = 0


def _from_the_top(labels: Labels, inside: Bools, progress: Progress) -> None:
    """Marker watershed slice by slice downwards; what the slice above has goes first; in place."""
    rows = labels.shape[1]
    margin = min(MARGIN, rows)
    above = np.zeros(labels.shape[1:], np.int32)
    for number, k in enumerate(range(len(labels) - 1, -1, -1)):
        progress(number / len(labels), "labelling the slices from the top")
        slice_inside = inside[k]
        if not slice_inside.any():
            above = np.zeros_like(above)
            continue
        markers = np.where(slice_inside & (above > 0), above, labels[k])
        if markers.any() and (slice_inside & (markers == 0)).any():
            padded = pad_sphere(slice_inside, margin)
            depth = distance_to(~padded[None])[0]
            found = watershed(-depth, pad_sphere(markers, margin), mask=padded)
            markers = found[margin:-margin, margin:-margin].astype(np.int32)
        labels[k] = above = markers


def _in_voxels(
    mask: Mask, uv: UV, topography: Topography, shell: LabelledShell, progress: Progress
) -> Labels:
    """The labels of the shell on the mask's grid, through the inverse map."""
    voxel_um = mask.voxel_size[0]
    pixel = np.sqrt(float(uv.fields["area_um2"].max())) / voxel_um
    near = _near_labels(mask, topography, shell, REACH + pixel)
    index = np.argwhere(near)
    volume = np.zeros(mask.shape, np.int32)
    if len(index) == 0:
        return volume
    locator = TopographyLocator(topography.nodes, topography.d_um, voxel_um)
    places, valid = locator.locate(mask.to_world(index), progress)
    above = np.zeros(len(index), bool)
    above[valid] = places[valid, 0] > sample_uv_linear(shell.cortex_um, places[valid, 1:])
    found = np.zeros(len(index), np.int32)
    found[above] = _at_places(shell, topography, places[above])
    # At the very surface, and where the map does not reach, the next voxel's label holds.
    open_ = (above | ~valid) & (found == 0)
    known = (found > 0) | (valid & ~above)
    if open_.any() and known.any():
        tree = cKDTree(index[known])
        _, nearest = tree.query(index[open_], distance_upper_bound=REACH + pixel)
        found[open_] = np.append(found[known], 0)[nearest]
    volume[tuple(index.T)] = found
    return largest_parts(volume)


def _near_labels(mask: Mask, topography: Topography, shell: LabelledShell, reach: float) -> Bools:
    """Voxels of the mask at most so many voxels from a labelled node."""
    layer, row, column = np.nonzero(shell.labels)
    world = topography.nodes[layer + shell.first, row + 1, column]
    voxel = np.rint(mask.to_index(world)).astype(np.int64)
    voxel = np.clip(voxel, 0, np.array(mask.shape) - 1)
    splat = np.zeros(mask.shape, bool)
    splat[tuple(voxel.T)] = True
    return np.asarray(mask.data & (distance_to(splat) <= reach))


def _at_places(shell: LabelledShell, topography: Topography, places: Floats) -> Labels:
    """Labels (n,) of the nodes nearest to places (d µm, v, u)."""
    step = topography.d_um[1] - topography.d_um[0]
    layers, rows, columns = shell.labels.shape
    layer = np.rint((places[:, 0] - topography.d_um[0]) / step).astype(np.int64) - shell.first
    row = np.clip(np.rint(places[:, 1]).astype(np.int64), 0, rows - 1)
    column = np.rint(places[:, 2]).astype(np.int64) % columns
    labels = shell.labels[np.clip(layer, 0, layers - 1), row, column]
    return np.where((layer >= 0) & (layer < layers), labels, 0)
