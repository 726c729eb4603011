"""A stack that was rotated is segmented where a motion puts it, as if it had not been."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask, Stack
from napari_unwrap3d.errors import TouchesBorderError
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging import segment as segmenting
from napari_unwrap3d.imaging.segment import check_mask, segment
from napari_unwrap3d.parameters import StackParameters
from turned import VOXEL, height, moved, recorded, solid

TRUE = moved((6, -8, 5), (0.4, -0.5, 0.6))
BACK = TRUE.inverse()
BUMPS = (0, 2)


def image(pose: Rigid, **more: Any) -> Stack:
    volume = recorded(pose, BUMPS, noise=4, **more)
    return Stack(np.rint(volume.data).astype(np.uint16), "zyx", volume.voxel_size)


def differing(one: Mask, other: Mask) -> float:
    """The part of the cell's voxels that are in one of two masks only."""
    edge = one.voxel_size[0]
    assert other.voxel_size[0] == pytest.approx(edge)
    places = [
        {tuple(p) for p in np.rint(m.to_world(np.argwhere(m.data)) / edge).astype(int)}
        for m in (one, other)
    ]
    return len(places[0] ^ places[1]) / len(places[0])


def test_an_image_is_segmented_in_the_common_world() -> None:
    straight, _ = segment(image(Rigid()), pose=Rigid())
    turned, report = segment(image(TRUE, seed=1), pose=BACK)
    assert differing(straight, turned) < 0.03
    assert report["touches_border_voxels"] == 0
    assert report["volume_um3"] == pytest.approx(straight.data.sum() * 0.15**3, rel=0.01)
    # On the common grid: whole multiples of the edge.
    steps = np.asarray(turned.origin) / 0.15
    assert steps == pytest.approx(np.rint(steps), abs=1e-6)
    # And where the cell is.
    inside = height(turned.to_world(np.argwhere(turned.data)), BUMPS)
    assert np.quantile(inside, 0.99) < 0.2


def test_masks_and_labels_too() -> None:
    straight, _ = check_mask(solid(Rigid(), BUMPS), pose=Rigid())
    given = solid(TRUE, BUMPS)
    turned, _ = check_mask(given, pose=BACK)
    assert differing(straight, turned) < 0.03
    labels = Stack(given.data.astype(np.uint8) * 5, "zyx", VOXEL)
    labelled, _ = segment(labels, StackParameters(label=5), pose=BACK)
    assert differing(turned, labelled) == 0


@pytest.mark.parametrize("pose", [Rigid(), BACK, Rigid(translation=np.array([0.31, 0.1, -0.2]))])
def test_a_crop_is_in_the_stack_and_the_mask_where_the_pose_puts_it(pose: Rigid) -> None:
    stack = image(TRUE)
    crop = StackParameters(crop_voxels=(3, 41, 7, 80, 9, 82))
    whole, _ = segment(stack, pose=pose)
    cropped, report = segment(stack, crop, pose=pose)
    assert report["crop"] == [[3, 41], [7, 80], [9, 82]]
    assert differing(whole, cropped) < 0.005


def test_the_box_grows_in_the_image_however_it_is_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, _ = segment(image(TRUE), pose=BACK)
    coarse = segmenting._coarse_boxes

    def too_small(*given: Any) -> Any:
        (z, y, x), others = coarse(*given)
        return (slice(z.start + 4, z.stop), slice(y.start, y.stop - 12), x), others

    monkeypatch.setattr(segmenting, "_coarse_boxes", too_small)
    grown, _ = segment(image(TRUE), pose=BACK)
    assert differing(whole, grown) < 0.01


def test_a_turned_cell_at_the_border_is_closed_flat_and_counted() -> None:
    cut = image(TRUE)
    cut = Stack(cut.data[:, 24:], "zyx", VOXEL)
    straight, expected = segment(cut)
    turned, report = segment(cut, pose=BACK)
    assert report["touched_sides"] == expected["touched_sides"] == 1
    for name in ("touches_border_voxels", "border_area_um2", "border_fraction"):
        assert report[name] == pytest.approx(expected[name], rel=0.1)
    # Nothing of the cell is made up beyond the border.
    own = TRUE.apply(turned.to_world(np.argwhere(turned.data)))
    assert own[:, 1].min() > -0.01
    assert turned.data.sum() == pytest.approx(straight.data.sum(), rel=0.02)


def test_too_much_at_the_border_is_refused_however_it_is_turned() -> None:
    cut = image(TRUE)
    for pose in (None, BACK):
        with pytest.raises(TouchesBorderError):
            segment(Stack(cut.data[:, 30:54, 30:54], "zyx", VOXEL), pose=pose)
