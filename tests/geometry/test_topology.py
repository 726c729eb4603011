"""Sealing: a topological ball around every input, and what was added to get it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage
from skimage.measure import euler_number

from napari_unwrap3d.errors import EmptyMaskError, MapError
from napari_unwrap3d.geometry.topology import (
    euler_characteristic,
    fill_cavities,
    handles,
    is_well_composed,
    make_well_composed,
    seal,
    sealed_parts,
)
from shapes import ball, knot, linked_rings_and_bar, sponge, torus

masks = arrays(bool, array_shapes(min_dims=3, max_dims=3, min_side=2, max_side=7))


@given(mask=masks)
def test_euler_characteristic_is_skimages(mask: np.ndarray) -> None:
    assert euler_characteristic(mask) == euler_number(mask, connectivity=3)


def test_euler_characteristic_of_known_solids() -> None:
    assert euler_characteristic(ball(5, 15)) == 1
    assert handles(torus(6, 2, (7, 19, 19))) == 1
    assert handles(knot()) == 1
    hollow = ball(6, 17) & ~ball(3, 17)
    assert euler_characteristic(hollow) == 2


@given(mask=masks)
def test_cavities_are_filled_as_scipy_does(mask: np.ndarray) -> None:
    np.testing.assert_array_equal(fill_cavities(mask), ndimage.binary_fill_holes(mask))


def test_critical_blocks_are_recognised() -> None:
    fine = np.zeros((4, 4, 4), bool)
    fine[1:3, 1:3, 1] = True
    assert is_well_composed(fine)
    edge = np.zeros((4, 4, 4), bool)
    edge[1, 1, 1] = edge[2, 2, 1] = True
    corner = np.zeros((4, 4, 4), bool)
    corner[1, 1, 1] = corner[2, 2, 2] = True
    for bad in (edge, corner, ~edge, ~corner):
        for axes in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            for flip in (0, 1, 2):
                assert not is_well_composed(np.flip(bad.transpose(axes), flip))


@given(mask=masks)
def test_well_composed_masks_contain_their_mask(mask: np.ndarray) -> None:
    result = make_well_composed(mask)
    assert is_well_composed(result)
    assert (result >= mask).all()
    np.testing.assert_array_equal(make_well_composed(result), result)


@pytest.mark.parametrize(
    ("mask", "genus"),
    [
        (torus(9, 3, (11, 31, 31)), 1),
        (knot(), 1),
        (sponge(), None),
        (linked_rings_and_bar(), 4),
        (np.pad(ball(6, 15) & ~ball(3, 15), 3), 0),
    ],
    ids=["torus", "knot", "sponge", "linked rings and a bar", "hollow ball"],
)
def test_every_solid_is_sealed_to_a_ball(mask: np.ndarray, genus: int | None) -> None:
    if genus is not None:
        assert handles(fill_cavities(mask)) == genus
    else:
        assert handles(fill_cavities(mask)) > 5
    sealed = seal(mask)
    assert euler_number(sealed, connectivity=3) == 1
    assert ndimage.label(sealed)[1] == 1
    assert ndimage.label(~np.pad(sealed, 1))[1] == 1
    assert is_well_composed(sealed)
    assert (sealed >= mask).all()
    # What was added is thin: membranes, not lumps.
    added = sealed & ~fill_cavities(mask)
    assert not ndimage.binary_erosion(added, iterations=2).any()


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6))
def test_random_crumbs_are_sealed(seed: int) -> None:
    mask = sponge(seed, 10)
    sealed = seal(mask)
    assert (sealed >= mask).all()
    assert is_well_composed(sealed)
    assert euler_characteristic(sealed) == 1


def test_a_ball_stays_as_it_is() -> None:
    solid = ball(7, 21)
    np.testing.assert_array_equal(seal(solid), solid)
    once = seal(np.pad(torus(6, 2, (7, 19, 19)), 2))
    np.testing.assert_array_equal(seal(once), once)


def test_sealing_does_not_depend_on_the_place() -> None:
    mask = sponge(1, 12)
    sealed = seal(mask)
    shifted = seal(np.pad(mask, ((3, 1), (0, 6), (2, 2))))
    np.testing.assert_array_equal(shifted, np.pad(sealed, ((3, 1), (0, 6), (2, 2))))


def test_a_solid_at_the_border_of_the_volume_is_sealed() -> None:
    mask = torus(6, 2.4, (5, 17, 17))
    assert mask[0].any()
    assert euler_characteristic(seal(mask)) == 1


def test_an_empty_mask_is_an_error() -> None:
    with pytest.raises(EmptyMaskError, match="empty") as caught:
        seal(np.zeros((4, 4, 4), bool))
    assert caught.value.measured == {"voxels": 0}


def test_a_mask_that_never_becomes_well_composed_is_an_error() -> None:
    checkers = np.indices((6, 6, 6)).sum(axis=0) % 2 == 0
    with pytest.raises(MapError, match="well-composed"):
        make_well_composed(checkers, iterations=1)
    assert is_well_composed(make_well_composed(checkers))


def test_the_membrane_of_a_ring_is_reported_in_its_middle() -> None:
    ring = torus(8, 3, (11, 27, 27))
    (part,) = sealed_parts(ring, seal(ring))
    assert part["kind"] == "membrane"
    np.testing.assert_allclose(part["position"], [5, 13, 13], atol=0.6)
    # A disk of the hole's size, one or two voxels thick.
    assert np.pi * 4**2 < part["voxels"] < 2 * np.pi * 6**2


def test_cavities_are_reported_with_their_voxels_largest_first() -> None:
    solid = ball(12, 29)
    solid[10:14, 9:12, 10:15] = False
    solid[18, 18, 18] = False
    parts = sealed_parts(solid, seal(solid))
    assert [(p["kind"], p["voxels"]) for p in parts] == [("cavity", 60), ("cavity", 1)]
    assert parts[0]["position"] == (11.5, 10.0, 12.0)
    assert parts[1]["position"] == (18.0, 18.0, 18.0)


def test_what_touches_at_an_edge_is_a_contact() -> None:
    mask = np.zeros((8, 8, 8), bool)
    mask[2:4, 2:4, 2:5] = True
    mask[4:6, 4:6, 2:5] = True
    sealed = seal(mask)
    assert is_well_composed(sealed)
    parts = sealed_parts(mask, sealed)
    assert sum(p["voxels"] for p in parts) == (sealed & ~mask).sum()
    assert {p["kind"] for p in parts} <= {"contact", "membrane"}
