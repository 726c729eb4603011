"""Plots as files: what was measured, on white, or the numbers behind it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import FileFormatError
from napari_unwrap3d.measuring.plot_files import FIGURE_SUFFIXES, write_plot
from viewer.measured import measured

BEGINS = {".svg": b"<?xml", ".pdf": b"%PDF", ".png": b"\x89PNG"}


@pytest.fixture(scope="module")
def tracks() -> Tracks:
    track, timepoint = (index.ravel() for index in np.indices((6, 8)))
    zeros = np.zeros(len(track))
    columns = {
        "track_id": track + 1,
        "timepoint": timepoint,
        "z_um": zeros,
        "y_um": zeros,
        "x_um": zeros,
        "area_um2": track + np.sin(timepoint),
    }
    return Tracks.of(columns, time_step_s=2.0, timepoints=8)


@pytest.mark.parametrize("suffix", FIGURE_SUFFIXES)
def test_the_same_plot_gives_the_same_file(tracks: Tracks, tmp_path: Path, suffix: str) -> None:
    files = [tmp_path / f"{name}{suffix}" for name in ("one", "other", "third")]
    for path, selection in zip(files, [(), (), (2,)], strict=True):
        write_plot(measured(tracks), "series", path, selection)
    one, other, third = (path.read_bytes() for path in files)
    assert one.startswith(BEGINS[suffix])
    assert one == other
    assert one != third
    if suffix == ".svg":
        assert b">Time (s)<" in one, "text stays text"


def test_the_numbers_are_those_that_were_measured(tracks: Tracks, tmp_path: Path) -> None:
    write_plot(measured(tracks), "series", tmp_path / "numbers.csv", (3, 5), "area_um2")
    table = pd.read_csv(tmp_path / "numbers.csv")
    chosen = np.isin(tracks.track_id, (3, 5))
    np.testing.assert_array_equal(table.track_id, tracks.track_id[chosen])
    np.testing.assert_array_equal(table.area_um2, tracks.columns["area_um2"][chosen])


def test_other_files_are_refused(tracks: Tracks, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"plot\.docx"):
        write_plot(measured(tracks), "series", tmp_path / "plot.docx")
    assert not list(tmp_path.iterdir())
