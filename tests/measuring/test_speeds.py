"""Speeds of tracks and their populations."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.measuring.speeds import mean_by_track, populations, step_speeds


def moving(speeds_um_per_min: list[float], step_s: float = 2.0, timepoints: int = 6) -> Tracks:
    """Tracks that go straight on in x, each at its own speed; every other one skips a timepoint."""
    rows = [
        (track + 1, t, 0.0, 0.0, speed * t * step_s / 60.0)
        for track, speed in enumerate(speeds_um_per_min)
        for t in range(timepoints)
        if not (track % 2 and t == 3)
    ]
    names = ("track_id", "timepoint", "z_um", "y_um", "x_um")
    columns = dict(zip(names, np.array(rows).T, strict=True))
    return Tracks.of(columns, time_step_s=step_s, timepoints=timepoints)


def test_what_goes_straight_on_has_its_speed() -> None:
    tracks = moving([1.0, 4.0, 0.0])
    speeds = step_speeds(tracks)
    assert np.isnan(speeds[tracks.timepoint == 0]).all()
    np.testing.assert_allclose(mean_by_track(tracks, speeds), [1.0, 4.0, 0.0])


def test_a_speed_along_the_surface_comes_first() -> None:
    tracks = moving([1.0]).with_columns(speed_um_per_min=np.full(6, 3.0))
    np.testing.assert_array_equal(step_speeds(tracks), 3.0)


def test_thresholds_lie_between_the_populations() -> None:
    rng = np.random.default_rng(0)
    speeds = np.concatenate([rng.normal(m, 0.2, 400) for m in (1.0, 4.0, 8.0)])
    found = populations(speeds, 10.0, 25)
    assert found is not None
    assert 1.3 < found.slow_um_per_min < 3.7
    assert 4.3 < found.fast_um_per_min < 7.7
    np.testing.assert_allclose(found.class_means_um_per_min, (1.0, 4.0, 8.0), atol=0.1)
    assert found.class_counts == pytest.approx((400, 400, 400), abs=3)


def test_alike_speeds_are_no_populations() -> None:
    assert populations(np.full(20, 2.0), 10.0, 25) is None
    assert populations([], 10.0, 25) is None
