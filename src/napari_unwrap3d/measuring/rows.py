"""Statistics over rows, one per track or event, in which NaN do not count."""

from __future__ import annotations

import numpy as np
from scipy import stats

from ..charts import Floats, Ints


def count_of_rows(values: Floats) -> Ints:
    """How many rows of (k, w) have a value in each column (w,)."""
    return np.asarray(np.isfinite(values).sum(axis=0), np.int64)


def mean_of_rows(values: Floats) -> Floats:
    """Mean over the rows (w,); NaN without any."""
    count = count_of_rows(values)
    total = np.where(np.isfinite(values), values, 0.0).sum(axis=0)
    mean: Floats = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return mean


def std_of_rows(values: Floats) -> Floats:
    """Standard deviation over the rows (w,), of a sample; NaN with fewer than two."""
    count = count_of_rows(values)
    off = np.where(np.isfinite(values), values - mean_of_rows(values), 0.0)
    squares = (off**2).sum(axis=0)
    variance = np.divide(squares, count - 1, out=np.full(len(count), np.nan), where=count > 1)
    std: Floats = np.sqrt(variance)
    return std


def sem_of_rows(values: Floats) -> Floats:
    """Standard error of the mean (w,); NaN with fewer than two rows."""
    sem: Floats = std_of_rows(values) / np.sqrt(np.maximum(count_of_rows(values), 1))
    return sem


def interval_of_rows(values: Floats, level: float) -> tuple[Floats, Floats]:
    """Confidence interval of the mean (w,), by Student's t over the rows."""
    return _interval(mean_of_rows(values), sem_of_rows(values), count_of_rows(values), level)


def interval_of_groups(values: Floats, groups: Ints, level: float) -> tuple[Floats, Floats]:
    """Confidence interval of the mean (w,) where rows of one group (k,) are alike.

    Neighbouring places of a surface change together, so that they tell less than as many that
    are independent. The standard error is that of the jackknife over groups, of which one after
    the other is left out (Efron and Tibshirani 1993, An Introduction to the Bootstrap, chapter
    11), and the interval by Student's t over the groups.
    """
    known = np.isfinite(values)
    names, index = np.unique(groups, return_inverse=True)
    total, count = np.zeros((len(names), values.shape[1])), np.zeros((len(names), values.shape[1]))
    np.add.at(total, index, np.where(known, values, 0.0))
    np.add.at(count, index, known)
    rest = count.sum(axis=0) - count
    without = np.divide(
        total.sum(axis=0) - total, rest, out=np.full(total.shape, np.nan), where=rest > 0
    )
    # A group without any value changes nothing when it is left out.
    without[count == 0] = np.nan
    number = count_of_rows(without)
    error = std_of_rows(without) * (number - 1) / np.sqrt(np.maximum(number, 1))
    return _interval(mean_of_rows(values), error, number, level)


def _interval(mean: Floats, error: Floats, count: Ints, level: float) -> tuple[Floats, Floats]:
    half = stats.t.ppf(0.5 + level / 2, np.maximum(count - 1, 1)) * error
    return mean - half, mean + half
