"""Labels layers whose painting goes to the annotations of the cell, and comes from them.

Everything that napari paints into a layer (brush, eraser, fill, polygon) ends with its
event of what has to be shown anew. What differs there from what the annotation shows was
drawn by the person; the annotation is told, and tells what else has changed for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from napari.layers import Labels
from napari.utils.colormaps import DirectLabelColormap

from ...annotations import Annotations, Change
from ..common.turns import soon
from ..views.layers import IMAGE, KEY, NORMAL, SPACE

AXES = {"uv": IMAGE, "direct": IMAGE, "plane": IMAGE, "topography": NORMAL, "volume": SPACE}
OPACITY = 0.65
DRAWN, DRAWN_ON = "annotation", "drawn_on"


def drawing_name(annotation: str, chart: str) -> str:
    """The name of the layer of an annotation on a chart."""
    return annotation if chart in ("uv", "volume") else f"{annotation} ({chart})"


def label_colormap(colours: Mapping[int, npt.ArrayLike]) -> DirectLabelColormap:
    """A layer's colormap of the colours of an annotation's labels."""
    table: dict[int | None, Any] = {label: np.asarray(c) for label, c in colours.items()}
    return DirectLabelColormap(color_dict={**table, 0: np.zeros(4), None: np.zeros(4)})


@cache
def compile_colours() -> None:
    """Let napari compile what colours labels, which holds up whoever needs it first.

    It takes seconds, once in a process; to be called in a thread.
    """
    label_colormap({1: (1.0, 1.0, 1.0, 1.0)}).map(np.zeros((2, 2), np.uint16))


class DrawnLabels(Labels):
    """An annotation on one chart, to be drawn on.

    Parameters
    ----------
    annotations : Annotations
    annotation : str
        The name of the annotation.
    chart : str
        "uv", "direct", "plane", "topography" or "volume".
    **attributes
        As of napari's Labels.
    """

    def __init__(
        self, annotations: Annotations, annotation: str, chart: str, **attributes: Any
    ) -> None:
        self.annotations, self.annotation, self.chart = annotations, annotation, chart
        #: Whether drawing in the topography marks every depth, not only the one that is shown.
        self.all_depths = False
        self._shown = np.array(annotations.image(annotation, chart))
        self._pending: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = []
        self._stroke = ExitStack()
        self._showing = False
        name = drawing_name(annotation, chart)
        # It shows no chart itself, so that nobody takes it for the chart's own image.
        about = {"layer": name, "chart": "", "field": "", DRAWN: annotation, DRAWN_ON: chart}
        given = {
            "name": name,
            "axis_labels": AXES[chart],
            "opacity": OPACITY,
            "metadata": {KEY: about},
        }
        super().__init__(self._shown.copy(), **{**given, **attributes})
        self._timer = soon(None, self.show_changes)
        self.events.labels_update.connect(self._on_drawn)
        annotations.changed.connect(self._on_changed)

    @property
    def _type_string(self) -> str:
        """What napari calls the layer, for its icon and when it is saved."""
        return "labels"

    def close(self) -> None:
        """Listen no more."""
        self._timer.stop()
        self._stroke.close()
        self.events.labels_update.disconnect(self._on_drawn)
        self.annotations.changed.disconnect(self._on_changed)

    def show_anew(self) -> None:
        """Show the annotation as it is, whatever was missed."""
        self._pending.clear()
        self._shown = np.array(self.annotations.image(self.annotation, self.chart))
        self.data[...] = self._shown
        self.refresh()

    # One stroke is one step, of the annotations' history ------------------------------

    @contextmanager
    def block_history(self) -> Iterator[None]:
        """Make everything inside one step to undo."""
        # napari's event of the end of a stroke comes when the annotations can undo it.
        with super().block_history(), self.annotations.stroke():
            yield

    def _begin_stroke(self) -> None:
        """Of napari's stroke that fills what it goes around."""
        super()._begin_stroke()
        self._stroke.enter_context(self.annotations.stroke())

    def _commit_stroke(self) -> None:
        self._stroke.close()
        super()._commit_stroke()

    def _abort_stroke(self) -> None:
        super()._abort_stroke()
        self._stroke.close()
        self.annotations.undo()
        self.show_anew()

    def undo(self) -> None:
        """Take back the last stroke, in whichever view it was drawn."""
        self.annotations.undo()

    def redo(self) -> None:
        """Make the last stroke again that was taken back."""
        self.annotations.redo()

    # From the person to the annotation ------------------------------------------------

    def _on_drawn(self, _: Any = None) -> None:
        if self._showing:
            return
        box = getattr(self, "_updated_slice", None) or tuple(slice(0, n) for n in self.data.shape)
        region = np.asarray(self.data[box])
        places = np.nonzero(region != self._shown[box])
        if not len(places[0]):
            return
        values = region[places]
        pixels = tuple(axis + part.start for axis, part in zip(places, box, strict=True))
        self._shown[pixels] = values
        drawn, labels = self._at_all_depths(pixels, values)
        self.annotations.draw(self.annotation, self.chart, drawn, labels)
        # Pixels that show no place of the surface cannot keep what was drawn in them.
        flat = np.ravel_multi_index(pixels, self.data.shape)
        self._pend(flat, self._kept(flat))

    def _kept(self, flat: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """What the annotation shows in some pixels."""
        if self.chart == "uv":
            return self.annotations.image(self.annotation, "uv").reshape(-1)[flat]
        owners = self.annotations.owners(self.chart)
        return owners.values(flat, self.annotations.labels(self.annotation))

    def _at_all_depths(
        self, pixels: tuple[npt.NDArray[Any], ...], values: npt.NDArray[Any]
    ) -> tuple[tuple[npt.NDArray[Any], ...], npt.NDArray[Any]]:
        if not self.all_depths or self.chart != "topography":
            return pixels, values
        columns, first = np.unique(
            np.ravel_multi_index(pixels[1:], self.data.shape[1:]), return_index=True
        )
        layers = self.data.shape[0]
        v, u = np.unravel_index(columns, self.data.shape[1:])
        depth = np.repeat(np.arange(layers), len(columns))
        return (depth, np.tile(v, layers), np.tile(u, layers)), np.tile(values[first], layers)

    # From the annotation to the person ------------------------------------------------

    def _on_changed(self, change: Change) -> None:
        if change.name == self.annotation and self.chart in change.pixels:
            self._pend(*change.pixels[self.chart])

    def _pend(self, flat: npt.NDArray[Any], values: npt.NDArray[Any]) -> None:
        if len(flat):
            self._pending.append((flat, values))
            self._timer.start()

    def show_changes(self) -> None:
        """Show what changed since the last time."""
        pending, self._pending = self._pending, []
        if not pending:
            return
        for flat, values in pending:
            self._shown.reshape(-1)[flat] = values
        flat = np.concatenate([flat for flat, _ in pending])
        shown = self._shown.reshape(-1)[flat]
        differs = np.asarray(self.data).reshape(-1)[flat] != shown
        if not differs.any():
            return
        places = np.unravel_index(flat[differs], self.data.shape)
        if not self._is_sliced():
            self.data[places] = shown[differs]
            self.refresh()
            return
        self._showing = True
        try:
            self.data_setitem(places, shown[differs])
        finally:
            self._showing = False

    def _is_sliced(self) -> bool:
        """Whether napari has a slice to change: of a layer that is hidden it may have none."""
        sizes = [self.data.shape[axis] for axis in self._slice.slice_input.displayed]
        return bool(self.visible) and sorted(self._slice.image.view.shape) == sorted(sizes)
