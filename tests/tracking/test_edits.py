"""Editing tracks: what every edit keeps, and that all of it can be taken back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.tracking.edits import TrackEdits

TIMES = {1: range(6), 2: range(3, 8), 3: range(6, 9), 4: range(2)}


def some_tracks(times=TIMES, splits=((1, 2),), merges=((4, 1),)) -> Tracks:
    """Four tracks of which every row has a value of its own."""
    track = np.concatenate([[k] * len(t) for k, t in times.items()])
    timepoint = np.concatenate([list(t) for t in times.values()])
    value = np.arange(len(track), dtype=float)
    columns = {
        "track_id": track,
        "timepoint": timepoint,
        **{name: value + i for i, name in enumerate(("z_um", "y_um", "x_um"))},
        "v_px": value % 32,
        "u_px": value % 64,
        "area_um2": value * 2,
        "label": value.astype(int),
    }
    return Tracks.of(
        columns,
        time_step_s=2.0,
        timepoints=9,
        rows=32,
        splits=np.array(splits, np.int64).reshape(-1, 2),
        merges=np.array(merges, np.int64).reshape(-1, 2),
    )


def detections(tracks: Tracks) -> set[tuple[float, ...]]:
    """What was detected, whatever track it belongs to."""
    names = ("timepoint", "z_um", "y_um", "x_um", "area_um2", "label")
    return set(zip(*(tracks.columns[name].tolist() for name in names), strict=True))


def times(tracks: Tracks, track: int) -> list[int]:
    found: list[int] = tracks.timepoint[tracks.rows_of(track)].tolist()
    return found


def pairs(found: np.ndarray) -> set[tuple[int, int]]:
    return {tuple(pair) for pair in found.tolist()}


def same(one: Tracks, other: Tracks) -> bool:
    return (
        set(one.columns) == set(other.columns)
        and all(np.array_equal(one.columns[n], other.columns[n]) for n in one.columns)
        and pairs(one.splits) == pairs(other.splits)
        and pairs(one.merges) == pairs(other.merges)
    )


def test_cut_parts_a_track_and_its_links_go_where_they_happened() -> None:
    edits = TrackEdits(some_tracks())
    new = edits.cut(1, 2)
    assert new == 5
    assert (times(edits.tracks, 1), times(edits.tracks, 5)) == ([0, 1], [2, 3, 4, 5])
    # Track 2 comes out of what is there at timepoint 2, and 4 goes into what is there at 2.
    assert pairs(edits.tracks.splits) == {(5, 2)}
    assert pairs(edits.tracks.merges) == {(4, 5)}
    assert detections(edits.tracks) == detections(some_tracks())
    with pytest.raises(ParameterError):
        edits.cut(1, 0)


def test_join_is_the_inverse_of_cut() -> None:
    edits = TrackEdits(some_tracks())
    assert edits.join(1, edits.cut(1, 2)) == 1
    assert same(edits.tracks, some_tracks())


def test_joined_tracks_have_the_earlier_number_and_no_link_with_each_other() -> None:
    edits = TrackEdits(some_tracks(splits=((1, 2), (1, 3), (2, 3)), merges=()))
    assert edits.join(3, 1) == 1
    assert times(edits.tracks, 1) == list(range(9))
    assert pairs(edits.tracks.splits) == {(1, 2)}
    with pytest.raises(ParameterError, match="5 timepoints"):
        edits.join(1, 2)
    with pytest.raises(ParameterError, match="itself"):
        edits.join(1, 1)


def test_deleted_tracks_take_their_links_along() -> None:
    edits = TrackEdits(some_tracks())
    edits.delete([1, 3])
    assert edits.tracks.ids.tolist() == [2, 4]
    assert len(edits.tracks.splits) == len(edits.tracks.merges) == 0
    with pytest.raises(InputError):
        edits.delete(1)


def test_relink_exchanges_what_follows() -> None:
    edits = TrackEdits(some_tracks(splits=(), merges=()))
    edits.relink(1, 2, 4)
    found = edits.tracks
    assert (times(found, 1), times(found, 2)) == (list(range(8)), [3, 4, 5])
    before = some_tracks()
    row = before.rows_of(2).start + 1
    assert found.column_of(1, "area_um2")[4] == before.columns["area_um2"][row]
    edits.relink(1, 2, 4)
    assert same(edits.tracks, some_tracks(splits=(), merges=()))


def test_relink_to_a_track_that_begins_later_joins_where_nothing_is_left() -> None:
    edits = TrackEdits(some_tracks())
    edits.relink(1, 3, 6)
    assert times(edits.tracks, 1) == list(range(9))
    assert 3 not in edits.tracks.ids
    with pytest.raises(ParameterError):
        TrackEdits(some_tracks()).relink(3, 4, 7 + 2)


def test_relink_at_a_split_changes_which_branch_goes_on() -> None:
    edits = TrackEdits(some_tracks())
    edits.relink(1, 2, 3)
    assert (times(edits.tracks, 1), times(edits.tracks, 2)) == (list(range(8)), [3, 4, 5])
    assert pairs(edits.tracks.splits) == {(1, 2)}


def test_links_are_made_and_removed() -> None:
    edits = TrackEdits(some_tracks())
    edits.link(2, 3)
    edits.link(1, 2, "merge")
    assert pairs(edits.tracks.splits) == {(1, 2), (2, 3)}
    assert pairs(edits.tracks.merges) == {(4, 1), (1, 2)}
    edits.unlink(1, 2)
    assert pairs(edits.tracks.splits) == {(2, 3)}
    assert pairs(edits.tracks.merges) == {(4, 1)}
    with pytest.raises(ParameterError):
        edits.link(3, 1)
    with pytest.raises(ParameterError):
        edits.unlink(1, 3)


def test_a_moved_point_is_marked_and_the_others_stay() -> None:
    edits = TrackEdits(some_tracks())
    edits.move(2, 4, position_um=(9.0, 8.0, 7.0), place_px=(3.5, 4.5))
    found, row = edits.tracks, some_tracks().rows_of(2).start + 1
    assert found.position_um[row].tolist() == [9.0, 8.0, 7.0]
    assert found.place_px[row].tolist() == [3.5, 4.5]
    assert np.flatnonzero(found.columns["moved"]).tolist() == [row]
    others = np.arange(len(found)) != row
    assert np.array_equal(found.position_um[others], some_tracks().position_um[others])
    with pytest.raises(InputError, match="not there"):
        edits.move(2, 0, position_um=(0, 0, 0))
    with pytest.raises(ParameterError):
        edits.move(2, 4)
    with pytest.raises(ParameterError):
        edits.move(2, 4, position_um=(0, np.nan, 0))


def test_a_box_goes_along_over_the_seam() -> None:
    base = some_tracks()
    rows = len(base)
    v, u = np.full(rows, 10.0), np.full(rows, 62.0)
    box = {"top_px": v - 2, "left_px": u - 3, "bottom_px": v + 3, "right_px": u + 4}
    edits = TrackEdits(base.with_columns(v_px=v, u_px=u, **box))
    edits.move(3, 7, position_um=(0, 0, 0), place_px=(11.0, 1.0))
    row = base.rows_of(3).start + 1
    moved = [edits.tracks.columns[name][row] for name in box]
    # Three columns farther, as the seam at 64 is none.
    assert moved == [9.0, 62.0, 14.0, 69.0]


def test_points_are_added_and_removed() -> None:
    edits = TrackEdits(some_tracks())
    assert edits.add(8, track=2, position_um=(1, 2, 3)) == 2
    assert times(edits.tracks, 2) == [3, 4, 5, 6, 7, 8]
    assert np.isnan(edits.tracks.column_of(2, "area_um2")[8])
    new = edits.add(0, position_um=(1, 2, 3), place_px=(4, 5))
    assert times(edits.tracks, new) == [0]
    edits.remove(new, 0)
    edits.remove(2, 8)
    assert same(edits.tracks, some_tracks())
    with pytest.raises(ParameterError):
        edits.add(3, track=2, position_um=(1, 2, 3))
    with pytest.raises(ParameterError):
        edits.add(9, position_um=(1, 2, 3))


def test_signals_name_the_tracks_that_were_touched() -> None:
    edits, heard = TrackEdits(some_tracks()), []
    edits.changed.connect(heard.append)
    new = edits.cut(1, 2)
    edits.undo()
    edits.redo()
    edits.move(3, 7, position_um=(0, 0, 0))
    edits.undo()
    assert heard == [{1, new}, {1, new}, {1, new}, {3}, {3}]


def test_a_stroke_is_one_step() -> None:
    edits = TrackEdits(some_tracks())
    with edits.stroke():
        edits.delete(3)
        edits.cut(1, 2)
    edits.undo()
    assert edits.tracks is edits.base
    assert not edits.can_undo
    edits.redo()
    assert edits.tracks.ids.tolist() == [1, 2, 4, 5]


def test_what_was_done_is_told() -> None:
    edits = TrackEdits(some_tracks())
    edits.cut(1, 2)
    edits.delete(3)
    assert edits.tracks.method == "edited"
    assert [each["edit"] for each in edits.tracks.numbers["edits"]] == ["cut", "delete"]


EDIT = st.tuples(
    st.sampled_from(["cut", "join", "relink", "link", "remove", "move", "delete"]),
    st.integers(1, 6),
    st.integers(1, 6),
    st.integers(0, 8),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(EDIT, max_size=8))
def test_any_edits_leave_tracks_and_can_all_be_taken_back(wanted) -> None:
    edits, states = TrackEdits(some_tracks()), []
    for name, one, other, timepoint in wanted:
        before = edits.tracks
        try:
            if name in ("cut", "remove"):
                getattr(edits, name)(one, timepoint)
            elif name in ("join", "link"):
                getattr(edits, name)(one, other)
            elif name == "relink":
                edits.relink(one, other, timepoint)
            elif name == "move":
                edits.move(one, timepoint, position_um=(1, 1, 1))
            else:
                edits.delete(one)
        except (InputError, ParameterError):
            assert edits.tracks is before
            continue
        states.append(before)
        if name not in ("remove", "move", "delete"):
            assert detections(edits.tracks) == detections(before)
        for parent, child in edits.tracks.splits.tolist():
            assert times(edits.tracks, parent)[0] < times(edits.tracks, child)[0]
        for track, into in edits.tracks.merges.tolist():
            assert times(edits.tracks, track)[-1] < times(edits.tracks, into)[-1]
    for state in reversed(states):
        edits.undo()
        assert edits.tracks is state
