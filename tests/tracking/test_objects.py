"""Tracks of protrusions on the common surface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from moving import TIME_STEP_S, blebbing_movie
from napari_unwrap3d import Movie, Parameters
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.parameters import TrackingParameters
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.tracking.detections import CERTAIN, FOOT, protrusions_of, same_for_all
from napari_unwrap3d.tracking.objects import lasting, link_tables, track_protrusions
from napari_unwrap3d.unwrapping.uv import direction_to_uv, uv_to_direction

ROWS, RADIUS_UM = 64, 5.0
Table = Mapping[str, np.ndarray[Any, Any]]


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


def table(directions: np.ndarray, height_um: float = 1.0, certain: bool = True) -> Table:
    """Protrusions of a ball in some directions (k, 3)."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    foot, top = RADIUS_UM * unit, (RADIUS_UM + height_um) * unit
    count = len(unit)
    return {
        "label": np.arange(1, count + 1),
        **dict(zip(FOOT, foot.T, strict=True)),
        **dict(zip(("z_um", "y_um", "x_um"), top.T, strict=True)),
        **dict(zip(("v_px", "u_px"), direction_to_uv(unit, ROWS).T, strict=True)),
        "area_um2": np.full(count, 4.0),
        "height_max_um": np.full(count, height_um),
        "motif": np.zeros(count, np.int8),
        CERTAIN: np.full(count, certain),
    }


def linked(tables: list[tuple[int, Table]], timepoints: int = 40, **chosen: Any) -> Tracks:
    parameters = TrackingParameters(**chosen)
    return link_tables(tables, parameters, time_step_s=1.0, timepoints=timepoints, rows=ROWS)


def circle(axis: int, timepoints: int = 40) -> np.ndarray:
    """Directions (t, 3) once around a great circle that is as far from an axis."""
    angle = 2 * np.pi * np.arange(timepoints) / timepoints
    found = np.zeros((timepoints, 3))
    found[:, (axis + 1) % 3], found[:, (axis + 2) % 3] = np.cos(angle), np.sin(angle)
    return found


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_walk_around_the_cell_is_one_track(axis: int) -> None:
    """Around z it crosses the seam, around the others both poles."""
    walk = circle(axis)
    tracks = linked([(t, table(walk[t : t + 1])) for t in range(len(walk))])
    assert tracks.ids.tolist() == [1]
    assert len(tracks) == len(walk)
    jumps = np.abs(np.diff(tracks.place_px, axis=0)).max(axis=0)
    assert jumps.max() > ROWS / 2  # it does cross a border of the image


def test_a_gap_over_the_seam_is_filled_on_the_sphere() -> None:
    walk = circle(0)
    gap = [29, 30, 31]
    assert np.ptp(direction_to_uv(walk[gap], ROWS)[:, 1]) > ROWS
    seen = [t for t in range(len(walk)) if t not in gap]
    tracks = linked([(t, table(walk[t : t + 1])) for t in seen], gap_s=3.0, longest_step_um=4.0)
    assert tracks.ids.tolist() == [1]
    lost = tracks.columns["label"] == 0
    assert tracks.timepoint[lost].tolist() == gap
    places = uv_to_direction(tracks.place_px[lost], ROWS)
    np.testing.assert_allclose(places, walk[gap], atol=0.01)
    assert np.isnan(tracks.columns["area_um2"][lost]).all()
    assert not tracks.columns[CERTAIN][lost].any()
    assert tracks.numbers["in_gaps"] == 3


@pytest.mark.parametrize(("gap_s", "count"), [(2.0, 2), (3.0, 1)])
def test_the_gap_is_the_time_for_which_it_is_lost(gap_s: float, count: int) -> None:
    here = np.array([[1.0, 0, 0]])
    tracks = linked([(t, table(here)) for t in (0, 1, 5, 6)], gap_s=gap_s)
    assert len(tracks.ids) == count


def test_no_protrusion_is_no_track() -> None:
    empty = table(np.zeros((0, 3)).reshape(0, 3))
    tracks = linked([(t, empty) for t in range(3)])
    assert len(tracks) == len(tracks.ids) == 0
    assert len(lasting(tracks, TrackingParameters())) == 0


def test_tracks_that_are_never_high_enough_are_left_out() -> None:
    one, other = np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]])
    both = table(np.vstack([one, other]))
    rising = {**both, CERTAIN: np.array([True, False])}
    low = {**both, CERTAIN: np.array([False, False])}
    tracks = linked([(0, low), (1, rising), (2, low)])
    assert len(tracks.ids) == 2
    kept = lasting(tracks, TrackingParameters())
    assert len(kept.ids) == 1
    # With the time at which it was low.
    assert kept.lifetimes_s().tolist() == [3.0]
    assert len(lasting(tracks, TrackingParameters(least_lifetime_s=4.0))) == 0


def test_the_bumps_of_a_movie_are_followed(movie: Movie) -> None:
    tracks = track_protrusions(movie)
    # Every bump is there at two timepoints that follow each other, but the first one.
    ends = tracks.track_table[["first_timepoint", "last_timepoint"]].to_numpy().tolist()
    assert {(0, 1), (1, 2), (2, 3)} <= {tuple(each) for each in ends}
    for row in range(len(tracks)):
        label, timepoint = tracks.columns["label"][row], int(tracks.timepoint[row])
        if label:
            found = movie.protrusions(timepoint)
            at = found.columns["label"].tolist().index(label)
            assert found.columns["area_um2"][at] == tracks.columns["area_um2"][row]
    assert tracks.rows == movie.common.uv.shape[0]
    assert tracks.time_step_s == TIME_STEP_S


def test_tracks_are_kept_and_made_the_same_again(movie: Movie) -> None:
    tracks = track_protrusions(movie)
    kept = movie.tracks()
    again = track_protrusions(movie)
    for other in (kept, again):
        assert other.columns.keys() == tracks.columns.keys()
        for name, column in tracks.columns.items():
            np.testing.assert_array_equal(other.columns[name], column)


def test_tracking_can_be_cancelled(movie: Movie) -> None:
    def stop(stage: str, fraction: float, message: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        track_protrusions(movie, progress=Progress(stop))


def test_all_timepoints_have_one_kind_and_threshold(movie: Movie) -> None:
    alike = same_for_all(movie, Parameters())
    assert alike.protrusions.kind == "blebs"
    assert alike.protrusions.threshold_um is not None
    assert same_for_all(movie, alike) is alike
    found = [protrusions_of(movie, t, alike).numbers for t in range(len(movie))]
    assert {numbers["kind"] for numbers in found} == {"blebs"}
    assert len({numbers["threshold_um"] for numbers in found}) == 1


def test_what_is_followed_includes_what_is_certain(movie: Movie) -> None:
    def found(part: float, timepoint: int) -> Table:
        chosen = Parameters(tracking=TrackingParameters(followed_part=part))
        return movie.protrusions(timepoint, chosen).columns

    for timepoint in range(len(movie)):
        every, whole = found(0.4, timepoint), found(1.0, timepoint)
        assert len(every["label"]) >= len(whole["label"])
        assert every[CERTAIN].sum() >= len(whole["label"])
        assert whole[CERTAIN].all()
