"""Which vertex is on which protrusion (paper, "Topography guided instance segmentation").

Tops of protrusions are connected parts of high mean curvature in (d, u, v). The paper
takes (d, u, v) as an isotropic box; here it is the shell that it stands for, sphere × height,
on two patches without poles whose voxels have the same edges in d and along the surface. So
a voxel, in which the parameters count, is as large at a pole as elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.spatial import cKDTree

from ...charts import UV, Floats, Topography
from ...geometry.affinity import spread_labels
from ...geometry.distance import signed_distance
from ...geometry.interpolate import sample_linear
from ...geometry.padding import pad_sphere
from ...geometry.sphere_patches import (
    PATCHES,
    SpherePatches,
    label_patches,
    sample_columns,
    shell_mean_curvature,
)
from ...parameters import TopographicParameters
from ...progress import Progress
from ...unwrapping.uv import direction_to_uv, uv_to_direction

Bools = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]
Floats32 = npt.NDArray[np.float32]

SCALES = {"kmeans": (1.0,), "gmm": (1.0, 3.0, 5.0)}
# Voxels beyond a patch, so that distances and filters see what lies there.
MARGIN = 20
# Layers beyond the surface.
BEYOND = 8
# Wider Gaussians are made of every second voxel of this narrow one.
NARROW = 1.0


@dataclass(frozen=True, eq=False)
class Curvatures:
    """Mean curvature at several scales in the shell around the surface.

    Attributes
    ----------
    patches : SpherePatches
    shells : two ndarrays, (layers, rows, columns) bool
    features : two ndarrays, (voxels, 3) float32
        H smoothed with σ = 1, 3 and 5 at the voxels of the shell, per topographic voxel.
    layers_um : ndarray, (layers,)
        d of the layers.
    edge_um : float
        Edge of a topographic voxel.
    """

    patches: SpherePatches
    shells: tuple[Bools, Bools]
    features: tuple[Floats32, Floats32]
    layers_um: Floats
    edge_um: float


def topographic_curvatures(
    uv: UV,
    topography: Topography,
    voxel_um: float,
    parameters: TopographicParameters,
    progress: Progress,
) -> Curvatures:
    """Mean curvature H = −½ ∇·n of the topographic surface, convex positive.

    n is the unit gradient of the signed distance to the cell in (d, u, v), which grows
    inwards in the paper and outwards here.
    """
    edge = parameters.grid_voxels * voxel_um
    radius = np.sqrt(float(uv.fields["area_um2"].sum()) / (4.0 * np.pi))
    patches = SpherePatches(max(round(np.pi * radius / edge), 16), MARGIN)
    places = topography.surface[np.isfinite(topography.surface).all(axis=1), 0]
    low, high = places.min() - BEYOND * edge, places.max() + BEYOND * edge
    layers = np.arange(low, high + edge, edge)
    shells, features = [], []
    for patch in PATCHES:
        part = progress.part(0.5 * patch, 0.5 * patch + 0.5)
        shell, values = _patch_curvatures(patches, patch, topography, layers, parameters, part)
        shells.append(shell)
        features.append(values)
    return Curvatures(patches, (shells[0], shells[1]), (features[0], features[1]), layers, edge)


def _patch_curvatures(
    patches: SpherePatches,
    patch: int,
    topography: Topography,
    layers_um: Floats,
    parameters: TopographicParameters,
    progress: Progress,
) -> tuple[Bools, Floats32]:
    """The shell and the features of its voxels on one patch."""
    progress(0.0, "resampling the topography")
    rows = topography.shape[1]
    vu = direction_to_uv(patches.directions(patch).reshape(-1, 3), rows)
    v, u = (vu.T + 1.0).reshape(2, *patches.shape)
    step = topography.d_um[1] - topography.d_um[0]
    layers = (layers_um - topography.d_um[0]) / step
    padded = pad_sphere(topography.mask, 1, axis=1)
    solid = progress.run(sample_columns, padded, layers, v, u)
    progress(0.15, "measuring the topographic curvature")
    distance = progress.run(signed_distance, solid)
    # A ball that dilates by r reaches centres up to r away from those in the cell.
    shell: Bools = np.abs(distance) <= parameters.shell - 0.5
    curvature = progress.run(shell_mean_curvature, distance, patches.sines)
    del distance
    progress(0.5, "measuring the topographic curvature")
    return shell, progress.run(_at_scales, curvature, shell)


def _at_scales(curvature: Floats32, shell: Bools) -> Floats32:
    """The Gaussian-smoothed curvature at the voxels of the shell, a column per scale."""
    narrow = ndimage.gaussian_filter(curvature, NARROW)
    features = [narrow[shell]]
    coarse = narrow[::2, ::2, ::2]
    half = np.argwhere(shell) / 2.0
    for scale in SCALES["gmm"][1:]:
        wide = ndimage.gaussian_filter(coarse, 0.5 * np.sqrt(scale**2 - NARROW**2))
        features.append(sample_linear(wide, half))
    return np.stack(features, axis=1)


def find_instances(
    curvatures: Curvatures,
    method: str,
    places: Floats,
    binary: Bools,
    areas: Floats,
    affinity: sparse.csr_array,
    parameters: TopographicParameters,
    progress: Progress,
) -> tuple[Labels, dict[str, Any]]:
    """A label per vertex, from 1 without gaps, 0 = none, and the numbers on the way.

    Parameters
    ----------
    method : str
        "kmeans" (σ = 1; blebs, filopodia) or "gmm" (σ = 1, 3, 5; lamellipodia).
    places : ndarray, (n, 3)
        (d µm, direction…) of the vertices: see :func:`shell_places`; NaN without an image.
    binary : ndarray, (n,) bool
        The vertices on protrusions.
    areas : ndarray, (n,)
        Of every vertex in µm².
    """
    progress(0.0, "classifying the curvature")
    classes = progress.run(_classify, curvatures, method, parameters)
    progress(0.5, "labelling the tops")
    solids = []
    for shell, kept in zip(curvatures.shells, classes, strict=True):
        solid = np.zeros(shell.shape, bool)
        solid[shell] = kept
        solids.append(solid)
    tops, count = progress.run(
        label_patches, curvatures.patches, (solids[0], solids[1]), parameters.smallest_top
    )
    progress(0.8, "carrying the tops to the surface")
    labels = progress.run(_nearest_tops, curvatures, tops, places, parameters.expansion)
    labels = np.where(binary, labels, 0)
    area = np.bincount(labels, areas, minlength=count + 1)
    labels = np.where(area[labels] >= parameters.smallest_instance_um2, labels, 0)
    labels = progress.run(
        spread_labels, affinity, labels, parameters.spreading, parameters.clamping
    )
    labels = renumbered(np.where(binary, labels, 0))
    covered = float(areas[labels > 0].sum() / max(areas[binary].sum(), 1e-300))
    return labels, {"tops": count, "instances": int(labels.max(initial=0)), "covered": covered}


def renumbered(labels: npt.NDArray[np.integer]) -> Labels:
    """The same labels as 1…k, 0 stays."""
    names = np.unique(labels[labels > 0])
    return np.where(labels > 0, np.searchsorted(names, labels) + 1, 0).astype(np.int32)


def shell_places(topography: Topography, curvatures: Curvatures) -> Floats:
    """Vertices (n, 4) in the shell sphere × height, in topographic voxels."""
    places = topography.surface
    directions = uv_to_direction(places[:, 1:], topography.shape[1])
    return _embedded(curvatures, directions, places[:, 0])


def _embedded(curvatures: Curvatures, directions: Floats, d_um: Floats) -> Floats:
    return np.column_stack([directions / curvatures.patches.step, d_um / curvatures.edge_um])


def _classify(
    curvatures: Curvatures, method: str, parameters: TopographicParameters
) -> Sequence[Bools]:
    """Which voxels of each shell are of the class with the highest mean curvature (σ = 1)."""
    scales = len(SCALES[method])
    owned = [
        np.broadcast_to(curvatures.patches.owned(patch), shell.shape)[shell]
        for patch, shell in zip(PATCHES, curvatures.shells, strict=True)
    ]
    features = [values[:, :scales].astype(np.float64) for values in curvatures.features]
    pool = np.concatenate([values[own] for values, own in zip(features, owned, strict=True)])
    rng = np.random.default_rng(parameters.seed)
    sample = pool[rng.choice(len(pool), min(parameters.samples, len(pool)), replace=False)]
    if len(np.unique(sample, axis=0)) < parameters.classes:
        return [np.zeros(len(values), bool) for values in features]
    model = _model(method, parameters)
    of_sample = model.fit(sample).predict(sample)
    mean = np.bincount(of_sample, sample[:, 0], parameters.classes)
    number = np.bincount(of_sample, minlength=parameters.classes)
    highest = np.argmax(np.where(number > 0, mean / np.maximum(number, 1), -np.inf))
    return [model.predict(values) == highest for values in features]


def _model(method: str, parameters: TopographicParameters) -> Any:
    if method == "gmm":
        from sklearn.mixture import GaussianMixture

        return GaussianMixture(parameters.classes, random_state=parameters.seed)
    from sklearn.cluster import KMeans

    return KMeans(parameters.classes, n_init=10, random_state=parameters.seed)


def _nearest_tops(
    curvatures: Curvatures, tops: Sequence[Labels], places: Floats, reach: float
) -> Labels:
    """The label (n,) of the nearest top within `reach` voxels of every vertex."""
    points, labels = [], []
    for patch in PATCHES:
        owned = curvatures.patches.owned(patch)
        layer, row, column = np.nonzero(tops[patch] * owned)
        directions = curvatures.patches.directions(patch)[row, column]
        points.append(_embedded(curvatures, directions, curvatures.layers_um[layer]))
        labels.append(tops[patch][layer, row, column])
    label = np.append(np.concatenate(labels), 0)
    result = np.zeros(len(places), np.int32)
    found = np.isfinite(places).all(axis=1)
    if len(label) > 1 and found.any():
        tree = cKDTree(np.concatenate(points), balanced_tree=False, compact_nodes=False)
        _, nearest = tree.query(places[found], distance_upper_bound=reach)
        result[found] = label[nearest]
    return result
