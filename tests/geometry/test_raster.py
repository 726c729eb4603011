"""The outermost face over every pixel, against trying every face."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.geometry.raster import outermost_faces
from napari_unwrap3d.unwrapping.topographic_surface import cut_at_seam
from napari_unwrap3d.unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction
from shapes import icosphere, rotation

ROWS = 24


def brute_force(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Largest d (ROWS, 2 ROWS) over every pixel's centre, NaN without any face."""
    height = np.full((ROWS, 2 * ROWS), -np.inf)
    i, j = np.mgrid[:ROWS, -2 * ROWS : 4 * ROWS]
    centres = np.stack([i, j, np.ones_like(i)], axis=-1)[..., None]
    for face in faces:
        corners = vertices[face]
        matrix = np.vstack([corners[:, 1], corners[:, 2], np.ones(3)])
        if abs(np.linalg.det(matrix)) < 1e-9:
            continue
        weights = (np.linalg.inv(matrix) @ centres)[..., 0]
        d = np.where((weights > -1e-12).all(axis=-1), weights @ corners[:, 0], -np.inf)
        height = np.maximum(height, d.reshape(ROWS, 3, 2 * ROWS).max(axis=1))
    return np.where(np.isfinite(height), height, np.nan)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_random_triangles_away_from_the_poles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.uniform([-5, 11.5, 0], [5, 11.5, 2 * ROWS], (12, 1, 3))
    size = [2.5, 0.9, 4.0]
    vertices = (centre + rng.uniform(-1, 1, (12, 3, 3)) * size).reshape(-1, 3)
    faces = np.arange(36).reshape(12, 3)
    face, weights, height = outermost_faces(vertices, faces, ROWS)
    expected = brute_force(vertices, faces)
    np.testing.assert_allclose(height, expected, atol=1e-9)
    np.testing.assert_array_equal(face >= 0, np.isfinite(expected))
    # The weights say where in the face the pixel is, at this height, a turn apart.
    seen = face >= 0
    place = np.einsum("ijk,ij->ik", vertices[faces[face[seen]]], weights[seen])
    i, j = np.nonzero(seen)
    np.testing.assert_allclose(place[:, 0], height[seen], atol=1e-9)
    np.testing.assert_allclose(place[:, 1], i, atol=1e-9)
    turn = np.mod(place[:, 2] - j + ROWS, 2 * ROWS) - ROWS
    np.testing.assert_allclose(turn, 0, atol=1e-9)


def sphere(rows: int, subdivisions: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions, and a mesh of the whole image cut at the seam, d = smooth(direction)."""
    where, faces = icosphere(subdivisions)
    where = where @ rotation(seed).T  # so that the poles lie anywhere in a face
    image = np.column_stack([smooth(where), direction_to_uv(where, rows)])
    vertices, cut, _ = cut_at_seam(image, faces, rows)
    return where, vertices, cut


def smooth(where: np.ndarray) -> np.ndarray:
    z, y, x = np.moveaxis(where, -1, 0)
    return 1 + 0.3 * z - 0.5 * x * y + 0.4 * y


@pytest.mark.parametrize(("rows", "subdivisions"), [(32, 3), (64, 5), (96, 3), (128, 4), (256, 3)])
def test_a_closed_surface_covers_every_pixel_also_at_the_poles(
    rows: int, subdivisions: int
) -> None:
    """With faces that are smaller and much larger than a pixel."""
    for seed in range(3):
        _, vertices, faces = sphere(rows, subdivisions, seed)
        face, weights, height = outermost_faces(vertices, faces, rows)
        assert (face >= 0).all()
        np.testing.assert_allclose(weights.sum(axis=-1), 1.0)
        assert weights.min() > -1e-11
        expected = smooth(uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows))
        size = 1.1 * np.pi / 2 / 2**subdivisions
        assert np.abs(height.ravel() - expected).max() < 0.8 * size**2


def test_the_place_in_the_face_is_right_around_the_poles() -> None:
    rows = 64
    where, vertices, faces = sphere(rows, 4, 1)
    image = np.column_stack([smooth(where), direction_to_uv(where, rows)])
    _, _, origin = cut_at_seam(image, icosphere(4)[1], rows)
    face, weights, _ = outermost_faces(vertices, faces, rows)
    point = np.einsum("ijkl,ijk->ijl", where[origin[faces[face]]], weights)
    point /= np.linalg.norm(point, axis=-1, keepdims=True)
    expected = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows).reshape(point.shape)
    miss = np.linalg.norm(point - expected, axis=-1) * rows / np.pi
    assert miss[[0, 1, -2, -1]].max() < 0.1
    assert miss.max() < 0.2


def test_a_small_cap_at_the_pole_is_seen_only_there() -> None:
    for south in (False, True):
        v = 4.0
        corners = [[2.0, v, 5.0], [2.0, v, 5.0 + 2 * ROWS / 3], [2.0, v, 5.0 + 4 * ROWS / 3]]
        vertices = np.array(corners)
        if south:
            vertices[:, 1] = ROWS - 1 - v
        face, _, height = outermost_faces(vertices, np.array([[0, 1, 2]]), ROWS)
        rows = np.flatnonzero((face >= 0).any(axis=1))
        expected = np.arange(ROWS - 5, ROWS) if south else np.arange(5)
        np.testing.assert_array_equal(rows, expected)
        assert (face[expected[-1 if south else 0]] == 0).all()
        np.testing.assert_allclose(height[face >= 0], 2.0)


def test_the_higher_of_two_sheets_is_seen_whatever_the_order() -> None:
    low = np.array([[1.0, 11, -1], [1, 12.5, -1], [1, 11, 8]])
    high = low + np.array([2.0, 0, 0])
    vertices = np.concatenate([low, high])
    for faces in ([[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]], [[5, 4, 3], [0, 2, 1]]):
        _, _, height = outermost_faces(vertices, np.array(faces), ROWS)
        np.testing.assert_allclose(height[np.isfinite(height)], 3.0)


def test_a_face_over_the_seam_covers_both_ends_of_the_row() -> None:
    vertices = np.array([[1.0, 11.2, 45.5], [1, 12.8, 45.5], [1, 12, 50.5]])
    face, _, _ = outermost_faces(vertices, np.array([[0, 1, 2]]), ROWS)
    assert set(np.nonzero(face[12] >= 0)[0]) == {46, 47, 0, 1, 2}


def test_pixels_outside_and_empty_meshes() -> None:
    far = np.array([[1.0, 50, 3], [1, 60, 3], [1, 55, 9]])
    face, weights, height = outermost_faces(far, np.array([[0, 1, 2]]), ROWS)
    assert (face == -1).all()
    assert np.isnan(height).all()
    assert (weights == 0).all()
    none, _, _ = outermost_faces(np.zeros((0, 3)), np.zeros((0, 3), np.int64), ROWS)
    assert (none == -1).all()
