"""How different two surfaces are: Chamfer, Hausdorff and sliced Wasserstein distance, area, volume.

Paper, "Assessment of geometrical difference between two meshes". Its volumes are counts of
voxels; ours are those that the meshes enclose.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from ..progress import Progress, silent
from .mesh import face_areas, is_consistently_wound, is_watertight, signed_volume
from .parallel import run_blocks, workers
from .wasserstein import (
    EVALUATIONS,
    PROJECTIONS,
    SAMPLES,
    Statistic,
    sampled_sliced_wasserstein,
    sliced_wasserstein,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Mesh(Protocol):
    """Anything with vertices (n, 3) in µm and faces (m, 3)."""

    @property
    def vertices(self) -> npt.NDArray[Any]: ...

    @property
    def faces(self) -> npt.NDArray[Any]: ...


# Everything ------------------------------------------------------------------


def compare_meshes(
    first: Mesh,
    second: Mesh,
    *,
    projections: int = PROJECTIONS,
    evaluations: int = EVALUATIONS,
    samples: int = SAMPLES,
    order: int = 1,
    statistic: Statistic = "max",
    seed: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Every measure of how `first` differs from `second`.

    Vertices at one place count once, and vertices without a face do not count.

    Parameters
    ----------
    first, second : mesh
        Surface or anything else with ``vertices`` (n, 3) in µm and ``faces`` (m, 3).
    projections, evaluations, order, statistic, seed
        See :func:`~napari_unwrap3d.geometry.wasserstein.sliced_wasserstein`; by default as
        in the paper.
    samples : int
        Points on each surface for the area-weighted sliced Wasserstein distance.
    progress : Progress, optional

    Returns
    -------
    dict
        JSON-able. ``chamfer_um``, ``hausdorff_um`` (both between vertices),
        ``sliced_wasserstein_vertices_um``, ``sliced_wasserstein_area_um`` and
        ``sliced_wasserstein_area_noise_floor_um``; ``area_difference`` and
        ``volume_difference`` (first over second, minus 1), ``area_difference_um2`` and
        ``volume_difference_um3`` (first minus second); ``area_um2`` and ``volume_um3`` of
        ``first`` and ``second``. Volumes are None where a mesh encloses none, and
        ``notes`` says why.

    Raises
    ------
    InputError
        A number of projections, evaluations or samples is not positive.
    MeshError
        A mesh has no area.
    """
    report = progress if progress is not None else silent()
    (v, f), (w, g) = _welded(first), _welded(second)
    report(0.0, "nearest vertices")
    there, back = nearest_distances(v, w)
    options: dict[str, Any] = {
        "projections": projections,
        "evaluations": evaluations,
        "order": order,
        "statistic": statistic,
        "seed": seed,
    }
    vertices = sliced_wasserstein(v, w, **options, progress=report.part(0.1, 0.6))
    sampled = sampled_sliced_wasserstein(
        (v, f), (w, g), samples=samples, **options, progress=report.part(0.6, 1.0)
    )
    return {
        "chamfer_um": float(there.mean() + back.mean()),
        "hausdorff_um": float(max(there.max(), back.max())),
        "sliced_wasserstein_vertices_um": vertices,
        "sliced_wasserstein_area_um": sampled.distance,
        "sliced_wasserstein_area_noise_floor_um": sampled.noise_floor,
        **_areas_and_volumes((v, f), (w, g)),
    }


def _welded(mesh: Mesh) -> tuple[Floats, Ints]:
    """Vertices (n, 3) and faces (m, 3) with one vertex per place, each of a face."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    used, corners = np.unique(faces, return_inverse=True)
    places, at = np.unique(vertices[used], axis=0, return_inverse=True)
    joined = at.ravel()[corners.reshape(faces.shape)]
    a, b, c = joined.T
    return places, joined[(a != b) & (b != c) & (c != a)]


def _areas_and_volumes(first: tuple[Floats, Ints], second: tuple[Floats, Ints]) -> dict[str, Any]:
    areas, volumes, notes = [], [], []
    for name, (vertices, faces) in (("first", first), ("second", second)):
        areas.append(float(face_areas(vertices, faces).sum()))
        why = _why_no_volume(faces)
        volumes.append(abs(signed_volume(vertices, faces)) if not why else None)
        notes += [f"The {name} mesh {why}: it has no volume."] if why else []
    one, other = volumes
    ratio = difference = None
    if one is not None and other:
        ratio, difference = one / other - 1.0, one - other
    return {
        "area_difference": areas[0] / areas[1] - 1.0,
        "area_difference_um2": areas[0] - areas[1],
        "volume_difference": ratio,
        "volume_difference_um3": difference,
        "area_um2": dict(zip(("first", "second"), areas, strict=True)),
        "volume_um3": dict(zip(("first", "second"), volumes, strict=True)),
        "notes": notes,
    }


def _why_no_volume(faces: Ints) -> str:
    if not is_watertight(faces):
        return "is open, or branches"
    return "" if is_consistently_wound(faces) else "has faces wound both ways"


# Distances between vertices ----------------------------------------------------


def nearest_distances(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Distance from every point to the nearest of the other set, (n,) and (m,)."""
    first_tree, second_tree = run_blocks(_tree, [first, second])
    to_second: Floats = second_tree.query(first, workers=workers())[0]
    to_first: Floats = first_tree.query(second, workers=workers())[0]
    return to_second, to_first


def _tree(points: Floats) -> KDTree:
    """Built in a third of the time of a balanced one, and as quick to ask."""
    return KDTree(points, balanced_tree=False, compact_nodes=False)


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
    to_second, to_first = nearest_distances(first, second)
    return float(to_second.mean() + to_first.mean())


# Area and volume ---------------------------------------------------------------


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
