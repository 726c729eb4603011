"""The lines of tracks: cut where they go over the seam or a pole, and joined where tracks are."""

import numpy as np
import pytest

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.geometry.padding import wrap_uv
from napari_unwrap3d.tracking.lines import lines_in_space, lines_on_uv
from napari_unwrap3d.unwrapping.uv import uv_to_direction

ROWS = 32


def on_image(places: dict[int, list[tuple[int, float, float]]], **others: object) -> Tracks:
    rows = [(track, t, v, u) for track, steps in places.items() for t, v, u in steps]
    track, t, v, u = np.array(rows, float).T
    zeros = np.zeros(len(track))
    columns = {"track_id": track, "timepoint": t, "z_um": zeros, "y_um": v, "x_um": u}
    columns |= {"v_px": v, "u_px": u}
    return Tracks.of(columns, time_step_s=1.0, timepoints=20, rows=ROWS, **others)


def longest(lines) -> float:
    steps = np.linalg.norm(np.diff(lines.place, axis=0), axis=1)
    return float(steps[lines.joined()].max())


def test_a_track_within_the_image_is_one_line():
    lines = lines_on_uv(on_image({3: [(0, 5, 5), (1, 6, 8), (4, 9, 9)]}))
    assert lines.line.tolist() == [3, 3, 3]
    assert lines.time.tolist() == [0, 1, 4]
    assert lines.place.tolist() == [[5, 5], [6, 8], [9, 9]]


def test_over_the_seam_a_line_ends_at_one_border_and_goes_on_at_the_other():
    lines = lines_on_uv(on_image({2: [(0, 10, 62), (1, 10, 2)]}))
    assert lines.place[:, 1].tolist() == [62, 63.5, -0.5, 2]
    assert len(set(lines.line.tolist())) == 2
    assert np.allclose(lines.time, [0, 1.5 / 4, 1.5 / 4, 1])
    assert set(lines.track.tolist()) == {2}


def test_over_a_pole_a_line_goes_on_half_a_turn_away():
    lines = lines_on_uv(on_image({1: [(0, 1, 10), (1, 2, 10 + ROWS)]}))
    assert lines.place.tolist() == [[1, 10], [-0.5, 10], [-0.5, 10 + ROWS], [2, 10 + ROWS]]
    assert lines.line[0] == lines.line[1] != lines.line[2] == lines.line[3]


@pytest.mark.parametrize("seed", range(4))
def test_walks_over_the_sphere_have_no_long_lines_and_both_ends_of_a_cut_are_one_place(seed):
    rng = np.random.default_rng(seed)
    walk = {}
    for track in range(1, 9):
        start = np.array([rng.uniform(0, ROWS), rng.uniform(0, 2 * ROWS)])
        steps = np.cumsum(rng.normal(0, 1.5, (20, 2)), axis=0)
        places = wrap_uv(start + steps, ROWS)
        walk[track] = [(t, v, u) for t, (v, u) in enumerate(places)]
    lines = lines_on_uv(on_image(walk))
    assert longest(lines) < 9
    assert lines.place.min() >= -0.5
    assert (lines.place <= [ROWS - 0.5, 2 * ROWS - 0.5]).all()
    assert (np.diff(lines.line) >= 0).all()
    assert (np.diff(lines.time)[lines.joined()] >= 0).all()
    whole = np.isin(np.arange(len(lines)), np.flatnonzero(lines.time % 1 == 0))
    assert whole.sum() == 8 * 20
    # The way out and the way in of a step over the seam alone are the same place of the sphere.
    ends = np.flatnonzero(~whole)
    for track in range(1, 9):
        own = [i for i in ends if lines.track[i] == track]
        own.sort(key=lambda i: lines.time[i])
        for out, into in zip(own[::2], own[1::2], strict=True):
            if lines.time[out] == pytest.approx(lines.time[into]):
                there = uv_to_direction(lines.place[[out, into]], ROWS)
                assert np.allclose(there[0], there[1], atol=1e-6)


def test_rows_of_unknown_place_are_left_out_and_properties_stay_with_their_rows():
    tracks = on_image({1: [(0, 5, 5), (1, np.nan, np.nan), (2, 5, 7)], 4: [(3, 8, 8)]})
    lines = lines_on_uv(tracks)
    assert lines.row.tolist() == [0, 2, 3]
    assert lines.line.tolist() == [1, 1, 4]


def test_a_split_is_joined_to_where_its_parent_was_just_before_and_a_merge_to_just_after():
    tracks = on_image(
        {
            1: [(t, 5, 5 + t) for t in range(6)],
            2: [(3, 7, 8), (4, 8, 8)],
            5: [(0, 9, 5), (2, 8, 6)],
        },
        splits=np.array([(1, 2)]),
        merges=np.array([(5, 1)]),
    )
    lines = lines_in_space(tracks)
    extra = lines.line > 5
    assert lines.time[extra].tolist() == [2, 3, 2, 3]
    assert lines.place[extra, 1:].tolist() == [[5, 7], [7, 8], [8, 6], [5, 8]]
    assert lines.track[extra].tolist() == [2, 2, 5, 5]


def test_no_tracks_are_no_lines():
    tracks = on_image({1: [(0, 5, 5), (1, 5, 6)]}).kept([])
    assert len(lines_on_uv(tracks)) == len(lines_in_space(tracks)) == 0


def test_tracks_that_lie_on_no_image_cannot_be_drawn_on_one():
    columns = {name: [1] for name in ("track_id", "timepoint", "z_um", "y_um", "x_um")}
    tracks = Tracks.of(columns, time_step_s=1.0, timepoints=2)
    with pytest.raises(InputError, match="do not lie"):
        lines_on_uv(tracks)
