"""The two patches of the sphere: a partition, without poles, that says the same everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry import sphere_patches
from napari_unwrap3d.geometry.sphere_patches import PATCHES, SpherePatches

ROWS = 96
AXES = [(0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0.6, -0.5, -0.6), (0.7, 0.7, 0), (0, 0, -1)]


@pytest.fixture(scope="module")
def patches() -> SpherePatches:
    return SpherePatches(ROWS, 8)


def towards(axis: tuple[float, float, float], directions: np.ndarray) -> np.ndarray:
    """Angle in steps from an axis."""
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return np.arccos(np.clip(directions @ unit, -1, 1)) * ROWS / np.pi


def caps(patches: SpherePatches, axes: list, radius: float, layers: int) -> tuple:
    return tuple(
        np.repeat(
            np.any([towards(a, patches.directions(p)) < radius for a in axes], axis=0)[None],
            layers,
            axis=0,
        )
        for p in PATCHES
    )


def test_what_the_patches_own_is_the_sphere_once(patches: SpherePatches) -> None:
    area = 0.0
    for patch in PATCHES:
        weight = np.broadcast_to(patches.sines[:, None] * patches.step**2, patches.shape)
        area += weight[patches.owned(patch)].sum()
    assert area == pytest.approx(4 * np.pi, rel=0.01)
    random = np.random.default_rng(0).normal(size=(3000, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    owners = 0
    for patch in PATCHES:
        row, column = np.rint(patches.locate(patch, random)).astype(int).T
        inside = (row >= 0) & (row < patches.shape[0]) & (column >= 0)
        inside &= column < patches.shape[1]
        owners += patches.owned(patch)[row * inside, column * inside] & inside
    # Within half a pixel of the border both or none may say so.
    assert (owners == 1).mean() > 0.93
    assert owners.max() <= 2


@pytest.mark.parametrize("patch", PATCHES)
def test_places_and_directions_are_inverse(patches: SpherePatches, patch: int) -> None:
    directions = patches.directions(patch)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1)
    places = patches.locate(patch, directions.reshape(-1, 3)).reshape(*patches.shape, 2)
    np.testing.assert_allclose(places, np.moveaxis(np.indices(patches.shape), 0, -1), atol=1e-9)


def test_no_step_along_a_row_is_short(patches: SpherePatches) -> None:
    assert patches.sines[patches.owned(0).any(axis=1)].min() > 0.69
    assert patches.sines[patches.owned(1).any(axis=1)].min() > 0.69


@pytest.mark.parametrize("axis", AXES)
def test_a_round_wall_has_the_same_curvature_wherever_it_stands(
    patches: SpherePatches, axis: tuple[float, float, float]
) -> None:
    # A cylinder of sphere × height around the axis: H = ½ cot(angle) per radian.
    for patch in PATCHES:
        angle = towards(axis, patches.directions(patch))
        level = np.repeat(angle[None].astype(np.float32), 3, axis=0)
        curvature = sphere_patches.shell_mean_curvature(level, patches.sines)[1]
        near = patches.owned(patch) & (np.abs(angle - 12) < 1)
        expected = 0.5 * patches.step / np.tan(angle[near] * patches.step)
        np.testing.assert_allclose(curvature[near], expected, rtol=0.03)


def test_layers_are_flat(patches: SpherePatches) -> None:
    level = np.repeat(np.arange(5, dtype=np.float32), np.prod(patches.shape))
    curvature = sphere_patches.shell_mean_curvature(level.reshape(5, *patches.shape), patches.sines)
    np.testing.assert_allclose(curvature, 0, atol=1e-7)


def test_parts_over_the_border_of_the_patches_are_one(patches: SpherePatches) -> None:
    labels, count = sphere_patches.label_patches(patches, caps(patches, AXES, 5, 4), 1)
    assert count == len(AXES)
    for axis in AXES:
        found = set()
        for patch in PATCHES:
            inside = patches.owned(patch) & (towards(axis, patches.directions(patch)) < 5)
            found |= set(np.unique(labels[patch][:, inside]))
        assert len(found) == 1
        assert 0 not in found


def test_small_parts_are_left_out_and_voxels_count_once(patches: SpherePatches) -> None:
    solids = caps(patches, AXES[:4], 5, 4)
    expected = 4 * np.pi * 25
    assert sphere_patches.label_patches(patches, solids, round(0.8 * expected))[1] == 4
    # Where rows are short a part has up to √2 as many voxels.
    assert sphere_patches.label_patches(patches, solids, round(1.6 * expected))[1] == 0


def test_nothing_has_no_parts(patches: SpherePatches) -> None:
    empty = np.zeros((3, *patches.shape), bool)
    labels, count = sphere_patches.label_patches(patches, (empty, empty), 1)
    assert count == 0
    assert not labels[0].any()


def test_columns_are_sampled_half_way() -> None:
    volume = np.zeros((3, 2, 2), bool)
    volume[0] = volume[1, 0] = True
    v = np.array([[0.0, 0.4, 0.6, 0.99]])
    layers = np.array([-1.0, 0.0, 1.0, 1.4, 1.6, 9.0])
    found = sphere_patches.sample_columns(volume, layers, v, np.zeros_like(v))
    np.testing.assert_array_equal(found[:2], True)
    np.testing.assert_array_equal(found[2, 0], [True, True, False, False])
    np.testing.assert_array_equal(found[3, 0], [True, False, False, False])
    np.testing.assert_array_equal(found[4:], False)
