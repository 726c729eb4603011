"""Closing or cutting handles: always a ball, and where there is a choice the smaller change."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.errors import Cancelled, EmptyMaskError
from napari_unwrap3d.geometry.handles import ball_without_handles, largest_cuts
from napari_unwrap3d.geometry.topology import euler_characteristic, is_well_composed, seal
from shapes import ball, grid, knot, linked_rings_and_bar, sponge, torus

CLOSINGS = ("smaller", "seal", "cut")


def body_with_loops() -> np.ndarray:
    """A body with a wide loop of a thin tube, and with a tight one of a thick tube."""
    points = grid((50, 50, 76))
    z, y, x = np.moveaxis(points, -1, 0)
    solid = np.sqrt(z**2 + y**2 + x**2) < 14
    solid |= np.hypot(np.hypot(y, x - 17) - 12, z) < 2.3
    solid |= np.hypot(np.hypot(y, x + 17) - 7.2, z) < 5.0
    return np.asarray(solid)


def assert_is_a_ball(solid: np.ndarray) -> None:
    assert euler_characteristic(solid) == 1
    assert is_well_composed(np.pad(solid, 1))


@pytest.mark.parametrize("closing", CLOSINGS)
@pytest.mark.parametrize("make", [body_with_loops, knot, linked_rings_and_bar, sponge])
def test_every_way_makes_a_ball(make, closing) -> None:
    solid = np.pad(make(), 2)
    result = ball_without_handles(solid, closing)
    assert_is_a_ball(result)
    changed = (result != solid).sum()
    if closing == "smaller":
        assert changed <= (seal(solid) != solid).sum()


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), size=st.integers(6, 12))
def test_sponges_become_balls(seed: int, size: int) -> None:
    assert_is_a_ball(ball_without_handles(sponge(seed, size), "cut"))


def test_sealing_only_adds_and_cutting_takes_away() -> None:
    ring = torus(13, 4, (13, 41, 41))
    assert (ball_without_handles(ring, "seal") >= ring).all()
    cut = ball_without_handles(ring, "cut")
    # Next to a cut a voxel or two may be added, where the ring touched itself at a corner.
    assert (cut & ~ring).sum() <= 2 < (ring & ~cut).sum() < 1.3 * np.pi * 4**2


def test_the_wide_loop_is_cut_and_the_tight_one_sealed() -> None:
    solid = body_with_loops()
    result = ball_without_handles(solid, "smaller")
    lost, added = solid & ~result, result & ~solid
    x = np.arange(76) - 37.5
    assert (x[np.nonzero(lost)[2]] > 10).all()
    assert (x[np.nonzero(added)[2]] < -10).all()
    # Neither way alone is as close to the solid.
    for other in ("seal", "cut"):
        assert (result != solid).sum() < (ball_without_handles(solid, other) != solid).sum()
    # A tube of radius 2.3 has a cross section of about 17 voxels.
    assert 10 < lost.sum() < 60


def test_the_body_itself_is_only_cut_when_asked() -> None:
    """Opened, a ring would be a long sausage."""
    ring = torus(13, 4, (13, 41, 41))
    np.testing.assert_array_equal(ball_without_handles(ring, "smaller"), seal(ring))
    (cut,), depth = largest_cuts(ring)
    assert depth.max() == pytest.approx(4, abs=0.7)
    assert cut.sum() == pytest.approx(np.pi * 4**2, rel=0.3)


@pytest.mark.parametrize("closing", CLOSINGS)
def test_a_ball_stays_as_it_is(closing) -> None:
    solid = ball(7, 21)
    np.testing.assert_array_equal(ball_without_handles(solid, closing), solid)


def test_an_empty_solid_is_an_error_and_the_check_can_cancel() -> None:
    with pytest.raises(EmptyMaskError):
        ball_without_handles(np.zeros((5, 5, 5), bool), "cut")

    def stop() -> None:
        raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        ball_without_handles(body_with_loops(), "smaller", stop)
