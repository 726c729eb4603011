"""Basins of peaks against a brute-force flooding, and regions around seeds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse
from scipy.sparse import csgraph

from napari_unwrap3d.geometry.mesh import edges_with_faces
from napari_unwrap3d.geometry.peaks import around_peaks, around_seeds, mesh_graph
from shapes import icosphere


def random_graph(seed: int, size: int) -> sparse.csr_array:
    rng = np.random.default_rng(seed)
    a, b = rng.integers(0, size, (2, 2 * size))
    keep = a != b
    half = sparse.coo_array((np.ones(keep.sum()), (a[keep], b[keep])), (size, size))
    return sparse.csr_array(half + half.T)


def persistences(graph: sparse.csr_array, height: np.ndarray) -> list[float]:
    """How far every peak stands out, by the components of every superlevel set."""
    alive: dict[int, float] = {}
    ended = []
    for level in np.sort(height)[::-1]:
        above = np.flatnonzero(height >= level)
        _, piece = csgraph.connected_components(graph[above][:, above], directed=False)
        for number in range(piece.max() + 1):
            mine = above[piece == number]
            tops = sorted((p for p in alive if p in mine), key=lambda p: -height[p])
            if not tops:
                alive[int(mine[np.argmax(height[mine])])] = np.inf
            for peak in tops[1:]:
                ended.append(height[peak] - level)
                del alive[peak]
    return sorted([*ended, *alive.values()], reverse=True)


@given(st.integers(0, 10_000), st.integers(3, 40))
def test_peaks_are_ranked_by_how_far_they_stand_out(seed: int, size: int) -> None:
    graph = random_graph(seed, size)
    height = np.random.default_rng(seed).permutation(size).astype(float)
    expected = persistences(graph, height)
    basin, peaks = around_peaks(graph, height, size)
    assert len(peaks) == len(expected)
    # Every peak is the highest of its basin, which is connected.
    for number, peak in enumerate(peaks):
        mine = np.flatnonzero(basin == number)
        assert mine[np.argmax(height[mine])] == peak
        assert csgraph.connected_components(graph[mine][:, mine], directed=False)[0] == 1
    # With fewer, the ones that stand out least are gone; within a connected graph, merged.
    for count in range(1, len(peaks) + 1):
        fewer, kept = around_peaks(graph, height, count)
        assert kept.tolist() == peaks[:count].tolist()
        assert set(np.unique(fewer)) == set(range(count))
        assert all(fewer[peak] == number for number, peak in enumerate(kept))


def test_two_hills_are_parted_at_the_saddle() -> None:
    x = np.linspace(0, 10, 101)
    height = np.maximum(np.exp(-((x - 2) ** 2)), 0.6 * np.exp(-((x - 7) ** 2)))
    height = height + 0.01 * np.cos(40 * x)
    line = sparse.diags_array(np.ones(100), offsets=1, shape=(101, 101))
    basin, peaks = around_peaks(sparse.csr_array(line + line.T), height, 2)
    assert abs(x[peaks[0]] - 2) < 0.2
    assert abs(x[peaks[1]] - 7) < 0.2
    border = np.flatnonzero(np.diff(basin))
    assert len(border) == 1
    assert 4 < x[border[0]] < 5


def test_regions_around_seeds_are_the_nearest_along_the_surface() -> None:
    vertices, faces = icosphere(3)
    chosen = np.flatnonzero(vertices[:, 0] > -0.5)
    graph = mesh_graph(vertices, edges_with_faces(faces).vertices, chosen)
    assert graph.shape == (len(chosen),) * 2
    assert abs(graph - graph.T).max() == 0
    points = vertices[chosen]
    seeds = np.array([points[:, 1].argmin(), points[:, 1].argmax()])
    nearest = around_seeds(graph, seeds)
    away = np.abs(points[:, 1]) > 0.15
    np.testing.assert_array_equal(nearest[away], (points[away, 1] > 0).astype(int))
    assert nearest[seeds].tolist() == [0, 1]


def test_what_no_seed_reaches_goes_to_the_first() -> None:
    graph = sparse.csr_array((4, 4))
    assert around_seeds(graph, np.array([3, 1])).tolist() == [0, 1, 0, 0]
    basin, peaks = around_peaks(graph, np.array([0.0, 2.0, 1.0, 3.0]), 2)
    assert peaks.tolist() == [3, 1]
    assert basin.tolist() == [0, 1, 0, 0]


@pytest.mark.parametrize("count", [1, 3])
def test_a_plain_without_slope_has_one_peak(count: int) -> None:
    vertices, faces = icosphere(1)
    graph = mesh_graph(vertices, edges_with_faces(faces).vertices, np.arange(len(vertices)))
    basin, peaks = around_peaks(graph, np.zeros(len(vertices)), count)
    assert (basin == 0).sum() >= 1
    assert len(peaks) <= count
