"""Named points on the surface, shown in both canvases and set with the mouse in either."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Points
from qtpy.QtCore import QObject

from ...annotations import Annotations
from ...errors import Unwrap3DError
from ..common.threads import tell
from ..common.turns import Turns, soon
from ..views.layers import KEY, SPACE, UNIT
from ..views.placing import chart_of
from .drawing import AXES

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from .annotating import Annotating

NAME = "points"
SURFACE = "surface"
SIZE_SHARE = 0.04
PIXELS = 14.0
ROWS = 512
# Read on light and dark fields and canvases, beside the mark, and before the surface.
TEXT = {
    "string": "{shown}",
    "size": 10,
    "color": "#aa00ff",
    "anchor": "lower_left",
    "blending": "translucent_no_depth",
}


class PointLayers(QObject):
    """Keeps napari's Points layers and the points of the cell the same.

    In the main canvas they can be moved and deleted as in any Points layer; a point that is
    moved goes to the nearest place of the surface.

    Parameters
    ----------
    viewer : napari.Viewer
    annotating : Annotating
    """

    def __init__(self, viewer: ViewerModel, annotating: Annotating) -> None:
        super().__init__(annotating)
        self._viewer = weakref.ref(viewer)
        self._annotating = annotating
        self._annotations: Annotations | None = None
        self._layers: dict[str, Points] = {}
        self._syncing = False
        self._timer = soon(self, self._raise)
        self._turns = Turns(self)

    def show(self, annotations: Annotations) -> None:
        """Show the points of this cell."""
        self._annotations = annotations
        annotations.points.changed.connect(self.fill)
        self._turns.add(self._filling())

    def leave(self) -> None:
        """Take all layers away."""
        self._turns.clear()
        if self._annotations is not None:
            self._annotations.points.changed.disconnect(self.fill)
            self._annotations = None
        for chart in list(self._layers):
            self._remove(chart)

    def use_canvas(self, canvas: Any) -> None:
        """Show points in the second canvas, too, and set them there."""
        canvas.chart_changed.connect(self.fill)
        canvas.charts_changed.connect(self.fill)
        canvas.model.layers.events.inserted.connect(self._raise_later)
        canvas.model.mouse_drag_callbacks.append(self._on_press)

    def layer(self, chart: str) -> Points | None:
        """The layer of the points on a chart, None before there is one."""
        return self._layers.get(chart)

    def add(self, position: Any, chart: str) -> None:
        """Set a new point at a position on a chart, given as in ``atlas.map``."""
        annotations, atlas = self._annotations, self._annotating.atlas
        if annotations is None or atlas is None:
            return
        point, valid = np.asarray(position, float)[None], np.array([True])
        if chart != SURFACE:
            point, valid = atlas.map(point, chart, SURFACE)
        if not valid[0]:
            self._annotating.told.emit("There is no surface at this place.")
            return
        number = 1
        while f"point {number}" in annotations.points.positions:
            number += 1
        annotations.points.set(f"point {number}", point[0])
        self._annotating.edited.emit()

    def fill(self, _: Any = None) -> None:
        """Show the points as they are."""
        for _ in self._filling():
            pass

    def _filling(self) -> Iterator[None]:
        """Do what :meth:`fill` does, a chart per step."""
        if self._annotations is None:
            return
        canvas = self._annotating.canvas
        charts = [SURFACE]
        if canvas is not None and canvas.image(canvas.chart) is not None:
            charts.append(str(canvas.chart))
        for chart in {*charts, *self._layers}:
            self._fill(chart)
            yield

    def _fill(self, chart: str) -> None:
        assert self._annotations is not None
        atlas, positions = self._annotating.atlas, self._annotations.points.positions
        if chart not in self._layers:
            if not positions:
                return
            self._make(chart)
        places, valid = self._annotations.points.on(chart)
        if chart == "topography" and atlas is not None:
            # That canvas counts d in layers.
            layers = np.arange(len(atlas.topography.d_um))
            places[:, 0] = np.interp(places[:, 0], atlas.topography.d_um, layers)
        names = [name for name, good in zip(positions, valid, strict=True) if good]
        layer, shown = self._layers[chart], places[valid]
        self._syncing = True
        try:
            layer.selected_data = set()
            layer.data = shown
            # One that is hidden would look for the names of points that are gone.
            layer.set_view_slice()
            # napari selects what is new, and draws a box over it.
            layer.selected_data = set()
            shown_names = [beside(name, chart) for name in names]
            layer.features = {
                "name": np.array(names, dtype=object),
                "shown": np.array(shown_names, dtype=object),
            }
            layer.refresh_text()
        finally:
            self._syncing = False

    def _raise_later(self, _: Any = None) -> None:
        self._timer.start()

    def _raise(self) -> None:
        """Points are seen over what is drawn."""
        canvas = self._annotating.canvas
        if canvas is None:
            return
        layers = canvas.model.layers
        for layer in self._layers.values():
            if layer in layers and any(
                type(each) is not Points for each in layers[layers.index(layer) :]
            ):
                layers.move(layers.index(layer), len(layers))

    def _make(self, chart: str) -> None:
        viewer, atlas = self._viewer(), self._annotating.atlas
        if viewer is None or atlas is None:
            return
        axes = SPACE if chart == SURFACE else AXES[chart]
        placed: dict[str, Any]
        if chart != SURFACE:
            placed = {"size": PIXELS * getattr(atlas, chart).shape[-2] / ROWS}
        else:
            surface = [layer for layer in viewer.layers if chart_of(layer) == SURFACE]
            size = SIZE_SHARE * float(np.ptp(atlas.surface.vertices, axis=0).max())
            placed = {"size": size, "units": (UNIT,) * 3, "blending": "translucent_no_depth"}
            placed["translate"] = surface[0].translate if surface else (0.0, 0.0, 0.0)
        layer = Points(
            np.zeros((0, len(axes))),
            name=NAME,
            axis_labels=axes,
            features={key: np.zeros(0, dtype=object) for key in ("name", "shown")},
            text=TEXT,
            face_color="#ffee58",
            border_color="black",
            metadata={KEY: {"layer": NAME, "chart": "", "field": ""}},
            **placed,
        )
        self._layers[chart] = layer
        if chart == SURFACE:
            layer.events.data.connect(self._on_data)
            active = viewer.layers.selection.active
            viewer.add_layer(layer)
            viewer.layers.selection.active = active
        elif self._annotating.canvas is not None:
            model = self._annotating.canvas.model
            active = model.layers.selection.active
            self._annotating.canvas.add_chart_layer(layer, chart)
            model.layers.selection.active = active

    def _remove(self, chart: str) -> None:
        layer = self._layers.pop(chart)
        if chart == SURFACE:
            layer.events.data.disconnect(self._on_data)
        viewer, canvas = self._viewer(), self._annotating.canvas
        for model in (viewer, None if canvas is None else canvas.model):
            if model is not None and layer in model.layers:
                model.layers.remove(layer)

    def _on_data(self, event: Any) -> None:
        """A person moved or deleted points in the main canvas."""
        annotations, action = self._annotations, str(getattr(event, "action", ""))
        if self._syncing or annotations is None or not action.endswith("ed"):
            return
        layer = self._layers[SURFACE]
        if len(layer.features) != len(layer.data):
            return
        kept = dict(zip(layer.features["name"], layer.data, strict=True))
        try:
            with annotations.stroke():
                for name, position in list(annotations.points.positions.items()):
                    if name not in kept:
                        annotations.points.remove(name)
                    elif not np.allclose(kept[name], position):
                        annotations.points.set(name, kept[name])
        except Unwrap3DError as error:
            tell(error)
        self._annotating.edited.emit()

    def _on_press(self, model: Any, event: Any) -> Iterator[None]:
        """A click, not a drag, in the second canvas."""
        canvas = self._annotating.canvas
        if not self._annotating.points_wanted or canvas is None or event.button != 1:
            return
        yield
        if event.type == "mouse_move":
            return
        # With a topography the canvas has three axes for every chart.
        place = np.asarray(event.position, float)[-len(AXES[canvas.chart]) :]
        atlas = self._annotating.atlas
        if canvas.chart == "topography" and atlas is not None:
            layers = np.arange(len(atlas.topography.d_um))
            place[0] = np.interp(place[0], layers, atlas.topography.d_um)
        self.add(place, str(canvas.chart))


def beside(name: str, chart: str) -> str:
    """A name with what keeps it beside its mark: in 3D napari centres every text."""
    gap = 2 * len(name) + 3 if chart == SURFACE else 2
    return " " * gap + name
