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
    freedom = np.maximum(count_of_rows(values) - 1, 1)
    half = stats.t.ppf(0.5 + level / 2, freedom) * sem_of_rows(values)
    mean = mean_of_rows(values)
    return mean - half, mean + half
