"""Annotations on the meshes of the main canvas, as textures over the field that they show.

A layer keeps its mesh, its values, colormap and limits, and may be given others as ever;
what it would show of them is drawn into the texture, below the annotations. While a layer
is textured its mesh is cut along the seam, so that some vertices are there twice, at the
end. ``metadata["napari_unwrap3d"]`` tells of which vertex each is a copy: as ``vertices``,
which is where the field that colours the layer is read, and as ``copies_of``.
"""

from __future__ import annotations

import weakref
from collections import Counter
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject

from ...annotations import Annotations, Change
from ...atlas import Atlas
from ...textured import PaintedTexture, Skin, make_skin, skin_chart
from ..common.threads import Task, tell
from ..common.turns import soon
from ..views.layers import COPIES, KEY, MISSING
from ..views.placing import chart_of
from ..views.subtexture import show_boxes

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer, Surface

TEXTURED = ("surface", "sealed", "reference", "sphere")
CLOSE_SECONDS = 5.0
SHADES = 256

Colours = Mapping[int, npt.ArrayLike]
# The colours of an annotation's labels, and whether it is visible.
Style = Callable[[str], tuple[Colours, bool]]


class Watching:
    """Counts who shows a chart: it is watched as long as anybody does.

    Parameters
    ----------
    annotations : Annotations
    """

    def __init__(self, annotations: Annotations) -> None:
        self._annotations = annotations
        self._count: Counter[str] = Counter()

    def begin(self, chart: str) -> None:
        """One more shows a chart."""
        self._count[chart] += 1
        if self._count[chart] == 1:
            self._annotations.watch(chart)

    def end(self, chart: str) -> None:
        """One less does."""
        self._count[chart] -= 1
        if self._count[chart] == 0:
            self._annotations.unwatch(chart)


class LayerTexture:
    """The texture of one layer.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : Surface
    skin : Skin
    faces : ndarray, (m, 3)
        Of the mesh as it is without the cut.
    later : callable
        Called when the texture has to be shown, which :meth:`show` then does.
    """

    def __init__(
        self,
        viewer: ViewerModel,
        layer: Surface,
        skin: Skin,
        faces: npt.NDArray[np.int64],
        later: Callable[[], None],
    ) -> None:
        self._viewer, self.layer = weakref.ref(viewer), layer
        self.skin, self.texture = skin, PaintedTexture(skin)
        self._faces, self._size = faces, int(faces.max()) + 1
        self._later, self._stale, self._changing = later, True, False
        self._emitters = [
            layer.events.colormap,
            layer.events.contrast_limits,
            layer.events.gamma,
        ]
        self._put_on()
        layer.events.data.connect(self._on_data)
        for emitter in self._emitters:
            emitter.connect(self._on_colours)

    @property
    def lost(self) -> bool:
        """Whether the layer was given another mesh, and no longer has this texture."""
        return self.layer.texture is not self.texture.pixels

    def show(self) -> None:
        """Show what changed."""
        viewer = self._viewer()
        if viewer is None or self.layer not in viewer.layers or self.lost:
            return
        if self._stale:
            self._stale = False
            self._draw_field()
        show_boxes(viewer, self.layer, self.texture.pixels, self.texture.take_changed())

    def take_off(self) -> None:
        """Let the layer show its mesh as it was."""
        self.layer.events.data.disconnect(self._on_data)
        for emitter in self._emitters:
            emitter.disconnect(self._on_colours)
        if self.lost:
            return
        layer = self.layer
        self._note(None)
        vertices, faces, values = layer.data
        cut = len(vertices) == len(self.skin.origin) and len(faces) == len(self._faces)
        with layer.events.set_data.blocker():
            layer.vertex_colors = None
            layer.texture = None
        layer.texcoords = None
        if cut:
            n, features = self._size, layer.features
            layer.data = (vertices[:n], self._faces.astype(faces.dtype), values[:n])
            if len(features.columns):
                layer.features = features.iloc[:n]

    def _put_on(self) -> None:
        layer, origin = self.layer, self.skin.origin
        layer.texcoords = self.skin.coordinates
        features = layer.features
        with layer.events.set_data.blocker():
            self._cut()
            layer.vertex_colors = np.ones((len(origin), 4), np.float32)
        if len(features.columns):
            layer.features = features.iloc[origin]
        self._draw_field()
        self._stale = False
        self.texture.take_changed()
        # The one call that napari draws anew for.
        layer.texture = self.texture.pixels
        self._note(origin)

    def _note(self, origin: npt.NDArray[np.int64] | None) -> None:
        known = self.layer.metadata.get(KEY, {})
        for key in (COPIES, "vertices"):
            if origin is None:
                known.pop(key, None)
            else:
                known[key] = origin

    def _cut(self) -> None:
        vertices, _, values = self.layer.data
        origin = self.skin.origin
        self._changing = True
        try:
            self.layer.data = (
                vertices[origin] if len(vertices) == self._size else vertices,
                self.skin.faces.astype(np.int32),
                values[origin] if len(values) == self._size else values,
            )
        finally:
            self._changing = False

    def _on_data(self, _: Any = None) -> None:
        """The layer was given another mesh or other values, without copies."""
        if self._changing or self.lost:
            return
        vertices, _, values = self.layer.data
        if not len(vertices) == len(values) == len(self.skin.origin):
            self._cut()
        self._on_colours()

    def _on_colours(self, _: Any = None) -> None:
        self._stale = True
        self._later()

    def _draw_field(self) -> None:
        layer = self.layer
        values = np.array(layer.vertex_values, dtype=np.float64)[: self._size]
        missing = layer.metadata.get(KEY, {}).get(MISSING)
        if missing is not None and len(missing) >= self._size:
            values[missing[: self._size]] = np.nan
        colours = layer.colormap.map(np.linspace(0.0, 1.0, SHADES))[:, :3]
        table = np.rint(255 * np.asarray(colours)).astype(np.uint8)
        image = self.skin.image(values, self._faces)
        self.texture.set_field(image, table, tuple(layer.contrast_limits), layer.gamma)


class Texturing(QObject):
    """Shows the annotations of a cell on every mesh of it in a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    atlas : Atlas
    annotations : Annotations
    style : callable
        Gives the colours of an annotation's labels, and whether it is visible.
    watching : Watching
    parent : QObject, optional
    """

    def __init__(
        self,
        viewer: ViewerModel,
        atlas: Atlas,
        annotations: Annotations,
        style: Style,
        watching: Watching,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._atlas, self._annotations, self._style = atlas, annotations, style
        self._textures: dict[Layer, LayerTexture] = {}
        self._making: dict[str, Task] = {}
        self._skins: dict[str, Skin] = {}
        self._watching, self._watched = watching, set[str]()
        self._timer = soon(self, self._show)
        self._more = soon(self, self.update)
        annotations.changed.connect(self._on_changed)
        annotations.listed.connect(self.update)
        viewer.layers.events.inserted.connect(self.update)
        viewer.layers.events.removed.connect(self._on_removed)
        self._closed = False
        self.update()

    def texture_of(self, layer: Layer) -> PaintedTexture | None:
        """The texture of a layer, None for one that has none (yet)."""
        found = self._textures.get(layer)
        return None if found is None else found.texture

    def update(self, _: Any = None) -> None:
        """Texture the meshes that are there, with the annotations that are there."""
        viewer = self._viewer()
        if self._closed or viewer is None:
            return
        if not self._annotations.names:
            self._take_off_all()
            return
        for layer in [each for each, texture in self._textures.items() if texture.lost]:
            self._textures.pop(layer).take_off()
        # What is seen comes first, and one in each turn of the event loop.
        for layer in sorted(viewer.layers, key=lambda layer: not layer.visible):
            mesh = chart_of(layer)
            if mesh in TEXTURED and layer not in self._textures and self._fits(layer, mesh):
                self._texture(layer, mesh)
                if layer in self._textures:
                    self._more.start()
                    break
        for texture in self._textures.values():
            self._cover(texture)
        self._timer.start()

    def remake(self) -> None:
        """Make those skins anew for which the atlas has a better chart now."""
        old = [mesh for mesh, skin in self._skins.items() if skin.chart != self._chart(mesh)]
        for mesh in old:
            del self._skins[mesh]
        for layer in [layer for layer in self._textures if chart_of(layer) in old]:
            self._textures.pop(layer).take_off()
        self.update()

    def _chart(self, mesh: str) -> str:
        return skin_chart(self._atlas, mesh)

    def close(self) -> None:
        """Leave the layers as they were without annotations, and no thread."""
        if self._closed:
            return
        self._closed = True
        self._timer.stop()
        self._more.stop()
        self._annotations.changed.disconnect(self._on_changed)
        self._annotations.listed.disconnect(self.update)
        viewer = self._viewer()
        if viewer is not None:
            viewer.layers.events.inserted.disconnect(self.update)
            viewer.layers.events.removed.disconnect(self._on_removed)
        self._take_off_all()
        for task in list(self._making.values()):
            task.wait(CLOSE_SECONDS)

    def _fits(self, layer: Layer, mesh: str) -> bool:
        """Whether a layer shows the mesh of this atlas, and not of the next or the last run."""
        if type(layer).__name__ != "Surface" or not self._atlas.has("uv"):
            return False
        if not self._atlas.has(mesh):
            return False
        chart = getattr(self._atlas, mesh)
        return len(layer.data[1]) == len(chart.faces) and len(layer.data[0]) == len(chart.vertices)

    def _texture(self, layer: Layer, mesh: str) -> None:
        if mesh not in self._skins:
            self._make(mesh)
            return
        viewer, skin = self._viewer(), self._skins[mesh]
        faces = getattr(self._atlas, mesh).faces
        self._textures[layer] = LayerTexture(viewer, layer, skin, faces, self._timer.start)
        self._watch()

    def _make(self, mesh: str) -> None:
        """Make a skin in a thread."""
        if mesh in self._making or (mesh == "sealed" and not self._atlas.has("direct")):
            return
        task = Task(_skin_and_images, self._atlas, self._annotations, mesh)
        self._making[mesh] = task
        task.returned.connect(self._on_skin)
        task.failed.connect(self._on_failed)
        task.start()

    def _on_skin(self, made: tuple[str, Skin]) -> None:
        mesh, skin = made
        self._making.pop(mesh, None)
        if not self._closed:
            self._skins[mesh] = skin
            self.update()

    def _on_failed(self, error: BaseException) -> None:
        if not self._closed:
            tell(error)

    def _cover(self, shown: LayerTexture) -> None:
        names = self._annotations.names
        for name in shown.texture.names:
            if name not in names:
                shown.texture.uncover(name)
        for name in names:
            colours, visible = self._style(name)
            if name in shown.texture.names:
                shown.texture.recolour(name, colours, visible)
            else:
                image = self._annotations.image(name, shown.skin.chart)
                shown.texture.cover(name, image, colours, visible)

    def _on_changed(self, change: Change) -> None:
        for shown in self._textures.values():
            if shown.skin.chart in change.pixels:
                shown.texture.change(change.name, *change.pixels[shown.skin.chart])
        self._timer.start()

    def _on_removed(self, event: Any) -> None:
        self._textures.pop(event.value, None)
        self._watch()

    def _show(self) -> None:
        for texture in self._textures.values():
            texture.show()

    def _take_off_all(self) -> None:
        textures, self._textures = self._textures, {}
        viewer = self._viewer()
        for layer, texture in textures.items():
            if viewer is not None and layer in viewer.layers:
                texture.take_off()
        self._watch()

    def _watch(self) -> None:
        """Only the charts that are shown get their changes computed."""
        wanted = {texture.skin.chart for texture in self._textures.values()}
        for chart in wanted - self._watched:
            self._watching.begin(chart)
        for chart in self._watched - wanted:
            self._watching.end(chart)
        self._watched = wanted


def _skin_and_images(atlas: Atlas, annotations: Annotations, mesh: str) -> tuple[str, Skin]:
    skin = make_skin(atlas, mesh)
    # The tables of a chart take a while too.
    annotations.owners(skin.chart)
    return mesh, skin
