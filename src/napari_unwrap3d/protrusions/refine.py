"""Under-segmented blebs taken apart: several round caps under one label become several labels.

Paper, Methods, "Refinement of undersegmented blebs". Of each protrusion, laid on a square
image, what is more curved than the higher of two Otsu thresholds of the whole surface is a
union of discs, one for each bleb; a watershed of its distance transform tells them apart.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from ..charts import Mask, Surface
from ..errors import FlippedFacesError, NotADiskError, TooSmallError
from ..geometry.laplacian import Factor, cotangent_laplacian, vertex_mass
from ..parameters import RefinementParameters
from ..progress import Progress
from .disk import Net, net_of, unwrap_disk
from .segment import Segmentation

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Labels = npt.NDArray[np.int32]

logger = logging.getLogger(__name__)

CURVATURE = "mean_curvature_per_um"
CLASSES = 3
# Beyond these quantiles curvatures are those of single bad triangles.
QUANTILES = (0.001, 0.999)
# Of the disk: caps are told apart whether or not areas are kept to a percent.
TOLERANCE, ITERATIONS = 0.05, 10


def refine(
    surface: Surface,
    labels: npt.NDArray[np.integer],
    voxel_um: float,
    parameters: RefinementParameters,
    progress: Progress,
) -> Labels:
    """Split protrusions that are several blebs.

    Parameters
    ----------
    surface : Surface
        With the field ``mean_curvature_per_um``.
    labels : ndarray, (n,) int
        One per vertex, 0 = none.
    voxel_um : float
        Edge of the working grid's voxels: the unit of the least area.
    parameters : RefinementParameters
    progress : Progress

    Returns
    -------
    ndarray, (n,) int32
        The largest part of a protrusion keeps its label, the others get new ones after the
        last. What is not of disk topology is left as it is, and so is 0.
    """
    refined = np.array(labels, dtype=np.int32)
    names = np.unique(refined[refined > 0])
    if len(names) == 0:
        return refined
    progress(0.0, "smoothing the curvature")
    smoothing_um = parameters.smoothing_voxels * voxel_um
    curvature = progress.run(smoothed, surface, surface.fields[CURVATURE], smoothing_um)
    threshold = curvature_threshold(curvature)
    least_um2 = parameters.minimum_area * voxel_um**2
    net = net_of(surface.vertices, surface.faces)
    lengths = _edge_graph(surface, net.edges)
    following = int(names[-1])
    for number, name in enumerate(names):
        part = progress.part(number / len(names), (number + 1) / len(names))
        part(0.0, f"refining protrusion {number + 1} of {len(names)}")
        seeds = _seeds(surface, labels, int(name), curvature, threshold, parameters, net, part)
        inside = np.flatnonzero(refined == name)
        for area in _spread_parts(lengths, inside, seeds[inside], net.mass, least_um2):
            following += 1
            refined[area] = following
    return refined


def refine_segmentation(
    found: Segmentation,
    mask: Mask,
    surface: Surface,
    parameters: RefinementParameters,
    progress: Progress,
) -> Segmentation:
    """A segmentation with several blebs under one label told apart, on the surface and inside.

    A voxel of a protrusion that was split goes with the nearest vertex of the protrusion.
    """
    voxel_um = float(mask.voxel_size[0])
    labels = refine(surface, found.labels, voxel_um, parameters, progress)
    volume = found.volume.copy()
    changed = np.unique(found.labels[labels != found.labels])
    for name in changed:
        own = found.labels == name
        voxels = np.nonzero(found.volume == name)
        positions = mask.to_world(np.stack(voxels, axis=1).astype(np.float64))
        _, nearest = cKDTree(surface.vertices[own]).query(positions)
        volume[voxels] = labels[own][nearest]
    numbers = {**found.numbers, "protrusions_split": len(changed)}
    return replace(found, labels=labels, volume=volume, numbers=numbers)


def smoothed(surface: Surface, values: npt.NDArray[np.floating], sigma_um: float) -> Floats:
    """Values (n,) after diffusion over the surface by σ in µm, one implicit step."""
    mass = sparse.diags_array(vertex_mass(surface.vertices, surface.faces))
    laplacian = cotangent_laplacian(surface.vertices, surface.faces)
    matrix = mass - 0.5 * sigma_um**2 * laplacian
    return Factor(matrix).solve(mass @ np.asarray(values, np.float64))


def curvature_threshold(curvature: Floats) -> float:
    """The higher threshold of a three-class Otsu segmentation: negative, flat, positive."""
    from skimage.filters import threshold_multiotsu

    low, high = np.quantile(curvature, QUANTILES)
    clipped = np.clip(curvature, low, high)
    if len(np.unique(clipped)) < CLASSES:
        return float(high)
    return float(threshold_multiotsu(clipped, classes=CLASSES)[-1])


def _seeds(
    surface: Surface,
    labels: npt.NDArray[np.integer],
    name: int,
    curvature: Floats,
    threshold: float,
    parameters: RefinementParameters,
    net: Net,
    progress: Progress,
) -> Ints:
    """A number per vertex (n,) of the surface: 1, 2, … in the caps of a protrusion, else 0."""
    seeds = np.zeros(len(labels), np.int64)
    try:
        disk = unwrap_disk(
            surface,
            labels,
            name,
            pixels=parameters.pixels,
            tolerance=TOLERANCE,
            iterations=ITERATIONS,
            net=net,
            progress=progress,
        )
    except (NotADiskError, TooSmallError, FlippedFacesError) as error:
        logger.info("Protrusion %d is not refined: %s", name, error)
        return seeds
    caps = split_caps(disk.scalars_to_square(curvature) > threshold, parameters.depth)
    seeds[disk.vertices] = disk.labels_to_vertices(caps)
    return seeds


def split_caps(high: npt.NDArray[np.bool_], depth: float) -> Ints:
    """Discs of a binary image told apart: a watershed of the distance to the background.

    Parameters
    ----------
    high : ndarray, (N, N) bool
    depth : float
        Two discs are two where the way between their middles narrows by more than this part
        of the smaller one's radius.

    Returns
    -------
    ndarray, (N, N) int64
        0 outside.
    """
    from skimage.morphology import disk
    from skimage.segmentation import watershed

    closed = ndimage.binary_closing(np.pad(high, 2), disk(1))[2:-2, 2:-2] | high
    distance = ndimage.distance_transform_edt(np.pad(closed, 1))[1:-1, 1:-1]
    # In the logarithm a depth is a part of the radius, whatever the radius is.
    height = np.log(np.maximum(distance, 0.5))
    markers = _peaks(height, -np.log1p(-depth))
    parts: Ints = watershed(-distance, markers, mask=closed).astype(np.int64)
    return parts


def _peaks(height: Floats, depth: float) -> Ints:
    """The maxima of an image, numbered, that rise more than `depth` above a saddle to a higher."""
    from skimage.morphology import local_maxima, reconstruction

    flooded = reconstruction(height - depth, height, method="dilation")
    peaks: Ints = ndimage.label(local_maxima(flooded), np.ones((3, 3)))[0].astype(np.int64)
    return peaks


def _edge_graph(surface: Surface, edges: Ints) -> sparse.csr_array:
    """Lengths of the edges (e, 2) between the vertices of a surface, (n, n)."""
    lengths = np.linalg.norm(np.diff(surface.vertices[edges], axis=1)[:, 0], axis=1)
    size = len(surface.vertices)
    half = sparse.coo_array((lengths, tuple(edges.T)), (size, size)).tocsr()
    return sparse.csr_array(half + half.T)


def _spread_parts(
    lengths: sparse.csr_array, inside: Ints, seeds: Ints, mass: Floats, least_um2: float
) -> Iterator[Ints]:
    """Parts but the largest, as vertices of the surface, of those `inside` (k,).

    Every vertex goes with the nearest seed (k,), along edges inside. Parts that stay below the
    least area are given to the others.
    """
    graph = lengths[inside][:, inside]
    seeds = seeds.copy()
    while True:
        chosen = np.flatnonzero(seeds)
        if len(np.unique(seeds[chosen])) < 2:
            return
        _, _, source = csgraph.dijkstra(
            graph, directed=False, indices=chosen, min_only=True, return_predecessors=True
        )
        reached = source >= 0
        part = np.where(reached, seeds[np.where(reached, source, 0)], 0)
        area = np.bincount(part, mass[inside])
        area[0] = np.inf
        present = np.flatnonzero(np.bincount(part))
        smallest = present[area[present].argmin()]
        if area[smallest] >= least_um2:
            break
        seeds[seeds == smallest] = 0
    area[0] = 0.0
    for other in present[present > 0]:
        if other != area.argmax():
            yield inside[part == other]
