"""Tracks of which every row has values of its own, that several test modules share."""

from __future__ import annotations

import numpy as np

from napari_unwrap3d.charts import Tracks


def rich_tracks(seed: int = 0) -> Tracks:
    """Tracks with gaps, single rows, splits, merges, and columns of every kind."""
    random = np.random.default_rng(seed)
    # Track 2 comes out of 1, which goes on; 4 goes into 1; 5 comes out of 3, which has ended.
    times = {1: range(8), 2: (3, 4, 6), 3: (0, 1), 4: (2, 3), 5: (2, 5), 7: (4,)}
    track = np.concatenate([[k] * len(t) for k, t in times.items()])
    timepoint = np.concatenate([list(t) for t in times.values()])
    rows = len(track)
    place = random.uniform(-0.5, 31.5, rows)
    place[3] = np.nan
    columns = {
        "track_id": track,
        "timepoint": timepoint,
        "z_um": random.uniform(0, 20, rows),
        "y_um": random.uniform(0, 20, rows),
        "x_um": random.uniform(0, 20, rows) / 3,
        "v_px": place,
        "u_px": random.uniform(-0.5, 63.5, rows),
        "top_px": place - 2,
        "left_px": place - 3,
        "bottom_px": place + 2,
        "right_px": place + 3,
        "label": random.integers(0, 9, rows).astype(np.int32),
        "area_um2": np.where(np.arange(rows) == 5, np.nan, random.uniform(1, 9, rows)),
        "mean_curvature_per_um": random.normal(size=rows).astype(np.float32),
        "signal_Septin 6/µ": np.where(np.arange(rows) == 2, np.inf, 1e-300),
        "on_border": random.integers(0, 2, rows).astype(bool),
        "kind": np.array(["bleb", "", "NA", 'a, "b" <c> & µ'])[random.integers(0, 4, rows)],
    }
    return Tracks.of(
        columns,
        time_step_s=1.21,
        timepoints=10,
        rows=32,
        splits=np.array([[1, 2], [3, 5]]),
        merges=np.array([[4, 1]]),
        method="surface",
        numbers={"links": 12, "cutoff_um": 1.5, "kept": [1, 2], "nothing": None, "far": np.inf},
    )


def assert_same(found: Tracks, expected: Tracks) -> None:
    """Nothing at all was lost; where it comes from may have been added."""
    assert list(found.columns) == list(expected.columns)
    for name, column in expected.columns.items():
        assert found.columns[name].dtype == column.dtype, name
        np.testing.assert_array_equal(found.columns[name], column, err_msg=name)
    for name in ("splits", "merges"):
        assert getattr(found, name).tolist() == getattr(expected, name).tolist()
    for name in ("time_step_s", "timepoints", "rows", "method"):
        assert getattr(found, name) == getattr(expected, name)
    own, given = (
        {key: value for key, value in tracks.numbers.items() if key != "provenance"}
        for tracks in (found, expected)
    )
    assert own == given
    told = dict(expected.numbers.get("provenance", {}))
    assert found.numbers["provenance"] == {**found.numbers["provenance"], **told}
