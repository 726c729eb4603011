"""The linked cursor: the place under the pointer, marked in every view and read out."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject

from ...fields import AREA_DISTORTION, CURVATURE, SIGNAL, Fields
from ...geometry.picking import RayPicker, SpherePicker
from ...motion.frame_places import FramePlaces
from ...motion.shown_frames import ShownFrame
from ...places import Place, Places
from ...unwrapping.surface import same_mesh
from ..common.threads import Task, tell
from .layers import CELL_AT_T, FRAME, KEY, flat_frame, flat_surface
from .markers import CanvasMarks

if TYPE_CHECKING:
    from ...atlas import Atlas
    from .canvas import UnwrappedCanvas

# Layer of the 3D canvas → where a place is in its data.
SHOWN_AT = {
    "surface": "position",
    CELL_AT_T: "on_frame",
    "sealed surface": "position",
    "reference": "reference",
    "sphere": "sphere",
    "sphere (conformal)": "conformal",
    "topographic surface": "topography",
}
# Those that follow the timepoint of a movie.
FOLLOWING = (CELL_AT_T, "topographic surface")
# Fields that are read out whatever is shown, once their values are known.
ALWAYS = (CURVATURE, AREA_DISTORTION, f"{SIGNAL}0")


class LinkedCursor(QObject):
    """Marks the place under the pointer in both canvases.

    Attributes
    ----------
    place : Place or None
        What is under the pointer.
    marks_3d, marks_unwrapped : CanvasMarks
    """

    def __init__(self, viewer: Any, canvas: UnwrappedCanvas) -> None:
        super().__init__(canvas)
        self._viewer = weakref.ref(viewer)
        self._canvas = canvas
        self.place: Place | None = None
        self._places: Places | None = None
        self._pickers: dict[str, _Mesh] = {}
        self._task: Task | None = None
        self._building: Task | None = None
        self._frame: ShownFrame | None = None
        self._frame_rests = False
        self.marks_3d = CanvasMarks(viewer.window._qt_viewer)
        self.marks_unwrapped = CanvasMarks(canvas.qt_viewer)
        canvas.session.finished.connect(self._on_atlas)
        canvas.chart_changed.connect(self.leave)
        viewer.mouse_move_callbacks.append(self._on_move_3d)
        canvas.model.mouse_move_callbacks.append(self._on_move_unwrapped)
        viewer.events.mouse_over_canvas.connect(self._on_over)
        canvas.model.events.mouse_over_canvas.connect(self._on_over)

    # The atlas ------------------------------------------------------------------

    def _on_atlas(self, atlas: Atlas) -> None:
        self.leave()
        self._places = None
        if atlas.has("topography"):
            self._task = Task(_prepare, atlas)
            self._task.returned.connect(self._on_prepared)
            self._task.failed.connect(self._on_failed)
            self._task.start()

    def _on_prepared(self, prepared: tuple[Places, dict[str, _Mesh]]) -> None:
        if prepared[0].atlas is self._canvas.atlas:
            self._places, self._pickers = prepared
            self.show_frame(self._frame)

    # A timepoint of a movie -------------------------------------------------------

    def show_frame(self, frame: ShownFrame | None) -> None:
        """Find places of a timepoint's surface from now on; None: of the atlas's own."""
        if frame is None and self._frame is None:
            return
        self._frame, self._frame_rests = frame, False
        for name in FOLLOWING:
            self._pickers.pop(name, None)
        if self._places is not None:
            atlas = self._places.atlas
            self._places = Places(atlas) if frame is None else FramePlaces(atlas, frame)
        if self.place is not None:
            self.leave()

    def frame_rests(self) -> None:
        """The timepoint is looked at, so that its meshes are worth being made pickable."""
        self._frame_rests = True

    def _on_failed(self, error: BaseException) -> None:
        tell(error)

    @property
    def ready(self) -> bool:
        """Whether a place can be found."""
        return self._places is not None and self._places.atlas is self._canvas.atlas

    # The pointer ----------------------------------------------------------------

    def _on_move_unwrapped(self, model: Any, event: Any) -> None:
        # Leaving is told only after entering was, which a window may miss that opens
        # under the pointer.
        model.mouse_over_canvas = True
        if self.ready and self._canvas.image(self._canvas.chart):
            self.show(self.unwrapped_place(event))

    def _on_move_3d(self, viewer: Any, event: Any) -> None:
        viewer.mouse_over_canvas = True
        if self.ready and viewer.dims.ndisplay == 3:
            self.show(self.place_in_3d(viewer, event))

    def unwrapped_place(self, event: Any) -> Place | None:
        """The place that the second canvas shows under the pointer."""
        if self._places is None or not self.ready or not self._canvas.image(self._canvas.chart):
            return None
        count = 3 if self._canvas.chart == "topography" else 2
        point = np.asarray(event.position, dtype=float)[-count:]
        return self._places.at_pixel(self._canvas.chart, point)

    def _on_over(self, event: Any) -> None:
        if not event.value:
            self.leave()

    def leave(self, _: Any = None) -> None:
        """Nothing is under the pointer."""
        self.show(None)

    def show(self, place: Place | None) -> None:
        """Mark a place in every view, or nothing."""
        self.place = place
        viewer = self._viewer()
        if place is None or viewer is None:
            self.marks_3d.hide()
            self.marks_unwrapped.hide()
            self._canvas.status.setText("")
            return
        self._mark(self.marks_3d, self._in_3d(viewer, place))
        self._mark(self.marks_unwrapped, self._unwrapped(place))
        self._canvas.status.setText(self.read_out(place))

    @staticmethod
    def _mark(marks: CanvasMarks, positions: list[npt.NDArray[np.floating]]) -> None:
        if positions:
            marks.show(positions)
        else:
            marks.hide()

    def _in_3d(self, viewer: Any, place: Place) -> list[npt.NDArray[np.floating]]:
        """Where the place is in the visible meshes of the 3D canvas, in its world."""
        found = {}
        for layer in viewer.layers:
            attribute = SHOWN_AT.get(layer.metadata.get(KEY, {}).get("layer", ""))
            if attribute is None or not layer.visible:
                continue
            point = getattr(place, attribute)
            if point is not None:
                world = point * layer.scale[-3:] + layer.translate[-3:]
                found[tuple(np.round(world, 6))] = world
        return list(found.values())

    def _unwrapped(self, place: Place) -> list[npt.NDArray[np.floating]]:
        chart = self._canvas.chart
        if chart != "topography":
            point = getattr(place, chart)
            return [] if point is None else [point]
        # Over or under a slice the mark is where the place would be in it.
        return [] if place.uv is None else [place.uv]

    # Picking --------------------------------------------------------------------

    def place_in_3d(self, viewer: Any, event: Any) -> Place | None:
        """The place of the visible mesh that is seen first under the pointer."""
        if self._places is None or not self.ready:
            return None
        position = np.asarray(event.position, dtype=float)[-3:]
        direction = np.asarray(event.view_direction, dtype=float)[-3:]
        nearest: tuple[float, _Mesh, npt.NDArray[Any], npt.NDArray[Any]] | None = None
        for layer in viewer.layers:
            name = layer.metadata.get(KEY, {}).get("layer", "")
            if name not in SHOWN_AT or not layer.visible:
                continue
            mesh = self._pickers.get(name)
            if mesh is None and name in FOLLOWING and self._frame and not self._frame_rests:
                continue
            if mesh is None:
                self._build_picker(name)
                continue
            scale, shift = layer.scale[-3:], layer.translate[-3:]
            hit = mesh.picker.pick((position - shift) / scale, direction / scale)
            if hit is None:
                continue
            corners, weights = mesh.faces[hit[0]], hit[1]
            world = weights @ mesh.vertices[corners] * scale + shift
            along = float((world - position) @ direction)
            if nearest is None or along < nearest[0]:
                nearest = (along, mesh, corners, weights)
        if nearest is None:
            return None
        _, mesh, corners, weights = nearest
        if mesh.of is not None:
            corners = mesh.of[corners]
        return self._places.on_mesh(mesh.chart, corners, weights)

    def _build_picker(self, name: str) -> None:
        """Make a mesh that is shown for the first time ready to be picked."""
        if self._building is None and self._places is not None:
            self._building = Task(_built, self._places, name)
            self._building.returned.connect(self._on_built)
            self._building.failed.connect(self._on_failed)
            self._building.start()

    def _on_built(self, built: tuple[Places, str, _Mesh]) -> None:
        self._building = None
        places, name, mesh = built
        # Meshes of the atlas stay when the timepoint is another.
        current = places is self._places or name not in FOLLOWING
        if current and places.atlas is self._canvas.atlas:
            self._pickers[name] = mesh

    # Words ----------------------------------------------------------------------

    def read_out(self, place: Place) -> str:
        """The numbers of a place, in one line."""
        parts = []
        position = place.position if place.on_frame is None else place.on_frame
        if position is not None:
            z, y, x = position
            parts.append(f"z {z:.2f}  y {y:.2f}  x {x:.2f} µm")
        if place.uv is not None:
            parts.append(f"v {place.uv[0]:.0f}  u {place.uv[1]:.0f}")
        if place.topography is not None:
            parts.append(f"d {place.topography[0]:+.2f} µm")
        colouring = self._canvas.colouring
        fields = colouring.fields
        if fields is not None:
            names = [colouring.field, *(n for n in ALWAYS if n != colouring.field)]
            parts += _values(fields, names, place)
        return "   ·   ".join(parts).replace("-", "−")

    def close(self) -> None:
        """Take the marks away and listen no longer."""
        viewer = self._viewer()
        self._canvas.session.finished.disconnect(self._on_atlas)
        if viewer is not None:
            viewer.mouse_move_callbacks.remove(self._on_move_3d)
            viewer.events.mouse_over_canvas.disconnect(self._on_over)
        self._canvas.model.mouse_move_callbacks.remove(self._on_move_unwrapped)
        self.marks_3d.remove()
        self.marks_unwrapped.remove()
        self._places = None
        self._pickers.clear()


def _values(fields: Fields, names: list[str], place: Place) -> list[str]:
    parts = []
    for name in names:
        value = fields.at_place(name, place) if name in fields.names else None
        if value is not None:
            field = fields.field(name)
            parts.append(f"{field.title} {value:.3g} {field.unit}".rstrip())
    return parts


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A mesh of the 3D canvas that can be picked, as it is in its layer's data.

    `of` are the vertices of the chart that its vertices are, None if they are the same.
    """

    chart: str
    vertices: Any
    faces: Any
    picker: RayPicker | SpherePicker
    of: Any = None


def _prepare(atlas: Atlas) -> tuple[Places, dict[str, _Mesh]]:
    """What is needed for the meshes that are shown at first; runs in a thread.

    libigl lets no other thread run while it builds a tree, so the window waits for every
    one: there is a single one here, and others are built when they are needed.
    """
    places = Places(atlas).prepare()
    names = ["surface", "sphere", "sphere (conformal)"]
    if same_mesh(atlas.sealed, atlas.surface):
        names.append("sealed surface")
    return places, {name: _mesh_of(atlas, name) for name in names}


def _mesh_of(atlas: Atlas, name: str) -> _Mesh:
    """What a layer's mesh is picked with."""
    surface, sphere = atlas.surface, atlas.sphere
    if name in ("sphere", "sphere (conformal)"):
        vertices = sphere.vertices if name == "sphere" else sphere.conformal
        return _Mesh("sphere", vertices, sphere.faces, SpherePicker(vertices, sphere.faces))
    if name == "topographic surface":
        cut, kept = flat_surface(atlas.topography)
        of = atlas.topography.cut_origin[kept]
        return _Mesh("surface", cut.vertices, cut.faces, RayPicker(cut.vertices, cut.faces), of)
    chart = {"sealed surface": "sealed"}.get(name, name)
    mesh = getattr(atlas, chart)
    shared = chart == "surface" or (chart == "sealed" and same_mesh(mesh, surface))
    locator = atlas._surface_locator if shared else None
    return _Mesh(chart, mesh.vertices, mesh.faces, RayPicker(mesh.vertices, mesh.faces, locator))


def _mesh_of_frame(shown: ShownFrame, name: str) -> _Mesh:
    """What the mesh of a timepoint is picked with."""
    mesh, of = (shown.frame.surface, None) if name == CELL_AT_T else flat_frame(shown)
    return _Mesh(FRAME, mesh.vertices, mesh.faces, RayPicker(mesh.vertices, mesh.faces), of)


def _built(places: Places, name: str) -> tuple[Places, str, _Mesh]:
    """What comes back from the thread, with what it belongs to."""
    if isinstance(places, FramePlaces) and name in FOLLOWING:
        return places, name, _mesh_of_frame(places.shown, name)
    return places, name, _mesh_of(places.atlas, name)
