"""Boxes on the sphere: over the seam, over the poles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.geometry.padding import pad_sphere
from napari_unwrap3d.tracking.boxes import Box, bounding_box, bounding_boxes, overlaps

ROWS = 16
IMAGE = np.arange(ROWS * 2 * ROWS).reshape(ROWS, 2 * ROWS)
boxes = st.builds(
    lambda v, u, h, w: Box(v, u, v + h, u + w),
    st.integers(-6, ROWS + 2),
    st.integers(-40, 70),
    st.integers(1, 6),
    st.integers(1, 9),
)


@given(st.integers(-8, 18), st.integers(-8, 32), st.integers(1, 5), st.integers(1, 7))
def test_a_box_cuts_the_padded_image(v: int, u: int, height: int, width: int) -> None:
    padded = pad_sphere(IMAGE, 8)
    box = Box(v, u, v + height, u + width)
    if v + height > ROWS + 8 or u + width > 2 * ROWS + 8:
        return
    expected = padded[v + 8 : v + 8 + height, u + 8 : u + 8 + width]
    np.testing.assert_array_equal(box.cut(IMAGE), expected)


@given(boxes)
def test_a_box_is_itself_wherever_it_is_written(box: Box) -> None:
    for other in (box.moved(0, 2 * ROWS), box.moved(0, -4 * ROWS)):
        assert box.iou(other, ROWS) == pytest.approx(1.0)
        np.testing.assert_array_equal(other.inside(ROWS), box.inside(ROWS))
    over = Box(-box.bottom, box.left + ROWS, -box.top, box.right + ROWS)
    np.testing.assert_array_equal(over.inside(ROWS), box.inside(ROWS))
    assert box.iou(over, ROWS) == pytest.approx(1.0)
    assert over.near(box, ROWS).centre == pytest.approx(box.centre)


@given(boxes, boxes)
def test_the_overlap_is_that_of_the_pixels(one: Box, other: Box) -> None:
    found = one.iou(other, ROWS)
    assert found == pytest.approx(other.iou(one, ROWS))
    # Small boxes overlap in one place only, and have no pixel twice unless they cross a pole.
    a, b = one.inside(ROWS), other.inside(ROWS)
    if a.sum() == one.area and b.sum() == other.area:
        assert found == pytest.approx((a & b).sum() / (a | b).sum())


@given(boxes)
def test_the_box_of_a_box_holds_it(box: Box) -> None:
    region = box.inside(ROWS)
    found = bounding_box(region)
    assert (found.inside(ROWS) & region).sum() == region.sum()
    if region.sum() == box.area:
        assert found.area <= box.area


def test_a_region_over_the_seam_has_a_narrow_box() -> None:
    region = np.zeros((ROWS, 2 * ROWS), bool)
    region[5:8, -2:] = region[5:8, :3] = True
    box = bounding_box(region)
    assert (box.top, box.bottom, box.right - box.left) == (5, 8, 5)
    assert box.cut(region).all()


@pytest.mark.parametrize("rows", [slice(None, 3), slice(-3, None)])
def test_a_region_over_a_pole_has_a_box_over_it(rows: slice) -> None:
    region = np.zeros((ROWS, 2 * ROWS), bool)
    region[rows, 4:9] = region[rows, 20:25] = True  # half a turn apart
    box = bounding_box(region)
    assert box.area == 6 * 5
    assert box.cut(region).all()


def test_nothing_has_no_box() -> None:
    with pytest.raises(ParameterError, match="empty"):
        bounding_box(np.zeros((ROWS, 2 * ROWS), bool))
    with pytest.raises(ParameterError, match="at least one row"):
        Box(3, 0, 3, 4)


@given(st.lists(boxes, min_size=1, max_size=4), st.lists(boxes, min_size=1, max_size=4))
def test_all_overlaps_at_once_are_those_one_by_one(few: list[Box], others: list[Box]) -> None:
    found = overlaps(few, others, ROWS)
    one_by_one = np.array([[box.iou(other, ROWS) for other in others] for box in few])
    # One by one, of two images of a box that both share something the nearer one counts.
    assert (found >= one_by_one - 1e-12).all()
    near = np.array([[box.iou(other, ROWS) > 0 for other in others] for box in few])
    np.testing.assert_array_equal((found > 0) >= near, True)
    np.testing.assert_allclose(overlaps(few, few, ROWS).diagonal(), 1.0)


def test_every_label_has_its_box() -> None:
    labels = np.zeros((ROWS, 2 * ROWS), np.int32)
    labels[3:5, 30:] = labels[3:5, :2] = 4  # over the seam
    labels[:2, 6:9] = labels[:2, 6 + ROWS : 9 + ROWS] = 2  # over the north pole
    found = bounding_boxes(labels)
    assert list(found) == [2, 4]
    for label, box in found.items():
        assert box == bounding_box(labels == label)
        np.testing.assert_array_equal(box.inside(ROWS), labels == label)
    assert bounding_boxes(np.zeros_like(labels)) == {}
