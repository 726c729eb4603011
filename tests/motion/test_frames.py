"""One timepoint in the common space: places, areas, and signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moving import (
    CENTRE_UM,
    DIRECTIONS,
    RADIUS_UM,
    TIME_STEP_S,
    VOXEL_UM,
    blebbing,
    blebbing_movie,
    bumpy_ball,
    quick,
)
from napari_unwrap3d import Mask, Movie, Stack, Surface
from napari_unwrap3d.errors import AxesError, ParameterError
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging.register import Registered
from napari_unwrap3d.motion.frames import CommonSpace, frame_of
from napari_unwrap3d.motion.signals import Signals
from napari_unwrap3d.parameters import MovieParameters
from napari_unwrap3d.progress import silent


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


@pytest.fixture(scope="module")
def space(movie: Movie) -> CommonSpace:
    return CommonSpace(movie.common)


def test_every_vertex_lies_where_the_common_space_puts_it(movie: Movie) -> None:
    for frame in movie.frames():
        assert not frame.outside.any()
        back, valid = movie.common.map(frame.topography, "topography", "volume")
        assert valid.all()
        off = np.linalg.norm(back - frame.surface.vertices, axis=1)
        assert off.max() < 0.01 * VOXEL_UM


def test_a_place_on_the_body_keeps_its_uv_while_bumps_come_and_go(movie: Movie) -> None:
    """Vertices of the bare ball at two timepoints, at the same place in space."""
    first, second = movie.frame(0), movie.frame(2)
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(first.surface.vertices).query(second.surface.vertices)
    same = distance < 1e-6
    assert same.sum() > 500
    one, other = first.topography[nearest[same]], second.topography[same]
    np.testing.assert_allclose(one, other, atol=1e-3)


def test_height_is_d(movie: Movie) -> None:
    frame = movie.frame(1)
    np.testing.assert_array_equal(frame.surface.fields["height_um"], frame.topography[:, 0])


def test_bumps_stand_out_where_they_are(movie: Movie) -> None:
    for timepoint, frame in enumerate(movie.frames()):
        height = frame.uv["height_um"]
        tall = DIRECTIONS[timepoint % 4] * RADIUS_UM * 0.99 + CENTRE_UM
        flat = DIRECTIONS[(timepoint + 2) % 4] * RADIUS_UM * 0.99 + CENTRE_UM
        (there, _), (elsewhere, _) = (
            movie.common.map(place[None], "volume", "uv") for place in (tall, flat)
        )
        v, u = np.rint(there[0]).astype(int) % height.shape
        w, x = np.rint(elsewhere[0]).astype(int) % height.shape
        assert height[v, u] > height[w, x] + 0.6


def test_areas_of_pixels_and_vertices_are_those_of_the_surface(movie: Movie) -> None:
    for frame in movie.frames():
        whole = frame.numbers["area_um2"]
        assert frame.surface.fields["area_um2"].sum() == pytest.approx(whole, rel=1e-9)
        # Bumps hang over a little, and a pixel's area is that of what lies outermost.
        assert frame.uv["area_um2"].sum() == pytest.approx(whole, rel=0.05)


def test_what_leaves_the_space_is_measured(space: CommonSpace) -> None:
    far = bumpy_ball([])
    frame = frame_of(
        space,
        Mask(far.data, far.voxel_size, (0, 5.0, 0)),
        None,
        None,
        Registered(),
        0,
        0.0,
        quick(),
        silent(),
    )
    area = frame.surface.fields["area_um2"]
    assert 0 < frame.outside.sum() < len(area)
    np.testing.assert_array_equal(frame.surface.fields["outside"], frame.outside)
    assert "outside" not in frame.uv
    assert frame.numbers["outside_area_um2"] == pytest.approx(area[frame.outside].sum())
    assert np.isnan(frame.topography[frame.outside]).all()
    # The part beyond is the one far away.
    outside_y = frame.surface.vertices[frame.outside, 1].mean()
    assert outside_y > frame.surface.vertices[~frame.outside, 1].mean()


def test_a_given_mesh_is_the_surface(space: CommonSpace, movie: Movie) -> None:
    given = Surface(movie.frame(0).surface.vertices, movie.frame(0).surface.faces)
    frame = frame_of(space, blebbing(1)[0], given, None, Registered(), 0, 0.0, quick(), silent())
    np.testing.assert_array_equal(frame.surface.vertices, given.vertices)


def test_frames_know_their_time(movie: Movie) -> None:
    assert [frame.time_s for frame in movie.frames()] == [t * TIME_STEP_S for t in range(4)]


# Signals -----------------------------------------------------------------------


def gradient(shift: tuple[int, int, int] = (0, 0, 0), bleach: float = 1.0) -> Stack:
    """Two channels: one that rises along z in the cell's world, one that is flat."""
    z = np.arange(48)[:, None, None] - shift[0]
    ramp = np.broadcast_to(100 + 2.0 * z, (48, 48, 48))
    data = bleach * np.stack([ramp, np.full((48, 48, 48), 50.0)])
    return Stack(data, "czyx", (VOXEL_UM,) * 3, channels=("ramp", "flat"))


def signals(stack: Stack, pose: Rigid | None = None, **changes: object) -> dict[str, np.ndarray]:
    parameters = MovieParameters(**changes)  # type: ignore[arg-type]
    mask = blebbing(1)[0]
    points = np.argwhere(mask.data)[::500] * VOXEL_UM
    found = Signals.chosen(stack, parameters)
    registered = Registered(pose or Rigid())
    values = found.at(points, mask, registered, silent())
    assert tuple(values) == found.names
    return values


def test_a_signal_is_read_where_the_timepoint_came_from() -> None:
    still = signals(gradient(), depth_um=0, normalize=False, statistic="mean")
    pose = Rigid(translation=np.array([-3 * VOXEL_UM, 0, 0]))
    moved = signals(gradient((3, 0, 0)), pose, depth_um=0, normalize=False, statistic="mean")
    np.testing.assert_allclose(moved["signal_ramp"], still["signal_ramp"], rtol=1e-5)


def test_a_turned_timepoint_is_read_where_it_came_from() -> None:
    """Turned by a quarter about z, the ramp along z is the same."""
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    centre = np.full(3, 47 / 2 * VOXEL_UM)
    still = signals(gradient(), depth_um=0, normalize=False, statistic="mean")
    turned = signals(
        gradient(),
        Rigid.about(centre, turn, np.zeros(3)),
        depth_um=0,
        normalize=False,
        statistic="mean",
    )
    np.testing.assert_allclose(turned["signal_ramp"], still["signal_ramp"], rtol=1e-5)


def test_normalising_takes_bleaching_away() -> None:
    bright, dim = (signals(gradient(bleach=b)) for b in (1.0, 0.3))
    for name, values in bright.items():
        np.testing.assert_allclose(dim[name], values, rtol=1e-5)
    np.testing.assert_allclose(bright["signal_flat"], 1.0, rtol=1e-5)


def test_a_ratio_divides_two_signals() -> None:
    found = signals(gradient(), signals="ramp/flat, 1", normalize=False)
    alone = signals(gradient(), normalize=False)
    assert tuple(found) == ("signal_ramp_per_flat", "signal_1")
    np.testing.assert_allclose(
        found["signal_ramp_per_flat"], alone["signal_ramp"] / alone["signal_flat"]
    )


def test_no_signal_is_sampled_where_none_is_wanted() -> None:
    assert signals(gradient(), signals="") == {}


@pytest.mark.parametrize("text", ["2", "ramp/flat/ramp", "green", "ramp/green"])
def test_a_signal_that_is_not_there_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        Signals.chosen(gradient(), MovieParameters(signals=text))


def test_a_name_with_a_slash_is_a_name() -> None:
    stack = replace(gradient(), channels=("GFP/RFP", "flat"))
    assert Signals.chosen(stack, MovieParameters(signals="GFP/RFP")).wanted == (("GFP/RFP",),)


def test_a_frame_has_one_place_for_each_vertex(movie: Movie) -> None:
    frame = movie.frame(0)
    with pytest.raises(AxesError, match="per vertex"):
        replace(frame, topography=frame.topography[1:])
    with pytest.raises(AxesError, match="one shape"):
        replace(frame, uv={**frame.uv, "other": np.zeros((2, 4))})
