"""Taking a mesh apart and putting it together on the sphere: exact, complete, without flips."""

import numpy as np
import pytest
import trimesh

from napari_unwrap3d.errors import NotGenusZeroError
from napari_unwrap3d.geometry.area_polish import determinant
from napari_unwrap3d.geometry.distortion import flipped_faces
from napari_unwrap3d.geometry.hierarchy import VertexHierarchy
from napari_unwrap3d.geometry.mesh import euler_characteristic, is_consistently_wound
from shapes import icosphere, lumpy, outward


def taken_apart(vertices: np.ndarray, faces: np.ndarray) -> VertexHierarchy:
    return VertexHierarchy(vertices, faces, np.full(len(vertices), 1.0 / len(vertices)))


def bipyramid(sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Two vertices with very many neighbours."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.zeros(sides), np.sin(angle), np.cos(angle)], axis=1)
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate(
        [
            np.stack([i, j, np.full(sides, sides)], 1),
            np.stack([j, i, np.full(sides, sides + 1)], 1),
        ]
    )
    return outward(trimesh.Trimesh(np.vstack([ring, [2, 0, 0], [-2, 0, 0]]), faces, process=False))


MESHES = [icosphere(2), lumpy(3), bipyramid(90), outward(trimesh.creation.box()), bipyramid(3)]


@pytest.mark.parametrize("mesh", MESHES)
def test_four_vertices_are_left_and_everything_comes_back(mesh) -> None:
    vertices, faces = mesh
    hierarchy = taken_apart(vertices, faces)
    assert hierarchy.alive.sum() == 4
    assert hierarchy.missing == len(vertices) - 4
    assert len(hierarchy.present_faces()) == 4
    assert hierarchy.insert(hierarchy.missing) == 0
    assert hierarchy.missing == 0
    assert hierarchy.alive.all()
    np.testing.assert_array_equal(hierarchy.faces, faces)
    for vertex in range(len(vertices)):
        around = hierarchy.star[vertex, : hierarchy.degree[vertex]]
        assert set(around) == set(np.flatnonzero((faces == vertex).any(axis=1)))


@pytest.mark.parametrize("mesh", MESHES)
def test_every_size_in_between_is_a_sphere_without_flips(mesh) -> None:
    hierarchy = taken_apart(*mesh)
    while True:
        chosen = hierarchy.faces[hierarchy.present_faces()]
        names, local = np.unique(chosen, return_inverse=True)
        assert euler_characteristic(local.reshape(-1, 3)) == 2
        assert is_consistently_wound(local.reshape(-1, 3))
        assert flipped_faces(hierarchy.positions[names], local.reshape(-1, 3)) == 0
        assert hierarchy.mass[names].sum() == pytest.approx(1.0)
        if not hierarchy.missing:
            break
        hierarchy.insert(max(1, len(names) // 3))
    np.testing.assert_allclose(hierarchy.mass, 1.0 / len(hierarchy.mass))


def test_a_torus_cannot_be_taken_apart() -> None:
    mesh = trimesh.creation.torus(3, 1, major_sections=12, minor_sections=8)
    with pytest.raises(NotGenusZeroError, match="apart") as caught:
        taken_apart(*outward(mesh))
    assert caught.value.measured["vertices_left"] > 4


def test_the_same_mesh_is_taken_apart_the_same_way() -> None:
    first, second = taken_apart(*lumpy(3)), taken_apart(*lumpy(3))
    for hierarchy in (first, second):
        hierarchy.insert(hierarchy.missing)
    np.testing.assert_array_equal(first.positions, second.positions)


def test_determinants_of_tiny_faces_keep_their_sign() -> None:
    centre = np.array([0.6, 0.0, 0.8])
    for size in (1e-2, 1e-6, 1e-10):
        b = centre + size * np.array([0.0, 1.0, 0.0])
        c = centre + size * np.array([0.8, 0.0, -0.6])
        expected = centre @ np.cross(b - centre, c - centre)
        assert determinant(centre, b, c) == pytest.approx(expected, rel=1e-5)
        assert determinant(centre, c, b) == pytest.approx(-expected, rel=1e-5)
