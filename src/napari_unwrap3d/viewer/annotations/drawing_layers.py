"""The layers to draw on: one per annotation and chart, made when its chart is looked at.

Those of the unwrapped charts are in the second canvas, that of the stack's slices in the
main one, where it is made when a person wants to draw there.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject

from ...annotations import Annotations
from ..common.threads import Task, tell
from ..common.turns import soon
from ..views.layers import UNIT, mesh_area, uv_pixel_um
from ..views.placing import chart_of
from .drawing import DrawnLabels, compile_colours, drawing_name, label_colormap
from .painting import BRUSH, ERASE, FILL, LASSO, LOOK, POINT
from .texturing import Watching

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from .annotating import Annotating
    from .colours import Colour

MODES = {
    LOOK: "pan_zoom",
    BRUSH: "paint",
    ERASE: "erase",
    FILL: "fill",
    LASSO: "polygon",
    POINT: "pan_zoom",
}
VOLUME = "volume"
CLOSE_SECONDS = 5.0
SMALLEST_BRUSH, LARGEST_BRUSH = 1, 400


class DrawingLayers(QObject):
    """Makes and keeps the layers to draw on.

    Parameters
    ----------
    viewer : napari.Viewer
    annotating : Annotating
    """

    def __init__(self, viewer: ViewerModel, annotating: Annotating) -> None:
        super().__init__(annotating)
        self._viewer = weakref.ref(viewer)
        self._annotating = annotating
        self._canvas: Any = None
        self._annotations: Annotations | None = None
        self._watching: Watching | None = None
        self._layers: dict[tuple[str, str], DrawnLabels] = {}
        self._colours: dict[tuple[str, str], Mapping[int, Colour]] = {}
        self._building: dict[str, Task] = {}
        self._slices = self._all_depths = self._syncing = False
        self._timer = soon(self, self._make_next)
        annotating.listed.connect(self._on_listed)
        annotating.chosen.connect(self._on_chosen)
        viewer.layers.events.removed.connect(self._on_removed)

    # The canvas and the cell -----------------------------------------------------------

    def use_canvas(self, canvas: Any) -> None:
        """Draw in the second canvas, too."""
        if canvas is self._canvas:
            return
        self._canvas = canvas
        canvas.chart_changed.connect(self._on_chart)
        canvas.charts_changed.connect(self._timer.start)
        canvas.model.layers.events.inserted.connect(self._later)
        canvas.model.layers.events.removed.connect(self._on_removed)
        canvas.model.layers.selection.events.active.connect(self._on_active)
        self._timer.start()

    def show(self, annotations: Annotations, watching: Watching) -> None:
        """Draw on this cell."""
        self._annotations, self._watching = annotations, watching
        self._timer.start()

    def leave(self) -> None:
        """Take all layers away."""
        self._timer.stop()
        for key in list(self._layers):
            self._remove(key)
        for task in list(self._building.values()):
            task.wait(CLOSE_SECONDS)
        self._building.clear()
        self._annotations = self._watching = None

    def layer(self, annotation: str, chart: str) -> DrawnLabels | None:
        """The layer of an annotation on a chart, None before it is made."""
        return self._layers.get((annotation, chart))

    @property
    def chart(self) -> str:
        """The chart that the second canvas shows; empty without one."""
        return "" if self._canvas is None else str(self._canvas.chart)

    # What a person chose -----------------------------------------------------------------

    @property
    def slices(self) -> bool:
        """Whether slices of the stack are drawn on, in the main canvas."""
        return self._slices

    @slices.setter
    def slices(self, wanted: bool) -> None:
        self._slices = wanted
        viewer = self._viewer()
        if viewer is not None and wanted:
            viewer.dims.ndisplay = 2
        for key, layer in self._layers.items():
            if key[1] == VOLUME:
                layer.visible = wanted and self._annotating.style(key[0])[1]
        self._timer.start()

    @property
    def all_depths(self) -> bool:
        """Whether drawing in the topography goes through all depths."""
        return self._all_depths

    @all_depths.setter
    def all_depths(self, wanted: bool) -> None:
        self._all_depths = wanted
        for layer in self._layers.values():
            layer.all_depths = wanted

    def restyle(self) -> None:
        """Show other colours, or hide what is hidden."""
        for (name, chart), layer in self._layers.items():
            # Those of the canvas's other charts stay hidden until they are looked at.
            if chart not in (self.chart, VOLUME):
                continue
            colours, visible = self._annotating.style(name)
            if colours != self._colours.get((name, chart)):
                self._colours[name, chart] = colours
                layer.colormap = label_colormap(colours)
            shown = visible and (chart != VOLUME or self._slices)
            # Setting what is there already makes napari put the brush away.
            if layer.visible != shown:
                layer.visible = shown

    # Making layers -----------------------------------------------------------------------

    def _later(self, _: Any = None) -> None:
        self._timer.start()

    def _charts(self) -> list[str]:
        """The charts that have to have layers now."""
        charts = []
        if self._canvas is not None and self._canvas.image(self.chart) is not None:
            charts.append(self.chart)
        if self._slices:
            charts.append(VOLUME)
        return charts

    def _make_next(self) -> None:
        """Make one layer that is missing; another in the next turn of the event loop."""
        annotations = self._annotations
        if annotations is None:
            return
        for chart in self._charts():
            if not annotations.names:
                return
            if not annotations.ready(chart) or not compile_colours.cache_info().currsize:
                self._build(chart)
                continue
            for name in annotations.names:
                if (name, chart) not in self._layers:
                    self._make(name, chart)
                    self._timer.start()
                    return

    def _build(self, chart: str) -> None:
        """Build the tables of a chart, which may take seconds."""
        if chart in self._building or self._annotations is None:
            return
        task = self._building[chart] = Task(_owners, self._annotations, chart)
        task.returned.connect(self._on_built)
        task.failed.connect(self._on_failed)
        task.start()

    def _on_built(self, chart: str) -> None:
        self._building.pop(chart, None)
        self._timer.start()

    def _on_failed(self, error: BaseException) -> None:
        if self._annotations is not None:
            tell(error)

    def _make(self, name: str, chart: str) -> None:
        viewer = self._viewer()
        assert self._annotations is not None
        assert self._watching is not None
        if viewer is None:
            return
        colours, visible = self._annotating.style(name)
        placed = self._place_of_volume() if chart == VOLUME else {}
        layer = DrawnLabels(
            self._annotations,
            name,
            chart,
            colormap=label_colormap(colours),
            visible=visible,
            **placed,
        )
        layer.all_depths = self._all_depths
        self._watching.begin(chart)
        self._layers[name, chart], self._colours[name, chart] = layer, colours
        layer.events.selected_label.connect(self._on_label)
        layer.events.paint.connect(self._on_stroke)
        if chart == VOLUME:
            viewer.add_layer(layer)
        else:
            self._canvas.add_chart_layer(layer, chart)
        self._on_chosen()

    def _place_of_volume(self) -> dict[str, Any]:
        """Where the stack is."""
        viewer, atlas = self._viewer(), self._annotating.atlas
        assert viewer is not None
        assert atlas is not None
        there = [layer for layer in viewer.layers if chart_of(layer) == "mask"]
        origin = there[0].translate[-3:] if there else np.asarray(atlas.mask.origin)
        scale, units = atlas.mask.voxel_size, (UNIT,) * 3
        return {"scale": scale, "translate": origin, "units": units}

    def _remove(self, key: tuple[str, str]) -> None:
        layer = self._layers.pop(key)
        self._colours.pop(key, None)
        layer.events.selected_label.disconnect(self._on_label)
        layer.events.paint.disconnect(self._on_stroke)
        layer.close()
        if self._watching is not None:
            self._watching.end(key[1])
        viewer = self._viewer()
        models = [] if viewer is None else [viewer]
        if self._canvas is not None:
            models.append(self._canvas.model)
        for model in models:
            if layer in model.layers:
                model.layers.remove(layer)

    def rename(self, old: str, new: str) -> None:
        """Keep the layers of an annotation that gets another name."""
        for name, chart in [key for key in self._layers if key[0] == old]:
            layer = self._layers.pop((name, chart))
            layer.annotation, layer.name = new, drawing_name(new, chart)
            self._layers[new, chart] = layer
            self._colours.pop((name, chart), None)

    # What happens -----------------------------------------------------------------------

    def _on_listed(self) -> None:
        if self._annotating.renaming is not None:
            self.rename(*self._annotating.renaming)
        names = self._annotating.names
        for key in [key for key in self._layers if key[0] not in names]:
            self._remove(key)
        self._timer.start()

    def _on_removed(self, event: Any) -> None:
        """A person removed a layer: it comes again when its chart is looked at again."""
        for key, layer in list(self._layers.items()):
            if layer is event.value:
                self._remove(key)

    def _on_chart(self, _: str) -> None:
        self.restyle()
        self._on_chosen()
        self._timer.start()

    def _on_chosen(self) -> None:
        """Give the layers the label, brush and tool that were chosen."""
        if self._syncing:
            return
        self._syncing = True
        try:
            for (name, chart), layer in self._layers.items():
                layer.selected_label = self._annotating.label
                layer.brush_size = self._brush_size(chart)
                if name == self._annotating.current and chart in (self.chart, VOLUME):
                    self._activate(layer, chart)
        finally:
            self._syncing = False

    def _activate(self, layer: DrawnLabels, chart: str) -> None:
        viewer = self._viewer()
        assert viewer is not None
        model = viewer if chart == VOLUME else self._canvas.model
        if chart == VOLUME and not (self._slices and viewer.dims.ndisplay == 2):
            return
        if layer in model.layers:
            model.layers.selection.active = layer
            layer.mode = MODES[self._annotating.tool]

    def _brush_size(self, chart: str) -> int:
        """Diameter in pixels of the brush, as it is at the equator of the chart."""
        atlas = self._annotating.atlas
        assert atlas is not None
        if chart == VOLUME:
            pixel = atlas.voxel_um
        else:
            radius = float(np.sqrt(mesh_area(atlas.reference) / (4 * np.pi)))
            pixel = uv_pixel_um(atlas.uv.shape[0], radius)
        size = round(2 * self._annotating.radius_um / pixel)
        return int(np.clip(size, SMALLEST_BRUSH, LARGEST_BRUSH))

    def _on_stroke(self, _: Any = None) -> None:
        self._annotating.edited.emit()

    def _on_label(self, event: Any) -> None:
        label = int(event.source.selected_label)
        if not self._syncing and label > 0:
            self._annotating.label = label

    def _on_active(self, event: Any) -> None:
        layer = event.value
        if isinstance(layer, DrawnLabels) and not self._syncing:
            self._annotating.current = layer.annotation


def _owners(annotations: Annotations, chart: str) -> str:
    annotations.owners(chart)
    compile_colours()
    return chart
