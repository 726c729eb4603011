"""Correlations of series in time, over tracks or over the surface.

Paper, Methods, "ROI timeseries extraction and cross-correlation" (normalised cross-correlation
of each track, mean and 95 % confidence interval over the tracks), "Cross-correlation and curvature
relationship" (kernel density with its conditional mean and standard deviation), and Fig. 4e
(temporal autocorrelation of fields on the surface, whose first side lobe is a period).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from ..charts import Floats, Ints
from ..errors import AxesError, InputError, ParameterError
from .rows import (
    count_of_rows,
    interval_of_groups,
    interval_of_rows,
    mean_of_rows,
    std_of_rows,
)

FEWEST_PAIRS = 3


@dataclass(frozen=True, eq=False)
class Correlation:
    """A normalised correlation at a range of lags, for several series.

    Attributes
    ----------
    lag_s : ndarray, (l,)
        Positive: the second series follows the first.
    values : ndarray, (k, l)
        −1 … 1, a row per series; NaN where there are too few common timepoints.
    groups : ndarray, (k,), optional
        Series of one group are alike, such as those of neighbouring places.
    """

    lag_s: Floats
    values: Floats
    groups: Ints | None = None

    @property
    def count(self) -> Ints:
        """How many series have a value at each lag (l,)."""
        return count_of_rows(self.values)

    @property
    def mean(self) -> Floats:
        """Mean over the series (l,)."""
        return mean_of_rows(self.values)

    @property
    def std(self) -> Floats:
        """Standard deviation over the series (l,); NaN with fewer than two."""
        return std_of_rows(self.values)

    def interval(self, level: float = 0.95) -> tuple[Floats, Floats]:
        """Confidence interval of the mean (l,), by Student's t over the series or their groups."""
        if self.groups is not None:
            return interval_of_groups(self.values, self.groups, level)
        return interval_of_rows(self.values, level)

    @property
    def best_lag_s(self) -> float:
        """Lag of the largest absolute mean, between samples by a parabola."""
        size = np.abs(self.mean)
        if not np.isfinite(size).any():
            return float("nan")
        at = int(np.nanargmax(size))
        if 0 < at < len(size) - 1 and np.isfinite(size[at - 1 : at + 2]).all():
            before, here, after = size[at - 1 : at + 2]
            bend = before - 2 * here + after
            shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
            return float(self.lag_s[at] + shift * (self.lag_s[1] - self.lag_s[0]))
        return float(self.lag_s[at])


def cross_correlation(
    first: npt.ArrayLike, second: npt.ArrayLike, time_step_s: float, longest_lag_s: float
) -> Correlation:
    """Normalised cross-correlation of pairs of series.

    Both are brought to mean 0 and variance 1 over the timepoints that they have in common, and
    their products are summed at every lag, over as many as there are at lag 0: the field's usual
    normalisation, in which the ends weigh less and |r| ≤ 1.

    Parameters
    ----------
    first, second : array-like, (k, T) or (T,)
        NaN where a series is not known.
    time_step_s : float
    longest_lag_s : float

    Returns
    -------
    Correlation
        At lags from −`longest_lag_s` to `longest_lag_s`.

    Raises
    ------
    AxesError
        They are not of one shape.
    ParameterError
        The longest lag is negative or the time step is not positive.
    """
    a, b = (np.atleast_2d(np.asarray(x, dtype=np.float64)) for x in (first, second))
    if a.shape != b.shape or a.ndim != 2:
        raise AxesError("Series that are correlated are of one shape.", a=a.shape, b=b.shape)
    if not (time_step_s > 0 and longest_lag_s >= 0):
        raise ParameterError(
            "The longest lag is not negative and the time step is positive.",
            longest_lag_s=longest_lag_s,
            time_step_s=time_step_s,
        )
    length = a.shape[1]
    reach = min(int(np.floor(longest_lag_s / time_step_s + 1e-9)), length - 1)
    known = np.isfinite(a) & np.isfinite(b)
    a, b = (_standardised(x, known) for x in (a, b))
    lags = np.arange(-reach, reach + 1)
    values = np.full((len(a), len(lags)), np.nan)
    count = known.sum(axis=1)
    for column, lag in enumerate(lags):
        early, late = slice(0, length - abs(lag)), slice(abs(lag), length)
        one, other = (early, late) if lag >= 0 else (late, early)
        both = known[:, one] & known[:, other]
        total = np.where(both, a[:, one] * b[:, other], 0.0).sum(axis=1)
        enough = (both.sum(axis=1) >= FEWEST_PAIRS) & (count >= FEWEST_PAIRS)
        values[enough, column] = total[enough] / count[enough]
    values[~np.isfinite(a).any(axis=1) | ~np.isfinite(b).any(axis=1)] = np.nan
    return Correlation(lags * time_step_s, values)


def _standardised(values: Floats, known: npt.NDArray[np.bool_]) -> Floats:
    """Mean 0 and variance 1 over what is known; NaN where a series does not change."""
    count = np.maximum(known.sum(axis=1), 1)[:, None]
    mean = np.where(known, values, 0.0).sum(axis=1, keepdims=True) / count
    off = np.where(known, values - mean, 0.0)
    spread = np.sqrt((off**2).sum(axis=1, keepdims=True) / count)
    scale = np.abs(mean) + spread
    standard: Floats = np.divide(
        off, spread, out=np.full(off.shape, np.nan), where=spread > 1e-12 * scale
    )
    return standard


def autocorrelation(series: npt.ArrayLike, time_step_s: float, longest_lag_s: float) -> Correlation:
    """Normalised temporal autocorrelation of series (k, T), at lags from 0.

    Parameters and errors are those of :func:`cross_correlation`.
    """
    both = cross_correlation(series, series, time_step_s, longest_lag_s)
    half = len(both.lag_s) // 2
    return Correlation(both.lag_s[half:], both.values[:, half:])


def first_side_lobe_s(correlation: Correlation) -> float:
    """Lag of the first peak of a mean autocorrelation after its first trough; NaN without one.

    A periodic signal has it at its period (paper, Fig. 4e: 30 s, as long as a bleb lives).
    """
    mean = correlation.mean
    rising = np.flatnonzero(np.diff(mean) > 0)
    if len(rising) == 0:
        return float("nan")
    trough = int(rising[0])
    falling = np.flatnonzero(np.diff(mean[trough:]) < 0)
    if len(falling) == 0:
        return float("nan")
    peak = trough + int(falling[0])
    return float(correlation.lag_s[peak])


@dataclass(frozen=True, eq=False)
class Relationship:
    """How one quantity depends on another, by a kernel density.

    Attributes
    ----------
    x : ndarray, (n,), y : ndarray, (m,)
        Where the density is evaluated.
    density : ndarray, (n, m)
        Joint density p(x, y).
    mean, std : ndarray, (n,)
        Conditional mean E[y | x] and standard deviation; NaN where there is next to nothing.
    """

    x: Floats
    y: Floats
    density: Floats
    mean: Floats
    std: Floats


def relationship(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    *,
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    bins: int = 100,
) -> Relationship:
    """Joint density of two quantities, and the conditional mean and deviation of the second.

    Gaussian kernels with Scott's bandwidth, evaluated at the middles of bins (paper,
    "Cross-correlation and curvature relationship").

    Raises
    ------
    AxesError
        They are not of one length.
    InputError
        There are fewer than three pairs, or one of them does not vary.
    """
    a, b = np.asarray(x, dtype=np.float64).ravel(), np.asarray(y, dtype=np.float64).ravel()
    if a.shape != b.shape:
        raise AxesError("Two quantities have one value each.", x=a.shape, y=b.shape)
    known = np.isfinite(a) & np.isfinite(b)
    a, b = a[known], b[known]
    if len(a) < FEWEST_PAIRS or np.ptp(a) == 0 or np.ptp(b) == 0:
        raise InputError(
            "There are too few different pairs for a density.",
            pairs=len(a),
            hint="Track more, or loosen what selects the tracks.",
        )
    middles = [_middles(*ends, bins) for ends in (x_range, y_range)]
    grid = np.stack(np.meshgrid(*middles, indexing="ij"))
    density = stats.gaussian_kde(np.stack([a, b]), bw_method="scott")(grid.reshape(2, -1))
    density = density.reshape(bins, bins)
    weight = density.sum(axis=1)
    there = weight > 1e-9 * weight.max()
    mean = np.where(there, density @ middles[1] / np.where(there, weight, 1.0), np.nan)
    square = np.where(there, density @ middles[1] ** 2 / np.where(there, weight, 1.0), np.nan)
    std = np.sqrt(np.maximum(square - mean**2, 0.0))
    return Relationship(middles[0], middles[1], density, mean, std)


def _middles(low: float, high: float, bins: int) -> Floats:
    edges = np.linspace(low, high, bins + 1)
    middles: Floats = 0.5 * (edges[1:] + edges[:-1])
    return middles
