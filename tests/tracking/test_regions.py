"""Regions carried by a flow: as many as asked for, everywhere, and moved as the pattern is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.tracking.flow_fields import flow_fields, flow_surface
from napari_unwrap3d.tracking.flows import FieldImages
from napari_unwrap3d.tracking.optical_flow import directions_of_pixels
from napari_unwrap3d.tracking.regions import Regions, track_flow

ROWS = 64
DIRECTIONS = directions_of_pixels(ROWS)


@pytest.fixture(autouse=True)
def nothing_kept(movie: unwrap3d.Movie) -> Iterator[None]:
    """The movie is one of many tests."""
    yield
    movie.folder.drop_tracks("flow")


def parameters(**flow: object) -> unwrap3d.Parameters:
    return unwrap3d.Parameters.from_dict({"flow": {"regions": 100} | flow})


@pytest.mark.parametrize("count", [4, 100, 1000])
def test_regions_are_even(count: int) -> None:
    regions = Regions.even(count)
    assert len(regions.ids) == pytest.approx(count, rel=0.1, abs=2)
    np.testing.assert_allclose(np.linalg.norm(regions.centres, axis=1), 1)
    # Of any direction the nearest region is not far.
    apart = np.arccos(np.clip((DIRECTIONS.reshape(-1, 3) @ regions.centres.T).max(axis=1), -1, 1))
    assert apart.max() < 1.1 * regions.side


def test_a_rotation_carries_every_region_rigidly() -> None:
    turn = Rotation.from_rotvec(np.array([0.02, -0.05, 0.03])).as_matrix()
    regions = Regions.even(200)
    moved = regions.carried(DIRECTIONS @ turn.T - DIRECTIONS)
    expected = regions.centres @ turn.T
    # At the poles as everywhere.
    assert np.linalg.norm(moved.centres - expected, axis=1).max() < 0.15 * 0.06
    assert moved.ids.tolist() == regions.ids.tolist()


def test_regions_end_in_older_ones_and_begin_where_none_is_left() -> None:
    places = Regions.even(100)
    # All of the northern half gather at the pole.
    gathered = places.centres.copy()
    north = gathered[:, 0] > 0
    gathered[north] = (1.0, 0.0, 0.0)
    crowded = Regions(gathered, places.ids, places.side)
    thin = crowded.thinned(0.25)
    assert len(thin.ids) == (~north).sum() + 1
    assert places.ids[north].min() in thin.ids
    assert crowded.thinned(0.0) is crowded
    filled = thin.filled(places, ROWS, 0.5, 101)
    new = filled.ids > 100
    assert new.sum() == pytest.approx(north.sum() - 1, abs=12)
    assert (filled.centres[new][:, 0] > 0).all()
    assert len(np.unique(filled.ids)) == len(filled.ids)
    # Nothing begins where all is covered.
    assert len(places.filled(places, ROWS, 0.5, 101).ids) == len(places.ids)


def test_tracks_of_a_movie(movie: unwrap3d.Movie) -> None:
    tracks = track_flow(movie, parameters())
    assert tracks.method == "flow"
    assert tracks.numbers["first_regions"] == pytest.approx(100, abs=10)
    counts = np.bincount(tracks.timepoint)
    assert len(counts) == len(movie)
    assert (counts >= 0.8 * counts[0]).all()
    for name in ("speed_um_per_min", "divergence_per_min", "direction_deg", "side_px"):
        later = tracks.timepoint > 0
        assert np.isfinite(tracks.columns[name][later]).mean() > 0.8
    centre_v = (tracks.columns["top_px"] + tracks.columns["bottom_px"] - 1) / 2
    np.testing.assert_allclose(centre_v, tracks.columns["v_px"])
    assert "lateral_speed_um_per_min" not in tracks.columns
    # Kept under its name, and read again where nothing changed.
    assert "flow" in movie.track_names
    again = track_flow(movie, parameters())
    np.testing.assert_array_equal(again.position_um, tracks.position_um)
    key = movie.folder.tracks_key("flow")
    track_flow(movie, parameters(method="farneback"))
    assert movie.folder.tracks_key("flow") != key


def test_short_regions_are_left_out(movie: unwrap3d.Movie) -> None:
    tracks = track_flow(movie, parameters(least_lifetime_s=8.0))
    assert (tracks.lifetimes_s() >= 8.0).all()
    np.testing.assert_array_equal(tracks.ids, np.arange(1, len(tracks.ids) + 1))


def test_speeds_are_projected_on_an_annotated_plane(movie: unwrap3d.Movie) -> None:
    drawn = movie.common.annotations
    drawn.add("floor")
    try:
        low = np.flatnonzero(movie.common.surface.vertices[:, 0] < 3.0)
        drawn.draw_vertices("floor", low, 1)
        tracks = track_flow(movie, parameters(plane="floor"))
    finally:
        drawn.remove("floor")
    lateral = tracks.columns["lateral_speed_um_per_min"]
    assert np.isfinite(lateral).any()
    with pytest.raises(InputError, match="annotation"):
        track_flow(movie, parameters(plane="nowhere"))


def test_fields_and_ratios(movie: unwrap3d.Movie) -> None:
    times = list(range(len(movie)))
    ratio = FieldImages(movie, "height_um/area_um2", times).at(1)
    uv = movie.frame(1).uv
    np.testing.assert_allclose(ratio, uv["height_um"] / uv["area_um2"], rtol=1e-5)
    for unknown in ("nothing", "height_um/nothing", "a/b/c"):
        with pytest.raises(InputError, match="field"):
            FieldImages(movie, unknown, times)


def test_images_are_averaged_over_time(movie: unwrap3d.Movie) -> None:
    times = list(range(len(movie)))
    step = movie.time_step_s
    images = [np.asarray(movie.frame(t).uv["height_um"], float) for t in times]
    # The window reaches 2 steps, where it is 0; a step away it is half.
    found = FieldImages(movie, "height_um", times, 2 * step)
    expected = (0.5 * images[0] + images[1] + 0.5 * images[2]) / 2
    np.testing.assert_allclose(found.at(1), expected, rtol=1e-5)
    np.testing.assert_allclose(found.at(0), (images[0] + 0.5 * images[1]) / 1.5, rtol=1e-5)
    np.testing.assert_allclose(FieldImages(movie, "height_um", times, 0.9 * step).at(2), images[2])


def test_mean_flow_on_the_surface(movie: unwrap3d.Movie) -> None:
    found = flow_fields(movie, parameters())
    shape = movie.common.uv.shape
    assert {image.shape for image in found.values()} == {shape}
    assert {"speed_um_per_min", "direction_deg", "divergence_per_min"} < set(found)
    area = np.asarray(movie.common.uv.fields["area_um2"])
    # What spreads somewhere gathers elsewhere.
    total = (found["divergence_per_min"] * area).sum()
    assert abs(total) < 0.05 * (np.abs(found["divergence_per_min"]) * area).sum()
    carried = movie.common.carry(found["speed_um_per_min"], "uv", "surface")
    fields = flow_surface(movie, parameters()).fields
    np.testing.assert_array_equal(fields["speed_um_per_min"], carried)
    angle = np.radians(found["direction_deg"])
    one, other = (movie.common.carry(f(angle), "uv", "surface") for f in (np.cos, np.sin))
    size = np.hypot(one, other)
    turned = np.radians(fields["direction_deg"])
    np.testing.assert_allclose(size * np.cos(turned), one, atol=1e-6)
    np.testing.assert_allclose(size * np.sin(turned), other, atol=1e-6)
