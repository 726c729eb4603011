"""Components, cavities, walls and borders on shapes whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask
from napari_unwrap3d.errors import (
    EmptyMaskError,
    FullMaskError,
    SeveralCellsError,
    TouchesBorderError,
)
from napari_unwrap3d.imaging.solid import (
    cavities,
    check_border,
    check_not_trivial,
    check_walls,
    filled,
    largest_component,
    sides_at_border,
    touched_sides,
    with_margin,
)

UNIT = (1.0, 1.0, 1.0)


def distance(shape: tuple[int, int, int], centre: tuple[float, float, float]) -> np.ndarray:
    away = np.indices(shape) - np.reshape(centre, (3, 1, 1, 1))
    return np.sqrt((away**2).sum(axis=0))


def border(mask: np.ndarray, *, given: bool = True) -> dict:
    extent = np.array(mask.shape, dtype=float)
    return check_border(touched_sides(mask), mask, UNIT, 1.0, extent, given=given)


def test_trivial_masks_are_refused() -> None:
    with pytest.raises(EmptyMaskError, match=r"voxels = 8\. Way out"):
        check_not_trivial(np.zeros((2, 2, 2), bool), "Way out.")
    with pytest.raises(FullMaskError, match="voxels = 8"):
        check_not_trivial(np.ones((2, 2, 2), bool), "")


def test_the_largest_component_is_kept_and_the_rest_counted() -> None:
    mask = np.zeros((8, 8, 20), dtype=bool)
    mask[1:5, 1:5, 1:5] = True
    mask[5, 5, 5] = True  # touches by a corner
    mask[6, 1, 10:13] = True
    mask[1, 1, 18] = True
    cell, report = largest_component(mask, 0.5, 0.5)
    assert cell.sum() == 65
    assert report == {"components": 3, "dropped_components": 2, "dropped_voxels": 4}
    mask[1:5, 1:5, 12:14] = True
    with pytest.raises(SeveralCellsError, match=r"2 objects.*largest_um3 = 32.5, second_um3 = 16"):
        largest_component(mask, 0.5, 0.49)


def test_cavities_are_what_is_enclosed() -> None:
    mask = distance((30, 30, 30), (14.5, 14.5, 14.5)) < 12
    hollow = mask & (distance(mask.shape, (14.5, 14.5, 14.5)) > 5)
    labels, sizes = cavities(hollow)
    assert np.array_equal(labels > 0, mask & ~hollow)
    assert sizes.tolist() == [(mask & ~hollow).sum()]
    solid, report = filled(hollow)
    assert np.array_equal(solid, mask)
    assert report == {"filled_cavities": 1, "filled_voxels": int(sizes[0])}
    pierced = hollow.copy()
    pierced[14, 14, 15:] = False
    assert filled(pierced)[1]["filled_cavities"] == 0
    assert filled(mask)[0] is mask


def test_walls_between_cells_are_refused_but_a_hollow_cell_is_not() -> None:
    one = (distance((30, 30, 30), (14.5,) * 3) < 13) & (distance((30, 30, 30), (14.5,) * 3) > 9)
    check_walls(one, 0.5)
    pair = np.ones((20, 20, 39), dtype=bool)
    pair[2:-2, 2:-2, 2:18] = pair[2:-2, 2:-2, 21:37] = False
    with pytest.raises(SeveralCellsError, match=r"chambers = 2.*label image"):
        check_walls(pair, 0.5)


def test_walls_with_gaps_are_seen_in_the_slices() -> None:
    foam = np.zeros((30, 48, 48), dtype=bool)
    for z in (0, 15, 29):
        foam[z] = True
    for i in (0, 15, 31, 47):
        foam[:, i] = foam[:, :, i] = True
    check = foam.copy()
    check[5:25:7, ::8] = False
    check[0] = check[29] = check[15] = False
    assert cavities(check)[1].sum() < 0.05 * check.sum()
    with pytest.raises(SeveralCellsError, match="chambers_per_slice"):
        check_walls(check, 0.5)


def test_contact_with_the_border_is_reported_and_limited(
    caplog: pytest.LogCaptureFixture,
) -> None:
    inside = distance((40, 40, 40), (19.5,) * 3) < 12
    assert border(inside)["touches_border_voxels"] == 0
    # The outermost voxels' centres lie 9.5 from the centre of the ball, their faces 10.
    capped = inside[10:]
    report = border(capped)
    disc = np.pi * (12.0**2 - 9.5**2)
    free = 2 * np.pi * 12.0 * (12.0 + 10.0)
    assert report["border_area_um2"] == pytest.approx(disc, rel=0.1)
    assert report["border_fraction"] == pytest.approx(disc / (disc + free), rel=0.1)
    assert report["touched_sides"] == 1
    assert "closed flat" in caplog.text
    half = inside[20:]
    assert border(half)["border_fraction"] == pytest.approx(1 / 3, rel=0.05)
    with pytest.raises(TouchesBorderError, match=r"fraction_of_surface = 0\.3"):
        border(half, given=False)
    # A disc between two borders: only its rim was seen.
    with pytest.raises(TouchesBorderError, match=r"fraction_of_surface = 0\.8.*field of view"):
        border(distance((3, 40, 40), (1.0, 19.5, 19.5)) < 18)


def test_an_image_full_of_tissue_is_told_by_its_sides() -> None:
    cross = np.zeros((40, 40, 40), dtype=bool)
    cross[17:23, 17:23, :] = cross[17:23, :, 17:23] = True
    cross |= distance(cross.shape, (19.5,) * 3) < 14
    assert border(cross)["touched_sides"] == 4
    with pytest.raises(TouchesBorderError, match=r"4 of the 6 sides.*label image"):
        border(cross, given=False)


def test_sides_at_the_border_of_the_image() -> None:
    box = (slice(0, 5), slice(2, 9), slice(1, 3))
    expected = [[True, False], [False, True], [False, False]]
    assert sides_at_border(box, (6, 9, 4)).tolist() == expected


def test_the_margin_keeps_the_place() -> None:
    data = np.zeros((10, 12, 14), dtype=bool)
    data[0:3, 5:8, 12:14] = True
    mask = Mask(data, (0.5, 0.5, 0.5), (1.0, 2.0, 3.0))
    roomy = with_margin(mask, 6)
    assert roomy.shape == (15, 15, 14)
    before = mask.to_world(np.argwhere(mask.data))
    assert roomy.to_world(np.argwhere(roomy.data)) == pytest.approx(before)
    assert not touched_sides(roomy.data).any()


def test_what_is_closed_flat_is_a_repair() -> None:
    inside = distance((40, 40, 40), (19.5,) * 3) < 12
    assert "repairs" not in border(inside)
    (repair,) = border(inside[10:])["repairs"]
    assert repair["count"] == border(inside[10:])["touches_border_voxels"]
