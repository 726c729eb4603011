"""Shapes of annotations in the second canvas, which stay shapes: to be moved, edited, deleted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from napari.layers import Shapes
from qtpy.QtCore import QObject

from ...annotations import Annotations, Shape
from ...errors import Unwrap3DError
from ..common.threads import tell
from ..views.layers import KEY
from .drawing import AXES

if TYPE_CHECKING:
    from .annotating import Annotating

CHARTS = ("uv", "direct", "plane")
KINDS = ("polygon", "rectangle", "ellipse")
SHAPES = "shapes_of"
EDGE_WIDTH = 1.0
FACE_OPACITY = 0.25


class ShapeLayers(QObject):
    """Keeps napari's Shapes layers and the shapes of the annotations the same.

    Parameters
    ----------
    annotating : Annotating
    """

    def __init__(self, annotating: Annotating) -> None:
        super().__init__(annotating)
        self._annotating = annotating
        self._annotations: Annotations | None = None
        self._layers: dict[tuple[str, str], Shapes] = {}
        self._syncing = False
        annotating.listed.connect(self._on_listed)
        annotating.styled.connect(self._restyle)
        annotating.chosen.connect(self._on_chosen)

    def edit(self) -> Shapes | None:
        """Let the person draw shapes of the current annotation in the chart that is shown.

        Returns
        -------
        Shapes layer or None
            None where the chart has no shapes.
        """
        name, canvas = self._annotating.current, self._annotating.canvas
        if canvas is None or not name or canvas.chart not in CHARTS:
            return None
        if canvas.image(canvas.chart) is None:
            return None
        key = (name, str(canvas.chart))
        if key not in self._layers:
            self._make(key)
        layer = self._layers[key]
        canvas.show_tools()
        canvas.model.layers.selection.active = layer
        layer.mode = "add_polygon"
        return layer

    def layer(self, name: str, chart: str) -> Shapes | None:
        """The layer of an annotation's shapes on a chart, None before there is one."""
        return self._layers.get((name, chart))

    def show(self, annotations: Annotations) -> None:
        """Draw shapes on this cell; those that it has are shown."""
        self._annotations = annotations
        annotations.shaped.connect(self._on_shaped)
        for name in annotations.names:
            self._on_shaped(name)

    def leave(self) -> None:
        """Take all layers away."""
        if self._annotations is not None:
            self._annotations.shaped.disconnect(self._on_shaped)
            self._annotations = None
        for key in list(self._layers):
            self._remove(key)

    def _make(self, key: tuple[str, str]) -> None:
        name, chart = key
        canvas = self._annotating.canvas
        if canvas is None:
            return
        layer = Shapes(
            ndim=2,
            name=f"{name}: shapes" if chart == "uv" else f"{name}: shapes ({chart})",
            edge_width=EDGE_WIDTH,
            features={"label": np.zeros(0, int)},
            feature_defaults={"label": self._annotating.label},
            axis_labels=AXES[chart],
            metadata={KEY: {"layer": name, "chart": "", "field": "", SHAPES: name}},
        )
        self._layers[key] = layer
        self._fill(key)
        self._colour_next(layer, name)
        layer.events.data.connect(self._on_data)
        canvas.add_chart_layer(layer, chart)

    def _remove(self, key: tuple[str, str]) -> None:
        layer = self._layers.pop(key)
        layer.events.data.disconnect(self._on_data)
        canvas = self._annotating.canvas
        if canvas is not None and layer in canvas.model.layers:
            canvas.model.layers.remove(layer)

    # From the person to the annotation ---------------------------------------------------

    def _on_data(self, event: Any) -> None:
        action = str(getattr(event, "action", ""))
        if self._syncing or self._annotations is None or not action.endswith("ed"):
            return
        for (name, chart), layer in self._layers.items():
            if layer is event.source:
                try:
                    shapes = self._shapes(layer, chart)
                    if not _same(shapes, self._annotations.shapes(name, chart)):
                        self._annotations.set_shapes(name, shapes, chart)
                except Unwrap3DError as error:
                    tell(error)
                    self._fill((name, chart))
        self._annotating.edited.emit()

    def _shapes(self, layer: Shapes, chart: str) -> list[Shape]:
        overhang = self._annotations.overhang if self._annotations is not None else "column"
        labels = list(layer.features["label"])
        return [
            Shape(chart, kind, np.asarray(data, float), int(label), overhang)
            for data, kind, label in zip(layer.data, layer.shape_type, labels, strict=True)
            if kind in KINDS and len(data) >= 3
        ]

    # From the annotation to the person ---------------------------------------------------

    def _on_shaped(self, name: str) -> None:
        annotations, canvas = self._annotations, self._annotating.canvas
        if annotations is None or canvas is None:
            return
        for chart in CHARTS:
            key, shapes = (name, chart), annotations.shapes(name, chart)
            if key in self._layers:
                if not _same(self._shapes(self._layers[key], chart), shapes):
                    self._fill(key)
            elif shapes and canvas.image(chart) is not None:
                self._make(key)

    def _fill(self, key: tuple[str, str]) -> None:
        """Show the annotation's shapes in place of the layer's."""
        if self._annotations is None:
            return
        layer, shapes = self._layers[key], self._annotations.shapes(*key)
        colours = self._annotating.style(key[0])[0]
        self._syncing = True
        try:
            layer.selected_data = set(range(len(layer.data)))
            layer.remove_selected()
            for shape in shapes:
                colour = np.array(colours.get(shape.label, (1.0, 1.0, 1.0, 1.0)))
                layer.feature_defaults = {"label": shape.label}
                layer.add(
                    np.array(shape.vertices),
                    shape_type=shape.kind,
                    edge_color=colour,
                    face_color=_light(colour),
                )
        finally:
            self._syncing = False
        self._colour_next(layer, key[0])

    def _on_chosen(self) -> None:
        for (name, _), layer in self._layers.items():
            if name in self._annotating.names:
                self._colour_next(layer, name)

    def _colour_next(self, layer: Shapes, name: str) -> None:
        """The next shape gets the current label, and its colour."""
        label = self._annotating.label
        colour = np.array(self._annotating.style(name)[0][label])
        selected, layer.selected_data = layer.selected_data, set()
        layer.feature_defaults = {"label": label}
        layer.current_edge_color, layer.current_face_color = colour, _light(colour)
        layer.selected_data = selected

    def _restyle(self) -> None:
        for key, layer in self._layers.items():
            self._fill(key)
            if key[1] == self._annotating.layers.chart:
                layer.visible = self._annotating.style(key[0])[1]

    def _on_listed(self) -> None:
        for key in [key for key in self._layers if key[0] not in self._annotating.names]:
            self._remove(key)
        for name in self._annotating.names:
            self._on_shaped(name)


def _light(colour: Any) -> Any:
    return np.array([*np.asarray(colour)[:3], FACE_OPACITY])


def _same(some: Any, others: Any) -> bool:
    return len(some) == len(others) and all(
        a.kind == b.kind and a.label == b.label and np.array_equal(a.vertices, b.vertices)
        for a, b in zip(some, others, strict=True)
    )
