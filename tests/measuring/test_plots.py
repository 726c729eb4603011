"""The registry of plots: everything can be drawn, and what is drawn are the numbers."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from measured import FIELD, TRACKS, made_up, nothing
from napari_unwrap3d.measuring.measurements import Measurements
from napari_unwrap3d.measuring.plots import PAPER, PLOTS, column_label, track_of


@pytest.fixture(scope="module")
def measurements() -> Measurements:
    return made_up()


def drawn(name: str, measurements: Measurements, selection: tuple[int, ...], choice: str) -> Figure:
    figure = Figure()
    PLOTS[name].draw(figure, measurements, selection, PAPER, choice)
    figure.draw_without_rendering()
    return figure


@pytest.mark.parametrize("selection", [(), (2, 5), (999,)])
@pytest.mark.parametrize("name", PLOTS)
def test_every_plot_has_axes_with_names_and_numbers(
    name: str, selection: tuple[int, ...], measurements: Measurements
) -> None:
    kind = PLOTS[name]
    assert kind.missing(measurements) == ""
    for choice in ("", *kind.choices(measurements)[:3]):
        figure = drawn(name, measurements, selection, choice)
        assert figure.axes
        assert figure.axes[-1].get_xlabel()
        assert figure.axes[-1].get_ylabel()
        if selection != (999,):
            assert len(kind.numbers(measurements, selection, choice))


@pytest.mark.parametrize("name", PLOTS)
def test_without_anything_there_is_a_reason(name: str) -> None:
    assert len(PLOTS[name].missing(nothing())) > 10


def test_curves_tell_their_tracks(measurements: Measurements) -> None:
    (axes,) = drawn("series", measurements, (3,), "on_area_um2").axes
    found = {track_of(line) for line in axes.lines if line.get_picker()}
    assert found == set(range(1, TRACKS + 1))
    curve = next(line for line in axes.lines if track_of(line) == 3)
    numbers = PLOTS["series"].numbers(measurements, (3,), "on_area_um2")
    np.testing.assert_array_equal(curve.get_ydata(), numbers["on_area_um2"])
    assert track_of(axes.title) is None


def test_the_mean_event_has_its_peak_at_zero(measurements: Measurements) -> None:
    table = PLOTS["aligned"].numbers(measurements, (), "area_um2")
    assert table.time_s[table["mean"].idxmax()] == pytest.approx(0, abs=1.5)
    one = PLOTS["aligned"].numbers(measurements, (4,), "area_um2")
    assert one["count"].max() == 1
    assert one["sem"].isna().all()


def test_a_histogram_counts_every_track(measurements: Measurements) -> None:
    for name in ("lifetimes", "speeds"):
        assert PLOTS[name].numbers(measurements, (), "").tracks.sum() == TRACKS


def test_labels_have_units() -> None:
    assert column_label("on_area_um2") == "Area (µm²), on the protrusion"
    assert column_label("speed_um_per_min") == "Speed (µm/min)"
    assert column_label(FIELD) == "Mean curvature (1/µm)"
    assert column_label("events") == "Events"
