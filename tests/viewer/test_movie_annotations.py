"""Drawing on a movie: the same on all timepoints, or on one only."""

from __future__ import annotations

from typing import Any

import mouse
import numpy as np
import pytest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from napari_unwrap3d import load_movie
from napari_unwrap3d.motion.movie import Movie
from napari_unwrap3d.textured import COVER
from napari_unwrap3d.viewer.annotations.widget import AnnotationWidget
from viewer.hand import follow
from viewer.playing import Projector

NAME = "drawn"


class Drawer:
    """A hand that draws on a movie."""

    def __init__(self, projector: Projector) -> None:
        self.projector = projector
        self.widget = AnnotationWidget(projector.viewer)
        projector.viewer.window.add_dock_widget(self.widget, name="Annotations")
        self.annotating = self.widget.annotating
        self.annotations = self.annotating.annotations
        self.widget.list.name_box.setEditText(NAME)
        self.widget.list.add_button.click()
        projector.wait(lambda: projector.layers.texture is not None)
        projector.wait(lambda: self.annotating.layers.layer(NAME, "uv") is not None)

    @property
    def image(self) -> np.ndarray:
        return self.annotations.image(NAME, "uv")

    def use(self, tool: str) -> None:
        self.widget.tools[tool].click()
        painter = self.annotating.painter
        self.projector.wait(lambda: painter.ready(self.projector.cell))

    def drag(self, native: Any, places: list[tuple[float, float]]) -> None:
        projector = self.projector
        model = projector.viewer if native is projector.main else projector.canvas.model
        mouse.drag(native, places, lambda move: follow(model, projector.qtbot, move))
        self.settle()

    def settle(self) -> None:
        layer = self.annotating.layers.layer(NAME, "uv")
        self.projector.wait(lambda: not layer._pending)
        self.projector.wait(lambda: not self.projector.layers._timer.isActive())

    def look_at_the_cell(self) -> None:
        """Bring the cell into the middle of the main canvas."""
        camera = self.projector.viewer.scene.camera
        camera.center = tuple(self.projector.cell.extent.world.mean(axis=0))
        camera.zoom = 40.0

    def covered(self) -> np.ndarray:
        """Which pixels of the texture have the colour of the label."""
        texture = self.projector.layers.texture
        assert texture is not None
        base = texture._base.reshape(*self.image.shape, 3)
        shown = texture.pixels[:, : self.image.shape[1]].astype(float)
        colour = np.array(self.annotating.style(NAME)[0][1][:3])
        expected = base + COVER * (255 * colour - base)
        changed = np.abs(shown - base).max(axis=2) > 1
        assert (np.abs(shown - expected).max(axis=2)[changed] <= 1).all()
        return changed


@pytest.fixture
def drawer(projector: Projector) -> Drawer:
    return Drawer(projector)


def test_what_is_drawn_in_uv_is_on_the_surface_of_every_timepoint_and_the_other_way(
    drawer: Drawer,
) -> None:
    drawer.use("brush")
    drawer.drag(drawer.projector.second, [(0.4 + 0.02 * k, 0.5) for k in range(6)])
    drawn = drawer.image
    assert (drawn == 1).sum() > 10
    for timepoint in (0, 2, 1):
        drawer.projector.go_to(timepoint)
        assert (drawer.covered() == (drawn == 1)).all()
        layer = drawer.projector.cell
        assert layer.texture is drawer.projector.layers.texture.pixels
        assert len(layer.texcoords) == len(layer.vertices) == len(layer.vertex_colors)
    QTest.keyClick(drawer.projector.second, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    drawer.settle()
    assert not drawer.image.any()
    # The brush on the surface draws in uv.
    projector = drawer.projector
    projector.go_to(1)
    projector.settle()
    drawer.look_at_the_cell()
    drawer.use("brush")
    before = projector.viewer.scene.camera.angles
    drawer.drag(projector.main, [(0.46 + 0.02 * k, 0.5) for k in range(5)])
    drawn = drawer.image == 1
    assert drawn.sum() > 5
    assert projector.viewer.scene.camera.angles == before
    assert (drawer.covered() == drawn).all()
    # It is where the stroke was: over the middle of the canvas.
    frame = projector.movie.frame(1)
    middle = np.mean(frame.surface.vertices, axis=0)
    view = np.asarray(projector.viewer.scene.camera.view_direction)
    seen = frame.surface.vertices[_under(frame, drawn)] - middle
    assert (seen @ view < 0).mean() > 0.9
    QTest.keyClick(projector.main, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    drawer.settle()
    assert not drawer.image.any()


def test_this_timepoint_only(drawer: Drawer) -> None:
    projector = drawer.projector
    drawer.use("brush")
    box = drawer.widget.list.time_box
    assert box.isVisible()
    QTest.mouseClick(box, Qt.MouseButton.LeftButton, pos=QPoint(8, box.height() // 2))
    assert drawer.annotations.times.one_by_one(NAME)
    drawer.drag(projector.second, [(0.4 + 0.02 * k, 0.5) for k in range(6)])
    first = drawer.image
    assert first.any()
    projector.go_to(2)
    drawer.settle()
    assert not drawer.image.any()
    assert not drawer.covered().any()
    assert not drawer.annotating.layers.layer(NAME, "uv").data.any()
    drawer.drag(projector.second, [(0.6, 0.3 + 0.02 * k) for k in range(6)])
    second = drawer.image
    assert second.any()
    projector.go_to(0)
    drawer.settle()
    assert (drawer.image == first).all()
    assert (drawer.covered() == (first == 1)).all()
    # Undo takes back the last stroke, and shows where.
    QTest.keyClick(projector.second, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    projector.wait(lambda: projector.session.timepoint == 2)
    drawer.settle()
    assert not drawer.image.any()
    assert (drawer.annotations.times.image(NAME, 0) == first).all()


def test_it_is_saved_with_the_movie_and_at_the_end_of_the_window(
    drawer: Drawer, tmp_path: Any
) -> None:
    projector = drawer.projector
    drawer.annotations.times.set_one_by_one(NAME, True)
    drawer.annotations.draw(NAME, "uv", (np.array([5, 6]), np.array([7, 7])), 1)
    projector.go_to(3)
    drawer.annotations.draw(NAME, "uv", (np.array([9]), np.array([2])), 2)
    drawer.annotations.add("static")
    drawer.annotations.draw("static", "uv", (np.array([3]), np.array([3])), 1)
    images = {t: drawer.annotations.times.image(NAME, t) for t in range(len(projector.movie))}
    path = projector.movie.save(tmp_path / "saved")
    for movie in (load_movie(path), Movie.open(projector.movie.folder.path)):
        there = movie.common.annotations
        assert set(there.names) == {NAME, "static"}
        assert there.times.drawn(NAME) == (0, 3)
        for timepoint, image in images.items():
            assert (there.times.image(NAME, timepoint) == image).all()
        assert there.image("static", "uv")[3, 3] == 1
    # The end of the window saves what is new, too.
    projector.go_to(2)
    drawer.annotations.draw(NAME, "uv", (np.array([5, 6]), np.array([7, 7])), 1)
    projector.session.set_movie(None)
    there = Movie.open(projector.movie.folder.path).common.annotations
    assert there.times.drawn(NAME) == (0, 2, 3)


def _under(frame: Any, drawn: np.ndarray) -> np.ndarray:
    """The vertices of a frame under drawn pixels."""
    place = frame.topography[:, 1:]
    v, u = np.rint(np.nan_to_num(place)).astype(int).T
    inside = drawn[np.clip(v, 0, len(drawn) - 1), u % drawn.shape[1]]
    return np.flatnonzero(inside & ~frame.outside)
