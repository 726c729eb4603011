"""Drawing with the mouse, on meshes and images, and what the other views show of it."""

from __future__ import annotations

import mouse
import numpy as np
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from viewer.hand import LEFT, NONE, Hand, covered
from viewer.opened import SECONDS


def test_what_is_drawn_in_uv_is_on_the_meshes_and_each_stroke_is_one_step(hand: Hand) -> None:
    hand.choose("brush")
    hand.drag(hand.second, [(0.4 + 0.02 * k, 0.5) for k in range(6)])
    drawn = hand.uv.data == 1
    assert drawn.sum() > 20
    assert (hand.annotations.image("drawn", "uv") == hand.uv.data).all()
    # Every vertex whose place lies in a drawn pixel, on every sheet, and no other.
    place = hand.atlas.topography.surface[:, 1:]
    rows, columns = drawn.shape
    known = np.isfinite(place).all(axis=1)
    v, u = np.rint(np.where(known[:, None], place, 0.0)).astype(int).T
    inside = known & drawn[np.clip(v, 0, rows - 1), u % columns]
    assert ((hand.labels() == 1) == inside).all()
    assert (covered(hand, "surface") == (hand.annotations.image("drawn", "direct") == 1)).all()
    assert (covered(hand, "reference") == drawn).all()
    # A second stroke, on the surface, is taken back in the main canvas.
    first = hand.labels()
    hand.drag(hand.main, [(0.45 + 0.02 * k, 0.5) for k in range(5)])
    assert (hand.labels() != first).any()
    QTest.keyClick(hand.main, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    hand.settle()
    assert (hand.labels() == first).all()
    assert (hand.annotations.image("drawn", "uv") == hand.uv.data).all()
    # In the second canvas, where the Labels layer is active: one step, not two.
    assert hand.canvas.model.layers.selection.active is hand.uv
    QTest.keyClick(hand.second, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    hand.settle()
    assert not hand.labels().any()
    assert not hand.uv.data.any()
    assert not covered(hand, "surface").any()
    assert hand.annotations.names == ("drawn",)
    both = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
    QTest.keyClick(hand.second, Qt.Key.Key_Z, both)
    hand.settle()
    assert (hand.labels() == first).all()
    assert (covered(hand, "reference") == (hand.uv.data == 1)).all()


def test_a_stroke_over_the_seam_or_a_pole_is_in_all_its_parts(hand: Hand) -> None:
    for where in ("seam", "pole"):
        a_stroke_is_in_all_its_parts(hand, where)
        for _ in range(2):
            hand.widget.undo_button.click()
        hand.settle()
        assert not hand.labels().any()


def a_stroke_is_in_all_its_parts(hand: Hand, where: str) -> None:
    rows, columns = hand.atlas.uv.shape
    v, u = (rows / 2, -0.5) if where == "seam" else (0.0, columns / 4)
    points, _ = hand.atlas.map(np.array([[v, u], [v, u + 1.0]]), "uv", "surface")
    centre = hand.atlas.surface.vertices.mean(axis=0)
    outwards = points[0] - centre
    hand.look_at(points[0], outwards / np.linalg.norm(outwards))
    hand.choose("brush")
    hand.drag(hand.main, [(0.4 + 0.02 * k, 0.5) for k in range(11)])
    hand.drag(hand.main, [(0.5, 0.4 + 0.02 * k) for k in range(11)])
    marked = hand.labels() == 1
    assert marked.sum() > 10
    # Each marked vertex that lies outermost is seen in uv, and so on both sides.
    image = hand.uv.data == 1
    if where == "seam":
        assert image[:, :4].any()
        assert image[:, -4:].any()
        assert not image[:, columns // 4 : -columns // 4].any()
    else:
        turn = np.flatnonzero(image[:3].any(axis=0))
        assert np.ptp(turn) > columns / 2
    assert (image == (hand.annotations.image("drawn", "uv") == 1)).all()
    direct = hand.annotations.image("drawn", "direct") == 1
    assert (covered(hand, "surface") == direct).all()
    owners = np.unique(hand.atlas.direct.owner[direct])
    assert set(owners) <= set(np.flatnonzero(marked))


def test_brush_lasso_and_eraser_on_the_surface_and_what_turns_the_camera(hand: Hand) -> None:
    # Two events far apart mark what a slow stroke marks between them.
    hand.choose("brush")
    hand.drag(hand.main, [(0.42, 0.5), (0.58, 0.5)])
    fast = hand.labels() == 1
    hand.widget.undo_button.click()
    hand.drag(hand.main, [(x, 0.5) for x in np.linspace(0.42, 0.58, 12)])
    slow = hand.labels() == 1
    assert (fast & slow).sum() / (fast | slow).sum() > 0.9
    hand.widget.undo_button.click()
    assert not hand.labels().any()
    # A lasso marks what is seen, the eraser takes some of it away, and shift all of it.
    turn = np.linspace(0, 2 * np.pi, 16)
    ring = [(0.5 + 0.06 * np.cos(t), 0.5 + 0.1 * np.sin(t)) for t in turn]
    hand.choose("lasso", label=2)
    hand.drag(hand.main, ring)
    marked = hand.labels() == 2
    assert marked.sum() > 10
    direction = np.array(hand.viewer.scene.camera.view_direction)
    tools = hand.annotating.painter._tools[hand.viewer.layers["surface"]]
    vertices = np.flatnonzero(marked)
    assert tools.picker.visible(vertices, np.tile(direction, (len(vertices), 1))).all()
    hand.choose("erase")
    hand.drag(hand.main, [(0.48 + 0.01 * k, 0.5) for k in range(5)])
    erased = hand.labels() == 2
    assert 0 < erased.sum() < marked.sum()
    hand.choose("lasso", label=2)
    hand.drag(hand.main, ring, keys=Qt.KeyboardModifier.ShiftModifier)
    assert not hand.labels().any()
    # A stroke keeps the camera; a drag that begins beside the cell, or without a tool, turns it.
    hand.choose("brush")
    camera = hand.viewer.scene.camera
    before = camera.angles, camera.center, camera.zoom
    hand.drag(hand.main, [(0.45 + 0.02 * k, 0.5) for k in range(5)])
    assert (camera.angles, camera.center, camera.zoom) == before
    assert camera.mouse_pan
    marked = hand.labels()
    assert marked.any()
    hand.drag(hand.main, [(0.02 + 0.02 * k, 0.03) for k in range(5)])
    assert camera.angles != before[0]
    assert (hand.labels() == marked).all()
    hand.choose("look")
    angles = camera.angles
    hand.drag(hand.main, [(0.45 + 0.02 * k, 0.5) for k in range(5)])
    assert camera.angles != angles
    assert (hand.labels() == marked).all()


def test_the_brush_shows_its_circle_and_the_mesh_is_as_before_at_the_end(hand: Hand) -> None:
    circle, model = hand.annotating.painter.circle, hand.viewer
    middle, beside = (
        QPoint(hand.main.width() * x // 100, hand.main.height() // 2) for x in (50, 2)
    )

    def point_at(place: QPoint) -> None:
        """Twice, as vispy leaves out events that follow each other too quickly."""
        before = tuple(model.cursor.position)

        def moved() -> bool:
            mouse.move(hand.main, place)
            return tuple(model.cursor.position) != before

        hand.qtbot.waitUntil(moved)

    point_at(middle)
    assert not len(circle.segments)
    hand.choose("brush")
    hand.widget.radius_box.setValue(0.5)
    hit = hand.annotating.painter.pick(model.cursor.position, model.cursor._view_direction)
    corners = circle.segments[:, 0] - hand.viewer.layers["surface"].translate
    np.testing.assert_allclose(np.linalg.norm(corners - hit.point, axis=1), 0.5, atol=1e-6)
    point_at(beside)
    assert not len(circle.segments)
    hand.drag(hand.main, [(0.45 + 0.02 * k, 0.5) for k in range(5)])
    marked = hand.atlas.surface.vertices[hand.labels() == 1]
    centre = circle.segments[:, 0].mean(axis=0) - hand.viewer.layers["surface"].translate
    assert np.linalg.norm(marked - centre, axis=1).min() < 0.5
    hand.choose("look")
    assert not len(circle.segments)
    # Without the annotation the meshes are as they were, and undoing brings it back.
    layer, mesh = hand.viewer.layers["surface"], hand.atlas.surface
    assert len(layer.data[0]) > len(mesh.vertices)
    hand.widget.list.delete_button.click()
    assert len(layer.data[0]) == len(mesh.vertices)
    assert (layer.data[1] == mesh.faces).all()
    assert layer.texture is None
    assert hand.annotating.layers.layer("drawn", "uv") is None
    hand.widget.undo_button.click()
    hand.qtbot.waitUntil(hand._ready, timeout=SECONDS)


def test_lasso_and_brush_on_the_reference_mark_columns(hand: Hand) -> None:
    hand.viewer.layers["surface"].visible = False
    hand.viewer.layers["reference"].visible = True
    hand.choose("lasso", label=2)
    reference = hand.viewer.layers["reference"]
    hand.qtbot.waitUntil(lambda: hand.annotating.painter.ready(reference), timeout=SECONDS)
    turn = np.linspace(0, 2 * np.pi, 12)
    hand.drag(hand.main, [(0.5 + 0.05 * np.cos(t), 0.5 + 0.1 * np.sin(t)) for t in turn])
    assert (hand.uv.data == 2).sum() > 10
    assert (hand.labels() == 2).any()
    assert (covered(hand, "reference", 2) == (hand.uv.data == 2)).all()
    hand.widget.undo_button.click()
    hand.settle()
    assert not hand.labels().any()
    hand.choose("brush")
    hand.drag(hand.main, [(0.48 + 0.01 * k, 0.5) for k in range(5)])
    assert hand.labels().any()
    assert (hand.uv.data == 1).any()
    assert (covered(hand, "reference") == (hand.uv.data == 1)).all()


def test_points_are_set_by_clicks_and_the_topography_marks_where_the_surface_is(hand: Hand) -> None:
    hand.choose("point")
    middle = QPoint(hand.main.width() // 2, hand.main.height() // 2)
    QTest.mouseClick(hand.main, LEFT, NONE, middle)
    points, shown = hand.annotations.points, hand.annotating.points
    assert list(points.positions) == ["point 1"]
    place, _ = points.on("uv")
    np.testing.assert_allclose(shown.layer("uv").data, place)
    second = QPoint(hand.second.width() // 3, hand.second.height() // 2)
    QTest.mouseClick(hand.second, LEFT, NONE, second)
    assert list(points.positions) == ["point 1", "point 2"]
    assert len(shown.layer("surface").data) == 2
    # Moved in the main canvas; dragging with the tool turns the view and sets none.
    angles = hand.viewer.scene.camera.angles
    hand.drag(hand.main, [(0.45 + 0.02 * k, 0.5) for k in range(5)])
    assert hand.viewer.scene.camera.angles != angles
    assert len(points.positions) == 2
    layer = shown.layer("surface")
    layer.selected_data = {0}
    layer.remove_selected()
    assert list(points.positions) == ["point 2"]
    assert len(shown.layer("uv").data) == 1
    hand.widget.undo_button.click()
    assert len(shown.layer("surface").data) == 2
    # Seen over what is drawn; and in a view that is not looked at, none is left over.
    model = hand.canvas.model
    hand.qtbot.waitUntil(lambda: model.layers[-1] is shown.layer("uv"))
    hand.show("topography")
    for name in list(points.positions):
        points.remove(name)
    hand.show("uv")
    assert [len(shown.layer(chart).data) for chart in ("surface", "uv", "topography")] == [0, 0, 0]

    # What is drawn in the topography is where the surface is, in all depths.
    layer = hand.show("topography")
    hand.choose("brush", label=3)
    hand.widget.all_depths.setChecked(True)
    hand.drag(hand.second, [(0.4 + 0.02 * k, 0.5) for k in range(6)])
    assert (hand.labels() == 3).sum() > 10
    assert (layer.data == hand.annotations.image("drawn", "topography")).all()
    assert layer.data.any(axis=(1, 2)).sum() > 1
    hand.widget.undo_button.click()
    hand.settle()
    assert not layer.data.any()
