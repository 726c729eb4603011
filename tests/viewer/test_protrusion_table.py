"""Protrusions in the window: selected in any view, filtered, coloured, edited, unwrapped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication
from scipy.ndimage import binary_erosion

from napari_unwrap3d.charts import MOTIFS
from napari_unwrap3d.fields import PROTRUSION, fields_of
from napari_unwrap3d.protrusions.editing import NAME
from napari_unwrap3d.protrusions.segment import Segmentation
from napari_unwrap3d.protrusions.table import measure_protrusions
from napari_unwrap3d.viewer.files.project import open_project, saving
from napari_unwrap3d.viewer.protrusions.annotation import KEPT
from napari_unwrap3d.viewer.protrusions.filter import Filter
from napari_unwrap3d.viewer.protrusions.instances import instances_of
from napari_unwrap3d.viewer.protrusions.look import look_at
from napari_unwrap3d.viewer.protrusions.table import ProtrusionTable
from napari_unwrap3d.viewer.session import session_of
from napari_unwrap3d.viewer.steps.panel import ProtrusionsDock
from viewer.opened import SECONDS
from viewer.protruding import LEFT, SHIFT, Protruding

BLEBS = 4


@pytest.fixture(scope="session")
def protrusion_atlas(direct_atlas: Any) -> Any:
    """The small cell with its protrusions."""
    atlas = direct_atlas.replaced()
    assert atlas.protrusions.count == BLEBS
    return atlas


@pytest.fixture(autouse=True)
def unsaved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells that are left behind are kept in a folder of the test."""
    for module in ("files.autosave", "files.project"):
        name = f"napari_unwrap3d.viewer.{module}.unsaved_folder"
        monkeypatch.setattr(name, lambda: tmp_path / "unsaved")


@pytest.fixture
def cell(make_napari_viewer: Any, protrusion_atlas: Any, qtbot: Any) -> Protruding:
    return Protruding(make_napari_viewer(show=True), protrusion_atlas.replaced(), qtbot)


def opacities(cell: Protruding) -> dict[int, float]:
    colours = cell.annotating.style(NAME)[0]
    return {label: colours[label][3] for label in cell.instances.labels}


def hues(cell: Protruding) -> dict[int, Any]:
    colours = cell.annotating.style(NAME)[0]
    return {label: colours[label][:3] for label in cell.instances.labels}


def test_every_view_and_the_panel_of_the_step_show_the_instances(cell: Protruding) -> None:
    assert (cell.labels == cell.found.labels).all()
    assert cell.dock.rows.rowCount() == BLEBS
    assert len(set(hues(cell).values())) == BLEBS
    for chart in ("uv", "direct", "topography"):
        image = cell.atlas.annotations.image(NAME, chart)
        assert (cell.show(chart).data == image).all()
        assert set(np.unique(image)) == {0, *cell.instances.labels}
    assert not cell.atlas.annotations.can_undo, "the run itself is nothing to undo"
    assert not cell.autosave.dirty, "nor anything to save"
    # The panel of the step has the heights.
    dock = ProtrusionsDock(cell.viewer)
    cell.viewer.window.add_dock_widget(dock)
    plot = dock.panel.plot
    cell.qtbot.waitUntil(lambda: plot.histogram is not None, timeout=SECONDS)
    assert not plot.isHidden()
    assert plot.threshold_um == cell.found.numbers["threshold_um"]
    assert f"{BLEBS} found" in dock.panel.status.text()
    # What a person edits is counted, too.
    cell.instances.select([1, 2])
    cell.press("merge")
    assert f"{BLEBS - 1} found" in dock.panel.status.text()
    assert cell.autosave.dirty


def test_a_row_is_selected_in_the_views_and_a_click_there_selects_the_row(cell: Protruding) -> None:
    before = cell.texture.pixels.copy()
    own = hues(cell)
    cell.click_row(2)
    assert cell.instances.selection == (2,)
    now = hues(cell)
    assert now[2] == own[2]
    # The others are greyer.
    assert all(
        np.ptp(now[label]) < np.ptp(own[label]) for label in cell.instances.labels if label != 2
    )
    image = cell.atlas.annotations.image(NAME, "direct")
    columns = image.shape[1]
    changed = (cell.texture.pixels != before).any(axis=2)[:, :columns]
    assert (changed == ((image > 0) & (image != 2))).all()
    cell.click_row(3, SHIFT)
    assert set(cell.instances.selection) == {2, 3}
    QTest.keyClick(cell.dock.table, Qt.Key.Key_Escape)
    cell.rest()
    assert cell.instances.selection == ()
    assert (cell.texture.pixels == before).all()
    # And a click in any view selects the row.
    chosen = cell.found.labels == 3
    look_at(cell.viewer, cell.atlas.surface.vertices, chosen)
    cell.viewer.scene.camera.zoom = 30.0
    cell.click(cell.main, cell.centre())
    assert cell.instances.selection == (3,)
    assert cell.selected_rows() == {3}
    for chart in ("uv", "direct"):
        cell.show(chart)
        cell.click_image(cell.pixel_of(1, chart))
        assert cell.selected_rows() == {1}, chart
        cell.click_image(cell.pixel_of(2, chart), SHIFT)
        assert cell.selected_rows() == {1, 2}, chart
        cell.click_image(cell.pixel_of(1, chart), SHIFT)
        assert cell.selected_rows() == {2}, chart
    layer = cell.show("topography")
    depth = int(cell.canvas.model.dims.current_step[0])
    there = np.argwhere(layer.data[depth] > 0)[0]
    cell.click_image(there)
    assert cell.instances.selection == (layer.data[depth][tuple(there)],)
    QTest.keyClick(cell.second, Qt.Key.Key_Escape)
    assert cell.instances.selection == ()
    # What is no protrusion selects nothing.
    cell.show("uv")
    cell.click_row(1)
    cell.click_image(np.argwhere(cell.atlas.annotations.image(NAME, "uv") == 0)[40])
    assert cell.instances.selection == ()
    # A drag and a tool select nothing.
    camera = cell.viewer.scene.camera
    angles = camera.angles
    cell.drag(cell.main, [(0.45 + 0.02 * k, 0.5) for k in range(5)])
    assert camera.angles != angles
    assert cell.instances.selection == ()
    cell.annotating.tool = "brush"
    cell.click_image(cell.pixel_of(1))
    assert cell.instances.selection == ()


def test_merge_undo_delete_and_split(cell: Protruding) -> None:
    # Escape ends a split.
    cell.instances.select([3])
    cell.press("split")
    assert cell.instances.pointing
    QTest.keyClick(cell.second, Qt.Key.Key_Escape)
    assert not cell.instances.pointing
    assert cell.instances.selection == (3,)
    assert cell.dock.message.isHidden()
    # Two are merged, deleted, and all of it undone.
    bar = cell.dock.edit_bar
    assert "Select two" in bar.buttons["merge"].toolTip()
    assert not bar.buttons["merge"].isEnabled()
    cell.click_row(3)
    cell.click_row(1, Qt.KeyboardModifier.ControlModifier)
    whole = cell.found
    cell.press("merge")
    assert cell.instances.labels == (2, 3, 4)
    assert cell.instances.selection == (3,)
    assert cell.selected_rows() == {3}
    assert "edited" in cell.dock.count.text()
    image, rows = cell.atlas.topography.surface, cell.atlas.topography.shape[1]
    found = Segmentation(
        cell.labels.astype(np.int32),
        whole.height_um,
        cell.found.volume.data,
        cell.found.cortex.data,
    )
    expected = measure_protrusions(found, cell.atlas.mask, cell.atlas.surface, image, rows=rows)
    for name, column in expected.items():
        np.testing.assert_array_equal(cell.found.columns[name], column, err_msg=name)
    assert cell.atlas.protrusions is cell.found, "it is what is exported and saved"
    cell.press("delete")
    assert cell.instances.labels == (2, 4)
    cell.press("undo")
    cell.press("undo")
    assert cell.instances.labels == (1, 2, 3, 4)
    assert not cell.instances.edited
    assert not bar.buttons["undo"].isEnabled()
    cell.press("redo")
    assert cell.instances.labels == (2, 3, 4)
    cell.press("undo")
    # Merged and split again at the saddle between them.
    cell.instances.select([1, 2])
    cell.press("merge")
    cell.press("split")
    assert len(cell.instances.labels) == BLEBS
    assert set(cell.selected_rows()) == set(cell.instances.selection)
    # A round bleb has one peak: the person says where its parts are.
    (whole,) = [n for n in cell.instances.labels if n not in cell.instances.selection][:1]
    cell.instances.select([whole])
    mine = cell.labels == whole
    cell.press("split")
    assert cell.instances.pointing
    assert "click a place" in cell.dock.message.text()
    image = cell.atlas.annotations.image(NAME, "uv")
    inside = np.argwhere(image == whole)
    cell.click_image(inside[inside[:, 0].argmin()])
    assert cell.instances.pointing
    cell.click_image(inside[inside[:, 0].argmax()])
    assert not cell.instances.pointing
    assert len(cell.instances.labels) == BLEBS + 1
    assert set(np.unique(cell.labels[mine])) == set(cell.instances.selection)
    assert len(cell.instances.selection) == 2


def test_the_filter_hides_in_table_and_views_and_a_row_is_repainted(cell: Protruding) -> None:
    heights = cell.found.columns["height_max_um"]
    bar = cell.dock.filter_bar
    row = bar.column.findData("height_max_um")
    bar.column.setCurrentIndex(row)
    bar.column.activated.emit(row)
    bar.low.setFocus()
    QTest.keyClicks(bar.low, f"{np.sort(heights)[1] + 1e-6:.6f}")
    QTest.keyClick(bar.low, Qt.Key.Key_Return)
    kept = {int(n) for n in cell.found.columns["label"][heights > np.sort(heights)[1]]}
    assert cell.dock.rows.rowCount() == len(kept) == 2
    assert {label for label, alpha in opacities(cell).items() if alpha} == kept
    gone = next(iter(set(cell.instances.labels) - kept))
    cell.click_image(cell.pixel_of(gone))
    assert cell.instances.selection == (), "what cannot be seen cannot be clicked"
    QTest.mouseClick(bar.clear_button, LEFT)
    assert cell.dock.rows.rowCount() == BLEBS
    motif = MOTIFS[int(cell.found.columns["motif"][0])]
    cell.instances.set_filter(Filter(motif=motif))
    alike = cell.found.columns["motif"] == cell.found.columns["motif"][0]
    assert cell.dock.rows.rowCount() == alike.sum()
    cell.instances.set_filter(Filter())
    # Repainting takes the brush of the label.
    cell.click_row(2)
    before = cell.found.columns["area_um2"].copy()
    cell.press("repaint")
    assert (cell.annotating.tool, cell.annotating.current, cell.annotating.label) == (
        "brush",
        NAME,
        2,
    )
    column = cell.pixel_of(2)[1]
    size = cell.layer("uv").brush_size
    image = cell.atlas.annotations.image(NAME, "uv")
    around = np.argwhere(image == 2)
    cell.click_image((around[:, 0].max() + size / 2, column))
    after = cell.found.columns["area_um2"]
    assert after[1] > before[1]
    assert (after[[0, 2, 3]] == before[[0, 2, 3]]).all()
    cell.press("repaint")
    assert cell.annotating.tool == "look"


def test_a_measure_colours_every_view_and_the_selected_one_is_a_square(cell: Protruding) -> None:
    box = cell.dock.colour_box
    row = box.findData("volume_um3")
    box.setCurrentIndex(row)
    box.activated.emit(row)
    cell.qtbot.waitUntil(lambda: cell.instances.measure == "volume_um3", timeout=SECONDS)
    cell.rest()
    name = f"{PROTRUSION}volume_um3"
    fields = fields_of(cell.atlas)
    on_surface = fields.values(name, "surface")
    inside = cell.labels > 0
    expected = dict(zip(cell.instances.labels, cell.found.columns["volume_um3"], strict=True))
    assert np.isnan(on_surface[~inside]).all()
    np.testing.assert_allclose(
        on_surface[inside], [expected[n] for n in cell.labels[inside]], rtol=1e-6
    )
    assert cell.canvas.image("uv").data is fields.values(name, "uv")
    assert not any(opacities(cell).values()), "the field is seen, not the labels"
    # Where there is no value the mesh is grey, as the image is empty.
    direct = cell.atlas.annotations.image(NAME, "direct")
    base = cell.texture._base.reshape(*direct.shape, 3)
    assert (base[binary_erosion(direct == 0, iterations=3)] == 178).all()
    # An edit changes the values; the limits stay.
    limits = cell.canvas.colouring.limits
    cell.instances.select([1, 2])
    cell.press("merge")
    merged = fields.values(name, "surface")[cell.labels == 1]
    np.testing.assert_allclose(merged, cell.found.columns["volume_um3"][0], rtol=1e-6)
    assert cell.canvas.colouring.limits == limits
    cell.canvas.colouring.set_field("mean_curvature_per_um")
    cell.rest()
    assert cell.instances.measure == ""
    assert box.currentData() == ""
    cell.press("undo")
    # The selected one is unwrapped to a square.
    cell.instances.select([])
    cell.rest()
    assert cell.dock.square.picture.isHidden()
    cell.click_row(1)
    square = cell.dock.square
    assert square.disk.label == 1
    assert not square.picture.isHidden()
    assert square.picture.pixmap().width() == square.disk.pixels
    cell.click_row(2, SHIFT)
    assert square.picture.isHidden()
    # A band around the cell is no disk.
    height = cell.atlas.surface.vertices[:, 0]
    middle = float(np.median(height))
    band = np.flatnonzero((np.abs(height - middle) < 0.8) & (cell.labels == 0))
    label = cell.instances.edits.add(band)
    cell.annotating.edited.emit()
    cell.rest()
    cell.click_row(label)
    assert square.picture.isHidden()
    assert "border" in square.text.text() or "disk" in square.text.text()


def test_the_table_is_grey_sorted_copied_and_opened_again(cell: Protruding) -> None:
    session = session_of(cell.viewer)
    session.update_automatically = False
    cell.click_row(1)
    session.set_values("protrusions", {"threshold_um": 0.9})
    assert "other parameters" in cell.dock.message.text()
    assert not cell.dock.table.isEnabled()
    assert not cell.dock.edit_bar.buttons["delete"].isEnabled()
    assert "other parameters" in cell.dock.edit_bar.buttons["delete"].toolTip()
    session.set_values("protrusions", {"threshold_um": None})
    assert cell.dock.table.isEnabled()
    assert cell.dock.message.isHidden()
    # It is sorted and copied as it is shown.
    dock = cell.dock
    dock.show_columns(["volume_um3", "neck_um"])
    shown = [not dock.table.isColumnHidden(k) for k in range(dock.model.columnCount())]
    assert sum(shown) == 3
    place = dock.model.columns.index("volume_um3")
    dock.table.sortByColumn(place, Qt.SortOrder.AscendingOrder)
    QTest.mouseClick(dock.copy_button, LEFT)
    first, *lines = QApplication.clipboard().text().splitlines()
    assert first.split("\t") == ["Label", "Volume (µm³)", "Neck (µm)"]
    volumes = [float(line.split("\t")[1]) for line in lines]
    assert volumes == sorted(cell.found.columns["volume_um3"])
    tip = dock.model.headerData(place, Qt.Orientation.Horizontal, Qt.ItemDataRole.ToolTipRole)
    assert "voxels" in tip
    # Columns and selection survive the dock.
    cell.dock.show_columns(["solidity"])
    cell.click_row(2)
    cell.viewer.window.remove_dock_widget(cell.dock)
    again = ProtrusionTable(cell.viewer)
    cell.viewer.window.add_dock_widget(again)
    assert not again.table.isColumnHidden(again.model.columns.index("solidity"))
    assert again.table.isColumnHidden(again.model.columns.index("area_um2"))
    rows = again.table.selectionModel().selectedRows()
    assert [again.model.ids[again.rows.mapToSource(r).row()] for r in rows] == [2]


def test_what_was_edited_is_kept_beside_a_new_run(cell: Protruding) -> None:
    cell.instances.select([1, 2])
    cell.press("merge")
    edited = cell.labels
    again = replace(cell.instances.edits._base, numbers={"threshold_um": 0.1})
    atlas = cell.atlas.replaced(on_request={**cell.atlas.on_request, "protrusions": again})
    session_of(cell.viewer)._finish(atlas)
    cell.atlas = atlas
    cell.rest()
    assert cell.found is again
    assert cell.instances.labels == (1, 2, 3, 4)
    assert (atlas.annotations.labels(KEPT) == edited).all()
    assert (cell.labels == again.labels).all()


def test_everything_is_exported_as_edited_and_segment_again_asks_before(
    cell: Protruding, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell.instances.select([1, 2])
    cell.press("merge")
    cell.dock.export(tmp_path / "out")
    cell.qtbot.waitUntil(lambda: cell.dock._exporting is None, timeout=SECONDS)
    table = pd.read_csv(tmp_path / "out" / "protrusions.csv")
    assert tuple(table["label"]) == (1, 3, 4)
    meshes = {path.name for path in (tmp_path / "out" / "meshes").rglob("*.ply")}
    assert meshes == {"cortex.ply", *(f"protrusion_{n}.ply" for n in (1, 3, 4))}
    assert "Wrote" in cell.dock.count.text()
    # To segment again asks before the edits are lost.
    bar, asked = cell.dock.edit_bar, []
    runs: list[str] = []
    monkeypatch.setattr(session_of(cell.viewer), "run", lambda until: runs.append(until))
    monkeypatch.setattr(session_of(cell.viewer), "blocked", lambda: "")
    monkeypatch.setattr(bar, "asked", lambda: bool(asked.append(1)))
    bar.update_buttons()
    cell.press("again")
    assert asked
    assert not runs
    monkeypatch.setattr(bar, "asked", lambda: True)
    cell.press("again")
    assert runs == ["protrusions"]
    assert "protrusions" not in session_of(cell.viewer).pipeline.kept


def test_a_project_brings_edits_and_selection_back(
    make_napari_viewer: Any, qtbot: Any, cell: Protruding, tmp_path: Path
) -> None:
    cell.instances.select([1, 2])
    cell.press("merge")
    cell.dock.show_columns(["solidity"])
    cell.instances.set_filter(Filter(column="volume_um3", low=0.01))
    cell.instances.select([3])
    path = saving(session_of(cell.viewer), cell.viewer, tmp_path / "cell.unwrap3d")()
    edited = cell.labels
    viewer = make_napari_viewer()
    open_project(viewer, path)
    session = session_of(viewer)
    qtbot.waitUntil(lambda: session.atlas is not None, timeout=SECONDS)
    instances = instances_of(viewer)
    qtbot.waitUntil(lambda: instances.selection == (3,), timeout=SECONDS)
    qtbot.waitUntil(lambda: not instances.busy, timeout=SECONDS)
    assert instances.edited
    assert instances.labels == (1, 3, 4)
    assert (session.atlas.annotations.labels(NAME) == edited).all()
    assert instances.columns == ("label", "solidity")
    assert instances.filter == Filter(column="volume_um3", low=0.01)
    assert not instances.reason()
