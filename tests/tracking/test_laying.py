"""Tracks laid on the surface of a movie: from space to (v, u) and back."""

from dataclasses import replace

import numpy as np
import pytest

from moving import TIME_STEP_S, blebbing_movie
from napari_unwrap3d import Movie
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.tracking.edits import TrackEdits
from napari_unwrap3d.tracking.laying import lay_tracks, place_of, position_of


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.mktemp("laid"))


def on_vertices(movie: Movie, step: int = 50) -> tuple[Tracks, np.ndarray]:
    """A track for every so manieth vertex of a frame, and its (v, u)."""
    positions, places, times = [], [], []
    for frame in movie.frames():
        chosen = np.arange(0, len(frame.surface.vertices), step)
        chosen = chosen[~frame.outside[chosen]]
        positions.append(frame.surface.vertices[chosen])
        places.append(frame.topography[chosen, 1:])
        times.append(np.full(len(chosen), frame.timepoint))
    position, time = np.concatenate(positions), np.concatenate(times)
    columns = {"track_id": np.arange(1, len(time) + 1), "timepoint": time}
    columns |= dict(zip(("z_um", "y_um", "x_um"), position.T, strict=True))
    tracks = Tracks.of(columns, time_step_s=TIME_STEP_S, timepoints=len(movie))
    return tracks, np.concatenate(places)


def around(found: np.ndarray, expected: np.ndarray, rows: int) -> np.ndarray:
    """How far (v, u) are apart, over the seam."""
    apart = found - expected
    apart[:, 1] = (apart[:, 1] + rows) % (2 * rows) - rows
    return np.abs(apart)


def test_points_of_the_surface_are_where_it_is(movie: Movie) -> None:
    tracks, places = on_vertices(movie)
    laid = lay_tracks(movie, tracks)
    np.testing.assert_allclose(around(laid.place_px, places, 64), 0, atol=1e-6)
    np.testing.assert_allclose(laid.columns["off_surface_um"], 0, atol=1e-6)
    np.testing.assert_allclose(laid.position_um, tracks.position_um)
    assert laid.rows == 64
    assert laid.numbers["laying"]["not_laid"] == 0


def test_points_off_the_surface_say_how_far(movie: Movie) -> None:
    tracks, _ = on_vertices(movie, 200)
    middle = movie.frame(0).surface.vertices.mean(axis=0)
    outward = tracks.position_um - middle
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    moved = (tracks.position_um + 3.0 * outward).T
    far = tracks.with_columns(**dict(zip(("z_um", "y_um", "x_um"), moved, strict=True)))
    laid = lay_tracks(movie, far)
    assert (laid.columns["off_surface_um"] > 1.0).all()
    assert np.isnan(lay_tracks(movie, far, farthest_um=0.5).place_px).all()
    snapped = lay_tracks(movie, far, snap=True)
    again = lay_tracks(movie, snapped)
    np.testing.assert_allclose(again.columns["off_surface_um"], 0, atol=1e-6)
    common = lay_tracks(movie, far, onto="common")
    assert np.isfinite(common.place_px).all()


def test_places_on_the_image_come_to_lie_in_space(movie: Movie) -> None:
    random = np.random.default_rng(0)
    place = np.column_stack([random.uniform(4, 59, 40), random.uniform(0, 127, 40)])
    unknown = np.full(40, np.nan)
    columns = {
        "track_id": np.arange(1, 41),
        "timepoint": np.arange(40) % 4,
        **dict.fromkeys(("z_um", "y_um", "x_um"), unknown),
        "v_px": place[:, 0],
        "u_px": place[:, 1],
    }
    laid = lay_tracks(movie, Tracks.of(columns, time_step_s=TIME_STEP_S, timepoints=4))
    np.testing.assert_array_equal(laid.place_px, place)
    assert np.isfinite(laid.position_um).all()
    for timepoint in range(4):
        rows = laid.timepoint == timepoint
        _, away = place_of(movie, timepoint, laid.position_um[rows])
        # The height is that of the pixel, and steep sides of bumps are a voxel or two off.
        assert np.median(away) < 0.1
        found = position_of(movie, timepoint, place[rows])
        np.testing.assert_array_equal(found, laid.position_um[rows])


def test_tracks_of_another_movie_are_refused(movie: Movie) -> None:
    tracks, _ = on_vertices(movie, 500)
    with pytest.raises(ParameterError, match="end of the movie"):
        lay_tracks(movie, shifted(tracks, 3))
    with pytest.raises(ParameterError, match="time steps"):
        lay_tracks(movie, replace(tracks, time_step_s=5.0))
    with pytest.raises(ParameterError, match="onto"):
        lay_tracks(movie, tracks, onto="moon")


def shifted(tracks: Tracks, by: int) -> Tracks:
    columns = {**tracks.columns, "timepoint": tracks.timepoint + by}
    return replace(tracks, columns=columns, timepoints=tracks.timepoints + by)


def test_a_moved_point_stays_on_the_surface(movie: Movie) -> None:
    tracks, _ = on_vertices(movie, 300)
    edits = TrackEdits(lay_tracks(movie, tracks), movie)
    track, timepoint = int(tracks.ids[0]), int(tracks.timepoint[0])
    edits.move(track, timepoint, place_px=(20.0, 30.0))
    row = edits.tracks.rows_of(track).start
    _, away = place_of(movie, timepoint, edits.tracks.position_um[row][None])
    assert away[0] < 0.5
    goal = movie.frame(timepoint).surface.vertices[7]
    edits.move(track, timepoint, position_um=goal)
    expected = movie.frame(timepoint).topography[7, 1:][None]
    np.testing.assert_allclose(around(edits.tracks.place_px[row][None], expected, 64), 0, atol=1e-6)
