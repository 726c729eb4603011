"""Linking detections into tracks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from napari_unwrap3d.errors import AxesError, ParameterError
from napari_unwrap3d.tracking.linking import Linked, link


def walkers(count: int = 5, timepoints: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, timepoints and identities of objects that move slowly and are far apart."""
    rng = np.random.default_rng(3)
    start = np.arange(count)[:, None] * (6.0, 0, 0)
    steps = np.cumsum(rng.normal(scale=0.2, size=(timepoints, count, 3)), axis=0)
    who = np.tile(np.arange(count), timepoints)
    when = np.repeat(np.arange(timepoints), count)
    return (start + steps).reshape(-1, 3), when, who


def same_partition(found: Linked, who: np.ndarray) -> bool:
    pairs = set(zip(found.track_id.tolist(), who.tolist(), strict=True))
    return len(pairs) == len(set(who.tolist())) == len(set(found.track_id.tolist()))


def test_objects_keep_their_identity() -> None:
    where, when, who = walkers()
    found = link(where, when, longest_step_um=2.0)
    assert same_partition(found, who)
    np.testing.assert_array_equal(found.track_id, who + 1)
    assert len(found.splits) == len(found.merges) == 0
    links = found.links(when)
    assert len(links) == len(where) - 5
    assert (when[links[:, 1]] - when[links[:, 0]] == 1).all()


def test_the_order_of_the_detections_does_not_matter() -> None:
    where, when, who = walkers()
    shuffled = np.random.default_rng(0).permutation(len(where))
    found = link(where[shuffled], when[shuffled], longest_step_um=2.0)
    assert same_partition(found, who[shuffled])


def test_a_long_step_ends_a_track() -> None:
    where = np.array([[0.0, 0, 0], [1.0, 0, 0], [9.0, 0, 0]])
    found = link(where, [0, 1, 2], longest_step_um=2.0)
    np.testing.assert_array_equal(found.track_id, [1, 1, 2])


@pytest.mark.parametrize("gap", [0, 1, 2])
def test_a_gap_is_bridged_as_far_as_is_allowed(gap: int) -> None:
    where, when, who = walkers(3)
    lost = (who == 1) & np.isin(when, (5, 6))
    found = link(where[~lost], when[~lost], longest_step_um=2.0, gap_timepoints=gap)
    assert len(set(found.track_id.tolist())) == (3 if gap == 2 else 4)


def test_a_feature_tells_neighbours_apart() -> None:
    """Two objects change places in one step; only their sizes say so."""
    where = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.9, 0, 0], [0.1, 0, 0]])
    when = [0, 0, 1, 1]
    size = np.array([[1.0], [5.0], [1.0], [5.0]])
    plain = link(where, when, longest_step_um=3.0)
    told = link(where, when, longest_step_um=3.0, features_um=size)
    np.testing.assert_array_equal(plain.track_id, [1, 2, 2, 1])
    np.testing.assert_array_equal(told.track_id, [1, 2, 1, 2])


def test_a_split_and_a_merge_are_found() -> None:
    before = [([0.0, 0, 0], t) for t in range(4)]
    after = [([side * (0.5 + 0.3 * (t - 4)), 0, 0], t) for t in range(4, 8) for side in (-1, 1)]
    where, when = (list(x) for x in zip(*(before + after), strict=True))
    found = link(where, when, longest_step_um=1.0, split_um=1.0)
    assert len(found.splits) >= 1
    assert len(link(where, when, longest_step_um=1.0).splits) == 0
    turned = link(where, [7 - t for t in when], longest_step_um=1.0, merge_um=1.0)
    assert len(turned.merges) >= 1


def test_nothing_and_one_are_tracks() -> None:
    assert len(link(np.zeros((0, 3)), [], longest_step_um=1.0).track_id) == 0
    np.testing.assert_array_equal(link(np.zeros((1, 3)), [4], longest_step_um=1.0).track_id, [1])


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(AxesError):
        link(np.zeros((3, 3)), [0, 1], longest_step_um=1.0)
    with pytest.raises(ParameterError, match="longest_step_um"):
        link(np.zeros((2, 3)), [0, 1], longest_step_um=0.0)


@pytest.mark.parametrize(("name", "gap"), [("with", 1), ("without", 0)])
def test_the_links_are_those_of_trackmate(shared_data: Path, name: str, gap: int) -> None:
    folder = shared_data / "trackmate"
    spots = pd.read_csv(folder / f"trackmate_tracks_{name}_gap_closing_spots.csv")
    edges = pd.read_csv(folder / f"trackmate_tracks_{name}_gap_closing_edges.csv")
    where = spots[["position_x", "position_y"]].to_numpy()
    when = spots["frame"].to_numpy()
    found = link(where, when, longest_step_um=15.0, gap_timepoints=gap)
    ids = spots["id"].to_numpy()
    links = {(int(ids[a]), int(ids[b])) for a, b in found.links(when)}
    true = set(map(tuple, edges[["spot_source_id", "spot_target_id"]].to_numpy().tolist()))
    assert links == true
