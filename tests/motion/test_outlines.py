"""The mean of the masks of a movie, and what its space has to hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moving import VOXEL_UM, blebbing, bumpy_ball, quick
from napari_unwrap3d import Mask, Surface
from napari_unwrap3d.charts import TemporalMask
from napari_unwrap3d.errors import AxesError, InputError, NoMeanError
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.motion.outlines import MeanOutline, outline
from napari_unwrap3d.pipeline import unwrap
from napari_unwrap3d.progress import silent
from shapes import icosphere


def box(origin: tuple[int, int, int], shape: tuple[int, int, int] = (4, 5, 6)) -> Mask:
    """A solid box on the voxels of the world's grid."""
    z, y, x = (i * VOXEL_UM for i in origin)
    return Mask(np.ones(shape, bool), (VOXEL_UM,) * 3, (z, y, x))


def occupied(mask: Mask) -> set[tuple[int, ...]]:
    """Which voxels of the world are inside."""
    index = np.argwhere(mask.data) + np.rint(np.asarray(mask.origin) / VOXEL_UM).astype(int)
    return set(map(tuple, index.tolist()))


# Boxes of 4 × 5 × 6 voxels that have the voxels around (1, 2, 2) in common.
places = st.tuples(*[st.integers(-1, 1)] * 3)


@given(st.lists(places, min_size=1, max_size=6))
def test_the_mean_is_what_is_inside_half_of_the_time(origins: list[tuple[int, int, int]]) -> None:
    masks = [box(origin) for origin in origins]
    mean = MeanOutline.of(masks)
    each = [occupied(mask) for mask in masks]
    temporal = mean.mask()
    counts: dict[tuple[int, ...], int] = {}
    for voxels in each:
        for voxel in voxels:
            counts[voxel] = counts.get(voxel, 0) + 1
    ever = Mask(temporal.ever, temporal.voxel_size, temporal.origin)
    always = Mask(temporal.always, temporal.voxel_size, temporal.origin)
    assert occupied(ever) == set.union(*each)
    assert occupied(always) == set.intersection(*each)
    half = {voxel for voxel, count in counts.items() if 2 * count >= len(masks)}
    assert occupied(mean.mask()) == half


@pytest.mark.parametrize("places", [[(0, 0, 0), (9, 0, 0)], [(0, 0, 0), (9, 0, 0), (0, 9, 0)]])
def test_a_cell_that_is_elsewhere_each_time_has_no_mean(
    places: list[tuple[int, int, int]],
) -> None:
    with pytest.raises(NoMeanError, match="Register the timepoints"):
        MeanOutline.of([box(place) for place in places]).mask()


def test_a_mask_comes_back_at_its_place() -> None:
    masks = [box((0, 0, 0)), box((-2, 3, 1))]
    mean = MeanOutline.of(masks)
    for mask in masks:
        assert occupied(mean.placed(mask)) == occupied(mask)


def test_different_working_voxels_are_refused() -> None:
    mean = MeanOutline.of([box((0, 0, 0))])
    with pytest.raises(InputError, match="different working voxels"):
        mean.add(Mask(np.ones((4, 4, 4), bool), (0.5,) * 3))


def test_what_is_ever_inside_is_on_the_masks_grid() -> None:
    data = np.ones((3, 3, 3), bool)
    with pytest.raises(AxesError, match="ever inside"):
        TemporalMask(data, (1, 1, 1), ever=np.ones((2, 2, 2), bool), always=data)


def test_reach_lies_on_both_borders() -> None:
    ever, always = np.zeros((2, 12, 12, 12), bool)
    ever[1:11, 1:11, 1:11], always[4:8, 4:8, 4:8] = True, True
    mask = TemporalMask(ever, (0.5,) * 3, (1, 2, 3), ever=ever, always=always)
    index = np.rint(mask.to_index(mask.reach())).astype(int)
    expected = 10**3 - 8**3 + 4**3 - 2**3
    assert len(index) == expected
    assert len(mask.reach(50)) <= 60
    assert set(map(tuple, mask.to_index(mask.reach(50)).tolist())) <= set(
        map(tuple, index.tolist())
    )


def test_the_space_of_the_mean_reaches_beyond_its_own_surface() -> None:
    low, high = bumpy_ball([]), bumpy_ball([(0, 1.2)])
    mean = MeanOutline.of([low, low, high]).mask()
    alone = unwrap(Mask(mean.data, mean.voxel_size, mean.origin), quick())
    space = unwrap(mean, quick())
    assert alone.topography.d_um[-1] < 1.2 < space.topography.d_um[-1]
    tip = high.to_world(np.argwhere(high.data))
    tip = tip[np.argmax(tip[:, 1])][None] - (0, VOXEL_UM, 0)
    assert space.map(tip, "volume", "uv")[1].all()
    assert not alone.map(tip, "volume", "uv")[1].any()


@pytest.mark.parametrize("shift", [(0.25, 0.5, -0.75), (0.1, -0.2, 0.33)])
def test_an_outline_is_where_its_pose_puts_it(shift: tuple[float, float, float]) -> None:
    mask = blebbing(1)[0]
    still, _ = outline(mask, Rigid(), quick(), silent())
    moved, _ = outline(mask, Rigid(translation=np.array(shift)), quick(), silent())
    middle = [m.to_world(np.argwhere(m.data)).mean(axis=0) for m in (still, moved)]
    # Voxels that are in or out cannot follow a fraction of a voxel better.
    np.testing.assert_allclose(middle[1] - middle[0], shift, atol=0.1 * VOXEL_UM)
    # Centres lie at whole multiples of the edge.
    offset = np.asarray(moved.origin) / VOXEL_UM
    np.testing.assert_allclose(offset, np.rint(offset), atol=1e-6)


def test_the_outline_of_a_mesh_moves_with_it() -> None:
    vertices, faces = icosphere(3)
    sphere = Surface(2.0 * vertices / np.linalg.norm(vertices[0]), faces)
    parameters = quick(stack={"working_voxel_um": 0.25})
    mask, _ = outline(sphere, Rigid(translation=np.array([5.0, 0, 0])), parameters, silent())
    middle = mask.to_world(np.argwhere(mask.data)).mean(axis=0)
    np.testing.assert_allclose(middle, [5, 0, 0], atol=0.01)
