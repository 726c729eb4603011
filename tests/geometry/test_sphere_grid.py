"""The operators of the sphere on uv images, against spherical harmonics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import sph_harm_y

from napari_unwrap3d.geometry import sphere_grid


def harmonic(degree: int, order: int, rows: int) -> np.ndarray:
    theta = (np.arange(rows) + 0.5) * np.pi / rows
    phi = (np.arange(2 * rows) + 0.5) * np.pi / rows - np.pi
    return sph_harm_y(degree, order, theta[:, None], phi[None, :]).real


def test_the_pixels_cover_the_sphere() -> None:
    assert sphere_grid.pixel_areas(24).sum() == pytest.approx(4 * np.pi)


def test_the_stiffness_is_symmetric_semidefinite_and_blind_to_constants() -> None:
    stiffness = sphere_grid.sphere_stiffness(10)
    dense = stiffness.toarray()
    np.testing.assert_allclose(dense, dense.T)
    np.testing.assert_allclose(dense.sum(axis=1), 0, atol=1e-12)
    assert np.linalg.eigvalsh(dense)[0] > -1e-10


@pytest.mark.parametrize(("degree", "order"), [(1, 0), (1, 1), (2, 0), (3, 2), (5, 5), (6, 1)])
def test_spherical_harmonics_are_eigenfunctions(degree: int, order: int) -> None:
    # Of second order: twice the rows, a quarter of the error.
    errors = []
    for rows in (32, 64):
        values = harmonic(degree, order, rows)
        areas = sphere_grid.pixel_areas(rows)
        laplacian = (sphere_grid.sphere_stiffness(rows) @ values.ravel()).reshape(values.shape)
        rest = laplacian / areas - degree * (degree + 1) * values
        norm = np.sqrt((areas * values**2).sum())
        errors.append(np.sqrt((areas * rest**2).sum()) / norm / (degree * (degree + 1)))
    assert errors[1] < 0.02
    assert errors[1] < 0.35 * errors[0]


@pytest.mark.parametrize(("degree", "order"), [(2, 1), (4, 3)])
def test_the_bending_energy_is_the_square_of_the_eigenvalue(degree: int, order: int) -> None:
    values = harmonic(degree, order, 64).ravel()
    mass = sphere_grid.pixel_areas(64).ravel()
    expected = (degree * (degree + 1)) ** 2
    energy = values @ (sphere_grid.bending_energy(64) @ values) / (mass @ values**2)
    assert energy == pytest.approx(expected, rel=0.03)


def test_a_smoothing_spline_damps_each_harmonic_as_the_theory_says() -> None:
    values, strength = harmonic(3, 2, 48), 0.01
    energy = strength * sphere_grid.bending_energy(48)
    smooth = sphere_grid.smoothing_spline(values, np.ones_like(values), energy)
    np.testing.assert_allclose(smooth, values / (1 + strength * 12**2), atol=0.01)


def test_what_has_no_weight_may_be_anything() -> None:
    values = harmonic(1, 1, 24)
    weights = np.ones_like(values)
    weights[:6, :10] = 0
    values[:6, :10] = np.nan
    energy = 1e-6 * sphere_grid.bending_energy(24)
    smooth = sphere_grid.smoothing_spline(values, weights, energy)
    np.testing.assert_allclose(smooth, harmonic(1, 1, 24), atol=0.02)


def test_a_hole_over_a_pole_is_filled_as_between_two_circles() -> None:
    # Between circles of latitude log tan(θ / 2) is harmonic; at the pole it is not, so the
    # cap is known and the band between is not.
    rows = 96
    theta = (np.arange(rows) + 0.5) * np.pi / rows
    exact = np.repeat(np.log(np.tan(theta / 2))[:, None], 2 * rows, axis=1)
    known = np.repeat(((theta < 0.5) | (theta > 1.2))[:, None], 2 * rows, axis=1)
    filled = sphere_grid.fill_harmonic(np.where(known, exact, np.nan), known)
    np.testing.assert_allclose(filled, exact, atol=2e-3)


def test_filling_keeps_within_what_is_known_over_the_pole_and_the_seam() -> None:
    rng = np.random.default_rng(0)
    image = rng.normal(size=(20, 40))
    known = rng.random((20, 40)) < 0.3
    known[:5] = False
    filled = sphere_grid.fill_harmonic(image, known)
    np.testing.assert_array_equal(filled[known], image[known])
    assert filled.min() >= image[known].min() - 1e-9
    assert filled.max() <= image[known].max() + 1e-9


@pytest.mark.parametrize("known", [True, False])
def test_filling_everything_or_nothing(known: bool) -> None:
    image = np.ones((8, 16))
    filled = sphere_grid.fill_harmonic(image, np.full(image.shape, known))
    np.testing.assert_array_equal(filled, image * known)


@pytest.mark.parametrize("rows", [16, 20, 48])
def test_shrinking_keeps_the_integral_and_the_weights(rows: int) -> None:
    rng = np.random.default_rng(1)
    image, weights = rng.normal(size=(48, 96)), rng.random((48, 96))
    image[3, 4] = np.nan
    weights[3, 4] = 0
    small, share = sphere_grid.shrink(image, rows, weights)
    before, after = sphere_grid.pixel_areas(48), sphere_grid.pixel_areas(rows)
    # A pixel that is cut has its area shared by length, the sphere by the cosine.
    close = 1e-9 if 48 % rows == 0 else 0.02
    assert (after * share).sum() == pytest.approx((before * weights).sum(), rel=close)
    total = (before * weights * np.nan_to_num(image)).sum()
    assert (after * share * small).sum() == pytest.approx(total, abs=close * 4 * np.pi)


def test_enlarging_follows_a_smooth_function_over_poles_and_seam() -> None:
    np.testing.assert_allclose(
        sphere_grid.enlarge(harmonic(3, 2, 24), 60), harmonic(3, 2, 60), atol=2e-3
    )
