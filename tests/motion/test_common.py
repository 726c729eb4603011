"""Which common space is recommended."""

from __future__ import annotations

import numpy as np

from moving import VOXEL_UM, blebbing, bumpy_ball
from napari_unwrap3d import Mask
from napari_unwrap3d.errors import NoMeanError
from napari_unwrap3d.motion.common import Recommendation, recommend
from napari_unwrap3d.motion.outlines import MeanOutline


def advice(masks: list[Mask], first: int = 0, limit: float = 0.02) -> Recommendation:
    outlines = MeanOutline.of(masks)
    try:
        mean = outlines.mask()
    except NoMeanError:
        mean = None
    return recommend(masks, mean, masks[first], limit)


def moved(mask: Mask, y_um: float) -> Mask:
    return Mask(mask.data, mask.voxel_size, (0.0, y_um, 0.0))


def test_blebs_that_come_and_go_leave_the_mean() -> None:
    found = advice(blebbing(6))
    assert found.method == "mean"
    assert max(found.outside["mean"]) == 0
    assert "temporal mean" in found.reason


def test_a_cell_that_is_far_away_at_one_timepoint_needs_its_own_atlas() -> None:
    still = bumpy_ball([])
    found = advice([still, still, moved(still, 6.0)])
    assert found.method == "each"
    assert found.outside["mean"][:2] == [0, 0]
    assert found.outside["mean"][2] > 0.02
    assert "% leaves the shell around the temporal mean" in found.reason


def test_without_a_mean_the_timepoint_is_tried() -> None:
    still = bumpy_ball([])
    found = advice([still, moved(still, 20.0)])
    assert found.method == "each"
    assert set(found.outside) == {"timepoint"}
    assert "too little in common" in found.reason


def test_the_largest_cell_makes_the_space_where_the_mean_is_too_small() -> None:
    masks = [bumpy_ball([], radius) for radius in (1.8, 1.8, 1.8, 4.5)]
    assert advice(masks, first=0).method == "each"
    found = advice(masks, first=3)
    assert found.method == "timepoint"
    assert "chosen timepoint" in found.reason


def test_the_limit_decides() -> None:
    still = bumpy_ball([])
    masks = [still, still, moved(still, 6.0)]
    worst = max(advice(masks).outside["mean"])
    assert advice(masks, limit=worst + 1e-6).method == "mean"
    assert advice(masks, limit=worst - 1e-6).method != "mean"


def test_shares_do_not_depend_on_where_the_grid_ends() -> None:
    still = bumpy_ball([])
    wide = Mask(np.pad(still.data, 12), still.voxel_size, (-12 * VOXEL_UM,) * 3)
    masks = [still, moved(still, 3.0)]
    assert advice(masks).outside == advice([wide, masks[1]]).outside
