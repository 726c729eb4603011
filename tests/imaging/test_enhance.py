"""Local contrast and edges: what they bring out, and what they leave as it is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from napari_unwrap3d.charts import Stack
from napari_unwrap3d.imaging.enhance import enhanced, local_contrast, sharpened
from napari_unwrap3d.imaging.segment import segment
from napari_unwrap3d.imaging.threshold import foreground
from napari_unwrap3d.parameters import StackParameters
from napari_unwrap3d.progress import silent

UNIT = (1.0, 1.0, 1.0)
BLOCK = np.array([20.0, 20.0, 20.0])
SIGMA = np.array([2.0, 2.0, 2.0])


def from_middle(shape: tuple[int, int, int] = (64, 64, 64)) -> np.ndarray:
    middle = (np.reshape(shape, (3, 1, 1, 1)) - 1) / 2
    return np.indices(shape) - middle


def body(radius: float = 20.0) -> np.ndarray:
    return np.sqrt((from_middle() ** 2).sum(axis=0)) < radius


def uneven(seed: int = 0) -> np.ndarray:
    """A cell stained five times as much on one side as on the other."""
    staining = np.where(body(), 40 + 160 * (from_middle()[2] + 20) / 40, 0)
    light = ndimage.gaussian_filter(50 + staining, 1.0)
    return np.random.default_rng(seed).poisson(light).astype(np.float32)


def agreement(mask: np.ndarray, cell: np.ndarray) -> float:
    return float((mask & cell).sum() / (mask | cell).sum())


def test_nothing_is_done_by_default() -> None:
    image = uneven()
    assert enhanced(image, UNIT, 1.0, StackParameters(), silent()) is image


def test_local_contrast_finds_the_faint_side() -> None:
    image = uneven()
    plain, _ = foreground(image, UNIT, 1.0, StackParameters(), silent())
    chosen = StackParameters(local_contrast_um=24.0)
    found, _ = foreground(image, UNIT, 1.0, chosen, silent())
    assert agreement(plain, body()) < 0.9
    assert agreement(found, body()) > 0.93


@pytest.mark.parametrize(("gain", "offset"), [(3.0, 0.0), (0.01, 0.0), (1.0, -200.0), (7.0, 90.0)])
def test_gain_and_offset_pass_through(gain: float, offset: float) -> None:
    image = uneven()
    other = (gain * image + offset).astype(np.float32)
    span = float(np.ptp(image))
    found = (local_contrast(other, BLOCK, 0.01) - offset) / gain
    np.testing.assert_allclose(found, local_contrast(image, BLOCK, 0.01), atol=0.02 * span)
    found = (sharpened(other, SIGMA, 2.0) - offset) / gain
    np.testing.assert_allclose(found, sharpened(image, SIGMA, 2.0), atol=1e-3 * span)
    chosen = StackParameters(local_contrast_um=24.0, edge_enhancement=1.0)
    one, _ = foreground(image, UNIT, 1.0, chosen, silent())
    two, _ = foreground(other, UNIT, 1.0, chosen, silent())
    assert agreement(one, two) > 0.999


def test_local_contrast_keeps_the_range_and_constant_images() -> None:
    image = uneven()
    found = local_contrast(image, BLOCK, 0.01)
    assert (found.min(), found.max()) == pytest.approx((image.min(), image.max()))
    flat = np.full((8, 9, 10), 5.0, dtype=np.float32)
    assert np.array_equal(local_contrast(flat, BLOCK, 0.01), flat)


def test_unsharp_masking_steepens_edges_and_keeps_the_mean() -> None:
    step = np.zeros((9, 9, 40), dtype=np.float32)
    step[:, :, 20:] = 1
    soft = ndimage.gaussian_filter(step, (0, 0, 2.0))
    found = sharpened(soft, SIGMA, 1.0)
    assert np.diff(found[4, 4]).max() > 1.2 * np.diff(soft[4, 4]).max()
    assert found.mean() == pytest.approx(soft.mean(), abs=1e-3)
    slope = np.broadcast_to(np.arange(40, dtype=np.float32), (9, 9, 40))
    np.testing.assert_allclose(
        sharpened(slope, SIGMA, 3.0)[:, :, 9:-9], slope[:, :, 9:-9], rtol=1e-5
    )


def test_edges_are_in_voxels_of_the_working_grid() -> None:
    image = uneven()
    chosen = StackParameters(edge_enhancement=1.0, edge_voxels=2.0)
    coarse = enhanced(image, (2.0, 2.0, 2.0), 1.0, chosen, silent())
    np.testing.assert_allclose(coarse, sharpened(image, SIGMA / 2, 1.0))


def test_the_segmentation_is_independent_of_the_order_of_the_axes() -> None:
    image = uneven()
    chosen = StackParameters(local_contrast_um=16.0, edge_enhancement=1.0, threshold="multi-level")
    mask, _ = segment(Stack(image, "zyx", UNIT), chosen)
    turned, _ = segment(Stack(image.transpose(2, 0, 1), "zyx", UNIT), chosen)
    back = turned.data.transpose(1, 2, 0)
    assert back.shape == mask.data.shape
    assert agreement(back, mask.data) > 0.999


def test_several_levels_find_a_bright_edge_around_a_faint_inside() -> None:
    """A stained cortex with a gap: nothing encloses the inside, so it cannot be filled."""
    radius = np.sqrt((from_middle() ** 2).sum(axis=0))
    z, y, x = from_middle()
    gap = (np.hypot(y, x) < 7) & (z > 0)
    light = np.where(radius < 24, 50.0, 10.0)
    light[(np.abs(radius - 22.5) < 1.5) & ~gap] = 200.0
    image = np.random.default_rng(0).poisson(ndimage.gaussian_filter(light, 0.7)).astype(float)
    stack = Stack(image.astype(np.float32), "zyx", UNIT)
    cell = radius < 24
    plain, _ = segment(stack)
    found, _ = segment(stack, StackParameters(threshold="multi-level", interior_um=5.0))

    def filled(mask: object) -> float:
        return float(np.asarray(mask.data).sum() / cell.sum())  # type: ignore[attr-defined]

    assert filled(plain) < 0.6
    assert filled(found) == pytest.approx(1, abs=0.1)
