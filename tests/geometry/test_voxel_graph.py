"""Components, spreading and peaks on a solid's voxels, against scipy's and worked examples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra

from napari_unwrap3d.geometry.voxel_graph import (
    LENGTHS,
    components,
    saddles,
    split_at_saddles,
    spread,
    voxel_graph,
)

masks = arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=7))


def line(heights: list[float]) -> tuple:
    """A row of voxels with these heights."""
    graph = voxel_graph(np.ones((1, 1, len(heights)), bool))
    return graph, np.array(heights, float)


@given(mask=masks)
def test_components_are_scipys(mask: np.ndarray) -> None:
    graph = voxel_graph(mask)
    found = graph.on_grid(components(graph, np.ones(len(graph.flat), bool)))
    expected, _ = ndimage.label(mask, np.ones((3, 3, 3)))
    np.testing.assert_array_equal(found, expected)


@given(mask=masks, seed=st.integers(0, 100), reach=st.sampled_from([1.5, 3.0, np.inf]))
def test_labels_spread_along_the_shortest_paths(mask: np.ndarray, seed: int, reach: float) -> None:
    graph = voxel_graph(mask)
    count = len(graph.flat)
    if count == 0:
        return
    seeds = np.zeros(count, np.int32)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(count, min(3, count), replace=False)
    seeds[chosen] = np.arange(1, len(chosen) + 1)
    row, step = np.nonzero(graph.neighbours >= 0)
    edges = (LENGTHS[step], (row, graph.neighbours[row, step]))
    away = dijkstra(sparse.csr_array(edges, shape=(count, count)), indices=chosen)
    found = spread(graph, seeds, reach)
    nearest = away.min(axis=0)
    reached = np.isfinite(nearest) & (nearest <= reach + 1e-9)
    assert ((found > 0) == reached).all()
    there = found > 0
    np.testing.assert_allclose(away[found[there] - 1, there], nearest[there], atol=1e-9)


def test_two_regions_meet_at_the_highest_voxel_between_them() -> None:
    graph, height = line([1, 5, 3, 2, 4, 1])
    found = saddles(graph, np.array([1, 1, 1, 2, 2, 0], np.int32), height)
    assert found.pairs.tolist() == [[1, 2]]
    assert found.height.tolist() == [2.0]


def test_no_regions_no_saddles() -> None:
    graph, height = line([1, 2])
    assert len(saddles(graph, np.zeros(2, np.int32), height).pairs) == 0


@pytest.mark.parametrize(
    ("share", "least", "expected"),
    [
        (0.6, 1.0, [1, 1, 1, 2, 2]),  # the saddle, 2, is below 0.6 of the lower peak, 4
        (0.4, 1.0, [1, 1, 1, 1, 1]),  # but not below 0.4 of it
        (0.6, 3.0, [1, 1, 1, 1, 1]),  # nor 3 below it
    ],
)
def test_peaks_are_parted_where_the_saddle_is_low(
    share: float, least: float, expected: list[int]
) -> None:
    graph, height = line([1, 5, 2, 4, 1])
    found = split_at_saddles(graph, np.ones(5, np.int32), height, share, least)
    assert (found == found[0]).tolist()[:2] == [True, True]
    assert len(np.unique(found)) == len(np.unique(expected))


def test_a_watershed_does_not_cross_labels_and_leaves_zeros() -> None:
    graph, height = line([1, 2, 3, 4, 5])
    found = split_at_saddles(graph, np.array([1, 1, 0, 2, 2], np.int32), height, 0.5, 1.0)
    assert found.tolist() == [1, 1, 0, 2, 2]
