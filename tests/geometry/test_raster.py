"""The outermost face over every pixel, against trying every face."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.geometry.raster import outermost_faces

ROWS = 10


def brute_force(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Largest d (ROWS, 2 ROWS) over every pixel's centre, NaN without any face."""
    height = np.full((ROWS, 2 * ROWS), -np.inf)
    for face in faces:
        corners = vertices[face]
        matrix = np.vstack([corners[:, 1], corners[:, 2], np.ones(3)])
        if abs(np.linalg.det(matrix)) < 1e-9 or np.ptp(corners[:, 2]) > ROWS:
            continue
        for i in range(ROWS):
            for j in range(-2 * ROWS, 4 * ROWS):
                weights = np.linalg.solve(matrix, [i, j, 1.0])
                if (weights > -1e-12).all():
                    column = j % (2 * ROWS)
                    height[i, column] = max(height[i, column], weights @ corners[:, 0])
    return np.where(np.isfinite(height), height, np.nan)


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6))
def test_random_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.uniform([-5, -2, 0], [5, ROWS + 2, 2 * ROWS], (12, 1, 3))
    vertices = (centre + rng.uniform(-3, 3, (12, 3, 3))).reshape(-1, 3)
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


def test_the_higher_of_two_sheets_is_seen_whatever_the_order() -> None:
    low = np.array([[1.0, -1, -1], [1, 20, -1], [1, -1, 8]])
    high = low + np.array([2.0, 0, 0])
    vertices = np.concatenate([low, high])
    for faces in ([[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]], [[5, 4, 3], [0, 2, 1]]):
        _, _, height = outermost_faces(vertices, np.array(faces), ROWS)
        np.testing.assert_allclose(height[np.isfinite(height)], 3.0)


def test_a_face_over_the_seam_covers_both_ends_of_the_row() -> None:
    vertices = np.array([[1.0, 3, 17.5], [1, 6, 17.5], [1, 4, 22.5]])
    face, _, _ = outermost_faces(vertices, np.array([[0, 1, 2]]), ROWS)
    assert set(np.nonzero(face[4] >= 0)[0]) == {18, 19, 0, 1, 2}


def test_pixels_outside_and_empty_meshes() -> None:
    far = np.array([[1.0, 50, 3], [1, 60, 3], [1, 55, 9]])
    face, weights, height = outermost_faces(far, np.array([[0, 1, 2]]), ROWS)
    assert (face == -1).all()
    assert np.isnan(height).all()
    assert (weights == 0).all()
    none, _, _ = outermost_faces(np.zeros((0, 3)), np.zeros((0, 3), np.int64), ROWS)
    assert (none == -1).all()
