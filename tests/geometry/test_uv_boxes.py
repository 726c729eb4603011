"""Sums over boxes of uv images, against boxes that are cut out one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from napari_unwrap3d.geometry.uv_boxes import label_sums, largest_part_sums
from napari_unwrap3d.tracking.boxes import Box

ROWS = 24
RNG = np.random.default_rng(3)
IMAGES = RNG.normal(size=(2, ROWS, 2 * ROWS))
AREAS = RNG.uniform(0.5, 2.0, (ROWS, 2 * ROWS))
LABELS = RNG.integers(0, 4, (ROWS, 2 * ROWS))
corners = st.builds(
    lambda v, u, h, w: (v, u, v + h, u + w),
    st.integers(-9, ROWS + 2),
    st.integers(-70, 100),
    st.integers(1, 9),
    st.integers(1, 60),
)


def sphere_areas(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Inclination and area of every pixel of a unit sphere."""
    edges = np.cos(np.arange(rows + 1) * np.pi / rows)
    area = (edges[:-1] - edges[1:]) * np.pi / rows
    inclination = (np.arange(rows) + 0.5) * np.pi / rows
    return tuple(np.repeat(x[:, None], 2 * rows, axis=1) for x in (inclination, area))


@given(st.lists(corners, min_size=1, max_size=5), st.integers(0, 3))
def test_sums_are_those_of_the_pixels_of_each_box(boxes: list[tuple[int, ...]], label: int) -> None:
    found = label_sums(IMAGES, AREAS, boxes, LABELS, np.full(len(boxes), label))
    for number, box in enumerate(boxes):
        inside = Box(*map(float, box)).inside(ROWS)
        for part, chosen in enumerate([inside & (label == LABELS), inside & (label != LABELS)]):
            assert found.pixels[number, part] == chosen.sum()
            assert found.area[number, part] == pytest.approx(AREAS[chosen].sum())
            expected = (IMAGES * AREAS)[:, chosen].sum(axis=1)
            np.testing.assert_allclose(found.total[number, part], expected, atol=1e-9)


@given(st.integers(-9, ROWS + 2), st.integers(-70, 100), st.integers(1, 9), st.integers(1, 20))
def test_the_largest_part_is_on_and_the_rest_off(v: int, u: int, height: int, width: int) -> None:
    box = Box(float(v), float(u), float(v + height), float(u + width))
    marked = LABELS > 1
    found = largest_part_sums(IMAGES, AREAS, [(v, u, v + height, u + width)], marked)
    parts, count = ndimage.label(box.cut(marked), structure=np.ones((3, 3)))
    largest = int(np.bincount(parts.ravel())[1:].max()) if count else 0
    # Over a pole a box may hold a pixel twice, which counts once.
    once = box.inside(ROWS).sum() == height * width
    assert found.pixels[0, 0] == largest if once else found.pixels[0, 0] <= largest
    assert found.pixels.sum() == box.inside(ROWS).sum()
    assert found.area.sum() == pytest.approx(AREAS[box.inside(ROWS)].sum())


def test_parts_are_connected_over_the_seam() -> None:
    marked = np.zeros((ROWS, 2 * ROWS), bool)
    marked[10:14, -3:] = marked[10:14, :2] = True
    marked[15, 1] = True
    found = largest_part_sums(IMAGES, AREAS, [(8, -6, 18, 6), (20, 20, 24, 24)], marked)
    np.testing.assert_array_equal(found.pixels, [[20, 100], [0, 16]])
    assert np.isnan(found.means(0)[1]).all()


def test_the_mean_over_a_cap_is_that_on_the_sphere() -> None:
    """z over the polar cap down to 60° has the mean ¾; the plain mean of the pixels has not."""
    rows = 96
    inclination, area = sphere_areas(rows)
    z, none = np.cos(inclination), np.zeros(area.shape, int)
    # A box that is as wide as half the way around and goes over the pole is the whole cap.
    box = (-rows // 3, 0, rows // 3, rows)
    found = label_sums(z[None], area, [box], none, [-1])
    assert found.means()[0, 0] == pytest.approx(0.75, rel=1e-3)
    assert found.area.sum() == pytest.approx(np.pi, rel=1e-9)
    assert abs(z[: rows // 3].mean() - 0.75) > 0.05


def test_what_is_not_known_does_not_count() -> None:
    image = np.array([[1.0, np.nan, 3.0, 5.0], [0.0, 0.0, 0.0, 0.0]])
    area = np.array([[1.0, 5.0, 3.0, np.nan], [1.0, 1.0, 1.0, 1.0]])
    found = label_sums(image[None], area, [(0, 0, 1, 4)], np.zeros((2, 4), int), [-1])
    assert found.means()[0, 0] == 2.5
    assert found.area[0].sum() == 9.0
    assert found.pixels[0].sum() == 4
