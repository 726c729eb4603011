"""Velocities on the surface, along a plane, and the divergence of a flow."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import napari_unwrap3d as unwrap3d
from moving import CENTRE_UM, RADIUS_UM
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import AxesError, InputError
from napari_unwrap3d.tracking.optical_flow import directions_of_pixels
from napari_unwrap3d.tracking.places import height_at, on_surface
from napari_unwrap3d.tracking.velocities import (
    LATERAL,
    SPEED,
    VELOCITY,
    annotated_plane,
    direction_deg,
    divergence,
    fit_plane,
    median_velocities,
    most_frequent,
    with_lateral,
    with_velocities,
)

ROWS = 64
Floats = npt.NDArray[np.float64]


def tracks_at(movie: unwrap3d.Movie, track: list[int], time: list[int], places: Floats) -> Tracks:
    times = np.array(time)
    points = np.array(
        [
            on_surface(movie, height_at(movie, t), place[None])[0]
            for t, place in zip(time, places, strict=True)
        ]
    )
    columns = {"track_id": track, "timepoint": times, "v_px": places[:, 0], "u_px": places[:, 1]}
    columns |= dict(zip(("z_um", "y_um", "x_um"), points.T, strict=True))
    return Tracks.of(columns, time_step_s=movie.time_step_s, timepoints=len(movie), rows=ROWS)


def test_places_lie_on_the_surface(movie: unwrap3d.Movie) -> None:
    places = np.random.default_rng(0).uniform((0, 0), (ROWS - 1, 2 * ROWS - 1), (200, 2))
    points = on_surface(movie, height_at(movie, 0), places)
    radius = np.linalg.norm(points - CENTRE_UM, axis=1)
    assert radius.min() > RADIUS_UM - 0.3
    assert radius.max() < RADIUS_UM + 1.2
    # Where the height is not known, the place is on the reference.
    nothing = on_surface(movie, np.full((ROWS, 2 * ROWS), np.nan), places)
    reference = movie.common.map(places, "uv", "reference")[0]
    np.testing.assert_allclose(nothing, reference, atol=0.05)


def test_velocities_are_ways_over_time(movie: unwrap3d.Movie) -> None:
    # A track that is lost at timepoint 1, one of a single timepoint, one that stays.
    places = np.array([(20, 10), (20, 16), (20, 19), (30, 60), (44, 90), (44, 90)], float)
    tracks = tracks_at(movie, [1, 1, 1, 2, 3, 3], [0, 2, 3, 1, 0, 1], places)
    found = with_velocities(movie, tracks)
    velocity = np.column_stack([found.columns[name] for name in VELOCITY])
    position, minute = tracks.position_um, movie.time_step_s / 60
    np.testing.assert_allclose(velocity[0], (position[1] - position[0]) / (2 * minute))
    np.testing.assert_allclose(velocity[1], (position[2] - position[0]) / (3 * minute))
    np.testing.assert_allclose(velocity[2], (position[2] - position[1]) / minute)
    assert np.isnan(velocity[3]).all()
    assert np.isnan(found.columns[SPEED][3])
    # What only goes in and out with the surface does not move along it.
    out = np.linalg.norm(velocity[4])
    assert found.columns[SPEED][4] < max(0.3 * out, 0.5)
    assert (found.columns[SPEED][:3] <= np.linalg.norm(velocity[:3], axis=1) + 1e-9).all()
    # On a ball the way is an arc of its surface.
    arc = np.linalg.norm(position[2] - position[1]) / minute
    assert found.columns[SPEED][2] == pytest.approx(arc, rel=0.1)


def test_a_plane_is_fitted_with_weights() -> None:
    rng = np.random.default_rng(1)
    normal = np.array([0.6, 0.0, 0.8])
    along = np.array([[0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    points = np.array([3.0, -2.0, 5.0]) + rng.normal(size=(200, 2)) * 4 @ along
    plane = fit_plane(points)
    assert abs(plane.normal @ normal) == pytest.approx(1.0)
    assert plane.distance_um == pytest.approx(0.0, abs=1e-6)
    outlier = np.vstack([points, [100.0, 0.0, 100.0]])
    weighed = fit_plane(outlier, np.append(np.ones(200), 0.0))
    assert abs(weighed.normal @ normal) == pytest.approx(1.0)
    np.testing.assert_allclose(plane.along(normal[None]), 0, atol=1e-12)
    np.testing.assert_allclose(plane.along(along), along, atol=1e-9)


def test_what_is_no_plane_is_refused() -> None:
    with pytest.raises(InputError, match="three"):
        fit_plane(np.zeros((2, 3)))
    with pytest.raises(InputError, match="line"):
        fit_plane(np.outer(np.arange(5.0), (1, 2, 3)))
    with pytest.raises(AxesError):
        fit_plane(np.zeros((4, 2)))


def test_speed_along_an_annotated_plane(movie: unwrap3d.Movie) -> None:
    drawn = movie.common.annotations
    surface = movie.common.surface
    with pytest.raises(InputError, match="annotation"):
        annotated_plane(movie, "bottom")
    drawn.add("bottom")
    try:
        low = np.flatnonzero(surface.vertices[:, 0] < CENTRE_UM[0] - 0.9 * RADIUS_UM)
        drawn.draw_vertices("bottom", low, 3)
        plane = annotated_plane(movie, "bottom", 3)
        with pytest.raises(InputError):
            annotated_plane(movie, "bottom", 2)
    finally:
        drawn.remove("bottom")
    # Out of the cell, that is down, within what voxels allow.
    assert plane.normal @ (-1, 0, 0) > 0.995
    places = np.array([(20, 10), (20, 16)], float)
    tracks = with_velocities(movie, tracks_at(movie, [1, 1], [0, 1], places))
    found = with_lateral(tracks, plane)
    y, x = (tracks.columns[name] for name in VELOCITY[1:])
    np.testing.assert_allclose(found.columns[LATERAL], np.hypot(y, x), rtol=0.1)
    assert found.numbers["plane_normal"] == plane.normal.tolist()
    with pytest.raises(InputError, match="velocities"):
        with_lateral(tracks_at(movie, [1], [0], places[:1]), plane)


def test_divergence_of_known_flows() -> None:
    directions = directions_of_pixels(ROWS)
    sine = np.sin((np.arange(ROWS) + 0.5) * np.pi / ROWS)[:, None]
    area = np.repeat(sine, 2 * ROWS, axis=1)
    axis = np.array([0.3, -0.5, 0.8])
    # A rotation keeps areas; the gradient of z·a has the divergence −2 z·a on the sphere.
    turning = np.cross(axis, directions)
    np.testing.assert_allclose(divergence(turning, area), 0, atol=0.02)
    height = directions @ axis
    gradient = axis - height[..., None] * directions
    np.testing.assert_allclose(divergence(gradient, area), -2 * height, atol=0.05)
    # As much comes together as spreads: the integral over any closed surface is 0.
    uneven = area * (1.5 + directions[..., 1] * directions[..., 2])
    total = (divergence(gradient, uneven) * uneven).sum() / np.abs(uneven).sum()
    assert abs(total) < 0.01


def test_directions_on_the_image() -> None:
    directions = directions_of_pixels(ROWS)
    # A turn about the axis of the image, from (z, y, x) = x to y, is along u.
    east = np.cross(np.array([1.0, 0.0, 0.0]), directions)
    sign = np.sign(np.median(np.gradient(np.unwrap(np.arctan2(*directions[32, :, 1:].T)))))
    along = direction_deg(east)
    assert np.isclose(np.abs(along), 0).all() or np.isclose(np.abs(along), 180).all()
    assert sign != 0
    north = np.array([1.0, 0.0, 0.0]) - directions[..., :1] * directions
    np.testing.assert_allclose(direction_deg(north), 90)


def test_median_velocities_leave_out_single_wrong_steps() -> None:
    count = 7
    columns = {
        "track_id": np.repeat([2, 5], count),
        "timepoint": np.tile(np.arange(count), 2),
        **{name: np.zeros(2 * count) for name in ("z_um", "y_um", "x_um")},
        **{name: np.full(2 * count, k + 1.0) for k, name in enumerate(VELOCITY)},
    }
    columns[VELOCITY[0]][3] = 1000.0
    columns[VELOCITY[1]][0] = np.nan
    tracks = Tracks.of(columns, time_step_s=1.0, timepoints=count)
    ids, velocity = median_velocities(tracks)
    np.testing.assert_array_equal(ids, [2, 5])
    np.testing.assert_array_equal(velocity, [[1, 2, 3], [1, 2, 3]])
    ids, _ = median_velocities(tracks, least_timepoints=count)
    np.testing.assert_array_equal(ids, [5])
    none, nothing = median_velocities(tracks, np.zeros(2 * count, bool))
    assert len(none) == len(nothing) == 0


def test_the_mode_is_that_of_the_larger_population() -> None:
    rng = np.random.default_rng(3)
    speeds = np.concatenate([rng.normal(0.8, 0.1, 600), rng.normal(4.2, 0.8, 400), [np.nan, 300.0]])
    assert most_frequent(speeds) == pytest.approx(0.8, abs=0.1)
    # A kernel as wide as the distribution sees one population.
    assert most_frequent(speeds, 3.0) > 1.2
    with pytest.raises(InputError):
        most_frequent([1.0, 1.0, np.nan])
