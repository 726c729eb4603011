"""Remeshing: same topology, same surface, better triangles."""

import numpy as np
import pytest
from scipy import ndimage

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.curvature import corner_angles
from napari_unwrap3d.geometry.locate import SurfaceLocator
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.geometry.mesh import (
    euler_characteristic,
    face_areas,
    face_neighbors,
    is_consistently_wound,
    is_watertight,
    nonmanifold_vertices,
    radius_ratio,
    signed_volume,
)
from napari_unwrap3d.geometry.remesh import (
    DELAUNAY,
    VALENCE,
    flip_edges,
    level_set_projection,
    relax,
    simplify,
    subdivide,
)
from napari_unwrap3d.progress import Progress, silent
from shapes import ball, grid, icosphere, torus


def level(solid: np.ndarray) -> np.ndarray:
    return ndimage.gaussian_filter(solid.astype(np.float32), 1.0) - np.float32(0.5)


SHAPES = {
    "lumps": level(ball(9, 33) | (np.linalg.norm(grid(33) - [0, 4, 9], axis=-1) < 5)),
    "torus": level(torus(10, 4, (15, 35, 35))),
}


def obtuse_pairs(vertices: np.ndarray, faces: np.ndarray) -> int:
    """Edges whose opposite angles sum to more than π (and some rounding)."""
    angles, across = corner_angles(vertices, faces), face_neighbors(faces)
    count = 0
    for f, k in np.ndindex(*faces.shape):
        g = across[f, k]
        j = int(np.flatnonzero(across[g] == f)[0])
        count += angles[f, k] + angles[g, j] > np.pi + 0.02
    return count // 2


@pytest.mark.parametrize("name", SHAPES)
def test_relaxing_improves_the_triangles_and_nothing_else(name: str) -> None:
    field = SHAPES[name]
    vertices, faces = clamped_marching_cubes(field)
    before = vertices.copy(), faces.copy()
    project = level_set_projection(field)
    points, triangles = relax(vertices, faces, silent(), project=project)
    np.testing.assert_array_equal(vertices, before[0])
    np.testing.assert_array_equal(faces, before[1])
    assert points.shape == vertices.shape
    assert triangles.shape == faces.shape
    assert is_watertight(triangles)
    assert is_consistently_wound(triangles)
    assert len(nonmanifold_vertices(triangles)) == 0
    assert euler_characteristic(triangles) == euler_characteristic(faces)
    old, new = radius_ratio(vertices, faces), radius_ratio(points, triangles)
    assert new.mean() > 0.9 > old.mean()
    assert new.min() > 0.3 > old.min()
    _, _, distance = SurfaceLocator(vertices, faces).closest(points)
    assert distance.max() < 0.25
    volume = signed_volume(vertices, faces)
    assert signed_volume(points, triangles) == pytest.approx(volume, rel=0.02)


def test_valence_flips_equalise_the_numbers_of_neighbours() -> None:
    points, faces = clamped_marching_cubes(SHAPES["lumps"])
    before = np.bincount(faces.ravel())
    flip_edges(points, faces, face_neighbors(faces), VALENCE)
    after = np.bincount(faces.ravel())
    assert np.var(after) < 0.6 * np.var(before)
    assert after.sum() == before.sum()
    assert after.min() >= 3


@pytest.mark.parametrize("rule", [VALENCE, DELAUNAY])
def test_the_neighbours_are_right_after_flips(rule: int) -> None:
    points, faces = clamped_marching_cubes(SHAPES["lumps"])
    neighbors = face_neighbors(faces)
    assert flip_edges(points, faces, neighbors, rule) > 50
    np.testing.assert_array_equal(neighbors, face_neighbors(faces))
    assert is_watertight(faces)
    assert is_consistently_wound(faces)
    assert euler_characteristic(faces) == 2


def test_delaunay_flips_leave_almost_no_obtuse_pair() -> None:
    points, faces = clamped_marching_cubes(SHAPES["lumps"])
    before = obtuse_pairs(points, faces)
    neighbors = face_neighbors(faces)
    while flip_edges(points, faces, neighbors, DELAUNAY):
        pass
    assert obtuse_pairs(points, faces) < 0.1 * before


def test_a_good_mesh_has_nothing_to_flip() -> None:
    vertices, faces = icosphere(3)
    assert flip_edges(vertices, faces, face_neighbors(faces), DELAUNAY) == 0


def test_without_a_projection_vertices_move_along_the_surface() -> None:
    vertices, faces = clamped_marching_cubes(9.0 - np.linalg.norm(grid(25), axis=-1))
    points, _ = relax(vertices, faces, silent(), iterations=4)
    radius = np.linalg.norm(points - 12, axis=1)
    assert np.abs(radius - 9).max() < 0.12
    assert np.abs(points - vertices).max() > 0.1


def test_remeshing_reports_and_can_be_cancelled() -> None:
    vertices, faces = icosphere(2)
    seen: list[float] = []
    relax(vertices, faces, Progress(lambda step, fraction, message: seen.append(fraction)))
    assert seen == sorted(seen)
    assert len(seen) == 15
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        relax(vertices, faces, progress)


def test_simplifying_reduces_to_the_target_and_keeps_the_shape() -> None:
    vertices, faces = clamped_marching_cubes(SHAPES["torus"])
    fewer, triangles = simplify(vertices, faces, len(vertices) // 3)
    assert len(fewer) == pytest.approx(len(vertices) / 3, rel=0.02)
    assert euler_characteristic(triangles) == 0
    assert is_watertight(triangles)
    assert signed_volume(fewer, triangles) == pytest.approx(
        signed_volume(vertices, faces), rel=0.02
    )
    same, _ = simplify(vertices, faces, len(vertices))
    assert same is vertices


def test_points_are_projected_onto_the_zero_set_along_the_shortest_way() -> None:
    distance = np.linalg.norm(grid(31), axis=-1).astype(np.float32)
    project = level_set_projection(10 - distance)
    rng = np.random.default_rng(0)
    way = rng.normal(size=(500, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = way * rng.uniform(9.3, 10.7, (500, 1)) + 15
    landed = project(start) - 15
    assert np.abs(np.linalg.norm(landed, axis=1) - 10).max() < 0.03
    assert np.abs(np.einsum("ij,ij->i", landed, way) - 10).max() < 0.03
    # A step is never longer than half a voxel: two of them cannot leave the neighbourhood.
    far = way * 14 + 15
    assert np.linalg.norm(project(far) - far, axis=1).max() < 1.01


@pytest.mark.parametrize("name", SHAPES)
def test_subdividing_cuts_every_face_into_four(name: str) -> None:
    vertices, faces = clamped_marching_cubes(SHAPES[name])
    finer, triangles = subdivide(vertices, faces)
    assert len(triangles) == 4 * len(faces)
    assert euler_characteristic(triangles) == euler_characteristic(faces)
    assert is_watertight(triangles)
    assert is_consistently_wound(triangles)
    np.testing.assert_array_equal(finer[: len(vertices)], vertices)
    # The same surface, with the same orientation.
    assert signed_volume(finer, triangles) == pytest.approx(signed_volume(vertices, faces))
    assert face_areas(finer, triangles).sum() == pytest.approx(face_areas(vertices, faces).sum())
