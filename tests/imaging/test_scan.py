"""One pass through a lazy volume sees what numpy sees, and never holds the whole."""

from __future__ import annotations

from typing import Any

import dask.array as da
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.errors import NotFiniteError
from napari_unwrap3d.imaging import scan as module
from napari_unwrap3d.imaging.scan import (
    box_of,
    box_of_value,
    coarse_factors,
    grown,
    labels_in,
    read_box,
    scan,
)
from napari_unwrap3d.progress import silent


class Watched:
    """An array that remembers how much of it was read at once."""

    def __init__(self, data: np.ndarray) -> None:
        self.data = data
        self.shape, self.dtype, self.ndim = data.shape, data.dtype, data.ndim
        self.largest = 0

    def __getitem__(self, key: Any) -> np.ndarray:
        part = self.data[key]
        self.largest = max(self.largest, part.size)
        return part


@settings(max_examples=30)
@given(
    shape=st.tuples(*[st.integers(1, 13)] * 3),
    depth=st.integers(1, 5),
    limit=st.integers(1, 60),
    seed=st.integers(0, 99),
)
def test_block_means(shape: tuple[int, int, int], depth: int, limit: int, seed: int) -> None:
    data = np.random.default_rng(seed).integers(0, 99, shape).astype(np.uint8)
    lazy = da.from_array(data, chunks=(depth, -1, -1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "COARSE_VOXELS", limit)
        found = scan(lazy, (1.0, 0.5, 0.5), silent())
    for index in np.ndindex(found.coarse.shape):
        block = data[
            tuple(slice(i * f, i * f + f) for i, f in zip(index, found.factors, strict=True))
        ]
        assert abs(found.coarse[index] - block.mean()) < 1e-3
    assert (found.lowest, found.highest) == (data.min(), data.max())
    assert found.two_values == (len(np.unique(data)) <= 2)


def test_two_values_across_slabs() -> None:
    data = np.zeros((6, 2, 2), dtype=np.uint8)
    lazy = da.from_array(data, chunks=(2, 2, 2))
    assert scan(lazy, (1, 1, 1), silent()).two_values
    data[3] = 7
    assert scan(da.from_array(data, chunks=(2, 2, 2)), (1, 1, 1), silent()).two_values
    data[5] = 9
    assert not scan(da.from_array(data, chunks=(2, 2, 2)), (1, 1, 1), silent()).two_values
    data[5], data[0] = 7, 3
    assert not scan(da.from_array(data, chunks=(2, 2, 2)), (1, 1, 1), silent()).two_values


def test_not_finite_values_are_counted() -> None:
    data = np.ones((4, 5, 6), dtype=np.float32)
    data[1, 2, 3] = np.nan
    data[3, :2, 0] = np.inf
    with pytest.raises(NotFiniteError, match="voxels = 3, of = 120"):
        scan(data, (1, 1, 1), silent())


def test_blocks_are_about_cubes_and_few() -> None:
    factors = coarse_factors((104, 2048, 2048), (0.3, 0.104, 0.104))
    blocks = [-(-n // f) for n, f in zip((104, 2048, 2048), factors, strict=True)]
    assert np.prod(blocks) < 2 * module.COARSE_VOXELS
    edges = np.array(factors) * (0.3, 0.104, 0.104)
    assert edges.max() / edges.min() < 1.5
    assert coarse_factors((50, 60, 70), (0.3, 0.1, 0.1)) == (1, 1, 1)


def test_memory_holds_a_slab_and_not_the_volume(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SLAB_BYTES", 5 * 30 * 40 * 2)
    data = np.zeros((60, 30, 40), dtype=np.uint16)
    data[20:24, 10:14, 7:9] = 3
    watched = Watched(data)
    scan(watched, (1, 1, 1), silent())
    box = box_of_value(watched, 3, silent())
    assert box == (slice(20, 24), slice(10, 14), slice(7, 9))
    assert watched.largest == 5 * 30 * 40
    part = read_box(watched, (0.3, 0.1, 0.1), box)
    assert part.data.shape == (4, 4, 2)
    assert part.origin == pytest.approx((6.0, 1.0, 0.7))


def test_boxes() -> None:
    data = np.zeros((6, 7, 8), dtype=bool)
    data[2, 3, 4] = data[4, 3, 6] = True
    box = box_of(data)
    assert box == (slice(2, 5), slice(3, 4), slice(4, 7))
    by = np.array([[1, 9], [0, 2], [5, 0]])
    assert grown(box, by, data.shape) == (slice(1, 6), slice(3, 6), slice(0, 7))
    assert box_of_value(data, 5, silent()) is None


def test_labels_are_listed_without_the_background() -> None:
    data = np.array([0, 5, 5, 9, 0, 2], dtype=np.uint16).reshape(1, 2, 3)
    assert labels_in(data).tolist() == [2, 5, 9]


def test_numbers_beyond_single_precision_count_as_infinite() -> None:
    data = np.ones((4, 5, 6))
    data[1, 2, 3:5] = 1e200
    with pytest.raises(NotFiniteError, match=r"voxels = 2.*3e38"):
        scan(data, (1.0, 1.0, 1.0), silent())
