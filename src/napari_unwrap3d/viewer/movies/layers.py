"""What changes in time in both canvases: the surface of a movie, its field, and its texture."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject

from ...annotations import Annotations, Change
from ...motion.frame_fields import FRAME, FrameFields, MovieColours
from ...motion.shown_frames import ShownFrame
from ...textured import PaintedTexture, Sheet
from ..common.threads import Task, tell
from ..common.turns import soon
from ..views.layers import CELL_AT_T, KEY, flat_frame, frame_layer
from ..views.placing import placing
from ..views.subtexture import show_boxes
from .frame_layer import draw_field, swap_mesh

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer, Surface

    from ..annotations.annotating import Annotating
    from ..views.canvas import UnwrappedCanvas
    from ..views.colouring import Colouring

TOPOGRAPHY_AT_T = "topographic surface"
# A timepoint that is looked at so long is no step of a scrub.
REST_MS = 300
CLOSE_SECONDS = 5.0


class MovieLayers(QObject):
    """Shows the frames of one movie.

    Parameters
    ----------
    viewer : napari.Viewer
        That shows the common space of the movie.
    canvas : UnwrappedCanvas
    annotating : Annotating
    colours : MovieColours
    """

    def __init__(
        self,
        viewer: ViewerModel,
        canvas: UnwrappedCanvas,
        annotating: Annotating,
        colours: MovieColours,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._canvas, self._colours = canvas, colours
        self._annotating = annotating
        self.shown: ShownFrame | None = None
        self._texture: PaintedTexture | None = None
        self._annotations: Annotations | None = None
        self._watching: Any = None
        self._watched_layers: list[Layer] = []
        self._preparing: Task | None = None
        self._timer = soon(self, self._show_texture)
        self._rest = soon(self, self._on_rest, REST_MS)
        colouring = self._colouring
        colouring.changed.connect(self._on_colours)
        annotating.styled.connect(self._cover)
        annotating.listed.connect(self._on_listed)
        viewer.layers.events.removed.connect(self._on_removed)
        self._on_listed()

    @property
    def _colouring(self) -> Colouring:
        return self._canvas.colouring

    @property
    def layer(self) -> Surface | None:
        """The surface of the timepoint; None before it is there."""
        return self._named(CELL_AT_T)

    def _named(self, name: str) -> Any:
        viewer = self._viewer()
        if viewer is None:
            return None
        return next(
            (e for e in viewer.layers if e.metadata.get(KEY, {}).get("layer") == name), None
        )

    # The frame ------------------------------------------------------------------

    def begin(self, shown: ShownFrame) -> Iterator[None]:
        """Show the first frame, in place of the common space's own surface; piece by piece."""
        viewer = self._viewer()
        if viewer is None:
            return
        yield from placing(viewer, [frame_layer(shown.vertices, shown.faces, shown.laid.origin)])
        for name in ("surface", "sealed surface"):
            layer = self._named(name)
            if layer is not None:
                layer.visible = False
                yield
        for layer in (self.layer, self._named(TOPOGRAPHY_AT_T)):
            if layer is not None:
                layer.metadata[KEY] |= {"values_on": FRAME, "field": ""}
                layer.events.visible.connect(self._on_visible)
                self._watched_layers.append(layer)
        viewer.layers.selection.active = self.layer
        self.show(shown)
        yield

    def show(self, shown: ShownFrame) -> None:
        """Show a frame: its mesh, its field in both canvases, and what is drawn on it."""
        self.shown = shown
        atlas = self._canvas.atlas
        if atlas is None:
            return
        colouring = self._colouring
        fields = FrameFields(atlas, shown, self._colours, colouring.fields)
        known = colouring.show_fields(fields)
        self._annotating.show_frame(shown)
        self._canvas.cursor.show_frame(shown)
        if known:
            self._show_image(fields)
        self._show_meshes()
        self._rest.start()
        if not known:
            colouring.refresh()

    def _show_image(self, fields: FrameFields) -> None:
        image = self._canvas.image("uv")
        if image is not None:
            image.data = fields.values(self._colouring.field, "uv")
            image.metadata[KEY]["field"] = self._colouring.field

    def _show_meshes(self) -> None:
        """Swap what is seen of the surface; what is hidden follows when it is shown."""
        shown = self.shown
        if shown is None:
            return
        layer = self.layer
        if layer is not None and layer.visible:
            self._follow(layer, shown.laid.origin)
            pixels = self._draw_texture()
            values = self._values()[shown.laid.origin]
            coordinates = None if pixels is None else shown.laid.coordinates
            swap_mesh(layer, shown.vertices, shown.faces, values, pixels, coordinates)
        flat = self._named(TOPOGRAPHY_AT_T)
        if flat is not None and flat.visible:
            mesh, origin = flat_frame(shown)
            self._follow(flat, origin)
            swap_mesh(flat, mesh.vertices.astype(np.float32), mesh.faces, self._values()[origin])

    def _follow(self, layer: Layer, vertices: Any) -> None:
        """A layer has these vertices of the frame now, in the colours of the field."""
        about = layer.metadata[KEY]
        about["vertices"] = vertices
        if about["field"] != self._colouring.field and self._colouring.values(FRAME) is not None:
            self._colouring.follow(layer, FRAME)

    def _values(self) -> Any:
        """Of the field that colours, at the vertices of the frame; ones before they are known."""
        assert self.shown is not None
        values = self._colouring.values(FRAME)
        return np.ones(len(self.shown.frame.surface.vertices)) if values is None else values

    def _on_visible(self, event: Any) -> None:
        if event.source.visible:
            self._show_meshes()

    def _on_rest(self) -> None:
        """The timepoint is looked at: bring it to the charts that take longer."""
        self._colouring.refresh()
        self._annotating.frame_rests()
        self._canvas.cursor.frame_rests()

    # The texture ----------------------------------------------------------------

    @property
    def texture(self) -> PaintedTexture | None:
        """The texture of the surface; None while no annotation is there."""
        return self._texture

    def _draw_texture(self, *, changed: bool = False) -> Any:
        """The texture with the field of the frame; None where the mesh shows the field itself."""
        layer = self.layer
        values = self._colouring.values("uv")
        if self._texture is None or layer is None or values is None:
            return None
        draw_field(self._texture, values, layer)
        if not changed:
            self._texture.take_changed()
        return self._texture.pixels

    def _on_listed(self) -> None:
        """There are other annotations, or another cell has them."""
        annotations = self._annotating.annotations if self._annotating.atlas is not None else None
        if annotations is not self._annotations:
            self._forget_annotations()
            if annotations is not None:
                self._annotations, self._watching = annotations, self._annotating.watching
                annotations.changed.connect(self._on_changed)
        self._cover()

    def _forget_annotations(self) -> None:
        if self._annotations is not None:
            self._annotations.changed.disconnect(self._on_changed)
            if self._texture is not None:
                self._watching.end("uv")
        self._annotations = self._watching = self._texture = None

    def _cover(self) -> None:
        """Lay the annotations over the field; without any the mesh shows the field itself."""
        names = () if self._annotations is None else self._annotations.names
        if not names or self.shown is None:
            if self._texture is not None:
                self._texture = None
                self._watching.end("uv")
                self._show_meshes()
            return
        assert self._annotations is not None
        if not self._annotations.ready("uv"):
            self._prepare(self._annotations)
            return
        texture, fresh = self._texture, self._texture is None
        if texture is None:
            texture = self._texture = PaintedTexture(Sheet.whole(self.shown.rows))
            self._watching.begin("uv")
        for name in texture.names:
            if name not in names:
                texture.uncover(name)
        for name in names:
            colours, visible = self._annotating.style(name)
            if name in texture.names:
                texture.recolour(name, colours, visible)
            else:
                texture.cover(name, self._annotations.image(name, "uv"), colours, visible)
        if fresh:
            self._show_meshes()
        else:
            self._timer.start()

    def _prepare(self, annotations: Annotations) -> None:
        """Build the tables of uv, in a thread."""
        if self._preparing is None:
            self._preparing = Task(annotations.owners, "uv")
            self._preparing.returned.connect(self._on_prepared)
            self._preparing.failed.connect(tell)
            self._preparing.start()

    def _on_prepared(self, _: Any) -> None:
        self._preparing = None
        self._cover()

    def _on_changed(self, change: Change) -> None:
        if self._texture is not None and "uv" in change.pixels:
            self._texture.change(change.name, *change.pixels["uv"])
            self._timer.start()

    def _on_colours(self) -> None:
        """Another field, or another colormap or limits of it."""
        layer, field = self.layer, self._colouring.field
        if layer is None:
            return
        if layer.metadata[KEY]["field"] != field:
            self._show_meshes()
        elif self._texture is not None and layer.texture is self._texture.pixels:
            self._draw_texture(changed=True)
            self._timer.start()

    def _show_texture(self) -> None:
        viewer, layer = self._viewer(), self.layer
        if viewer is None or layer is None or self._texture is None or not layer.visible:
            return
        if layer.texture is self._texture.pixels:
            boxes = self._texture.take_changed()
            show_boxes(viewer, layer, self._texture.pixels, boxes)

    # The end --------------------------------------------------------------------

    def _on_removed(self, event: Any) -> None:
        if event.value in self._watched_layers:
            event.value.events.visible.disconnect(self._on_visible)
            self._watched_layers.remove(event.value)

    def close(self) -> None:
        """Show no frame any more."""
        self._timer.stop()
        self._rest.stop()
        if self._preparing is not None:
            self._preparing.wait(CLOSE_SECONDS)
        viewer = self._viewer()
        self._colouring.changed.disconnect(self._on_colours)
        self._annotating.styled.disconnect(self._cover)
        self._annotating.listed.disconnect(self._on_listed)
        self._forget_annotations()
        self._annotating.show_frame(None)
        self._canvas.cursor.show_frame(None)
        self.shown = None
        if viewer is not None:
            viewer.layers.events.removed.disconnect(self._on_removed)
            for layer in self._watched_layers:
                layer.events.visible.disconnect(self._on_visible)
            if self.layer is not None:
                viewer.layers.remove(self.layer)
        self._watched_layers.clear()
