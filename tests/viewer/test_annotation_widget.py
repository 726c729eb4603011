"""The dock of annotations, with its window."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QEvent, QPoint, QPointF, Qt
from qtpy.QtGui import QEnterEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.fields import CURVATURE, HEIGHT
from napari_unwrap3d.viewer.annotations.arrows import AXIS
from napari_unwrap3d.viewer.annotations.regions import RegionsBox
from napari_unwrap3d.viewer.annotations.widget import (
    NO_ANNOTATION,
    NO_CELL,
    TOOL_TEXTS,
    AnnotationWidget,
)
from napari_unwrap3d.viewer.files.view_state import show_view, view_of
from napari_unwrap3d.viewer.files.writers import write_surface
from napari_unwrap3d.viewer.steps.computing import Outcome
from napari_unwrap3d.viewer.views.layers import COPIES, KEY
from viewer.opened import SECONDS, open_atlas

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier


@pytest.fixture
def opened(make_napari_viewer: Any, small_atlas: Any, qtbot: Any) -> Any:
    """A window with the small cell, and the dock with one annotation."""
    atlas = small_atlas.replaced()
    # Nothing here is about the direct chart, which would take seconds.
    object.__setattr__(atlas, "quality", {**atlas.quality, "direct": {"reason": "not wanted"}})
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, atlas, qtbot, names=("surface", "mask", "uv"))
    widget = AnnotationWidget(viewer)
    viewer.window.add_dock_widget(widget, name="Annotations")
    widget.list.add_button.click()
    layers = widget.annotating.layers
    qtbot.waitUntil(lambda: layers.layer("out of focus", "uv") is not None, timeout=SECONDS)
    return viewer, canvas, widget, atlas.annotations


def test_without_a_cell_it_says_so(make_napari_viewer: Any) -> None:
    widget = AnnotationWidget(make_napari_viewer())
    assert widget.message.text() == NO_CELL
    assert not widget.list.add_button.isEnabled()
    assert not any(button.isEnabled() for button in widget.tools.values())
    widget.deleteLater()


def test_the_tools_and_the_list(opened: Any, qtbot: Any, errors: list[str]) -> None:
    _, canvas, widget, _ = opened
    layer = widget.annotating.layers.layer("out of focus", "uv")
    modes = {"look": "pan_zoom", "brush": "paint", "erase": "erase", "fill": "fill"}
    assert set(modes) < set(TOOL_TEXTS)
    for tool, mode in modes.items():
        widget.tools[tool].click()
        assert layer.mode == mode
        assert canvas.model.layers.selection.active is layer
    widget.label_box.setValue(7)
    assert layer.selected_label == 7
    layer.selected_label = 3
    assert widget.label_box.value() == 3
    sizes = []
    for radius in (0.5, 1.0):
        widget.radius_box.setValue(radius)
        sizes.append(layer.brush_size)
    assert 1 < sizes[0] < sizes[1]
    widget.overhang_box.setCurrentIndex(1)
    assert widget.annotating.annotations.overhang == "outermost"
    # The list.
    annotations = opened[-1]
    listed, annotating = widget.list, widget.annotating
    assert annotations.names == ("out of focus",)
    assert listed.name_box.currentText() == "cell bottom"
    listed.add_button.click()
    assert annotations.names == ("out of focus", "cell bottom")
    assert annotating.current == "cell bottom"
    qtbot.waitUntil(lambda: annotating.layers.layer("cell bottom", "uv") is not None)
    # Each has a colour of its own, the same in every view.
    colours = [annotating.style(name)[0][1] for name in annotations.names]
    assert colours[0] != colours[1]
    layer = annotating.layers.layer("cell bottom", "uv")
    np.testing.assert_allclose(layer.colormap.map(1), colours[1], atol=0.01)
    annotating.set_colour("cell bottom", 1, (1.0, 0.0, 0.0, 1.0))
    np.testing.assert_allclose(layer.colormap.map(1), (1, 0, 0, 1), atol=0.01)
    # A taken name is an error in words, and changes nothing.
    listed.list.item(1).setText("out of focus")
    assert len(errors) == 1
    assert listed.list.item(1).text() == "cell bottom"
    listed.list.item(1).setText("the glass")
    assert annotations.names == ("out of focus", "the glass")
    assert annotating.layers.layer("the glass", "uv") is layer
    assert layer.name == "the glass"
    listed.list.item(1).setCheckState(Qt.CheckState.Unchecked)
    assert not layer.visible
    listed.delete_button.click()
    assert annotations.names == ("out of focus",)
    assert layer not in canvas.model.layers
    widget.undo_button.click()
    assert annotations.names == ("out of focus", "the glass")
    listed.list.setCurrentRow(1)
    for _ in range(2):
        listed.delete_button.click()
    assert widget.message.text() == NO_ANNOTATION


def test_a_half_space_and_a_box_follow_their_form(opened: Any) -> None:
    _, _, widget, annotations = opened
    regions, z = widget.regions, widget.annotating.atlas.surface.vertices[:, 0]
    regions.add_button.click()
    name = "out of focus"
    assert ((annotations.labels(name) == 1) == (z >= regions.region().vertices[0, 0])).all()
    regions.position.setValue(float(z.mean()))
    assert len(annotations.shapes(name, "volume")) == 1
    position = annotations.shapes(name, "volume")[0].vertices[0, 0]
    assert ((annotations.labels(name) == 1) == (z >= position)).all()
    regions.remove_button.click()
    assert not annotations.labels(name).any()
    # A dock that is opened later proposes a place in the cell, too.
    later = RegionsBox(widget.annotating)
    assert z.min() < later.position.value() < z.max()
    later.deleteLater()
    # A box is previewed, added, and follows its form.
    viewer = opened[0]
    vertices = widget.annotating.atlas.surface.vertices
    translate = viewer.layers["surface"].translate

    def box_seen() -> Any:
        corners = regions.preview.segments.reshape(-1, 3) - translate
        return corners.min(axis=0), corners.max(axis=0)

    # The pointer may happen to be in the form.
    QApplication.sendEvent(regions, QEvent(QEvent.Type.Leave))
    assert not len(regions.preview.segments)
    middle = QPointF(regions.rect().center())
    QApplication.sendEvent(regions, QEnterEvent(middle, middle, middle))
    low, _ = box_seen()
    assert low[0] == pytest.approx(regions.position.value())
    regions.kind_box.setCurrentText("box")
    low, high = box_seen()
    # Its spin boxes have two decimals.
    assert np.abs(low - vertices.min(axis=0)).max() < 0.01
    assert not annotations.labels(name).any()
    regions.corners[1][2].setValue(float(vertices[:, 2].mean()))
    low, high = box_seen()
    assert high[2] == pytest.approx(vertices[:, 2].mean(), abs=0.01)
    regions.add_button.click()
    inside = ((vertices >= low) & (vertices <= high)).all(axis=1)
    assert 0 < inside.sum() < len(vertices) / 2
    assert ((annotations.labels(name) == 1) == inside).all()
    regions.corners[1][0].setValue(float(vertices[:, 0].mean()))
    assert len(annotations.shapes(name, "volume")) == 1
    low, high = box_seen()
    assert (
        (annotations.labels(name) == 1) == ((vertices >= low) & (vertices <= high)).all(1)
    ).all()
    widget.tools["brush"].click()
    assert not len(regions.preview.segments)
    regions.remove_button.click()
    assert not annotations.labels(name).any()


def test_a_label_is_measured_fitted_and_exported(
    opened: Any, qtbot: Any, tmp_path: Path, errors: list[str]
) -> None:
    viewer, _, widget, annotations = opened
    measures, name = widget.measures, "out of focus"
    measures.fit()
    assert len(errors) == 1
    vertices = widget.annotating.atlas.surface.vertices
    annotations.draw_vertices(name, np.flatnonzero(vertices[:, 0] < vertices[:, 0].min() + 0.3), 1)
    qtbot.waitUntil(lambda: measures.table.rowCount() == 1, timeout=SECONDS)
    area = widget.annotating.atlas.elements("surface")[annotations.labels(name) == 1].sum()
    assert float(measures.table.item(0, 2).text()) == pytest.approx(area, rel=1e-3)
    measures.plane_button.click()
    normal = viewer.layers[f"normal of {name}"].data[0, 1]
    assert abs(normal[0]) > 0.9 * np.linalg.norm(normal)
    assert normal[0] < 0
    # The normal becomes the axis, which is a step of its own to undo.
    assert not measures.axis_text.text()
    measures.axis_button.click()
    np.testing.assert_allclose(annotations.axis, normal / np.linalg.norm(normal))
    assert "0." in measures.axis_text.text()
    qtbot.waitUntil(lambda: AXIS in viewer.layers)
    np.testing.assert_allclose(np.cross(viewer.layers[AXIS].data[0, 1], normal), 0, atol=1e-5)
    measures.clear_button.click()
    qtbot.waitUntil(lambda: AXIS not in viewer.layers)
    assert annotations.axis is None
    assert not measures.axis_text.text()
    widget.undo_button.click()
    assert annotations.axis is not None
    assert measures.axis_text.text()
    # One mean is shown, so that the table is as wide as the dock.
    table, means = measures.table, measures.mean_box
    assert table.columnCount() == 4
    assert "weighted by area" in table.horizontalHeaderItem(3).toolTip()
    titles = [means.itemText(row) for row in range(means.count())]
    assert {"Mean curvature (1/µm)", "Height d (µm)"} <= set(titles)
    area, chosen = widget.annotating.atlas.elements("surface"), annotations.labels(name) == 1
    for title, field in (("Mean curvature (1/µm)", CURVATURE), ("Height d (µm)", HEIGHT)):
        means.setCurrentText(title)
        values = widget.annotating.atlas.surface.fields[field]
        mean = np.average(values[chosen], weights=area[chosen])
        assert float(table.item(0, 3).text()) == pytest.approx(mean, rel=1e-3)
    header = table.horizontalHeader()
    qtbot.waitUntil(lambda: header.length() <= table.width())
    measures.export(tmp_path / "out")
    qtbot.waitUntil(lambda: measures._exporting is None, timeout=SECONDS)
    assert (tmp_path / "out" / "labels.csv").exists()


def test_a_textured_mesh_is_written_whole_and_shapes_stay_shapes(
    opened: Any, qtbot: Any, tmp_path: Path
) -> None:
    from napari_unwrap3d.files.meshes import read_mesh

    viewer, _, widget, _ = opened
    layer = viewer.layers["surface"]
    texturing = widget.annotating.texturing
    qtbot.waitUntil(lambda: texturing.texture_of(layer) is not None, timeout=SECONDS)
    assert COPIES in layer.metadata[KEY]
    data, attributes, _ = layer.as_layer_data_tuple()
    write_surface(str(tmp_path / "mesh.ply"), data, attributes)
    mesh = read_mesh(tmp_path / "mesh.ply")
    assert mesh.faces.shape == widget.annotating.atlas.surface.faces.shape
    assert mesh.vertices.shape == widget.annotating.atlas.surface.vertices.shape
    # Shapes stay shapes.
    _, canvas, widget, annotations = opened
    name = "out of focus"
    widget.label_box.setValue(2)
    widget.regions.shapes_button.click()
    layer = widget.annotating.shapes.layer(name, "uv")
    native = canvas.qt_viewer.canvas.native
    layer.mode = "add_rectangle"
    layer.add_rectangles(np.array([[20.0, 30.0], [20, 50], [40, 50], [40, 30]]))
    assert len(annotations.shapes(name, "uv")) == 1
    image = annotations.image(name, "uv")
    assert (image[22:38, 32:48] == 2).all()
    layer.selected_data = {0}
    layer.remove_selected()
    assert annotations.shapes(name, "uv") == ()
    assert not annotations.labels(name).any()
    widget.undo_button.click()
    assert len(layer.data) == 1
    assert (annotations.image(name, "uv") == image).all()
    # With the mouse: three corners, and the first one again.
    layer.mode = "add_polygon"
    for x, y in ((0.6, 0.3), (0.7, 0.3), (0.7, 0.6)):
        place = QPoint(round(x * native.width()), round(y * native.height()))
        QTest.mouseClick(native, LEFT, NONE, place)
    QTest.keyClick(native, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: len(annotations.shapes(name, "uv")) == 2)
    assert annotations.shapes(name, "uv")[1].kind == "polygon"
    # A hint is no work.
    canvas.show_chart("topography")
    widget.regions.shapes_button.click()
    assert "uv, direct and plane" in widget.message.text()
    assert widget.busy.isHidden()


def test_slices_of_the_stack_are_drawn_on_where_the_mask_is(opened: Any, qtbot: Any) -> None:
    viewer, _, widget, annotations = opened
    widget.slices.setChecked(True)
    layers = widget.annotating.layers
    qtbot.waitUntil(lambda: layers.layer("out of focus", "volume") is not None, timeout=SECONDS)
    layer, mask = layers.layer("out of focus", "volume"), viewer.layers["mask"]
    assert viewer.dims.ndisplay == 2
    np.testing.assert_allclose(layer.scale, mask.scale)
    np.testing.assert_allclose(layer.translate, mask.translate)
    assert [str(unit) for unit in viewer.layers.units] == ["micrometer"] * 3
    middle = np.array(mask.data.shape) // 2
    layer.brush_size = 2 * int(max(mask.data.shape))
    layer.paint(tuple(middle), 1)
    slab = annotations.labels("out of focus") == 1
    z = widget.annotating.atlas.mask.to_index(widget.annotating.atlas.surface.vertices)[:, 0]
    assert slab.any()
    assert (np.abs(z[slab] - middle[0]) <= 1.0).all()
    widget.slices.setChecked(False)
    assert not layer.visible


def test_another_run_keeps_what_was_drawn_and_colours_come_back(opened: Any, qtbot: Any) -> None:
    viewer, canvas, widget, annotations = opened
    annotations.draw_vertices("out of focus", np.arange(300), 3)
    annotations.axis = (-1.0, 0.0, 0.0)
    session, old = canvas.session, widget.annotating.atlas
    again = type(old)(
        **{name: getattr(old, name) for name in ("sealed", "reference", "sphere")},
        surface=replace(old.surface, vertices=old.surface.vertices.copy()),
        uv=old.uv,
        topography=old.topography,
        mask=old.mask,
        quality=old.quality,
    )
    session.turns.add(session._end(Outcome(atlas=again)))
    qtbot.waitUntil(lambda: widget.annotating.atlas is again, timeout=SECONDS)
    assert again.annotations.names == ("out of focus",)
    assert again.annotations.axis == (-1.0, 0.0, 0.0)
    assert "-1.000" in widget.measures.axis_text.text()
    qtbot.waitUntil(lambda: AXIS in viewer.layers)
    assert (again.annotations.labels("out of focus") == annotations.labels("out of focus")).all()
    layers = widget.annotating.layers
    qtbot.waitUntil(lambda: layers.layer("out of focus", "uv") is not None, timeout=SECONDS)
    assert layers.layer("out of focus", "uv").annotations is again.annotations
    # Colours, and what is hidden, come back.
    annotating, annotations = widget.annotating, again.annotations
    for name in ("first", "second"):
        annotations.add(name)
    annotations.remove("out of focus")
    annotating.set_visible("second", False)
    before = {name: annotating.style(name) for name in annotations.names}
    assert not before["second"][1]
    view = json.loads(json.dumps(view_of(viewer)))
    annotating.set_visible("second", True)
    annotating.restore({"hidden": [], "first_colours": {"first": 0, "second": 5}})
    assert annotating.style("second")[0] != before["second"][0]
    show_view(viewer, view)
    assert {name: annotating.style(name) for name in annotations.names} == before
    for nonsense in ({"hidden": 3, "first_colours": {}}, {"hidden": [], "first_colours": [1]}):
        show_view(viewer, {"annotations": nonsense})
        assert {name: annotating.style(name) for name in annotations.names} == before
