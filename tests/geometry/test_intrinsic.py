"""The intrinsic Delaunay triangulation: non-negative weights, the same surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from napari_unwrap3d.geometry.intrinsic import delaunay_edges, mollified
from napari_unwrap3d.geometry.laplacian import cotangent_laplacian
from napari_unwrap3d.geometry.mesh import edges_with_faces, half_edges
from shapes import icosphere, lumpy


def lengths_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    ends = vertices[np.roll(faces, -1, axis=1)] - vertices[np.roll(faces, -2, axis=1)]
    return np.linalg.norm(ends, axis=2)


def laplacian(ends: np.ndarray, weights: np.ndarray, size: int) -> sparse.csr_array:
    half = sparse.coo_array((weights, tuple(ends.T)), shape=(size, size)).tocsr()
    full = half + half.T
    return sparse.csr_array(full - sparse.diags_array(full.sum(axis=1)))


def made(vertices: np.ndarray, faces: np.ndarray) -> sparse.csr_array:
    none = np.zeros_like(faces)
    ends, weights, _ = delaunay_edges(lengths_of(vertices, faces), faces, none)
    return laplacian(ends, weights, len(vertices))


@pytest.mark.parametrize("stretch", [1.0, 4.0, 15.0])
def test_no_weight_is_negative(stretch: float) -> None:
    vertices, faces = lumpy(3)
    vertices = vertices * [1.0, stretch, 1.0]
    off = made(vertices, faces).tocoo()
    assert off.data[off.row != off.col].min() > -1e-6
    plain = cotangent_laplacian(vertices, faces).tocoo()
    assert stretch == 1.0 or plain.data[plain.row != plain.col].min() < -0.1


def test_a_delaunay_mesh_is_left_as_it_is() -> None:
    vertices, faces = icosphere(3)
    expected = cotangent_laplacian(vertices, faces)
    assert abs(made(vertices, faces) - expected).max() < 1e-9


def test_it_is_the_laplacian_of_the_same_surface() -> None:
    """Linear functions on a flat sheet are harmonic, however thin the triangles."""
    n = 12
    grid = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1)
    points = grid.reshape(-1, 2) * [1.0, 0.15]
    points[:, 1] += 0.6 * points[:, 0]
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])
    vertices = np.column_stack([points, np.zeros(len(points))])
    inner = (grid.min(axis=2) > 0) & (grid.max(axis=2) < n - 1)
    force = made(vertices, faces) @ vertices
    np.testing.assert_allclose(force[inner.ravel()], 0.0, atol=1e-8)


def test_what_is_carried_along_edges_adds_up() -> None:
    """A difference of a value per vertex stays that difference on every new edge."""
    vertices, faces = lumpy(3)
    vertices = vertices * [1.0, 6.0, 1.0]
    value = np.random.default_rng(0).integers(-9, 9, len(vertices))
    over = value[np.roll(faces, -2, axis=1)] - value[np.roll(faces, -1, axis=1)]
    ends, _, carried = delaunay_edges(lengths_of(vertices, faces), faces, over)
    np.testing.assert_array_equal(carried, value[ends[:, 1]] - value[ends[:, 0]])
    before = {tuple(sorted(e)) for e in half_edges(faces).reshape(-1, 2).tolist()}
    assert any(tuple(sorted(e)) not in before for e in ends.tolist())


def test_mollified_lengths_are_those_of_triangles() -> None:
    vertices, faces = lumpy(2)
    of_face = edges_with_faces(faces).of_face
    lengths = lengths_of(vertices, faces)
    np.testing.assert_allclose(mollified(lengths, of_face), lengths)
    broken = lengths.copy()
    broken[of_face == of_face[5, 1]] *= 9.0
    repaired = mollified(broken, of_face)
    excess = 2.0 * repaired - repaired.sum(axis=1, keepdims=True)
    assert excess.max() < 0
    # An edge has one length, whichever face it is seen from.
    order = np.argsort(of_face.ravel(), kind="stable")
    pairs = repaired.ravel()[order].reshape(-1, 2)
    np.testing.assert_allclose(pairs[:, 0], pairs[:, 1])
