"""A small movie, and a window that shows it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from napari_unwrap3d.charts import Stack
from napari_unwrap3d.motion.movie import Movie, unwrap_movie
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.viewer.movies.layers import MovieLayers
from napari_unwrap3d.viewer.movies.session import MovieSession, movie_session_of
from napari_unwrap3d.viewer.movies.views import MovieViews
from napari_unwrap3d.viewer.session import session_of
from napari_unwrap3d.viewer.views.canvas import UnwrappedCanvas, canvas_of
from shapes import QUICK

SIZE, TIMEPOINTS, TIME_STEP_S, VOXEL_UM = 56, 5, 2.0, 0.2
BUMPS = ((1.0, 0.1, 0.2), (-0.2, 1.0, 0.3), (0.1, -0.4, 1.0))
PARAMETERS = Parameters.from_dict(
    {
        **QUICK.model_dump(),
        "uv": {"rows": 64, "axis_zyx": (1.0, 0.0, 0.0)},
        "registration": {"method": "none"},
    }
)


def breathing(timepoint: int) -> np.ndarray:
    """A ball whose bumps grow and shrink, each at its own time."""
    points = np.stack(np.meshgrid(*[np.arange(SIZE) - SIZE / 2] * 3, indexing="ij"), axis=-1)
    solid = np.linalg.norm(points, axis=-1) < 14 + 0.4 * timepoint
    for number, axis in enumerate(BUMPS):
        out = 13.0 + 5.0 * np.sin(1.1 * timepoint + number) ** 2
        centre = out * np.array(axis) / np.linalg.norm(axis)
        solid |= np.linalg.norm(points - centre, axis=-1) < 5.0
    return solid


def breathing_stack() -> Stack:
    """The cell in two channels: a bright cell, and a ramp along x that grows in time."""
    ramp = np.broadcast_to(np.arange(SIZE, dtype=np.uint16), (SIZE,) * 3)
    cells = [
        np.stack([200 * breathing(t).astype(np.uint16), (1 + t) * ramp]) for t in range(TIMEPOINTS)
    ]
    size = (VOXEL_UM,) * 3
    return Stack(np.stack(cells), "tczyx", size, TIME_STEP_S, ("membrane", "ramp"), "breathing")


def make_movie(folder: Path) -> Movie:
    """All frames of the cell, in a folder."""
    return unwrap_movie(breathing_stack(), PARAMETERS, folder=folder).compute()


class Projector:
    """A window that shows a movie."""

    def __init__(self, viewer: Any, movie: Movie, qtbot: Any) -> None:
        self.viewer, self.movie, self.qtbot = viewer, movie, qtbot
        self.session: MovieSession = movie_session_of(viewer)
        self.session.set_movie(movie)
        self.wait(lambda: self.views.layers is not None and self.views.layers.shown is not None)
        self.canvas: UnwrappedCanvas = canvas_of(viewer)
        self.wait(lambda: not session_of(viewer).turns.busy)
        self.wait(lambda: self.canvas.cursor.ready)
        self.settle()

    @property
    def views(self) -> MovieViews:
        return self.session.findChild(MovieViews)

    @property
    def layers(self) -> MovieLayers:
        layers = self.views.layers
        assert layers is not None
        return layers

    @property
    def cell(self) -> Any:
        return self.viewer.layers["cell at t"]

    @property
    def main(self) -> Any:
        return self.viewer.window._qt_viewer.canvas.native

    @property
    def second(self) -> Any:
        return self.canvas.qt_viewer.canvas.native

    def wait(self, condition: Any) -> None:
        self.qtbot.waitUntil(condition, timeout=60_000)

    def settle(self) -> None:
        """Wait until the field is on every layer."""
        colouring = self.canvas.colouring
        self.wait(lambda: not colouring.busy and not self.layers._rest.isActive())

    def go_to(self, timepoint: int) -> None:
        """Ask for a timepoint, and wait until it is shown."""
        self.session.set_timepoint(timepoint)
        self.wait(partial(self._shows, timepoint))

    def _shows(self, timepoint: int) -> bool:
        shown = self.layers.shown
        return shown is not None and shown.frame.timepoint == timepoint
