"""Key numbers of tracks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.tracking.summary import summary


def some(**columns: object) -> Tracks:
    """Tracks of 3, 1 and 2 timepoints of 2 s."""
    rows = {"track_id": [1, 1, 1, 2, 3, 3], "timepoint": [0, 1, 2, 1, 3, 4]}
    space = dict.fromkeys(("z_um", "y_um", "x_um"), np.zeros(6))
    splits = np.array([(1, 3)])
    return Tracks.of({**rows, **space, **columns}, time_step_s=2.0, timepoints=5, splits=splits)


def test_numbers_of_tracks() -> None:
    found = summary(some(area_um2=[1, 2, 3, 4, 5, np.nan]))
    assert found["tracks"] == 3
    assert found["places"] == 6
    assert found["at_a_time"] == pytest.approx(6 / 5)
    assert found["lifetime_mean_s"] == pytest.approx(4.0)
    assert found["lifetime_sd_s"] == pytest.approx(2.0)
    assert found["lifetime_median_s"] == pytest.approx(4.0)
    assert (found["splits"], found["merges"]) == (1, 0)
    assert found["area_mean_um2"] == pytest.approx(3.0)
    assert "height_mean_um" not in found


def test_without_tracks_nothing_is_said() -> None:
    found = summary(some().kept([]))
    assert found["tracks"] == 0
    assert math.isnan(found["lifetime_mean_s"])
    assert math.isnan(found["lifetime_sd_s"])
