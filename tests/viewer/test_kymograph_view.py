"""A line is drawn in the uv image, and what happens along it is seen over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from qtpy.QtWidgets import QApplication, QFileDialog

from napari_unwrap3d.motion.kymograph import kymograph, line_on_surface
from napari_unwrap3d.viewer.common.docking import dock_of
from napari_unwrap3d.viewer.movies.kymograph_view import KymographDock
from napari_unwrap3d.viewer.movies.polar_view import PolarDock
from napari_unwrap3d.viewer.movies.surface_lines import NAME, WAY
from viewer.movie_window import MovieWindow, press_plot
from viewer.opened import SECONDS

CURVATURE = "mean_curvature_per_um"


@pytest.fixture
def window(make_napari_viewer: Any, breathing: Any, qtbot: Any) -> MovieWindow:
    return MovieWindow(make_napari_viewer(show=True), breathing, qtbot)


@pytest.fixture
def dock(window: MovieWindow) -> KymographDock:
    return window.dock(KymographDock, "Kymograph")


def rest(dock: KymographDock, qtbot: Any) -> None:
    """Wait until what was drawn is computed."""
    for _ in range(3):
        QApplication.processEvents()
    qtbot.waitUntil(lambda: not dock.busy and dock.found is not None, timeout=SECONDS)


def drawn(window: MovieWindow, dock: KymographDock, qtbot: Any) -> Any:
    """Draw a line of two corners with the mouse."""
    dock.draw_button.click()
    window.lay_out()
    window.click(30.0, 40.0)
    window.click(30.0, 80.0)
    window.double_click(40.0, 100.0)
    rest(dock, qtbot)
    return dock.found


def test_a_line_is_drawn_edited_and_followed_in_time(
    window: MovieWindow, dock: KymographDock, qtbot: Any, tmp_path: Path
) -> None:
    found = drawn(window, dock, qtbot)
    assert dock.plot.isVisible()
    np.testing.assert_allclose(found.line.corners[0], [30, 40], atol=1)
    np.testing.assert_allclose(found.line.corners[-1], [40, 100], atol=1)
    assert found.field == CURVATURE, "the field of the views comes first"
    expected = kymograph(window.movie, found.line.corners, CURVATURE)
    np.testing.assert_array_equal(found.values, expected.values)
    axes = dock.plot._axes
    assert axes.get_xlabel() == "position (µm)"
    assert axes.get_ylabel() == "time (s)"
    assert f"{found.line.length_um:.2f} µm" in dock.status.text()

    # In the image, and on the surface of the timepoint.
    way = window.canvas.model.layers[WAY]
    np.testing.assert_allclose(np.concatenate(way.data), found.line.points)
    in_space = window.viewer.layers[NAME]
    assert in_space.units == window.viewer.layers["surface"].units
    before = in_space.data[:, 0]
    on_it = line_on_surface(window.movie.common, found.line, window.session.frame)
    lift = window.movie.common.voxel_um
    assert np.linalg.norm(before - on_it[:-1], axis=1).max() < lift
    np.testing.assert_allclose(before[:-1] + in_space.data[:-1, 1], before[1:], atol=1e-5)
    press_plot(dock.plot, found.line.length_um / 2, 4.3)
    window.at(2)
    assert dock.plot._now.get_ydata()[0] == 4.0
    after = window.viewer.layers[NAME].data[:, 0]
    assert np.linalg.norm(after - before, axis=1).max() > 0.05

    # A corner is dragged.
    layer = window.canvas.model.layers[NAME]
    layer.mode = "direct"
    layer.selected_data = {0}
    corner = tuple(layer.data[0][-1])
    window.drag(corner, (38.0, 105.0), (35.0, 110.0))
    qtbot.waitUntil(lambda: dock.found is not found and not dock.busy, timeout=SECONDS)
    np.testing.assert_allclose(dock.found.line.corners[-1], [35, 110], atol=1.5)

    # Another field, and a width.
    dock.field_box.setCurrentIndex(dock.field_box.findData("height_um"))
    dock.width_box.setValue(0.4)
    qtbot.waitUntil(
        lambda: dock.found.field == "height_um" and dock.found.line.width_um == 0.4,
        timeout=SECONDS,
    )

    dock.export(tmp_path / "kymograph.csv")
    qtbot.waitUntil(lambda: "Written" in dock.status.text(), timeout=SECONDS)
    table = pd.read_csv(tmp_path / "kymograph.csv")
    assert len(table) == dock.found.values.size


def test_a_new_line_takes_the_place_of_the_old_one_and_all_go_with_the_dock(
    window: MovieWindow, dock: KymographDock, qtbot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = drawn(window, dock, qtbot)
    layer = window.canvas.model.layers[NAME]
    layer.mode = "add_line"
    window.drag((10.0, 20.0), (15.0, 30.0), (20.0, 50.0))
    qtbot.waitUntil(lambda: dock.found is not first and not dock.busy, timeout=SECONDS)
    qtbot.waitUntil(lambda: len(layer.data) == 1, timeout=SECONDS)
    rest(dock, qtbot)
    np.testing.assert_allclose(dock.found.line.corners, [[10, 20], [20, 50]], atol=1.5)
    # Deleted: nothing is shown.
    layer.selected_data = {0}
    layer.remove_selected()
    qtbot.waitUntil(lambda: dock.found is None, timeout=SECONDS)
    assert not dock.plot.isVisible()
    assert not len(window.viewer.layers[NAME].data)
    assert not dock.export_button.isEnabled()
    # Over the seam, and on a great circle, which is the shorter way.
    dock.lines.set_corners(np.array([[30.0, 5.0], [30.0, 120.0]]))
    rest(dock, qtbot)
    long = dock.found
    dock.way_box.setCurrentIndex(1)
    qtbot.waitUntil(lambda: dock.found is not long and not dock.busy, timeout=SECONDS)
    assert dock.found.line.length_um < 0.3 * long.line.length_um
    assert len(window.canvas.model.layers[WAY].data) == 2, "on both sides of the seam"
    # The layers go with the dock.
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: ("", ""))
    dock.export_button.click()
    assert NAME in window.viewer.layers
    window.viewer.window.remove_dock_widget(dock)
    qtbot.waitUntil(lambda: NAME not in window.viewer.layers, timeout=SECONDS)
    assert NAME not in window.canvas.model.layers
    assert WAY not in window.canvas.model.layers
    window.go_to(3)


def test_without_a_movie_one_is_told(
    make_napari_viewer: Any, errors: list[str], qtbot: Any
) -> None:
    dock = KymographDock(make_napari_viewer())
    dock.draw_button.click()
    assert "no movie" in errors[0]
    qtbot.waitUntil(lambda: "no movie" in dock.status.text(), timeout=SECONDS)


def test_the_polar_view_follows_time_field_and_colours(window: MovieWindow, qtbot: Any) -> None:
    from napari_unwrap3d.unwrapping.uv_views import to_polar

    dock = window.dock(PolarDock, "Polar view")
    assert dock_of(dock) is not None
    window.go_to(2)
    qtbot.waitUntil(lambda: not dock._later.isActive(), timeout=SECONDS)

    def expected(field: str, pole: str) -> Any:
        return to_polar(window.session.frame.uv[field].astype(float), pole, 128)

    np.testing.assert_array_equal(dock.plot.view, expected(CURVATURE, "north"))
    dock.buttons["south"].click()
    np.testing.assert_array_equal(dock.plot.view, expected(CURVATURE, "south"))
    shown = np.asarray(dock.plot._image.get_array().filled(np.nan))
    np.testing.assert_array_equal(shown, dock.plot.view)
    window.go_to(0)
    qtbot.waitUntil(lambda: not dock._later.isActive(), timeout=SECONDS)
    np.testing.assert_array_equal(dock.plot.view, expected(CURVATURE, "south"))
    window.canvas.colouring.set_limits(-0.5, 0.75)
    qtbot.waitUntil(lambda: dock.plot._image.get_clim() == (-0.5, 0.75), timeout=SECONDS)
    window.canvas.colouring.set_field("height_um")
    qtbot.waitUntil(
        lambda: np.array_equal(dock.plot.view, expected("height_um", "south"), equal_nan=True),
        timeout=SECONDS,
    )
