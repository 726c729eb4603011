"""Registration: motions that are known are found, and what comes and goes does not matter."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from napari_unwrap3d.charts import Volume
from napari_unwrap3d.errors import Cancelled, EmptyMaskError, NotFiniteError
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging.register import Registered, register, register_channel
from napari_unwrap3d.parameters import RegistrationParameters
from napari_unwrap3d.progress import Progress, silent
from turned import CENTRE, SHAPE, VOXEL, body_points, moved, recorded, solid

RIGID = RegistrationParameters(method="rigid")
SHIFT = RegistrationParameters(method="translation")
FINEST = min(VOXEL)


def error_voxels(found: Rigid, true: Rigid) -> float:
    """The largest displacement of a body point from where it belongs."""
    points = body_points()
    wrong = found.apply(true.apply(points)) - points
    return float(np.linalg.norm(wrong, axis=1).max()) / FINEST


def test_a_shift_is_found_and_told() -> None:
    true = moved((0, 0, 0), (0.41, -0.33, 0.57))
    found, numbers = register(recorded(Rigid()), recorded(true), SHIFT, silent())
    assert error_voxels(found, true) < 0.03
    assert not found.turns
    assert numbers["shift_um"] == pytest.approx([0.41, -0.33, 0.57], abs=0.005)
    assert numbers["angle_deg"] == 0.0
    assert numbers["residual"] < 1e-3 < 10 * numbers["residual"] + numbers["residual_before"]
    assert numbers["residual"] < numbers["residual_before"]
    assert 0.9 < numbers["corresponding"] <= 1


def test_the_body_decides_and_not_what_comes_and_goes_on_it() -> None:
    true = moved((1.8, -1.5, 1.2), (0.4, -0.5, 0.3))
    fixed = recorded(Rigid(), (0, 1), noise=6, seed=1)
    moving = recorded(true, (2, 3, 4), brightness=60, noise=6, seed=2)
    found, numbers = register(fixed, moving, RIGID, silent())
    assert error_voxels(found, true) < 0.25
    assert numbers["angle_deg"] == pytest.approx(true.angle_deg, abs=0.25)
    assert numbers["shift_um"] == pytest.approx(true.apply(CENTRE) - CENTRE, abs=0.03)
    assert numbers["corresponding"] < 0.95


def test_a_large_drift_and_rotation_out_of_the_field_of_view() -> None:
    true = moved((4, -9, 7), (1.5, 3.2, -2.6))
    found, _ = register(recorded(Rigid()), recorded(true), RIGID, silent())
    assert error_voxels(found, true) < 0.3


def test_volumes_of_different_voxels_in_worlds_of_their_own() -> None:
    true = moved((1, 2, -1.5), (0.2, 0.3, -0.4))
    finer = recorded(true, shape=(63, 63, 63), voxel=(0.2, 0.2, 0.2))
    away = Rigid(translation=np.array([5.0, -3.0, 11.0]))
    moving = Volume(finer.data, finer.voxel_size, tuple(away.translation))
    found, _ = register(recorded(Rigid()), moving, RIGID, silent())
    assert error_voxels(found, away @ true) < 0.15


def test_masks_are_registered_too() -> None:
    true = moved((1.5, -1, 2), (0.3, -0.25, 0.4))
    fixed, moving = (
        Volume(mask.data.astype(np.float32), mask.voxel_size)
        for mask in (solid(Rigid(), (0,)), solid(true, (3,)))
    )
    found, _ = register(fixed, moving, RIGID, silent())
    assert error_voxels(found, true) < 0.3


def test_nothing_moves_without_motion_and_there_and_back_is_the_same() -> None:
    fixed = recorded(Rigid(), noise=3)
    found, numbers = register(fixed, fixed, RIGID, silent())
    assert error_voxels(found, Rigid()) < 1e-3
    assert numbers["residual"] == pytest.approx(0, abs=1e-6)
    true = moved((1, -2, 1), (0.3, 0.2, -0.4))
    moving = recorded(true, noise=3, seed=1)
    there, _ = register(fixed, moving, RIGID, silent())
    back, _ = register(moving, fixed, RIGID, silent())
    points = body_points()
    loop = back.apply(there.apply(points)) - points
    assert np.linalg.norm(loop, axis=1).max() < 0.15 * FINEST


def test_the_same_bit_for_bit_also_when_read_lazily() -> None:
    import dask.array

    true = moved((1, -2, 1), (0.3, 0.2, -0.4))
    fixed, moving = recorded(Rigid(), noise=3), recorded(true, (1,), noise=3, seed=1)
    one, numbers = register(fixed, moving, RIGID, silent())
    lazy = [
        Volume(dask.array.from_array(v.data, chunks=(9, 40, 50)), v.voxel_size)
        for v in (fixed, moving)
    ]
    other, again = register(*lazy, RIGID, silent())
    assert one.to_list() == other.to_list()
    assert numbers == again


def test_what_cannot_be_registered_is_refused() -> None:
    cell, empty = recorded(Rigid()), Volume(np.full(SHAPE, 7.0), VOXEL)
    with pytest.raises(EmptyMaskError, match="one intensity"):
        register(empty, cell, SHIFT, silent())
    broken = cell.data.copy()
    broken[3, 4, 5] = np.nan
    with pytest.raises(NotFiniteError):
        register(cell, Volume(broken, VOXEL), SHIFT, silent())


@pytest.mark.parametrize("at", [0.0, 0.4, 0.6, 0.8])
def test_it_can_be_cancelled(at: float) -> None:
    cancelled = threading.Event()

    def stop(step: str, fraction: float, message: str) -> None:
        if fraction >= at:
            cancelled.set()

    with pytest.raises(Cancelled):
        register(recorded(Rigid()), recorded(Rigid()), RIGID, Progress(stop, cancelled=cancelled))


def test_progress_never_goes_back() -> None:
    seen: list[float] = []
    report = Progress(lambda step, fraction, message: seen.append(fraction))
    register(recorded(Rigid()), recorded(Rigid()), SHIFT, report)
    assert seen == sorted(seen)


def test_a_channel_with_another_contrast_is_moved_onto_the_outline() -> None:
    outline = recorded(Rigid(), noise=3)
    true = moved((0, 0, 0), (0.21, -0.3, 0.12))
    there = recorded(true, seed=1)
    # Bright where the other is dark, and bent: no correlation would find it.
    other = Volume((300 - there.data) ** 2 / 300, VOXEL)
    found, numbers = register_channel(outline, other, SHIFT, silent())
    assert error_voxels(found, true) < 0.15
    assert numbers["shift_um"] == pytest.approx([0.21, -0.3, 0.12], abs=0.03)


def test_what_was_found_goes_through_a_file() -> None:
    pose = moved((1, 2, 3), (0.1, 0.2, 0.3))
    kept = Registered(pose, {1: pose.inverse()}, {"channels": {"1": {"angle_deg": 1.0}}})
    again = Registered.from_plain(kept.to_plain())
    assert again.pose.to_list() == pose.to_list()
    assert again.of_channel(0).to_list() == pose.to_list()
    np.testing.assert_allclose(again.of_channel(1).apply(CENTRE), CENTRE, atol=1e-12)
    later = Registered().with_channels_of(again)
    assert later.channels == again.channels
    assert later.numbers == {"channels": {"1": {"angle_deg": 1.0}}}
