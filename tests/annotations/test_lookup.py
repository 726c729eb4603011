"""Tables from pixels to vertices say what brute force says."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.annotations.lookup import Owners, Places, Rows

numbers = st.lists(st.integers(-1, 9), max_size=40)


@given(numbers, st.lists(st.integers(0, 9), max_size=12))
def test_rows_hold_what_was_put_in_them(rows: list[int], asked: list[int]) -> None:
    table = Rows(np.array(rows, np.int64), np.arange(len(rows)), 10)
    expected = [i for row in asked for i, other in enumerate(rows) if other == row]
    assert table.of(np.array(asked, np.int64)).tolist() == expected


@given(st.lists(st.booleans(), min_size=1, max_size=200))
def test_places_are_numbered_in_order(chosen: list[bool]) -> None:
    places = Places(np.array(chosen))
    rank = places.rank(np.arange(len(chosen)))
    expected = [sum(chosen[:i]) if there else -1 for i, there in enumerate(chosen)]
    assert rank.tolist() == expected
    assert places.flat.tolist() == np.flatnonzero(chosen).tolist()


@given(st.lists(st.integers(-1, 5), min_size=12, max_size=12), st.data())
def test_sparse_tables_are_as_dense_ones(shown: list[int], data: st.DataObject) -> None:
    image = np.array(shown).reshape(3, 4)
    pixels = np.array(data.draw(st.lists(st.integers(0, 11), max_size=8)), np.int64)
    dense = Owners((3, 4), 6, image.ravel(), Rows(np.arange(12), image.ravel(), 12))
    places = Places(image >= 0)
    kept = image.ravel()[places.flat]
    sparse = Owners((3, 4), 6, kept, Rows(np.arange(len(kept)), kept, len(kept)), places=places)
    labels = np.arange(1, 7, dtype=np.uint16)
    expected = np.where(image >= 0, labels[image], 0)
    vertices = np.unique(image.ravel()[pixels])
    for owners in (dense, sparse):
        assert (owners.display(labels) == expected).all()
        assert (owners.values(pixels, labels) == expected.ravel()[pixels]).all()
        assert set(owners.owned(np.arange(6))) == set(np.flatnonzero(image.ravel() >= 0))
    assert sparse.touched(pixels).tolist() == vertices[vertices >= 0].tolist()
