"""Voxels of meshes against closed formulas and libigl's winding numbers."""

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.geometry.mesh import signed_volume
from napari_unwrap3d.geometry.voxelize import voxelize, winding_number
from shapes import grid, icosphere, outward, rotation

SHAPE = (24, 26, 28)
CENTRE = (np.array(SHAPE) - 1) / 2


def test_a_sphere_is_filled_exactly() -> None:
    directions, faces = icosphere(4)
    vertices = CENTRE + 9.3 * directions
    solid = voxelize(vertices, faces, SHAPE)
    distance = np.linalg.norm(grid(SHAPE), axis=-1)
    deepest_face = np.linalg.norm(directions[faces].mean(axis=1), axis=1).min()
    assert solid[distance < 9.3 * deepest_face - 1e-3].all()
    assert not solid[distance > 9.3 + 1e-3].any()
    assert solid.sum() == pytest.approx(signed_volume(vertices, faces), rel=0.02)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_a_turned_box_is_filled_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, extents = rotation(seed), rng.uniform(4, 15, 3)
    centre = CENTRE + rng.uniform(-1, 1, 3)
    vertices, faces = outward(trimesh.creation.box(extents))
    solid = voxelize(vertices @ turn.T + centre, faces, SHAPE)
    depth = (0.5 * extents - np.abs((grid(SHAPE) + CENTRE - centre) @ turn)).min(axis=-1)
    clear = np.abs(depth) > 1e-3  # the mesh is shifted by less than that
    np.testing.assert_array_equal(solid[clear], (depth > 0)[clear])


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_winding_numbers_of_overlapping_pieces_agree_with_libigl(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (12, 13, 14)
    parts, faces, count = [], [], 0
    for _ in range(3):
        v, f = outward(trimesh.creation.icosphere(subdivisions=1))
        # Every second piece is turned inside out.
        parts.append(v * rng.uniform(2, 5, 3) @ rotation(seed).T + rng.uniform(3, 10, 3))
        faces.append((f if len(parts) % 2 else f[:, ::-1]) + count)
        count += len(v)
    vertices, triangles = np.concatenate(parts), np.concatenate(faces)
    index = np.stack(np.indices(shape), axis=-1).reshape(-1, 3).astype(float)
    expected = igl.winding_number(vertices, triangles, index).reshape(shape)
    found = winding_number(vertices, triangles, shape)
    squared = igl.point_mesh_squared_distance(index, vertices, triangles)[0].reshape(shape)
    clear = squared > 1e-6  # the mesh is shifted by less than that
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(found[clear], np.rint(expected)[clear])


def test_overlaps_count_twice_and_belong_to_the_solid() -> None:
    directions, faces = icosphere(3)
    first, second = 6 * directions + CENTRE - 2, 6 * directions + CENTRE + 2
    both = np.concatenate([first, second]), np.concatenate([faces, faces + len(directions)])
    number = winding_number(*both, SHAPE)
    one, two = voxelize(first, faces, SHAPE), voxelize(second, faces, SHAPE)
    np.testing.assert_array_equal(number, one.astype(int) + two.astype(int))
    assert number.max() == 2
    np.testing.assert_array_equal(voxelize(*both, SHAPE), one | two)


def test_inside_out_is_empty() -> None:
    directions, faces = icosphere(2)
    vertices = CENTRE + 6 * directions
    assert winding_number(vertices, faces[:, ::-1], SHAPE).min() == -1
    assert not voxelize(vertices, faces[:, ::-1], SHAPE).any()


def test_faces_through_voxel_centres_count_half_open() -> None:
    """A box whose faces, edges and corners all pass through centres has its exact volume."""
    vertices, faces = outward(trimesh.creation.box((4, 6, 8)))
    solid = voxelize(vertices + np.array([8, 9, 10]), faces, SHAPE)
    assert solid.sum() == 4 * 6 * 8
    assert solid.any(axis=(1, 2)).sum() == 4


def test_what_lies_outside_of_the_grid_is_cut_off() -> None:
    directions, faces = icosphere(3)
    vertices = CENTRE + 20 * directions + [1, 5, -7]
    big = tuple(n + 60 for n in SHAPE)
    whole = voxelize(vertices + 30, faces, big)
    part = voxelize(vertices, faces, SHAPE)
    np.testing.assert_array_equal(part, whole[30 : 30 + 24, 30 : 30 + 26, 30 : 30 + 28])
    assert part.any()
    assert not voxelize(vertices + 100, faces, SHAPE).any()
