"""Kymographs: lines measured in µm on a ball, and speeds that are known."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.errors import AxesError, InputError, ParameterError
from napari_unwrap3d.motion.kymograph import (
    along_line,
    broken_at_seam,
    kymograph,
    line_on_surface,
    pixel_um,
    surface_line,
)
from napari_unwrap3d.motion.uv_stacks import UvStacks, field_label
from synthetic import CENTRE, RADIUS, make_atlas

ROWS = 32
# Across the seam from both sides, over the north pole, and within the image.
LINES = {
    "within": [[16.0, 10.0], [16.0, 40.0]],
    "oblique": [[6.0, 12.0], [14.0, 25.0], [24.0, 28.0]],
    "seam": [[12.0, 50.0], [18.0, 80.0]],
    "back over the seam": [[12.0, 10.0], [18.0, -20.0]],
    "north pole": [[10.0, 5.0], [-11.0, 5.0]],
    "south pole": [[20.0, 61.0], [42.0, 61.0]],
}


@pytest.fixture(scope="module")
def ball() -> Any:
    """A cell whose reference is a ball."""
    return make_atlas(subdivisions=4, rows=ROWS)


def travelling(atlas: Any, corners: Any, speed: float, times: Any) -> Any:
    """A movie in which a bump travels along a line at a speed in µm/s."""
    line = surface_line(atlas, corners, step_um=0.05)
    places = line_on_surface(atlas, line)
    frames = []
    for time in times:
        at = [np.interp(1.5 + speed * time, line.positions_um, axis) for axis in places.T]
        away = np.linalg.norm(atlas.uv.positions - np.array(at), axis=-1)
        image = np.exp(-((away / 0.9) ** 2) / 2).astype(np.float32)
        frames.append(SimpleNamespace(uv={"bump": image, "area_um2": atlas.uv.fields["area_um2"]}))
    return Travelling(
        common=atlas,
        fields=("bump", "area_um2"),
        times_s=times,
        name="bump",
        work=None,
        has_frame=lambda t: True,
        frame=lambda t: frames[t],
    )


class Travelling(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.times_s)


@pytest.mark.parametrize("name", LINES)
def test_a_great_circle_on_a_ball_has_the_length_of_its_angle(ball: Any, name: str) -> None:
    corners = np.array(LINES[name])
    line = surface_line(ball, corners, between="great circle")
    directions, _ = ball.map(corners, "uv", "sphere")
    angles = [np.arccos(a @ b) for a, b in itertools.pairwise(directions)]
    assert line.length_um == pytest.approx(RADIUS * sum(angles), rel=0.003)
    steps = np.diff(line.positions_um)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
    assert line.step_um == pytest.approx(pixel_um(ball), rel=0.1)
    places = line_on_surface(ball, line)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(places, axis=0), axis=1), line.step_um, rtol=0.05
    )
    np.testing.assert_allclose(np.linalg.norm(places - CENTRE, axis=1), RADIUS, rtol=0.004)


def test_what_is_drawn_is_straight_in_the_image(ball: Any) -> None:
    line = surface_line(ball, LINES["within"])
    np.testing.assert_allclose(line.points[:, 0], 16.0, atol=1e-3)
    # Along a circle of latitude, a little off the equator.
    angle = 30 * np.pi / ROWS
    assert line.length_um == pytest.approx(RADIUS * np.sin(16.5 * np.pi / ROWS) * angle, rel=0.003)
    short = surface_line(ball, [[16.0, 1.0], [16.0, 63.0]], between="great circle")
    assert short.length_um < 0.1 * surface_line(ball, [[16.0, 1.0], [16.0, 63.0]]).length_um


def test_over_a_seam_and_a_pole_a_line_goes_on(ball: Any) -> None:
    for name in ("seam", "north pole"):
        line = surface_line(ball, LINES[name], width_um=1.0)
        v, u = line.points.T
        assert ((v >= -0.5) & (v <= ROWS - 0.5) & (u >= -0.5) & (u < 2 * ROWS - 0.5)).all()
        assert (np.abs(np.diff(u)) > ROWS / 2).sum() == 1, "it passes once"


@pytest.mark.parametrize("name", LINES)
def test_lanes_lie_at_their_distance_on_a_ball(ball: Any, name: str) -> None:
    line = surface_line(ball, LINES[name], width_um=2.0, step_um=0.25)
    count = line.lanes.shape[1]
    assert count % 2 == 1
    gap = 2.0 / count
    assert gap <= 0.25 + 1e-9
    directions, _ = ball.map(line.lanes.reshape(-1, 2), "uv", "sphere")
    directions = directions.reshape(*line.lanes.shape[:2], 3)
    middle = directions[:, count // 2]
    np.testing.assert_allclose(middle, line.directions, atol=1e-9)
    for lane in range(count):
        cosine = np.sum(directions[:, lane] * middle, axis=1)
        away = RADIUS * np.arccos(np.clip(cosine, -1, 1))
        np.testing.assert_allclose(away, gap * abs(lane - count // 2), atol=0.03)
    # Square to the line.
    ahead = np.gradient(middle, axis=0)
    aside = directions[:, -1] - middle
    cosine = np.sum(ahead * aside, axis=1)
    cosine /= np.linalg.norm(ahead, axis=1) * np.linalg.norm(aside, axis=1)
    assert np.abs(cosine).max() < 0.15


def test_lanes_run_from_the_left_to_the_right(ball: Any) -> None:
    # v goes down and u to the right: who goes down has smaller u at the right hand.
    line = surface_line(ball, [[8.0, 30.0], [24.0, 30.0]], width_um=2.0)
    assert (line.lanes[:, 0, 1] > line.lanes[:, -1, 1]).all()


@pytest.mark.parametrize("name", ["within", "seam", "north pole", "oblique"])
@pytest.mark.parametrize("width_um", [0.0, 1.0])
def test_the_slope_is_the_speed(ball: Any, name: str, width_um: float) -> None:
    times = np.arange(6) * 3.0
    line = surface_line(ball, LINES[name])
    speed = (line.length_um - 3.0) / times[-1]
    movie = travelling(ball, LINES[name], speed, times)
    found = kymograph(movie, LINES[name], "bump", width_um)
    assert found.values.shape == (6, len(line.points))
    peak = found.positions_um[found.values.argmax(axis=1)]
    weight = np.where(found.values > 0.5 * found.values.max(axis=1, keepdims=True), found.values, 0)
    peak = (weight * found.positions_um).sum(axis=1) / weight.sum(axis=1)
    slope, start = np.polyfit(times, peak, 1)
    assert slope == pytest.approx(speed, rel=0.02)
    assert start == pytest.approx(1.5, abs=0.1)


def test_a_width_takes_the_mean_by_area(ball: Any) -> None:
    line = surface_line(ball, LINES["within"], width_um=2.0, step_um=0.5)
    v = np.repeat(np.arange(ROWS, dtype=float)[:, None], 2 * ROWS, axis=1)
    even = along_line(line, v, np.ones_like(v))
    np.testing.assert_allclose(even, line.lanes[..., 0].mean(axis=1), atol=1e-6)
    # Twice as much surface below the line: its values count twice.
    below = np.where(v > 16, 2.0, 1.0)
    assert (along_line(line, v, below) > even + 0.1).all()


def test_gaps_are_left_out_and_a_line_in_a_gap_has_no_value(ball: Any) -> None:
    line = surface_line(ball, LINES["within"], width_um=2.0)
    image = np.full((ROWS, 2 * ROWS), 3.0)
    image[:, 20:25] = np.nan
    found = along_line(line, image, np.ones_like(image))
    u = line.points[:, 1]
    assert np.isnan(found[(u > 21) & (u < 23)]).all()
    np.testing.assert_allclose(found[(u < 18) | (u > 26)], 3.0)


def test_the_movie_of_a_breathing_cell(breathing: Any, tmp_path: Any) -> None:
    corners = [[20.0, 100.0], [40.0, 150.0]]
    found = kymograph(breathing, corners, "height_um", 0.3)
    assert (found.times_s == [0, 2, 4, 6, 8]).all()
    assert np.isfinite(found.values).all()
    # It breathes out and in again.
    np.testing.assert_allclose(found.values[0], found.values[-1], atol=1e-6)
    table = found.table()
    assert list(table) == [
        "timepoint",
        "time_s",
        "position_um",
        "v_px",
        "u_px",
        "height_um",
    ]
    assert len(table) == found.values.size
    row = table.iloc[len(found.positions_um) + 2]
    assert row["time_s"] == 2.0
    assert row["height_um"] == found.values[1, 2]
    stacks = UvStacks.of(breathing, ["height_um", "area_um2"])
    again = kymograph(breathing, corners, "height_um", 0.3, stacks=stacks)
    assert (again.values == found.values).all()


def test_the_line_lies_on_the_surface_of_a_frame(breathing: Any) -> None:
    from napari_unwrap3d.geometry.locate import SurfaceLocator

    line = surface_line(breathing.common, [[20.0, 40.0], [40.0, 140.0]])
    frame = breathing.frame(2)
    places = line_on_surface(breathing.common, line, frame)
    assert np.isfinite(places).all()
    surface = frame.surface
    _, _, away = SurfaceLocator(surface.vertices, surface.faces).closest(places)
    # Heights are interpolated between pixels of a coarse image.
    assert np.percentile(away, 90) < 0.5 * breathing.common.voxel_um


def test_a_missing_frame_is_empty(breathing: Any, tmp_path: Any) -> None:
    import shutil

    from napari_unwrap3d.motion.movie import load_movie

    folder = tmp_path / "copy"
    shutil.copytree(breathing.folder.path, folder)
    next((folder / "frames").glob("00003*")).unlink()
    found = kymograph(load_movie(folder), [[20.0, 40.0], [40.0, 140.0]], "height_um")
    assert np.isnan(found.values[3]).all()
    assert np.isfinite(found.values[[0, 1, 2, 4]]).all()


def test_what_is_no_line_is_refused(ball: Any, breathing: Any) -> None:
    with pytest.raises(AxesError):
        surface_line(ball, [[1.0, 2.0]])
    with pytest.raises(AxesError):
        surface_line(ball, [[1.0, 2.0], [np.nan, 3.0]])
    with pytest.raises(InputError, match="no length"):
        surface_line(ball, [[1.0, 2.0], [1.0, 2.0]])
    with pytest.raises(InputError, match="no length"):
        surface_line(ball, [[1.0, 2.0], [1.0, 2.0]], between="great circle")
    with pytest.raises(InputError, match="opposite"):
        surface_line(ball, [[15.5, 2.0], [15.5, 34.0]], between="great circle")
    with pytest.raises(ParameterError):
        surface_line(ball, [[1.0, 2.0], [5.0, 2.0]], width_um=-1)
    with pytest.raises(ParameterError):
        surface_line(ball, [[1.0, 2.0], [5.0, 2.0]], step_um=0)
    with pytest.raises(ParameterError):
        surface_line(ball, [[1.0, 2.0], [5.0, 2.0]], between="curly")
    with pytest.raises(ParameterError, match="height_um"):
        kymograph(breathing, [[1.0, 2.0], [5.0, 2.0]], "nothing")


def test_labels_have_units() -> None:
    assert field_label("height_um") == "Height d (µm)"
    assert field_label("mean_curvature_per_um") == "Mean curvature (1/µm)"
    assert field_label("signal_actin") == "Signal actin"


def test_a_line_is_broken_at_the_seam() -> None:
    points = np.array([[5.0, 60.0], [5.0, 63.0], [5.0, 1.0], [5.0, 3.0]])
    found = broken_at_seam(points, 32)
    assert np.isnan(found[:, 0]).tolist() == [False, False, True, False, False]
