"""Events: peaks of a series, and windows around them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import AxesError, ParameterError
from napari_unwrap3d.measuring.events import (
    Events,
    align,
    event_columns,
    find_events,
    moving_average,
)


def bumps(peaks: list[int], length: int = 100, width: float = 3.0) -> np.ndarray:
    """A series with a bump of height 1 at each peak."""
    t = np.arange(length)
    return sum((np.exp(-0.5 * ((t - peak) / width) ** 2) for peak in peaks), np.zeros(length))


@given(st.integers(8, 12), st.integers(0, 3))
def test_every_bump_is_an_event(gap: int, number: int) -> None:
    peaks = [15 + gap * 2 * k for k in range(number)]
    found = find_events(bumps(peaks), 1.0, prominence=0.5, distance_s=3.0)
    np.testing.assert_array_equal(found.timepoint, peaks)
    assert (found.prominence > 0.5).all()


def test_low_bumps_and_close_ones_are_none() -> None:
    series = bumps([20]) + 0.3 * bumps([60])
    assert list(find_events(series, 1.0, prominence=0.5).timepoint) == [20]
    twins = bumps([40, 47], width=1.5) + 0.1 * bumps([47], width=1.5)
    assert list(find_events(twins, 1.0, prominence=0.3, distance_s=3.0).timepoint) == [40, 47]
    assert list(find_events(twins, 1.0, prominence=0.3, distance_s=9.0).timepoint) == [47]


def test_the_time_step_scales_the_distance() -> None:
    twins = bumps([40, 47], width=1.5)
    assert len(find_events(twins, 0.5, prominence=0.3, distance_s=3.0)) == 2
    assert len(find_events(twins, 0.5, prominence=0.3, distance_s=4.0)) == 1


def test_a_gap_is_no_event() -> None:
    series = bumps([30])
    series[50:60] = np.nan
    assert list(find_events(series, 1.0).timepoint) == [30]
    assert len(find_events(np.full(20, np.nan), 1.0)) == 0
    assert len(find_events([1.0, 2.0], 1.0)) == 0


def test_noise_of_one_timepoint_is_smoothed_away() -> None:
    series = np.zeros(30)
    series[15] = 0.9
    assert len(find_events(series, 1.0, prominence=0.5, smoothing=1)) == 1
    assert len(find_events(series, 1.0, prominence=0.5, smoothing=3)) == 0


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=20), st.sampled_from([1, 3, 5]))
def test_the_moving_average_is_that_of_what_is_there(values: list[float], width: int) -> None:
    half = width // 2
    expected = [np.mean(values[max(i - half, 0) : i + half + 1]) for i in range(len(values))]
    np.testing.assert_allclose(moving_average(values, width), expected, atol=1e-12)


def test_the_moving_average_leaves_gaps_out() -> None:
    np.testing.assert_allclose(moving_average([1, np.nan, 3, 5], 3), [1, 2, 4, 4])
    assert np.isnan(moving_average([np.nan, np.nan, np.nan, 1], 3)[1])


def test_events_are_aligned_on_their_peaks() -> None:
    series = [bumps([20, 60]), 2 * bumps([50])]
    events = [find_events(each, 0.5) for each in series]
    found = align(series, events, 0.5, before_s=3.0, after_s=4.0)
    np.testing.assert_allclose(found.time_s, np.arange(-6, 9) * 0.5)
    assert found.values.shape == (3, 15)
    np.testing.assert_allclose(found.values[:, 6], [1, 1, 2], rtol=1e-6)
    np.testing.assert_allclose(found.mean[6], 4 / 3, rtol=1e-6)
    expected = np.std([1, 1, 2], ddof=1) / np.sqrt(3)
    np.testing.assert_allclose(found.sem[6], expected, rtol=1e-6)


def test_a_window_beyond_a_track_is_unknown_there() -> None:
    series = bumps([2], length=10)
    found = align([series], [Events(np.array([2]), np.array([1.0]))], 1.0, before_s=4, after_s=9)
    np.testing.assert_array_equal(np.isnan(found.values[0]), [True] * 2 + [False] * 10 + [True] * 2)
    assert np.isnan(found.sem).all()


def test_no_event_is_an_empty_mean() -> None:
    found = align([], [], 1.0)
    assert found.values.shape == (0, 35)
    assert np.isnan(found.mean).all()


def test_the_table_has_a_row_for_each_event() -> None:
    events = {7: find_events(bumps([20, 60]), 0.5), 9: find_events(bumps([50]), 0.5)}
    columns = event_columns(events, 0.5)
    np.testing.assert_array_equal(columns["track_id"], [7, 7, 9])
    np.testing.assert_allclose(columns["time_s"], [10, 30, 25])
    assert {len(column) for column in event_columns({}, 1.0).values()} == {0}


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(AxesError):
        find_events(np.zeros((2, 3)), 1.0)
    with pytest.raises(ParameterError):
        find_events(np.zeros(5), 0.0)
    with pytest.raises(ParameterError, match="odd"):
        moving_average(np.zeros(5), 2)
    with pytest.raises(AxesError):
        align([np.zeros(5)], [], 1.0)


@given(st.integers(3, 39), st.floats(1.0, 6.0))
def test_a_peak_that_is_cut_off_counts_by_the_side_that_is_seen(after: int, width: float) -> None:
    """However little of its fall is recorded; but what is still rising is no peak."""
    series = bumps([60], width=width)
    seen = series[: 60 + after + 1]
    found = find_events(seen, 1.0, prominence=0.3, cut=(False, True))
    assert list(found.timepoint) == [60]
    assert found.prominence[0] > 0.3
    turned = find_events(seen[::-1], 1.0, prominence=0.3, cut=(True, False))
    assert list(turned.timepoint) == [after]
    assert len(find_events(series[:58], 1.0, prominence=0.1, cut=(False, True))) == 0
    assert len(find_events(series[63:], 1.0, prominence=0.1, cut=(True, False))) == 0
