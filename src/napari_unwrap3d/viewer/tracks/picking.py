"""A click on a track, in any view, selects it; what is clicked is what is seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...charts import Floats
from ...geometry.segments import across, distance_to_segments
from ..annotations.annotating import open_annotating
from ..annotations.painting import LOOK
from ..views.canvas import open_canvas
from ..views.clicking import Clicks

if TYPE_CHECKING:
    from .layers import TrackLayers
    from .session import TracksSession

# How near to a line or a head a click selects it.
NEAR_PIXELS = 8.0
IN_SPACE, ON_UV = "surface", "uv"


class TrackPicking(Clicks):
    """Selects the tracks that are clicked in the two canvases of a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    session : TracksSession
    layers : TrackLayers
    """

    def __init__(self, viewer: Any, session: TracksSession, layers: TrackLayers) -> None:
        super().__init__(viewer, session)
        self._session, self._layers = session, layers
        session.shown_changed.connect(self._begin)
        session.movies.frame_changed.connect(self._begin)
        self._begin()

    def _begin(self, _: Any = None) -> None:
        """Listen once there is something to click, in every canvas that is open."""
        viewer = self._viewer()
        if viewer is None or self._session.tracks is None:
            return
        canvas = open_canvas(viewer)
        known = [(viewer, viewer.window._qt_viewer)]
        if canvas is not None:
            known.append((canvas.model, canvas.qt_viewer))
        for model, qt_viewer in known:
            if model not in self._models:
                self.listen(model, qt_viewer.canvas.native)

    def may_pick(self, model: Any) -> bool:
        """Whether there is a track to click, and no tool is in hand."""
        viewer = self._viewer()
        if viewer is None or self._session.shown is None:
            return False
        annotating = open_annotating(viewer)
        if annotating is not None and annotating.tool != LOOK:
            return False
        return super().may_pick(model)

    def pick(self, model: Any, event: Any, adding: bool) -> None:
        """Select the track that was clicked."""
        track = self.track_at(model, event)
        if track is not None and adding:
            self._session.toggle(track)
        elif track is not None:
            self._session.select([track])
        elif not adding:
            self._session.select([])

    def track_at(self, model: Any, event: Any) -> int | None:
        """The track that is seen under the pointer, None where there is none."""
        viewer = self._viewer()
        if viewer is None:
            return None
        seen = self._in_space(viewer, event) if model is viewer else self._on_image(event)
        if seen is None:
            return None
        starts, ends, tracks, point = seen
        if not len(tracks):
            return None
        distances = distance_to_segments(point, starts, ends)
        nearest = int(np.argmin(distances))
        near = NEAR_PIXELS / float(model.scene.camera.zoom)
        return int(tracks[nearest]) if distances[nearest] <= near else None

    def _on_image(self, event: Any) -> tuple[Floats, Floats, Any, Floats] | None:
        """What is seen of the uv image, in (v, u)."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        if canvas is None or canvas.chart != ON_UV:
            return None
        starts, ends, tracks = self._segments(ON_UV)
        return starts, ends, tracks, np.asarray(event.position, float)[-2:]

    def _in_space(self, viewer: Any, event: Any) -> tuple[Floats, Floats, Any, Floats] | None:
        """What is seen of the cell, as it is seen along the direction of sight."""
        layer = self._layers.layer(IN_SPACE) or self._layers.heads.layer(IN_SPACE)
        if viewer.dims.ndisplay != 3 or layer is None:
            return None
        starts, ends, tracks = self._segments(IN_SPACE)
        shift = layer.translate[-3:]
        starts, ends = starts + shift, ends + shift
        front = self._layers.far_side.in_front(starts) & self._layers.far_side.in_front(ends)
        axes = across(np.asarray(event.view_direction, float)[-3:])
        point = axes @ np.asarray(event.position, float)[-3:]
        return starts[front] @ axes.T, ends[front] @ axes.T, tracks[front], point

    def _segments(self, chart: str) -> tuple[Floats, Floats, npt.NDArray[np.int64]]:
        """From where to where (k, n), and of which track (k,), what is drawn now goes."""
        session, count = self._session, 3 if chart == IN_SPACE else 2
        parts: list[tuple[Floats, Floats, Any]] = []
        lines, layer = self._layers.lines.get(chart), self._layers.layer(chart)
        if lines is not None and layer is not None and layer.visible and len(lines):
            now = session.timepoint
            low, high = now - layer.tail_length, now + layer.head_length
            # A line that begins within the tail is seen, also where it has come from before.
            seen = lines.joined() & (lines.time[1:] >= low) & (lines.time[1:] <= high)
            parts.append((lines.place[:-1][seen], lines.place[1:][seen], lines.track[1:][seen]))
        heads = self._layers.heads.layer(chart)
        if heads is not None and heads.visible and session.shown is not None:
            rows = self._layers.heads.rows(chart)
            tracks = session.shown
            own = (tracks.position_um if chart == IN_SPACE else tracks.place_px)[rows]
            parts.append((own, own, tracks.track_id[rows]))
        if not parts:
            return np.zeros((0, count)), np.zeros((0, count)), np.zeros(0, np.int64)
        starts, ends, tracks_of = (np.concatenate(each) for each in zip(*parts, strict=True))
        return starts, ends, tracks_of

    def clear(self) -> None:
        """Select nothing."""
        self._session.select([])
