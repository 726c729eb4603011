"""Where tracks are at the timepoint that is shown: points that can be selected and moved."""

from __future__ import annotations

import weakref
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from napari.layers import Layer, Points
from qtpy.QtCore import QObject

from ...charts import Floats, Ints, Tracks
from ..annotations.point_layers import TEXT, beside
from ..views.canvas import canvas_of, open_canvas
from ..views.layers import IMAGE, KEY, PIXELS, SPACE, UNIT
from ..views.placing import chart_of, undisturbed
from .editing import NEW

if TYPE_CHECKING:
    from .layers import TrackLayers
    from .session import TracksSession

NAME = "track heads"
IN_SPACE, ON_UV = "surface", "uv"
SIZE_SHARE = 0.045
PIXELS_WIDE, ROWS = 9.0, 512
RIM, RIM_SELECTED = (0.12, 0.12, 0.12, 1.0), (1.0, 1.0, 1.0, 1.0)
ADDING = "add"
LEAST_RIM = 0.35


class TrackHeads(QObject):
    """Points of both canvases, one per track that is there at the timepoint.

    A head that a person selects with napari's own tool is a track that is selected; one that is
    dragged moves the track at this timepoint, one that is deleted takes the track's point away,
    and one that is added is of the track that is selected, or of a new one.

    Parameters
    ----------
    viewer : napari.Viewer
    session : TracksSession
    layers : TrackLayers
    """

    def __init__(self, viewer: Any, session: TracksSession, layers: TrackLayers) -> None:
        super().__init__(layers)
        self._viewer = weakref.ref(viewer)
        self._session, self._lines = session, layers
        self._layers: dict[str, Points] = {}
        self._following: dict[str, Any] = {}
        self._dragged: Points | None = None
        self._syncing = False
        session.movies.frame_changed.connect(self.update)
        viewer.dims.events.point.connect(self._on_point)
        viewer.layers.events.removed.connect(self._on_removed)

    def layer(self, chart: str) -> Points | None:
        """The heads on a chart; None before they are there."""
        return self._layers.get(chart)

    # What is there --------------------------------------------------------------

    def rows(self, chart: str) -> Ints:
        """The rows of what is shown that are heads now, and have a place on a chart."""
        tracks = self._session.shown
        if tracks is None:
            return np.zeros(0, np.int64)
        now: Ints = np.flatnonzero(tracks.timepoint == self._session.timepoint)
        return now[np.isfinite(_places(tracks, chart)[now]).all(axis=1)]

    def show(self, chart: str) -> None:
        """Make the layer of a chart if it is not there."""
        viewer = self._viewer()
        if viewer is None or chart in self._layers:
            return
        layer = self._layers[chart] = self._made(viewer, chart)
        layer.events.data.connect(self._on_data)
        follow = self._following[chart] = partial(self._on_selected, chart)
        layer.selected_data.events.items_changed.connect(follow)
        model = viewer if chart == IN_SPACE else canvas_of(viewer).model
        active = model.layers.selection.active
        with undisturbed(model):
            if chart == IN_SPACE:
                viewer.add_layer(layer)
                self._lines.far_side.add(layer)
            else:
                canvas_of(viewer).add_chart_layer(layer, ON_UV)
        model.layers.selection.active = active

    def _made(self, viewer: Any, chart: str) -> Points:
        placed: dict[str, Any]
        if chart == ON_UV:
            image = canvas_of(viewer).image(ON_UV)
            rows = ROWS if image is None else image.data.shape[0]
            size = PIXELS_WIDE * rows / ROWS
            placed = {"units": (PIXELS,) * 2, "axis_labels": IMAGE}
        else:
            from .layers import origin_of

            size = SIZE_SHARE * _size_of_cell(viewer)
            placed = {"units": (UNIT,) * 3, "axis_labels": SPACE, "translate": origin_of(viewer)}
        return Points(
            np.zeros((0, len(placed["axis_labels"]))),
            name=NAME,
            size=size,
            features={"track": np.zeros(0, np.int64), "shown": np.zeros(0, dtype=object)},
            text=TEXT,
            border_width=0.15,
            blending="translucent_no_depth",
            metadata={KEY: {"layer": NAME, "chart": "", "field": ""}},
            **placed,
        )

    def update(self, _: Any = None) -> None:
        """Show the heads of the timepoint, in the colours of their tracks."""
        if not self._layers:
            return
        tracks, colours = self._session.shown, self._session.colours
        painted = None
        if tracks is not None and colours is not None:
            painted = colours.rows(self._session.selection)
        for chart, layer in self._layers.items():
            if layer is self._dragged:
                continue
            rows = self.rows(chart)
            self._fill(layer, chart, tracks, rows, None if painted is None else painted[rows])

    def _fill(
        self,
        layer: Points,
        chart: str,
        tracks: Tracks | None,
        rows: Ints,
        colours: npt.NDArray[Any] | None,
    ) -> None:
        self._syncing = True
        # Who drags a head has selected it.
        held = _selected(layer)
        try:
            layer.selected_data.clear()
            with ExitStack() as blocked:
                # napari would show each of these by itself, and look at all layers again for
                # the new extent.
                for event in (layer.events.set_data, layer.events.data, layer.events.extent):
                    blocked.enter_context(event.blocker())
                self._put(layer, chart, tracks, rows, colours)
                # napari selects what is new, and draws a box over it.
                layer.selected_data.clear()
            ids = [] if tracks is None else tracks.track_id[rows].tolist()
            layer.selected_data = {place for place, track in enumerate(ids) if track in held}
            layer.refresh(extent=False)
        finally:
            self._syncing = False

    def _put(
        self,
        layer: Points,
        chart: str,
        tracks: Tracks | None,
        rows: Ints,
        colours: npt.NDArray[Any] | None,
    ) -> None:
        if tracks is None or colours is None or not len(rows):
            layer.data = np.zeros((0, layer.ndim))
            return
        chosen = np.isin(tracks.track_id[rows], list(self._session.selection))
        layer.data = _places(tracks, chart)[rows]
        # One that is hidden would look for texts of points that are gone.
        layer.set_view_slice()
        layer.face_color = colours
        layer.border_color = _rims(chosen, colours[:, 3])
        layer.features = self._features(tracks, rows, chosen, chart)

    def _features(
        self, tracks: Tracks, rows: Ints, chosen: Any, chart: str
    ) -> dict[str, npt.NDArray[Any]]:
        ids = tracks.track_id[rows]
        written = chosen | self._session.ids
        shown = [
            beside(str(i), chart) if there else "" for i, there in zip(ids, written, strict=True)
        ]
        columns = {name: column[rows] for name, column in tracks.columns.items()}
        del columns["track_id"]
        return {"track": ids, "shown": np.array(shown, dtype=object), **columns}

    # What a person does ---------------------------------------------------------

    def _on_point(self, _: Any = None) -> None:
        """Without a movie napari's own slider tells the timepoint."""
        if self._session.movies.movie is None:
            self.update()

    def _on_selected(self, chart: str, *_: Any) -> None:
        """A person selected heads with napari's own tool."""
        layer = self._layers[chart]
        # A point that is added is selected before it is of any track.
        if not self._syncing and str(layer.mode) != ADDING:
            self._session.select(_selected(layer))

    def _on_data(self, event: Any) -> None:
        """A person moved, deleted or added heads."""
        action = str(getattr(event, "action", ""))
        if self._syncing:
            return
        self._dragged = event.source if action.endswith("changing") else None
        if not action.endswith("ed"):
            return
        chart = next((c for c, layer in self._layers.items() if layer is event.source), None)
        tracks = self._session.tracks
        if chart is None or tracks is None:
            return
        layer = self._layers[chart]
        if action.endswith("added"):
            self._session.editing.heads_changed(chart, {NEW: np.asarray(layer.data[-1])}, [])
            return
        before = self.rows(chart)
        assert self._session.shown is not None
        known = dict(zip(self._session.shown.track_id[before].tolist(), before, strict=True))
        if len(layer.features) != len(layer.data):
            return
        now = dict(zip(layer.features["track"].tolist(), layer.data, strict=True))
        places = _places(self._session.shown, chart)
        moved = {
            track: np.asarray(now[track])
            for track, row in known.items()
            if track in now and not np.allclose(now[track], places[row])
        }
        gone = [track for track in known if track not in now]
        self._session.editing.heads_changed(chart, moved, gone)

    # The end --------------------------------------------------------------------

    def _on_removed(self, event: Any) -> None:
        for chart, layer in list(self._layers.items()):
            if layer is event.value:
                self._forget(chart)

    def _forget(self, chart: str) -> Points:
        layer = self._layers.pop(chart)
        layer.events.data.disconnect(self._on_data)
        layer.selected_data.events.items_changed.disconnect(self._following.pop(chart))
        self._lines.far_side.remove(layer)
        return layer

    def remove(self, chart: str) -> None:
        """Take the heads of a chart away."""
        if chart in self._layers:
            take_away(self._viewer(), self._forget(chart))

    def close(self) -> None:
        """Listen no longer."""
        self._session.movies.frame_changed.disconnect(self.update)
        viewer = self._viewer()
        if viewer is not None:
            viewer.dims.events.point.disconnect(self._on_point)
            viewer.layers.events.removed.disconnect(self._on_removed)


def take_away(viewer: Any, layer: Layer) -> None:
    """Remove a layer from the canvas of a viewer, or its window's second one, that has it."""
    canvas = None if viewer is None else open_canvas(viewer)
    for model in (viewer, None if canvas is None else canvas.model):
        if model is not None and layer in model.layers:
            with undisturbed(model):
                model.layers.remove(layer)


def _selected(layer: Points) -> set[int]:
    """The tracks of the heads that are selected in napari's own way."""
    ids = layer.features["track"].tolist()
    return {int(ids[place]) for place in layer.selected_data if place < len(ids)}


def _places(tracks: Tracks, chart: str) -> Floats:
    return tracks.position_um if chart == IN_SPACE else tracks.place_px


def _rims(chosen: npt.NDArray[np.bool_], strength: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """White around what is selected, dark and as strong as the others around those."""
    colours = np.where(chosen[:, None], RIM_SELECTED, RIM)
    colours[:, 3] = np.maximum(strength, LEAST_RIM)
    return colours


def _size_of_cell(viewer: Any) -> float:
    """The longest side of the cell in µm; 1 before it is there."""
    for layer in viewer.layers:
        if chart_of(layer) == IN_SPACE:
            low, high = layer.extent.data[:, -3:]
            return float((high - low).max())
    return 1.0
