"""Brush, eraser and lasso on the meshes of the main canvas.

Dragging on a mesh draws, and the camera stays; dragging beside it turns the view as ever.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject, QPointF, Qt
from qtpy.QtGui import QPainter, QPen, QPolygonF
from qtpy.QtWidgets import QWidget

from ...charts import Floats, Ints
from ...geometry.brush import Brush, lasso
from ...geometry.mesh import vertex_normals
from ...geometry.picking import RayPicker
from ..common.threads import Task, tell
from ..views.layers import FRAME
from ..views.placing import chart_of
from .brush_circle import BrushCircle

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer

    from .annotating import Annotating

LOOK, BRUSH, ERASE, LASSO, FILL = "look", "brush", "erase", "lasso", "fill"
POINT = "point"
TOOLS = (LOOK, BRUSH, ERASE, LASSO, FILL, POINT)
# Filling is for images.
ON_MESHES = (BRUSH, ERASE, LASSO)
PAINTED = ("surface", "reference", "sphere", FRAME)
ERASING_KEY = "Shift"
# Between two mouse events the brush is put down this often per radius, but not oftener
# than this.
DABS_PER_RADIUS, MOST_DABS = 2.0, 64
CLOSE_SECONDS = 5.0


@dataclass(frozen=True, eq=False)
class MeshTools:
    """What is needed to draw on one mesh."""

    picker: RayPicker
    brush: Brush
    normals: Floats


def make_tools(layer: Layer, vertices: Floats, faces: Ints) -> tuple[Layer, MeshTools]:
    """The tools of a layer; takes a second or two for a large mesh."""
    normals = vertex_normals(vertices, faces)
    return layer, MeshTools(RayPicker(vertices, faces), Brush(vertices, faces), normals)


def find_inside(
    layer: Layer, label: int, picker: RayPicker, outline: Floats, directions: Floats
) -> tuple[Layer, int, Ints]:
    """What a lasso of a label on a layer is around."""
    return layer, label, lasso(picker, outline, directions)


@dataclass(frozen=True, eq=False)
class Hit:
    """The place of a mesh that is under the mouse.

    Attributes
    ----------
    layer : Surface
    face : int
    point : ndarray, (3,)
        In the layer's own coordinates.
    """

    layer: Any
    face: int
    point: Floats


class SurfacePainter(QObject):
    """Draws on the meshes of a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    annotating : Annotating
        Which annotation, label, tool and radius.
    """

    def __init__(self, viewer: ViewerModel, annotating: Annotating) -> None:
        super().__init__(annotating)
        self._viewer = weakref.ref(viewer)
        self.annotating = annotating
        self._tools: dict[Layer, MeshTools] = {}
        self._making: dict[Layer, Task] = {}
        self._lassoing: Task | None = None
        self._outline: Outline | None = None
        self._closed = False
        self.circle = BrushCircle(viewer, self)
        viewer.mouse_drag_callbacks.append(self.drag)

    def close(self) -> None:
        """Leave nothing behind in the viewer, and no thread."""
        if self._closed:
            return
        self._closed = True
        self.circle.close()
        viewer = self._viewer()
        if viewer is not None and self.drag in viewer.mouse_drag_callbacks:
            viewer.mouse_drag_callbacks.remove(self.drag)
        tasks = [*self._making.values(), *([self._lassoing] if self._lassoing else [])]
        for task in tasks:
            task.wait(CLOSE_SECONDS)
        if self._outline is not None:
            self._outline.deleteLater()
            self._outline = None

    def forget(self, mesh: str = "") -> None:
        """The meshes are others now: all of them, or one."""
        for known in (self._tools, self._making):
            for layer in [each for each in known if mesh in ("", chart_of(each))]:
                known.pop(layer)
        self.circle.hide()

    def ready(self, layer: Layer) -> bool:
        """Whether a layer can be drawn on."""
        return layer in self._tools

    def prepare(self) -> None:
        """Make what is needed to draw on the meshes that are seen, in threads."""
        for layer in self._layers():
            if layer not in self._tools and layer not in self._making:
                faces = self.annotating.faces(chart_of(layer))
                vertices = np.array(layer.data[0][: int(faces.max()) + 1], np.float64)
                task = self._making[layer] = Task(make_tools, layer, vertices, faces)
                task.returned.connect(partial(self._on_made, faces))
                task.failed.connect(self._on_failed)
                task.start()

    def _on_made(self, faces: Ints, made: tuple[Layer, MeshTools]) -> None:
        layer, tools = made
        # What was begun for a mesh that is gone is not waited for any more.
        if layer in self._making and faces is self.annotating.faces(chart_of(layer)):
            del self._making[layer]
            self._tools[layer] = tools

    def _on_failed(self, error: BaseException) -> None:
        if not self._closed:
            tell(error)

    def _layers(self) -> list[Layer]:
        viewer = self._viewer()
        if viewer is None:
            return []
        return [
            layer
            for layer in viewer.layers
            if layer.visible and chart_of(layer) in PAINTED and self.annotating.shows(layer)
        ]

    # Picking -------------------------------------------------------------------------

    def pick(self, position: npt.ArrayLike, direction: npt.ArrayLike) -> Hit | None:
        """What is seen along a line of sight, given in world coordinates."""
        best: tuple[float, Hit] | None = None
        for layer in self._layers():
            if layer not in self._tools:
                continue
            origin, along = _in_layer(layer, np.asarray(position), np.asarray(direction))
            hits = self._tools[layer].picker.pick_many(origin[None], along[None])
            if len(hits.line):
                # The same line in all layers, so that its parameter tells which is before.
                depth = float((hits.points[0] - origin) @ along / (along @ along))
                if best is None or depth < best[0]:
                    best = depth, Hit(layer, int(hits.face[0]), hits.points[0])
        return None if best is None else best[1]

    def normal(self, layer: Layer, face: int) -> Floats:
        """The direction out of a mesh (in the layer's coordinates) at one of its faces."""
        tools = self._tools[layer]
        normal: Floats = tools.normals[tools.picker.faces[face]].sum(axis=0)
        return normal if normal.any() else np.array([1.0, 0.0, 0.0])

    # Drawing -------------------------------------------------------------------------

    def drag(self, viewer: ViewerModel, event: Any) -> Iterator[None]:
        """Called by napari when a mouse button goes down."""
        tool = self.annotating.tool
        if tool == POINT and event.button == 1 and len(event.dims_displayed) == 3:
            yield from self._click(event)
            return
        if tool not in ON_MESHES or event.button != 1 or len(event.dims_displayed) != 3:
            return
        hit = self.pick(event.position, event.view_direction)
        if hit is None or not self.annotating.current:
            return
        label = self.annotating.label
        if tool == ERASE or ERASING_KEY in event.modifiers:
            label = 0
        camera = viewer.scene.camera
        moves, camera.mouse_pan = camera.mouse_pan, False
        try:
            # The canvas moves no camera and selects nothing with what we use.
            event.handled = True
            with self.annotating.annotations.stroke():
                drawing = self._go_around if tool == LASSO else self._paint
                yield from drawing(hit.layer, label, event)
        finally:
            camera.mouse_pan = moves
            # A stroke that the end of the window cut short ends when it is forgotten.
            if not self._closed:
                self.annotating.edited.emit()

    def _click(self, event: Any) -> Iterator[None]:
        """Set a point where the surface is clicked; a drag turns the view."""
        hit = self.pick(event.position, event.view_direction)
        yield
        if hit is not None and event.type != "mouse_move":
            if chart_of(hit.layer) == "surface":
                self.annotating.points.add(hit.point, "surface")
            else:
                self.annotating.told.emit("Points are set on the surface, or in an image.")

    def _paint(self, layer: Layer, label: int, event: Any) -> Iterator[None]:
        last = self._dab(layer, label, event, None)
        yield
        while event.type == "mouse_move":
            last = self._dab(layer, label, event, last)
            yield

    def _dab(
        self, layer: Layer, label: int, event: Any, last: tuple[Floats, Floats] | None
    ) -> tuple[Floats, Floats]:
        """Put the brush down from where it was last to where it is now."""
        now = _in_layer(layer, np.asarray(event.position), np.asarray(event.view_direction))
        tools = self._tools.get(layer)
        if tools is None:
            # Another timepoint was shown in the midst of the stroke.
            return now
        radius = self.annotating.radius_um / float(np.mean(np.abs(layer.scale[-3:])))
        start = now if last is None else last
        way = float(np.linalg.norm(now[0] - start[0]))
        count = min(int(np.ceil(way * DABS_PER_RADIUS / radius)), MOST_DABS) if way else 1
        share = np.linspace(0.0, 1.0, count + 1)[1:, None]
        lines = [start[k] + share * (now[k] - start[k]) for k in (0, 1)]
        hits = tools.picker.pick_many(*lines)
        if len(hits.line):
            self._mark(layer, tools.brush.vertices(hits.face, hits.points, radius), label)
            self.circle.show(layer, int(hits.face[-1]), hits.points[-1])
        return now

    def _mark(self, layer: Layer, vertices: Ints, label: int) -> None:
        annotations, name = self.annotating.annotations, self.annotating.current
        if len(vertices) == 0:
            return
        if chart_of(layer) == FRAME:
            # A place of the movie is its (v, u).
            assert self.annotating.frame is not None
            annotations.draw(name, "uv", self.annotating.frame.pixels_under(vertices), label)
            return
        if chart_of(layer) == "surface":
            annotations.draw_vertices(name, vertices, label)
        else:
            annotations.draw(name, chart_of(layer), (vertices,), label)

    def _go_around(self, layer: Layer, label: int, event: Any) -> Iterator[None]:
        lines = [_in_layer(layer, np.asarray(event.position), np.asarray(event.view_direction))]
        outline = self._show_outline()
        outline.add(event.pos)
        yield
        while event.type == "mouse_move":
            lines.append(
                _in_layer(layer, np.asarray(event.position), np.asarray(event.view_direction))
            )
            outline.add(event.pos)
            yield
        outline.clear()
        self._lassoing = Task(
            find_inside,
            layer,
            label,
            self._tools[layer].picker,
            np.array([origin for origin, _ in lines]),
            np.array([along for _, along in lines]),
        )
        self._lassoing.returned.connect(self._on_lassoed)
        self._lassoing.failed.connect(self._on_failed)
        self._lassoing.start()

    def _on_lassoed(self, found: tuple[Layer, int, Ints]) -> None:
        layer, label, vertices = found
        self._lassoing = None
        if not self._closed and self.annotating.current:
            self._mark(layer, vertices, label)
            self.annotating.edited.emit()

    def _show_outline(self) -> Outline:
        viewer = self._viewer()
        if self._outline is None and viewer is not None:
            # napari offers no way to draw on the screen itself.
            self._outline = Outline(viewer.window._qt_viewer.canvas.native)
        assert self._outline is not None
        return self._outline


def _in_layer(layer: Layer, position: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """A line of sight (a point and a direction) in the coordinates of a layer."""
    origin = np.asarray(layer.world_to_data(position), dtype=np.float64)[-3:]
    ahead = np.asarray(layer.world_to_data(position + direction), dtype=np.float64)[-3:]
    return origin, ahead - origin


class Outline(QWidget):
    """The line of the lasso, over the canvas."""

    def __init__(self, canvas: QWidget) -> None:
        super().__init__(canvas)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setAttribute(Qt.WidgetAttribute.WA_NoSystemBackground)
        self._points: list[QPointF] = []
        self.hide()

    def add(self, position: npt.ArrayLike) -> None:
        """Go on to a position (x, y) on the canvas."""
        x, y = np.asarray(position, dtype=float)[:2]
        self._points.append(QPointF(float(x), float(y)))
        parent = self.parentWidget()
        if not self.isVisible() and parent is not None:
            self.setGeometry(parent.rect())
            self.show()
        self.update()

    def clear(self) -> None:
        """Show nothing."""
        self._points = []
        self.hide()

    def paintEvent(self, event: Any) -> None:
        """Draw a white line with a dark border, to be seen on anything."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for width, colour in ((3.5, Qt.GlobalColor.black), (1.5, Qt.GlobalColor.white)):
            painter.setPen(QPen(colour, width, Qt.PenStyle.SolidLine))
            painter.drawPolygon(QPolygonF(self._points))
        painter.end()
