"""Correlations of series, and how one quantity depends on another."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import AxesError, InputError, ParameterError
from napari_unwrap3d.measuring.correlation import (
    autocorrelation,
    cross_correlation,
    first_side_lobe_s,
    relationship,
)

RNG = np.random.default_rng(4)


@given(st.integers(-12, 12))
def test_a_delay_is_found(delay: int) -> None:
    noise = np.random.default_rng(1).normal(size=(5, 260))
    smooth = np.apply_along_axis(np.convolve, 1, noise, np.hanning(9), "valid")
    first, second = smooth[:, 20:220], smooth[:, 20 - delay : 220 - delay]
    found = cross_correlation(first, second, 0.5, 10.0)
    assert found.best_lag_s == pytest.approx(0.5 * delay, abs=0.1)
    assert found.mean.max() > 0.9


def test_at_lag_zero_it_is_pearsons() -> None:
    a, b = RNG.normal(size=(2, 4, 50))
    found = cross_correlation(a, b, 1.0, 5.0)
    expected = [np.corrcoef(x, y)[0, 1] for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(found.values[:, 5], expected)
    gaps = a.copy()
    gaps[:, ::7] = np.nan
    kept = np.isfinite(gaps[0])
    expected = [np.corrcoef(x[kept], y[kept])[0, 1] for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(cross_correlation(gaps, b, 1.0, 5.0).values[:, 5], expected)


@given(st.integers(0, 50))
def test_it_is_within_one_and_does_not_depend_on_scale(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3, 20))
    found = cross_correlation(a, b, 1.0, 19.0)
    assert (np.abs(found.values[np.isfinite(found.values)]) <= 1 + 1e-12).all()
    scaled = cross_correlation(3 + 5 * a, 7 - 2 * b, 1.0, 19.0)
    np.testing.assert_allclose(scaled.values, -found.values, atol=1e-12)
    turned = cross_correlation(b, a, 1.0, 19.0)
    np.testing.assert_allclose(turned.values, found.values[:, ::-1], atol=1e-12)


def test_the_interval_covers_the_mean_of_many() -> None:
    """Of 200 samples of 20 pairs of series of known correlation ½, some 95 % cover it."""
    covered = 0
    rng = np.random.default_rng(0)
    for _ in range(200):
        a = rng.normal(size=(20, 60))
        b = 0.5 * a + np.sqrt(0.75) * rng.normal(size=(20, 60))
        low, high = cross_correlation(a, b, 1.0, 0.0).interval()
        covered += bool(low[0] <= 0.5 <= high[0])
    assert 180 <= covered <= 199


def test_a_series_that_does_not_change_has_no_correlation() -> None:
    found = cross_correlation(np.ones((1, 20)), RNG.normal(size=(1, 20)), 1.0, 3.0)
    assert np.isnan(found.values).all()
    assert np.isnan(found.best_lag_s)


def test_the_first_side_lobe_is_the_period() -> None:
    t = np.arange(300) * 0.5
    phases = RNG.uniform(0, 2 * np.pi, 40)[:, None]
    series = np.cos(2 * np.pi * t / 30 + phases) + 0.3 * RNG.normal(size=(40, 300))
    found = autocorrelation(series, 0.5, 60.0)
    np.testing.assert_allclose(found.mean[0], 1.0)
    assert first_side_lobe_s(found) == pytest.approx(30, abs=1.5)
    assert np.isnan(first_side_lobe_s(autocorrelation(np.arange(20.0), 1.0, 10.0)))


def test_the_conditional_mean_is_the_dependence() -> None:
    x = RNG.uniform(-0.2, 0.6, 4000)
    y = 0.8 * x + 0.05 * RNG.normal(size=4000)
    found = relationship(x, y, x_range=(-0.2, 0.6), y_range=(-1, 1))
    middle = (found.x > -0.05) & (found.x < 0.45)
    np.testing.assert_allclose(found.mean[middle], 0.8 * found.x[middle], atol=0.03)
    assert 0.05 < found.std[middle].mean() < 0.12
    assert found.density.shape == (100, 100)


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: cross_correlation(np.zeros((2, 5)), np.zeros((2, 6)), 1.0, 1.0), AxesError),
        (lambda: cross_correlation(np.zeros(5), np.zeros(5), 0.0, 1.0), ParameterError),
        (lambda: cross_correlation(np.zeros(5), np.zeros(5), 1.0, -1.0), ParameterError),
        (lambda: relationship([1, 2], [1, 2], x_range=(0, 1), y_range=(0, 1)), InputError),
        (lambda: relationship([1, 1, 1], [1, 2, 3], x_range=(0, 1), y_range=(0, 1)), InputError),
        (lambda: relationship([1, 2], [1], x_range=(0, 1), y_range=(0, 1)), AxesError),
    ],
)
def test_what_makes_no_sense_is_refused(call: object, error: type[Exception]) -> None:
    with pytest.raises(error):
        call()  # type: ignore[operator]
