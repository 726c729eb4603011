"""Intervals of means where rows are alike."""

from __future__ import annotations

import numpy as np

from napari_unwrap3d.measuring.rows import interval_of_groups, interval_of_rows

RNG = np.random.default_rng(5)


def test_groups_of_one_are_rows() -> None:
    values = RNG.normal(size=(12, 5))
    values[3, 2] = np.nan
    grouped = interval_of_groups(values, np.arange(12), 0.95)
    np.testing.assert_allclose(grouped, interval_of_rows(values, 0.95))


def test_rows_that_are_alike_tell_as_much_as_one() -> None:
    """Of 200 samples of 12 groups of 10 rows each, some 95 % cover the mean; by rows far fewer."""
    covered = np.zeros(2, int)
    groups = np.repeat(np.arange(12), 10)
    for _ in range(200):
        values = (RNG.normal(size=12)[groups] + 0.3 * RNG.normal(size=120))[:, None]
        for which, (low, high) in enumerate(
            (interval_of_groups(values, groups, 0.95), interval_of_rows(values, 0.95))
        ):
            covered[which] += bool(low[0] <= 0.0 <= high[0])
    assert 178 <= covered[0] <= 199
    assert covered[1] < 130
