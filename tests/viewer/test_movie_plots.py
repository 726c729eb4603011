"""Plots of a movie over time, drawn for real."""

from __future__ import annotations

from typing import Any

import mouse
import numpy as np
import pandas as pd
import pytest
from qtpy.QtCore import QPoint
from qtpy.QtTest import QTest

from napari_unwrap3d.viewer.movies.plots import Row, TimePlot, drift_rows, outside_rows, size_rows
from napari_unwrap3d.viewer.session import session_of

TIMES = np.arange(5) * 2.0


@pytest.fixture
def plot(make_napari_viewer: Any, qtbot: Any) -> TimePlot:
    plot = TimePlot(session_of(make_napari_viewer()))
    qtbot.addWidget(plot)
    plot.resize(400, 200)
    plot.show()
    return plot


def test_a_click_goes_to_the_timepoint_under_it(plot: TimePlot, qtbot: Any) -> None:
    plot.show_rows(TIMES, [Row("a", {"a": TIMES}), Row("b", {"b": TIMES, "c": -TIMES}, 3.0)])
    plot.canvas.draw()
    axes = plot.figure.axes[1]
    x, y = axes.transData.transform((6.3, 0.0))
    height = plot.figure.bbox.height
    ratio = plot.canvas.device_pixel_ratio
    where = QPoint(round(x / ratio), round((height - y) / ratio))
    with qtbot.waitSignal(plot.picked, timeout=2000) as clicked:
        QTest.mouseClick(plot.canvas, mouse.LEFT, mouse.NO_KEYS, where)
    assert clicked.args == [3]


def test_a_line_shows_the_timepoint_in_the_views(plot: TimePlot) -> None:
    plot.show_rows(TIMES, [Row("a", {"a": TIMES})])
    plot.show_timepoint(4)
    (line,) = plot._lines
    assert list(line.get_xdata()) == [8.0, 8.0]
    assert line.get_visible()
    plot.show_rows(TIMES, [Row("a", {"a": 2 * TIMES})])
    assert list(plot._lines[0].get_xdata()) == [8.0, 8.0], "it stays when something is made"


def test_nothing_known_shows_nothing(plot: TimePlot) -> None:
    plot.show_rows(TIMES, [Row("a", {"a": np.full(5, np.nan)})])
    assert not plot.isVisible()


def test_rows_of_the_tables() -> None:
    table = pd.DataFrame({
        "time_s": TIMES, "shift_z_um": TIMES, "shift_y_um": 0.0, "shift_x_um": -TIMES,
        "angle_deg": 0.0, "residual": 0.1, "residual_before": 0.5,
    })  # fmt: skip
    shift, residual = drift_rows(table)
    assert list(shift.curves) == ["z", "y", "x"]
    np.testing.assert_array_equal(shift.curves["x"], -TIMES)
    assert set(residual.curves) == {"before", "after"}
    turned = drift_rows(table.assign(angle_deg=TIMES))
    assert [row.title for row in turned][1] == "angle (°)"
    record = {"recommendation": {"outside": {"mean": [0.0, 0.01, np.nan, 0.0, 0.5]}}}
    check = pd.DataFrame({"outside_fraction": [np.nan, 0.02, 0, 0, 0], "volume_um3": TIMES})
    (outside,) = outside_rows(record, check, 0.02)
    assert outside.limit == 2.0
    assert outside.curves["mean"][4] == 50.0
    assert outside.curves["measured"][1] == 2.0
    volume, area = size_rows(check)
    np.testing.assert_array_equal(volume.curves["volume"], TIMES)
    assert np.isnan(area.curves["area"]).all()
