"""Series over boxes and labels: means that allow for the distortion of the image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import AxesError, InputError
from napari_unwrap3d.measuring.series import (
    box_series,
    curvature_threshold,
    label_series,
    on_and_off,
    weighted_mean,
)
from napari_unwrap3d.tracking.boxes import Box

ROWS = 32


def sphere() -> tuple[np.ndarray, np.ndarray]:
    """Inclination and area of every pixel of a unit sphere."""
    edges = np.cos(np.arange(ROWS + 1) * np.pi / ROWS)
    area = (edges[:-1] - edges[1:]) * np.pi / ROWS
    inclination = (np.arange(ROWS) + 0.5) * np.pi / ROWS
    shape = (ROWS, 2 * ROWS)
    return (
        np.broadcast_to(inclination[:, None], shape),
        np.broadcast_to(area[:, None], shape),
    )


def test_the_mean_over_a_cap_is_that_on_the_sphere() -> None:
    """z over the polar cap down to 60° has the mean ¾; the plain mean of the pixels has not."""
    inclination, area = sphere()
    z = np.cos(inclination)
    cap = (inclination < np.pi / 3).astype(int)
    # Nearest rows end at 60°: not quite the cap.
    found = label_series([z], [area], cap)[1]
    edge = np.cos(np.ceil(ROWS / 3 - 0.5) * np.pi / ROWS)
    assert found.mean[0] == pytest.approx((1 + edge) / 2, rel=2e-3)
    assert found.area_um2[0] == pytest.approx(2 * np.pi * (1 - edge), rel=1e-6)
    assert abs(z[cap > 0].mean() - (1 + edge) / 2) > 0.02


@given(st.integers(-4, 30), st.integers(0, 63), st.integers(1, 9), st.integers(1, 12))
def test_the_mean_of_a_constant_is_it_everywhere(v: int, u: int, height: int, width: int) -> None:
    _, area = sphere()
    boxes = {3: {0: Box(v, u, v + height, u + width)}}
    found = box_series([np.full(area.shape, 7.0)], [area], boxes, 1)[3]
    assert found.mean[0] == pytest.approx(7.0)
    assert found.area_um2[0] == pytest.approx(area[boxes[3][0].inside(ROWS)].sum())


def test_a_track_without_a_box_is_unknown_there() -> None:
    _, area = sphere()
    images = [np.full(area.shape, float(t)) for t in range(3)]
    boxes = {1: {0: Box(3, 3, 5, 5), 2: Box(3, 4, 5, 6)}, 2: {1: Box(9, 9, 12, 12)}}
    found = box_series(images, [area] * 3, boxes, 3)
    np.testing.assert_array_equal(found[1].mean, [0, np.nan, 2])
    np.testing.assert_array_equal(found[2].mean, [np.nan, 1, np.nan])
    assert found[2].area_um2[0] == 0


def test_labels_may_come_and_go() -> None:
    _, area = sphere()
    images = [np.full(area.shape, float(t)) for t in range(2)]
    first, second = np.zeros(area.shape, int), np.zeros(area.shape, int)
    first[4:6, 4:6], second[4:6, 4:6], second[9, 9] = 1, 2, 1
    found = label_series(images, [area, area], [first, second])
    assert set(found) == {1, 2}
    np.testing.assert_array_equal(found[1].mean, [0, 1])
    np.testing.assert_array_equal(found[2].mean, [np.nan, 1])
    np.testing.assert_allclose(found[2].area_um2, [0, area[4:6, 4:6].sum()])


def test_what_is_not_known_does_not_count() -> None:
    assert weighted_mean([1, np.nan, 3], [1, 5, 3]) == 2.5
    assert np.isnan(weighted_mean([np.nan], [1]))
    assert np.isnan(weighted_mean([1.0], [0.0]))


def test_the_threshold_tells_what_is_bent_outwards() -> None:
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.normal(m, 0.05, 500) for m in (-1.0, 0.0, 1.0)])
    assert 0.1 < curvature_threshold([values[:700], values[700:]]) < 0.8
    with pytest.raises(InputError, match="three classes"):
        curvature_threshold([np.zeros(10)])


def test_on_is_the_largest_part_and_off_the_rest_of_the_box() -> None:
    field = np.zeros((ROWS, 2 * ROWS))
    field[10:14, -3:] = field[10:14, :2] = 1.0  # over the seam
    field[15, 1] = 1.0
    box = Box(8, -6, 18, 6)
    on, off = on_and_off(field, box, 0.5)
    assert on.sum() == 4 * 5
    assert not (on & off).any()
    np.testing.assert_array_equal(on | off, box.inside(ROWS))
    assert off[15, 1]
    nothing, all_of_it = on_and_off(field, Box(20, 20, 24, 24), 0.5)
    assert not nothing.any()
    assert all_of_it.sum() == 16


def test_what_does_not_fit_is_refused() -> None:
    _, area = sphere()
    with pytest.raises(AxesError):
        label_series([area], [area], np.zeros((2, 4), int))
    with pytest.raises(ValueError, match="longer"):
        box_series([area], [area, area], {}, 2)
