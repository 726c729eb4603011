"""Tracks that wander over a small movie, and a window that shows both."""

from __future__ import annotations

from typing import Any

import numpy as np
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.geometry.padding import wrap_uv
from napari_unwrap3d.motion.movie import Movie
from napari_unwrap3d.tracking.laying import position_of
from napari_unwrap3d.viewer.tracks.layers import TrackLayers
from napari_unwrap3d.viewer.tracks.session import TracksSession, tracks_session_of
from viewer.playing import Projector

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
CONTROL = Qt.KeyboardModifier.ControlModifier
SHOWN, OTHER = "protrusions", "other"
STEP = 0.06


def wandering(movie: Movie, count: int = 12, seed: int = 0) -> Tracks:
    """Tracks that go straight on over the uv image, the first over the seam, the second over
    the north pole; the third and later ones begin and end where they like.
    """
    rng, rows = np.random.default_rng(seed), movie.common.uv.shape[0]
    starts = np.column_stack([rng.uniform(0.2, 0.8, count), rng.uniform(0, 2, count)]) * rows
    steps = rng.normal(0, STEP, (count, 2)) * rows
    half = len(movie) / 2
    starts[0], steps[0] = (0.5 * rows, 2 * rows - half * STEP * rows), (0, STEP * rows)
    starts[1], steps[1] = (half * STEP * rows, 0.6 * rows), (-STEP * rows, 0)
    columns: dict[str, list[Any]] = {
        name: [] for name in ("track_id", "timepoint", "z_um", "y_um", "x_um", "v_px", "u_px")
    }
    columns["area_um2"] = []
    for timepoint in range(len(movie)):
        there = wrap_uv(starts + timepoint * steps, rows)
        space = position_of(movie, timepoint, there)
        for track in range(count):
            if track > 1 and not track % 3 <= timepoint < len(movie) - (track % 2):
                continue
            values = (track + 1, timepoint, *space[track], *there[track], 1.0 + track + timepoint)
            for name, value in zip(columns, values, strict=True):
                columns[name].append(value)
    return Tracks.of(
        columns,
        time_step_s=movie.time_step_s,
        timepoints=len(movie),
        rows=rows,
        splits=np.array([(1, 3)]) if count > 2 else np.zeros((0, 2), np.int64),
        method="imported",
    )


class Tracked(Projector):
    """A window that shows a movie and the tracks that were kept with it."""

    def __init__(self, viewer: Any, movie: Movie, qtbot: Any) -> None:
        # As when the docks are open before the movie is.
        self.tracking: TracksSession = tracks_session_of(viewer)
        super().__init__(viewer, movie, qtbot)
        self.wait(lambda: self.tracking.tracks is not None)
        self.tracks: Tracks = self.tracking.tracks
        self.drawn()

    @property
    def lines(self) -> TrackLayers:
        return self.tracking.findChild(TrackLayers)

    def heads(self, chart: str) -> dict[int, Any]:
        """Where the heads are that are shown on a chart, by track."""
        layer = self.lines.heads.layer(chart)
        assert layer is not None
        return dict(zip(layer.features["track"].tolist(), layer.data, strict=True))

    def there(self, timepoint: int) -> set[int]:
        """The tracks that are shown and somewhere at a timepoint."""
        shown = self.tracking.shown
        assert shown is not None
        return set(shown.track_id[shown.timepoint == timepoint].tolist())

    def row(self, track: int, timepoint: int) -> int:
        """Of the tracks as they are now."""
        tracks = self.tracking.tracks
        assert tracks is not None
        rows = tracks.rows_of(track)
        return rows.start + int(np.searchsorted(tracks.timepoint[rows], timepoint))

    def drawn(self) -> None:
        """Wait until the tracks are shown as they are."""
        self.wait(lambda: not self.lines.busy)

    def go_to(self, timepoint: int) -> None:
        super().go_to(timepoint)
        self.drawn()

    def dock(self, kind: Any, name: str) -> Any:
        widget = kind(self.viewer)
        self.viewer.window.add_dock_widget(widget, name=name)
        QApplication.processEvents()
        return widget

    # The mouse ------------------------------------------------------------------

    def on_image(self, place: Any) -> QPoint:
        """Where a (v, u) is on the second canvas."""
        camera = self.canvas.model.scene.camera
        half = np.array([self.second.height(), self.second.width()]) / 2
        y, x = (np.asarray(place, float) - np.asarray(camera.center)[-2:]) * camera.zoom + half
        return QPoint(round(x), round(y))

    def in_space(self, position: Any) -> QPoint:
        """Where a (z, y, x) in µm of the surface is on the main canvas."""
        visual = self.viewer.window._qt_viewer.canvas.layer_to_visual[self.cell]
        transform = visual.node.get_transform("visual", "canvas")
        x, y, _, w = transform.map([*np.asarray(position, float)[::-1], 1.0])
        return QPoint(round(x / w), round(y / w))

    def click(self, native: Any, point: QPoint, keys: Any = NONE) -> None:
        QTest.mouseMove(native, point)
        QTest.mouseClick(native, LEFT, keys, point)
        QApplication.processEvents()
