"""Harmonic functions against those with a closed form."""

import numpy as np
import pytest

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.harmonic import harmonic_between
from napari_unwrap3d.progress import Progress, silent
from shapes import grid


def radial_fit(found: np.ndarray, radius: np.ndarray, free: np.ndarray) -> tuple[float, float]:
    """Largest residual of the best a + b / r, and the radius where that is zero."""
    columns = np.stack([np.ones(free.sum()), 1 / radius[free]], axis=1)
    fit, *_ = np.linalg.lstsq(columns, found[free], rcond=None)
    return float(np.abs(columns @ fit - found[free]).max()), float(-fit[1] / fit[0])


def test_between_concentric_spheres_it_is_linear_in_one_over_r() -> None:
    radius = np.linalg.norm(grid(81), axis=-1)
    found = harmonic_between(radius <= 10, radius >= 38, silent())
    r = radius[::2, ::2, ::2]
    assert found.shape == r.shape
    free = (r > 12) & (r < 36)
    residual, zero = radial_fit(found, r, free)
    assert residual < 0.04
    assert zero == pytest.approx(10, abs=1.0)  # half the step of the coarser grid
    # What it is for: its gradient points along the radius.
    slope = np.stack(np.gradient(found), axis=-1)[free]
    way = grid(81)[::2, ::2, ::2][free]
    cosine = np.einsum("ij,ij->i", slope, way) / np.linalg.norm(slope, axis=1) / r[free]
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert angle.max() < 12
    assert angle.mean() < 2


def test_inside_a_ball_around_a_core() -> None:
    """As it is used inside of a solid: 0 outside of the ball, 1 on a small core."""
    radius = np.linalg.norm(grid(65), axis=-1)
    found = harmonic_between(radius >= 28, radius <= 4, silent())
    r = np.maximum(radius[::2, ::2, ::2], 1e-9)
    residual, zero = radial_fit(found, r, (r > 6) & (r < 27))
    assert residual < 0.02
    assert zero == pytest.approx(28, abs=1.0)


def test_between_planes_it_is_linear() -> None:
    z = np.broadcast_to(np.arange(49)[:, None, None], (49, 20, 26))
    found = harmonic_between(z <= 8, z >= 40, silent())
    expected = np.clip((np.arange(0, 49, 2) - 8) / 32, 0, 1)
    assert np.abs(found - expected[:, None, None]).max() < 0.01


def test_the_values_lie_between_those_that_are_given() -> None:
    rng = np.random.default_rng(0)
    zero = np.zeros((40, 44, 48), bool)
    for centre in rng.uniform(10, 30, (4, 3)):
        index = np.stack(np.indices(zero.shape), axis=-1)
        zero |= np.linalg.norm(index - centre, axis=-1) < 5
    one = np.ones(zero.shape, bool)
    one[2:-2, 2:-2, 2:-2] = False
    found = harmonic_between(zero, one, silent())
    assert (found[zero[::2, ::2, ::2]] == 0).all()
    assert (found[one[::2, ::2, ::2]] == 1).all()
    assert found.min() > -1e-3
    assert found.max() < 1 + 1e-3
    # The mean value property, at the free points that have six neighbours.
    mean = sum(np.roll(found, s, axis) for axis in range(3) for s in (1, -1)) / 6
    free = ~(zero | one)[::2, ::2, ::2]
    assert np.abs(found - mean)[free].max() < 0.02


def test_it_can_be_cancelled() -> None:
    progress = Progress()
    progress.cancel()
    radius = np.linalg.norm(grid(20), axis=-1)
    with pytest.raises(Cancelled):
        harmonic_between(radius < 3, radius > 8, progress)
