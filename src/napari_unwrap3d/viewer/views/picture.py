"""The charts of one cell in the two canvases of a viewer: put there, fitted, taken away."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .canvas import canvas_of, open_canvas, opening
from .layers import LayerData, split_layers
from .placing import chart_of, placing, remove_charts
from .showing import fit_visible, hide_sources, show_cell

if TYPE_CHECKING:
    from napari.components import ViewerModel


class Picture:
    """What a viewer and its second canvas show of a cell's charts.

    Parameters
    ----------
    viewer : ViewerModel
    """

    def __init__(self, viewer: ViewerModel) -> None:
        self._viewer = weakref.ref(viewer)
        # The view is set for the first charts; afterwards it belongs to the user.
        self._turn_to_3d = self._fit_at_end = False

    @property
    def charts(self) -> set[str]:
        """The charts that have a layer, by name."""
        charts = {chart_of(layer) for each in self._viewers() for layer in each.layers}
        return charts - {""}

    def begin(self) -> None:
        """Charts will come: where there is none yet, the view is set for them."""
        self._turn_to_3d = self._fit_at_end = not self.charts

    def clear(self) -> None:
        """Take every chart away."""
        for each in self._viewers():
            remove_charts(each)

    def place(self, layers: list[LayerData]) -> Iterator[None]:
        """Show layers, each a turn of the event loop or more, see :func:`placing`."""
        viewer = self._viewer()
        if viewer is None:
            return
        own, unwrapped = split_layers(layers)
        first = self._turn_to_3d and bool(layers)
        if first:
            self._turn_to_3d = False
            # Before the first frame in 3D: without a graphics card that of a stack takes a second.
            hide_sources(viewer)
            yield
            # And before there are meshes, which napari would prepare anew.
            viewer.dims.ndisplay = 3
            yield
        yield from placing(viewer, own)
        if unwrapped:
            yield from opening(viewer)
            yield from canvas_of(viewer).place(unwrapped)
        if first:
            yield
            viewer.reset_view()
            fit_visible(viewer)

    def finish(self) -> None:
        """All charts are there: fit the first ones into view."""
        viewer = self._viewer()
        if self._fit_at_end and viewer is not None:
            show_cell(viewer)

    def _viewers(self) -> list[Any]:
        """The viewer, and its second canvas if it is open."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        return [] if viewer is None else [viewer] if canvas is None else [viewer, canvas.model]
