"""Affinity of neighbouring vertices, and labels that spread by it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from napari_unwrap3d.geometry import affinity as kernel
from shapes import icosphere


def strip(length: int) -> sparse.csr_array:
    """A chain of vertices, every one as near to its neighbours as to itself."""
    ones = np.ones(length)
    return sparse.csr_array(sparse.diags_array([ones[1:], ones, ones[1:]], offsets=[-1, 0, 1]))


def test_the_affinity_is_the_formula_of_the_paper() -> None:
    vertices, faces = icosphere(1)
    vertices = vertices * [1.0, 1.5, 0.7]
    found = kernel.edge_affinity(vertices, faces, 0.9).toarray()
    pairs = {tuple(sorted((f[k], f[k - 1]))) for f in faces.tolist() for k in range(3)}
    normals = np.zeros_like(vertices)
    for a, b, c in faces:
        normals[[a, b, c]] += np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    length = {p: np.linalg.norm(vertices[p[0]] - vertices[p[1]]) for p in pairs}
    bend = {p: (1 - normals[p[0]] @ normals[p[1]]) / 2 for p in pairs}
    mean = [np.mean(list(d.values())) for d in (length, bend)]
    expected = np.eye(len(vertices))
    for p in pairs:
        near = np.exp(-(length[p] ** 2) / (2 * mean[0] ** 2))
        flat = np.exp(-(bend[p] ** 2) / (2 * mean[1] ** 2))
        expected[p] = expected[p[::-1]] = 0.9 * near + 0.1 * flat
    np.testing.assert_allclose(found, expected)


def test_labels_take_a_ring_per_iteration_and_meet_in_the_middle() -> None:
    labels = np.zeros(21, int)
    labels[0], labels[20] = 7, 3
    for iterations in (0, 1, 4):
        spread = kernel.spread_labels(strip(21), labels, iterations, 0.99)
        assert (spread > 0).sum() == 2 * (iterations + 1)
    spread = kernel.spread_labels(strip(21), labels, 30, 0.99)
    assert (spread[:10] == 7).all()
    assert (spread[11:] == 3).all()


def test_without_labels_nothing_spreads() -> None:
    assert not kernel.spread_labels(strip(5), np.zeros(5, int), 3, 0.99).any()


@pytest.mark.parametrize("threshold", [0.2, 0.5])
def test_the_first_class_goes_on_below_a_quarter_and_ends_at_what_it_never_takes(
    threshold: float,
) -> None:
    marked, never = np.arange(30) < 10, np.arange(30) >= 18
    spread = kernel.spread_binary(strip(30), marked, never, 50, 0.99, threshold)
    # On a chain the next one has a third of its neighbours in the first class.
    np.testing.assert_array_equal(spread, np.arange(30) < (18 if threshold < 1 / 3 else 10))


def test_a_single_vertex_is_lost_or_kept_by_its_chance() -> None:
    marked = np.arange(9) == 4
    never = np.zeros(9, bool)
    assert not kernel.spread_binary(strip(9), marked, never, 1, 0.99, 0.5).any()
    assert kernel.spread_binary(strip(9), marked, never, 1, 0.99, 0.3).sum() == 3
