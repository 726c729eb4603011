"""Tracks in both canvases: their lines as napari's Tracks layers, their heads as points."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QEvent, QObject

from ...charts import Floats, Tracks
from ...tracking.lines import TrackLines, lines_in_space, lines_on_uv
from ..common.turns import Turns, soon
from ..movies.time_axis import TimeScale, time_scale
from ..session import session_of
from ..views.canvas import canvas_of, open_canvas
from ..views.far_side import FarSide
from ..views.layers import KEY, PIXELS, SPACE, UNIT
from ..views.placing import chart_of, same_view, undisturbed
from .heads import TrackHeads, take_away
from .lines_layer import Tracks as TracksLayer

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from .session import TracksSession

NAME, HEADS = "tracks", "track heads"
IN_SPACE, ON_UV = "surface", "uv"
# The canvas of the charts has the depth d, too, when the topography is there.
AXES = {IN_SPACE: ("t", *SPACE), ON_UV: ("t", "d", "v", "u")}
TAIL = 20
WIDTH = 3
SECOND = "second"
# Names that napari's layers give a meaning of their own.
OWN = ("track_id",)
TRACK = "track"


class TrackLayers(QObject):
    """Shows the tracks of one viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    session : TracksSession

    Attributes
    ----------
    lines : dict of str to TrackLines
        What is drawn, by chart: "surface" in the 3D canvas, "uv" in the second one.
    """

    def __init__(self, viewer: Any, session: TracksSession) -> None:
        super().__init__(session)
        self._viewer = weakref.ref(viewer)
        self._session = session
        self.lines: dict[str, TrackLines] = {}
        self._layers: dict[str, TracksLayer] = {}
        self._columns: dict[str, dict[str, npt.NDArray[Any]]] = {}
        self._hidden: set[str] = set()
        self._syncing = False
        self.far_side = FarSide(viewer, self)
        self.heads = TrackHeads(viewer, session, self)
        self._turns = Turns(self)
        # Of what is to be shown: work on an earlier one stops.
        self._version, self._shown_version = 0, 0
        self._timer = soon(self, self._begin)
        self._colour_timer = soon(self, self._recolour)
        session.shown_changed.connect(self._timer.start)
        session.selection_changed.connect(self._colour_timer.start)
        session.colouring_changed.connect(self._colour_timer.start)
        session.movies.frame_changed.connect(self._on_cell)
        session_of(viewer).finished.connect(self._on_cell)
        viewer.layers.events.removed.connect(self._on_removed)
        viewer.layers.events.inserted.connect(self._on_axes)
        viewer.layers.events.removed.connect(self._on_axes)
        viewer.window._qt_window.installEventFilter(self)
        self._timer.start()

    def layer(self, chart: str) -> TracksLayer | None:
        """The lines on a chart; None before they are there."""
        return self._layers.get(chart)

    @property
    def busy(self) -> bool:
        """Whether something is still to be shown."""
        behind = self._shown_version != self._version
        return behind or self._timer.isActive() or self._colour_timer.isActive()

    # The lines ------------------------------------------------------------------

    def _begin(self) -> None:
        viewer = self._viewer()
        if viewer is None:
            return
        self._version += 1
        # After what brings the cell into the window, where that is still going on.
        opening = self._session.movies.movie is not None
        turns = session_of(viewer).turns if opening else self._turns
        turns.add(self._showing(self._version))

    def _showing(self, version: int) -> Iterator[None]:
        """Show the tracks as they are, a piece per step; until there are others."""
        for chart in (IN_SPACE, ON_UV):
            for _ in self._showing_on(chart):
                yield
                if version != self._version:
                    return
        self.heads.update()
        self._shown_version = version

    def _showing_on(self, chart: str) -> Iterator[None]:
        tracks = self._session.shown
        if tracks is None or not self._can_show(chart, tracks):
            self.remove(chart)
            yield
            return
        lines = (lines_in_space if chart == IN_SPACE else lines_on_uv)(tracks)
        self.lines[chart] = lines
        yield
        if not len(lines):
            self._hide(chart)
        elif chart in self._layers:
            self._change(chart, tracks)
        else:
            yield from self._adding(chart, tracks)
        yield
        self.heads.show(chart)
        yield

    def _can_show(self, chart: str, tracks: Tracks) -> bool:
        """Whether what the tracks lie on is there."""
        viewer = self._viewer()
        if viewer is None:
            return False
        if chart == IN_SPACE:
            opening = self._session.movies.movie is not None
            return not opening or any(chart_of(layer) == IN_SPACE for layer in viewer.layers)
        canvas = open_canvas(viewer)
        image = None if canvas is None else canvas.image(ON_UV)
        return image is not None and tracks.rows == image.data.shape[0]

    def _on_cell(self, _: Any = None) -> None:
        """A frame, or the common space: what was not there before may be now."""
        tracks = self._session.shown
        if tracks is not None and any(
            chart not in self.lines and self._can_show(chart, tracks) for chart in AXES
        ):
            self._timer.start()
        self._tell_time()

    def _on_axes(self, _: Any = None) -> None:
        """A stack with other axes came or went: time may be another one."""
        viewer, layer = self._viewer(), self._layers.get(IN_SPACE)
        if viewer is not None and layer is not None and layer in viewer.layers:
            tracks = layer.metadata[KEY]["tracks"]
            time = time_scale(viewer, tracks.timepoints)
            if _beside_channels(viewer, time) != (layer.timepoint is not None):
                self._place(IN_SPACE, tracks)

    def _tell_time(self) -> None:
        """The timepoint, to lines in space whose first axis is not the canvas's time."""
        viewer, layer = self._viewer(), self._layers.get(IN_SPACE)
        if viewer is None or layer is None:
            return
        movies, tracks = self._session.movies, layer.metadata[KEY]["tracks"]
        time = time_scale(viewer, tracks.timepoints)
        told = movies.movie is not None and _beside_channels(viewer, time)
        layer.timepoint = movies.timepoint if told else None

    def _adding(self, chart: str, tracks: Tracks) -> Iterator[None]:
        viewer = self._viewer()
        if viewer is None:
            return
        lines = self.lines[chart]
        layer = TracksLayer(
            _vertices(lines),
            name=NAME,
            axis_labels=AXES[chart],
            features=self._features(chart, tracks),
            tail_length=min(TAIL, max(tracks.timepoints - 1, 1)),
            tail_width=WIDTH,
            blending="translucent_no_depth",
            metadata={KEY: {"layer": NAME, "chart": "", "field": "", "tracks": tracks}},
            **self._placed(chart, tracks),
        )
        yield
        self._layers[chart] = layer
        self._paint(chart)
        layer.events.color_by.connect(self._on_column)
        layer.events.colormap.connect(self._on_colormap)
        model = viewer if chart == IN_SPACE else canvas_of(viewer).model
        active = model.layers.selection.active
        self._tell_time()
        with undisturbed(model), same_view(model):
            if chart == IN_SPACE:
                viewer.add_layer(layer)
            else:
                canvas_of(viewer).add_chart_layer(layer, ON_UV)
        model.layers.selection.active = active
        if chart == IN_SPACE:
            self.far_side.add(layer)
        yield
        self._settle_time(model, tracks)

    def _settle_time(self, model: ViewerModel, tracks: Tracks) -> None:
        """Show the timepoint of the movie, which napari knows nothing of."""
        movies = self._session.movies
        scale = time_scale(model, tracks.timepoints)
        if movies.movie is not None and scale is not None:
            with undisturbed(model):
                model.dims.set_point(scale.axis, scale.point(movies.timepoint))

    def _place(self, chart: str, tracks: Tracks) -> None:
        """Put a layer where it is among those that there are now."""
        # First: napari takes its extent when the placement changes.
        self._tell_time()
        for name, value in self._placed(chart, tracks).items():
            setattr(self._layers[chart], name, value)

    def _placed(self, chart: str, tracks: Tracks) -> dict[str, Any]:
        """Where the lines are among the other layers."""
        viewer = self._viewer()
        if chart == ON_UV or viewer is None:
            return {"units": (PIXELS,) * 4}
        time = time_scale(viewer, tracks.timepoints)
        start, step, unit = (0.0, tracks.time_step_s, SECOND)
        if _beside_channels(viewer, time):
            start, step, unit = (0.0, 1.0, _unit_before_space(viewer))
        elif time is not None:
            start, step, unit = time.start, time.step, time.unit
        return {
            "units": (unit, *(UNIT,) * 3),
            "scale": (step, 1.0, 1.0, 1.0),
            "translate": (start, *origin_of(viewer)),
        }

    def _features(self, chart: str, tracks: Tracks) -> dict[str, npt.NDArray[Any]]:
        lines = self.lines[chart]
        columns = {TRACK: lines.track}
        for name in tracks.columns:
            if name not in OWN:
                columns[name] = tracks.columns[name][lines.row]
        table, places = tracks.track_table, np.searchsorted(tracks.ids, lines.track)
        for name in self._session.columns:
            if name not in columns:
                columns[name] = np.asarray(table[name])[places]
        self._columns[chart] = columns
        return columns

    def _change(self, chart: str, tracks: Tracks) -> None:
        """Give a layer other lines; napari is told once."""
        layer, lines = self._layers[chart], self.lines[chart]
        events = layer.events
        # It may have been of another movie.
        self._place(chart, tracks)
        self._syncing = True
        try:
            with events.rebuild_tracks.blocker(), events.color_by.blocker():
                # napari warns of a column that is gone for a moment.
                layer.color_by = "track_id"
                layer.data = _vertices(lines)
                layer.features = self._features(chart, tracks)
            layer.metadata = {KEY: layer.metadata[KEY] | {"tracks": tracks}}
            self._paint(chart, tell=False)
            events.rebuild_tracks()
            events.color_by()
        finally:
            self._syncing = False
        if chart in self._hidden:
            self._hidden.discard(chart)
            layer.visible = True

    def _hide(self, chart: str) -> None:
        """There is no line; napari has no empty tracks."""
        layer = self._layers.get(chart)
        if layer is not None and layer.visible:
            layer.visible = False
            self._hidden.add(chart)

    # Colours --------------------------------------------------------------------

    def _recolour(self) -> None:
        for chart in self._layers:
            if self._is_drawn(chart):
                self._paint(chart)
        self.heads.update()

    def _is_drawn(self, chart: str) -> bool:
        """Whether the lines in a layer are those of what is shown now."""
        layer, lines = self._layers[chart], self.lines.get(chart)
        shown = layer.metadata[KEY]["tracks"]
        return lines is not None and shown is self._session.shown and len(lines) == len(layer.data)

    def _paint(self, chart: str, *, tell: bool = True) -> None:
        """Colour the lines by the session's column, those that are not selected dimmed."""
        layer, lines, colours = self._layers[chart], self.lines[chart], self._session.colours
        if colours is None:
            return
        own = replace(colours).rows(self._session.selection)[lines.row]
        column = self._session.column
        syncing, self._syncing = self._syncing, True
        try:
            with layer.events.color_by.blocker(), layer.events.colormap.blocker():
                layer.color_by = column if column in self._columns[chart] else TRACK
                layer.track_colors = own
            if tell:
                layer.events.color_by()
        finally:
            self._syncing = syncing

    def _on_column(self, event: Any) -> None:
        """A person chose a column in napari's own controls."""
        if not self._syncing:
            column = event.source.color_by
            self._session.colour_by("" if column in (TRACK, *OWN) else column)
            # napari has painted the layer in its own way.
            self._colour_timer.start()

    def _on_colormap(self, event: Any) -> None:
        if not self._syncing:
            self._session.colour_by(self._session.column, event.source.colormap)
            self._colour_timer.start()

    # The end --------------------------------------------------------------------

    def _on_removed(self, event: Any) -> None:
        """A person removed a layer: it comes again with other tracks."""
        for chart, layer in list(self._layers.items()):
            if layer is event.value:
                self._forget(chart)

    def _forget(self, chart: str) -> TracksLayer:
        layer = self._layers.pop(chart)
        layer.events.color_by.disconnect(self._on_column)
        layer.events.colormap.disconnect(self._on_colormap)
        self.far_side.remove(layer)
        self._hidden.discard(chart)
        return layer

    def remove(self, chart: str) -> None:
        """Take the lines and heads of a chart away."""
        self.heads.remove(chart)
        self.lines.pop(chart, None)
        if chart not in self._layers:
            return
        take_away(self._viewer(), self._forget(chart))

    def close(self) -> None:
        """Listen no longer."""
        self._version += 1
        self._turns.clear()
        self._timer.stop()
        self._colour_timer.stop()
        self.heads.close()
        self.far_side.close()
        viewer = self._viewer()
        if viewer is not None:
            session_of(viewer).finished.disconnect(self._on_cell)
            viewer.layers.events.removed.disconnect(self._on_removed)
            viewer.layers.events.inserted.disconnect(self._on_axes)
            viewer.layers.events.removed.disconnect(self._on_axes)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes."""
        if event.type() == QEvent.Type.Close:
            self.close()
        return super().eventFilter(watched, event)


def origin_of(viewer: Any) -> tuple[float, float, float]:
    """Where the surface of the cell is placed in the 3D canvas."""
    surface = next((layer for layer in viewer.layers if chart_of(layer) == IN_SPACE), None)
    if surface is None:
        return 0.0, 0.0, 0.0
    z, y, x = surface.translate[-3:]
    return float(z), float(y), float(x)


def _beside_channels(viewer: ViewerModel, time: TimeScale | None) -> bool:
    """Whether the axis before z is another one than the time of a movie."""
    return time is not None and time.axis != viewer.dims.ndim - len(AXES[IN_SPACE])


def _unit_before_space(viewer: ViewerModel) -> str:
    """Of the axis before z: napari draws nothing in units where two layers do not agree on one."""
    place = -len(AXES[IN_SPACE])
    layers = (layer for layer in viewer.layers if type(layer) is not TracksLayer)
    return next((str(layer.units[place]) for layer in layers if layer.ndim >= -place), PIXELS)


def _vertices(lines: TrackLines) -> Floats:
    """As napari has them: (line, t, z, y, x), or (line, t, 0, v, u)."""
    place = lines.place
    if place.shape[1] == 2:
        place = np.column_stack([np.zeros(len(place)), place])
    return np.column_stack([lines.line, lines.time, place])
