"""Measuring a small movie: a ball on which bumps come and go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moving import TIME_STEP_S, blebbing_movie
from napari_unwrap3d import Movie, Parameters
from napari_unwrap3d.analyses import tracked
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.fields import CURVATURE
from napari_unwrap3d.measuring.analysis import measure_tracks
from napari_unwrap3d.measuring.fields import image_of
from napari_unwrap3d.measuring.still import still_tracks
from napari_unwrap3d.progress import Progress

SPACE = ("z_um", "y_um", "x_um")


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


def chosen(**values: object) -> Parameters:
    return Parameters.from_dict({"measurement": values})


def one_by_one(movie: Movie) -> Tracks:
    """Every protrusion as a track of its own."""
    rows = [movie.protrusions(t).table.assign(timepoint=t) for t in range(len(movie))]
    names = ("timepoint", "label", *SPACE, "v_px", "u_px", "area_um2", "height_max_um")
    columns = {name: np.concatenate([row[name] for row in rows]) for name in names}
    columns["track_id"] = np.arange(1, len(columns["label"]) + 1)
    rows_of_uv = movie.common.uv.shape[0]
    step = movie.time_step_s
    return Tracks.of(columns, time_step_s=step, timepoints=len(movie), rows=rows_of_uv)


def test_on_a_protrusion_is_what_its_label_shows(movie: Movie) -> None:
    tracks = one_by_one(movie)
    found = measure_tracks(movie, tracks, chosen(beyond_s=0))
    series = found.table("series")
    assert len(series) == len(tracks)
    for row in series.itertuples():
        frame, own = movie.frame(row.timepoint), movie.protrusions(row.timepoint)
        label = tracks.columns["label"][tracks.track_id == row.track_id][0]
        area = np.where(own.uv == label, frame.uv["area_um2"], 0.0)
        assert row.on_area_um2 == pytest.approx(np.nansum(area), rel=1e-6)
        curvature = np.nansum(area * frame.uv[CURVATURE]) / np.nansum(area)
        assert getattr(row, f"on_{CURVATURE}") == pytest.approx(curvature, rel=1e-5)
        assert row.on_area_px == (own.uv == label).sum()
        assert row.area_um2 == pytest.approx(row.on_area_um2 + row.off_area_um2)
        # What is bent outwards is on it.
        assert getattr(row, f"on_{CURVATURE}") > getattr(row, f"off_{CURVATURE}")


def test_the_whole_of_a_box_is_the_same_however_it_is_parted(movie: Movie) -> None:
    tracks = one_by_one(movie)
    one, other = (
        measure_tracks(movie, tracks, chosen(beyond_s=0, on=on)).table("series")
        for on in ("protrusion", "curvature")
    )
    for name in ("area_um2", "area_px", CURVATURE):
        np.testing.assert_allclose(one[name], other[name])
    assert not np.allclose(one["on_area_um2"], other["on_area_um2"])


def test_beyond_its_life_a_box_stays_and_nothing_is_on_it(movie: Movie) -> None:
    tracks = one_by_one(movie)
    found = measure_tracks(movie, tracks, chosen(beyond_s=TIME_STEP_S)).table("series")
    beyond = found[~found.alive]
    assert len(beyond) > len(tracks) / 2
    assert beyond.on_area_um2.isna().all()
    assert beyond.area_um2.gt(0).all()
    assert found[found.alive].on_area_um2.notna().all()


def test_areas_of_all_places_are_that_of_the_surface(movie: Movie) -> None:
    """Boxes all around the image, one row high: together they are the whole surface."""
    rows = movie.common.uv.shape[0]
    top = np.arange(float(rows))
    columns = {"track_id": np.arange(1, rows + 1), "timepoint": np.full(rows, 2)}
    columns |= {name: np.zeros(rows) for name in SPACE}
    columns |= {"top_px": top, "bottom_px": top + 1}
    columns |= {"left_px": np.full(rows, -7.0), "right_px": np.full(rows, 2.0 * rows - 7)}
    tracks = Tracks.of(columns, time_step_s=1.0, timepoints=len(movie), rows=rows)
    found = measure_tracks(movie, tracks, chosen(beyond_s=0))
    assert found.table("series").area_um2.sum() == pytest.approx(
        np.nansum(movie.frame(2).uv["area_um2"]), rel=1e-6
    )


def test_places_that_do_not_move_are_everywhere_and_as_large(movie: Movie) -> None:
    found = measure_tracks(movie, None, chosen(tracks="places", places=60, region_um=1.5))
    assert len(found.tracks.ids) == 60
    assert found.numbers["place"] == "region"
    area = found.table("tracks").series_area_um2
    # Also near the poles, where a pixel is narrow.
    assert 0.6 * 1.5**2 < area.min() <= area.max() < 4 * 1.5**2
    distance = np.linalg.norm(found.tracks.position_um - found.tracks.position_um.mean(0), axis=1)
    assert 3.5 < distance.min() <= distance.max() < 6.5
    assert "on_area_um2" not in found.table("series")
    by_name = tracked(movie, "places", chosen(places=60), Progress())
    np.testing.assert_array_equal(by_name.position_um, found.tracks.position_um)


def test_ratios_of_signals_are_fields(movie: Movie) -> None:
    frame = movie.frame(0)
    signals = {"signal_a_per_b": 6.0, "signal_c": 2.0, "signal_a": 5.0}
    uv = {name: np.full(movie.common.uv.shape, value) for name, value in signals.items()}
    known = replace(frame, uv=uv)
    assert (image_of(known, "signal_a_per_b_per_c") == 3.0).all()
    assert (image_of(known, "signal_a_per_c") == 2.5).all()
    uv["signal_c"][:] = 0.0
    assert np.isnan(image_of(known, "signal_a_per_c")).all()
    with pytest.raises(ParameterError, match="no field"):
        image_of(known, "signal_per_d")


def test_only_tracks_in_an_annotation_are_measured(movie: Movie) -> None:
    annotations = movie.common.annotations
    if "half" not in annotations.names:
        annotations.add("half")
        image = np.zeros(movie.common.uv.shape, bool)
        image[: len(image) // 2] = True
        annotations.draw("half", "uv", np.nonzero(image), 1)
    tracks = still_tracks(movie, 40)
    inside, outside = (
        measure_tracks(movie, tracks, chosen(**{side: "half"})).tracks
        for side in ("inside", "outside")
    )
    assert len(inside.ids)
    assert len(outside.ids)
    assert inside.place_px[:, 0].max() < outside.place_px[:, 0].min()
    assert set(inside.ids) | set(outside.ids) == set(tracks.ids)


def test_annotations_are_measured_too(movie: Movie) -> None:
    annotations = movie.common.annotations
    if "cap" not in annotations.names:
        annotations.add("cap")
    image = np.zeros(movie.common.uv.shape, bool)
    image[:20] = True
    annotations.draw("cap", "uv", np.nonzero(image), 3)
    found = measure_tracks(movie, still_tracks(movie, 8), chosen(regions="cap")).table("regions")
    assert list(found.label.unique()) == [3]
    assert list(found.timepoint) == list(range(len(movie)))
    for row in found.itertuples():
        frame = movie.frame(row.timepoint)
        shown = annotations.image("cap", "uv") == 3
        assert row.area_um2 == pytest.approx(np.nansum(frame.uv["area_um2"][shown]), rel=1e-6)


def test_without_tracks_everything_is_empty(movie: Movie) -> None:
    tracks = one_by_one(movie).kept([])
    found = measure_tracks(movie, tracks, chosen())
    assert found.numbers["tracks"] == 0
    assert found.numbers["mean_lifetime_s"] is None
    assert len(found.table("series")) == 0
    assert len(found.table("autocorrelation")) > 0


def test_what_is_not_there_is_refused(movie: Movie) -> None:
    tracks = one_by_one(movie)
    with pytest.raises(ParameterError, match="no field"):
        measure_tracks(movie, tracks, chosen(fields="colour"))
    with pytest.raises(ParameterError, match="Two fields"):
        measure_tracks(movie, tracks, chosen(correlate=CURVATURE))
    with pytest.raises(ParameterError, match="no ratio"):
        measure_tracks(movie, tracks, chosen(fields=f"{CURVATURE}/{CURVATURE}"))
    with pytest.raises(ParameterError, match="annotation"):
        measure_tracks(movie, tracks, chosen(regions="nowhere"))
    with pytest.raises(InputError, match="no tracks named"):
        measure_tracks(movie, None, chosen(tracks="mine"))
    elsewhere = Tracks.of(
        {"track_id": [1], "timepoint": [0], **{name: [0.0] for name in SPACE}},
        time_step_s=1.0,
        timepoints=len(movie),
    )
    with pytest.raises(InputError, match="no place on the surface"):
        measure_tracks(movie, elsewhere, chosen())
    with pytest.raises(InputError, match="another size"):
        measure_tracks(
            movie, Tracks.of(dict(tracks.columns), time_step_s=1.0, timepoints=4, rows=9)
        )
