"""The report: one page that needs no other, and the numbers behind it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from measured import made_up, nothing
from napari_unwrap3d import Parameters
from napari_unwrap3d.measuring.plots import PLOTS
from napari_unwrap3d.measuring.report import write_report


def test_the_page_needs_nothing_else(tmp_path: Path) -> None:
    picture = Figure()
    picture.subplots().plot([0, 1])
    page = write_report(made_up(), tmp_path / "report", pictures={"A <picture>": picture})
    text = page.read_text("utf-8")
    assert text.count("<svg") == len(PLOTS) + 1
    assert not re.search(r"<(?:script|link|img|iframe)\b|url\(http|@import", text)
    assert "made &lt;up&gt;" in text
    assert "A &lt;picture&gt;" in text
    assert "[measurement]" in text


def test_the_numbers_lie_beside_it(tmp_path: Path) -> None:
    measurements = made_up()
    write_report(measurements, tmp_path, choices={"series": ("area_um2",)})
    for name, table in measurements.tables.items():
        pd.testing.assert_frame_equal(
            pd.read_csv(tmp_path / "tables" / f"{name}.csv"), table, check_dtype=False
        )
    assert (tmp_path / "series-area_um2.csv").exists()
    assert json.loads((tmp_path / "numbers.json").read_text("utf-8"))["fast_um_per_min"] == 4.0
    text = (tmp_path / "parameters.toml").read_text("utf-8")
    assert Parameters.from_toml(text) == measurements.parameters


def test_the_same_measurements_give_the_same_report(tmp_path: Path) -> None:
    one, other = (write_report(made_up(), tmp_path / name) for name in ("a", "b"))
    assert one.read_bytes() == other.read_bytes()


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    text = write_report(nothing(), tmp_path, title="Empty").read_text("utf-8")
    assert "<svg" not in text
    assert "No track was measured." in text
