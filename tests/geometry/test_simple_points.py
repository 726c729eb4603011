"""Simple points: whatever changes, components, handles and cavities stay."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from skimage.measure import euler_number

from napari_unwrap3d.geometry.simple_points import change_simple_points
from napari_unwrap3d.geometry.topology import is_well_composed, make_well_composed
from shapes import ball, grid, torus

FULL = np.ones((3, 3, 3))


def topology_of(solid: np.ndarray) -> tuple[int, int, int]:
    """Components, cavities and Euler characteristic."""
    components = ndimage.label(solid, structure=FULL)[1]
    background = ndimage.label(~np.pad(solid, 1))[1]
    return components, background - 1, euler_number(solid, connectivity=3)


def random_solid(seed: int) -> np.ndarray:
    """Sponges, crumbs and hollow lumps, well-composed, with room around."""
    rng = np.random.default_rng(seed)
    size = rng.integers(3, 8, 3)
    noise = rng.random(size) < rng.uniform(0.2, 0.9)
    return make_well_composed(np.pad(noise, 3))


def inner(shape: tuple[int, ...]) -> np.ndarray:
    inside = np.zeros(shape, bool)
    inside[1:-1, 1:-1, 1:-1] = True
    return inside


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), new_value=st.booleans())
def test_random_changes_keep_the_topology(seed: int, new_value: bool) -> None:
    solid = random_solid(seed)
    rng = np.random.default_rng(seed + 1)
    changeable = inner(solid.shape) & (rng.random(solid.shape) < rng.uniform(0.3, 1.0))
    changed = change_simple_points(solid, changeable, rng.random(solid.shape), new_value)
    assert topology_of(changed) == topology_of(solid)
    assert is_well_composed(changed)
    np.testing.assert_array_equal(changed[~changeable], solid[~changeable])
    assert (changed >= solid).all() if new_value else (changed <= solid).all()


@pytest.mark.parametrize(
    ("solid", "left"), [(ball(6, 17), 1), (np.pad(np.ones((4, 5, 6), bool), 2), 1)]
)
def test_what_has_no_handle_shrinks_to_a_voxel(solid: np.ndarray, left: int) -> None:
    distance = ndimage.distance_transform_edt(solid)
    shrunk = change_simple_points(solid, solid, -distance, new_value=False)
    assert shrunk.sum() == left


def test_a_ring_shrinks_to_a_closed_thread() -> None:
    ring = torus(7, 3, (11, 25, 25))
    shrunk = change_simple_points(
        ring, ring, -ndimage.distance_transform_edt(ring), new_value=False
    )
    assert topology_of(shrunk) == (1, 0, 0)
    assert shrunk.sum() < 2 * 2 * np.pi * 7


def test_a_voxel_grows_to_fill_a_box() -> None:
    seed = np.zeros((12, 13, 14), bool)
    seed[6, 6, 6] = True
    room = inner(seed.shape)
    grown = change_simple_points(
        seed, room, -np.linalg.norm(grid((12, 13, 14)), axis=-1), new_value=True
    )
    np.testing.assert_array_equal(grown, room)


def test_a_shape_filled_from_a_seed_has_its_handle_cut() -> None:
    ring = torus(7, 3, (11, 25, 25))
    seed = np.zeros(ring.shape, bool)
    seed[5, 12, 5] = True
    grown = change_simple_points(seed, ring, ndimage.distance_transform_edt(ring), new_value=True)
    assert topology_of(grown) == (1, 0, 1)
    assert (grown <= ring).all()
    # Only a cut across the tube is missing.
    assert (ring & ~grown).sum() < 60


@pytest.mark.parametrize("direction", [1, -1])
def test_the_highest_priority_changes_first(direction: int) -> None:
    """A bar is eaten from the end of high priority, so the voxel of the lowest is left."""
    bar = np.zeros((3, 3, 13), bool)
    bar[1, 1, 2:11] = True
    priority = direction * np.broadcast_to(np.arange(13.0), bar.shape)
    left = change_simple_points(bar, bar, priority, new_value=False)
    assert np.flatnonzero(left[1, 1]).tolist() == [2 if direction > 0 else 10]


def test_what_is_uncovered_late_waits_its_turn() -> None:
    """Membranes stay where the priority is lowest, in the middle of a hole."""
    frame = torus(6, 2.5, (9, 21, 21))
    hull = np.zeros(frame.shape, bool)
    hull[1:-1, 1:-1, 1:-1] = True
    distance = ndimage.distance_transform_edt(~frame)
    closed = change_simple_points(hull, hull & ~frame, distance, new_value=False)
    membrane = closed & ~frame
    assert topology_of(closed) == (1, 0, 1)
    assert np.abs(np.nonzero(membrane)[0] - 4).max() <= 1


def test_nothing_changes_in_place_and_equal_priorities_are_deterministic() -> None:
    solid = random_solid(3)
    before = solid.copy()
    flat = np.zeros(solid.shape)
    first = change_simple_points(solid, inner(solid.shape), flat, new_value=False)
    second = change_simple_points(solid, inner(solid.shape), flat, new_value=False)
    np.testing.assert_array_equal(solid, before)
    np.testing.assert_array_equal(first, second)
