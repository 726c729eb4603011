"""The working grid: positions are kept, linear functions are exact, masks stay smooth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from napari_unwrap3d.charts import Mask, Volume
from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging.resample import (
    covered,
    interpolate_axis,
    mask_to_working_grid,
    to_working_grid,
)

SIZES = st.tuples(*[st.floats(0.3, 1.0)] * 3)


def centres(volume: Volume) -> np.ndarray:
    return volume.to_world(np.indices(volume.shape).reshape(3, -1).T)


def ball(voxel_size: tuple[float, float, float], radius: float) -> Mask:
    shape = [int(2.5 * radius / size) for size in voxel_size]
    volume = Volume(np.zeros(shape), voxel_size, (3.0, -2.0, 1.0))
    middle = volume.to_world([[(n - 1) / 2 for n in shape]])[0]
    distance = np.linalg.norm(centres(volume) - middle, axis=1).reshape(shape)
    return Mask(distance < radius, voxel_size, volume.origin)


@settings(max_examples=30)
@given(size=SIZES, origin=st.tuples(*[st.floats(-5, 5)] * 3), fraction=st.floats(0.4, 1.0))
def test_linear_functions_are_kept_at_their_places(
    size: tuple[float, float, float], origin: tuple[float, float, float], fraction: float
) -> None:
    slope = np.array([1.0, -2.0, 0.5])
    volume = Volume(np.zeros((6, 7, 8)), size, origin)
    volume = Volume((centres(volume) @ slope).reshape(volume.shape), size, origin)
    edge = fraction * min(size)
    working = to_working_grid(volume, edge)
    assert working.voxel_size == (edge,) * 3
    assert working.data.dtype == np.float32
    np.testing.assert_allclose(working.data.ravel(), centres(working) @ slope, atol=1e-4)
    places = centres(working)
    assert (places >= centres(volume).min(axis=0) - 1e-6).all()
    assert (places <= centres(volume).max(axis=0) + 1e-6).all()
    # Nothing of the volume is left out but less than a working voxel on each side.
    assert (np.ptp(places, axis=0) > np.ptp(centres(volume), axis=0) - 2 * edge).all()


def test_isotropic_volumes_are_not_touched() -> None:
    data = np.random.default_rng(0).random((5, 6, 7)).astype(np.float32)
    working = to_working_grid(Volume(data, (0.104,) * 3, (0.104 * 3, 0.0, 0.104 * 7)), 0.104)
    assert np.array_equal(working.data, data)
    assert working.origin == pytest.approx((0.312, 0.0, 0.728))
    mask = Mask(data > 0.5, (0.104,) * 3)
    assert mask_to_working_grid(mask, 0.104) is mask


def test_the_grid_does_not_depend_on_the_box() -> None:
    size = (0.3, 0.104, 0.104)
    data = np.random.default_rng(0).random((20, 30, 40)).astype(np.float32)
    whole = to_working_grid(Volume(data, size), 0.104)
    origin = (0.3 * 5, 0.104 * 7, 0.104 * 9)
    part = to_working_grid(Volume(data[5:15, 7:25, 9:30], size, origin), 0.104)
    first = np.rint(whole.to_index([part.origin])[0]).astype(int)
    assert whole.to_index([part.origin])[0] == pytest.approx(first, abs=1e-6)
    same = whole.data[tuple(slice(f, f + n) for f, n in zip(first, part.shape, strict=True))]
    np.testing.assert_allclose(part.data, same, atol=1e-5)


def test_coarser_grids_do_not_alias() -> None:
    checkered = (np.indices((40, 40, 40)).sum(axis=0) % 2).astype(float)
    working = to_working_grid(Volume(checkered, (1.0,) * 3), 4.0)
    inner = working.data[2:-2, 2:-2, 2:-2]
    np.testing.assert_allclose(inner, 0.5, atol=0.01)


def test_a_grid_beyond_memory_is_refused() -> None:
    with pytest.raises(ParameterError, match="working_voxel_um"):
        to_working_grid(Volume(np.zeros((10, 10, 10)), (1.0,) * 3), 1e-3)


def test_interpolation_along_one_axis() -> None:
    data = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    assert interpolate_axis(data, np.arange(4.0), 2) is data
    assert np.array_equal(interpolate_axis(data, np.array([2.0, 0.0]), 1), data[:, [2, 0]])
    halves = interpolate_axis(data, np.array([0.5]), 0)
    assert halves[0] == pytest.approx((data[0] + data[1]) / 2)
    clamped = interpolate_axis(data, np.array([-3.0, 9.0]), 2)
    assert np.array_equal(clamped, data[:, :, [0, 3]])
    assert interpolate_axis(data[:1], np.array([0.25]), 0).shape == (1, 3, 4)


@pytest.mark.parametrize("ratio", [2.0, 3.0, 4.5])
def test_masks_keep_volume_and_place_and_have_no_terraces(ratio: float) -> None:
    edge = 0.5
    given_mask = ball((ratio * edge, edge, edge), 12.0)
    working = mask_to_working_grid(given_mask, edge)
    assert working.data.sum() * edge**3 == pytest.approx(4 / 3 * np.pi * 12.0**3, rel=0.01)
    middle = given_mask.to_world(np.argwhere(given_mask.data)).mean(axis=0)
    inside = working.to_world(np.argwhere(working.data))
    assert inside.mean(axis=0) == pytest.approx(middle, abs=0.05)
    radius = np.linalg.norm(inside - middle, axis=1)
    outside = working.to_world(np.argwhere(~working.data))
    nearest = np.linalg.norm(outside - middle, axis=1).min()
    # Terraces would be off by up to half a slice, ½ ratio edge.
    assert radius.max() < 12.0 + 0.35 * ratio * edge
    assert nearest > 12.0 - 0.35 * ratio * edge


def test_thin_parts_of_a_mask_survive() -> None:
    data = np.zeros((9, 20, 20), dtype=bool)
    data[4, 10, 2:18] = True
    data[2:7, 3, 3] = True
    working = mask_to_working_grid(Mask(data, (0.3, 0.1, 0.1)), 0.1)
    along = working.data.any(axis=(0, 1))
    assert along.sum() >= 16
    index = np.rint(working.to_index([[4 * 0.3, 10 * 0.1, 5 * 0.1]])[0]).astype(int)
    assert working.data[tuple(index)]


# Where a motion puts a volume -----------------------------------------------------


def turned(degrees: tuple[float, float, float], shift: tuple[float, float, float]) -> Rigid:
    rotation = Rotation.from_rotvec(np.radians(degrees)).as_matrix()
    return Rigid.about((4.0, 5.0, 6.0), rotation, shift)


POSE = turned((10, -20, 15), (0.7, -1.1, 0.4))
QUARTER = turned((90, 0, 0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("pose", [POSE, QUARTER, turned((0, 0, 3), (5.0, 0.0, 0.0))])
def test_a_rotated_ramp_stays_exact_so_it_was_interpolated_once(pose: Rigid) -> None:
    slope = np.array([1.0, -2.0, 0.5])
    size, origin = (0.9, 0.4, 0.5), (3.0, 2.0, 4.0)
    volume = Volume(np.zeros((9, 14, 12)), size, origin)
    volume = Volume((centres(volume) @ slope).reshape(volume.shape), size, origin)
    working = to_working_grid(volume, 0.4, pose)
    own = pose.inverse().apply(centres(working))
    inside = covered(working, volume, pose).ravel()
    assert inside.mean() > 0.2
    np.testing.assert_allclose(working.data.ravel()[inside], own[inside] @ slope, atol=1e-4)
    # Exactly what is between the volume's outermost centres is covered.
    low, high = centres(volume).min(axis=0), centres(volume).max(axis=0)
    expected = ((own > low - 1e-5) & (own < high + 1e-5)).all(axis=1)
    assert np.array_equal(inside, expected)
    # The grid is that of the common world, and all of the volume is on it.
    steps = np.asarray(working.origin) / 0.4
    assert steps == pytest.approx(np.rint(steps))
    corners = pose.apply(centres(volume))
    assert (np.abs(corners.min(axis=0) - working.origin) < 0.4 + 1e-6).all()


def test_a_shift_by_whole_voxels_is_exact() -> None:
    data = np.random.default_rng(0).random((5, 6, 7)).astype(np.float32)
    volume = Volume(data, (0.5,) * 3, (1.0, 1.5, 2.0))
    working = to_working_grid(volume, 0.5, Rigid(translation=np.array([1.5, -1.0, 4.0])))
    assert np.array_equal(working.data, data)
    assert working.origin == pytest.approx((2.5, 0.5, 6.0))
    mask = mask_to_working_grid(
        Mask(data > 0.5, (0.5,) * 3, volume.origin), 0.5, Rigid(translation=np.array([0.5, 0, 1]))
    )
    assert mask.data.sum() == (data > 0.5).sum()


def test_a_quarter_turn_of_cubic_voxels_is_a_permutation() -> None:
    data = np.random.default_rng(0).random((5, 6, 7)).astype(np.float32)
    pose = Rigid(Rotation.from_euler("x", 90, degrees=True).as_matrix())
    working = to_working_grid(Volume(data, (1.0,) * 3), 1.0, pose)
    np.testing.assert_allclose(working.data, np.swapaxes(data, 1, 2)[:, ::-1], atol=1e-6)


def test_a_mask_that_was_turned_and_turned_back() -> None:
    given_mask = ball((0.6, 0.2, 0.2), 4.0)
    data = given_mask.data.copy()
    data[:, : data.shape[1] // 2, : data.shape[2] // 2] = False  # not a ball any more
    straight = mask_to_working_grid(Mask(data, given_mask.voxel_size, given_mask.origin), 0.2)
    there = mask_to_working_grid(Mask(data, given_mask.voxel_size, given_mask.origin), 0.2, POSE)
    assert there.data.sum() == pytest.approx(straight.data.sum(), rel=0.01)
    back = POSE.inverse().apply(there.to_world(np.argwhere(there.data)))
    index = np.rint(straight.to_index(back)).astype(int)
    agrees = straight.data[tuple(np.clip(index, 0, np.array(straight.shape) - 1).T)]
    assert agrees.mean() > 0.97
    assert back.mean(axis=0) == pytest.approx(
        straight.to_world(np.argwhere(straight.data)).mean(axis=0), abs=0.02
    )


def test_a_turned_mask_closes_where_the_image_ends() -> None:
    full = Mask(np.ones((6, 8, 10), bool), (1.0,) * 3)
    there = mask_to_working_grid(full, 0.5, POSE)
    own = POSE.inverse().apply(there.to_world(np.argwhere(there.data)))
    # Half a voxel beyond the outermost centres, as without a rotation.
    assert (own > -0.55).all()
    assert (own < np.array([5, 7, 9]) + 0.55).all()
    assert there.data.sum() * 0.125 == pytest.approx(6 * 8 * 10, rel=0.03)
