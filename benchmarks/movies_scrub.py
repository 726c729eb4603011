"""What scrubbing costs: our own CPU per timepoint of a movie of 200 frames, and memory.

    .venv/bin/python benchmarks/movies_scrub.py

A cell of 60 000 vertices is brought into its common space at two timepoints; 200 frames are
made of them, each moved and coloured by itself. The window goes through all of them, without and
with an annotation on the surface, and once in any order. Per timepoint the CPU time is added up
of reading the frame and cutting its mesh (in a thread) and of everything that is done in the
window's own thread until both canvases have it; what the graphics card would do is left out, and
measured beside it ("drawn_ms"). Memory is the peak of all timepoints against that of twenty.
Without a display it starts itself anew on a virtual one.
"""

from __future__ import annotations

import argparse
import gc
import json
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from common import results
from common.children import options_of, run_child
from common.results import Bar, Entries
from common.window import on_a_display, wait_until

import napari_unwrap3d as unwrap3d

LIMIT_S = 1800.0
FRAMES, WARM = 200, 20
SIZE, VOXEL_UM, ROWS, BUMPS = 186, 0.1, 256, 10
BARS = {
    "movies/scrub-slowest": Bar(200.0, "CPU ms per timepoint"),
    "movies/scrub-rate": Bar(10.0, "frames per CPU s", at_least=True),
    "movies/scrub-memory": Bar(1.1, "peak of all timepoints / peak of 20"),
}


def bumpy_mask(phase: float) -> unwrap3d.Mask:
    """A ball with bumps that grow and shrink."""
    grid = np.indices((SIZE,) * 3, dtype=np.float32) - (SIZE - 1) / 2
    distance = np.linalg.norm(grid, axis=0) + 1e-6
    radius = np.full_like(distance, 0.28 * SIZE)
    random = np.random.default_rng(10)
    for number in range(BUMPS):
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        cosine = np.einsum("i...,i->...", grid, axis.astype(np.float32)) / distance
        height = 0.05 * SIZE * (1 + np.sin(phase + number))
        radius += height * np.exp(-((np.arccos(np.clip(cosine, -1, 1)) / 0.22) ** 2))
    return unwrap3d.Mask(distance < radius, (VOXEL_UM,) * 3)


def make_movie(folder: Path) -> int:
    """A movie of many frames, made of two; the number of vertices of one."""
    parameters = unwrap3d.Parameters.from_dict(
        {"uv": {"rows": ROWS}, "registration": {"method": "none"}}
    )
    masks = [bumpy_mask(phase) for phase in (0.0, 1.5)]
    movie = unwrap3d.unwrap_movie(masks, parameters, time_step=2.0, folder=folder).compute()
    frames = [movie.frame(t) for t in range(2)]
    manifest = folder / "movie.json"
    about = json.loads(manifest.read_text("utf-8"))
    manifest.write_text(json.dumps(about | {"timepoints": FRAMES}), "utf-8")
    random = np.random.default_rng(11)
    for timepoint in range(FRAMES):
        movie.folder.keep_frame(_moved(frames[timepoint % 2], timepoint, random), "made")
    return len(frames[0].surface.vertices)


def _moved(frame: Any, timepoint: int, random: np.random.Generator) -> Any:
    """A frame as another timepoint: its fields are noisy, its surface is pushed a little."""
    surface = frame.surface
    push = 0.05 * np.sin(surface.vertices + timepoint)
    fields = {
        name: np.asarray(values) * (1 + 0.1 * random.standard_normal(len(values)))
        for name, values in surface.fields.items()
    }
    moved = replace(surface, vertices=surface.vertices + push, fields=fields)
    uv = {n: (i * (1 + 0.1 * np.sin(timepoint))).astype(np.float32) for n, i in frame.uv.items()}
    return replace(frame, timepoint=timepoint, time_s=2.0 * timepoint, surface=moved, uv=uv)


class OwnTime:
    """CPU time inside of some functions, in the thread that calls them."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def watch(self, owner: Any, name: str) -> None:
        """Count the time in a function from now on."""
        function = getattr(owner, name)

        def timed(*arguments: Any, **more: Any) -> Any:
            begin = time.thread_time()
            try:
                return function(*arguments, **more)
            finally:
                self.seconds += time.thread_time() - begin

        setattr(owner, name, timed)

    def take(self) -> float:
        seconds, self.seconds = self.seconds, 0.0
        return seconds


class Window:
    """A window with a movie."""

    def __init__(self, folder: str) -> None:
        import napari

        from napari_unwrap3d.viewer.movies import frame_reader
        from napari_unwrap3d.viewer.movies.session import movie_session_of
        from napari_unwrap3d.viewer.movies.views import MovieViews
        from napari_unwrap3d.viewer.session import session_of
        from napari_unwrap3d.viewer.views.canvas import canvas_of

        self.reading, self.showing = OwnTime(), OwnTime()
        self.reading.watch(frame_reader, "_read")
        for name in ("_tell", "want"):
            self.showing.watch(frame_reader.FrameReader, name)
        self.viewer = napari.Viewer()
        self.viewer.window.resize(900, 700)
        self.session = movie_session_of(self.viewer)
        self.session.set_movie(unwrap3d.load_movie(folder))
        views = self.session.findChild(MovieViews)
        wait_until(lambda: views.layers is not None and views.layers.shown is not None, LIMIT_S)
        self.layers = views.layers
        self.canvas = canvas_of(self.viewer)
        wait_until(lambda: not session_of(self.viewer).turns.busy, LIMIT_S)
        self.rest()

    def rest(self) -> None:
        """Until nothing follows any more."""
        busy = self.canvas.colouring
        wait_until(lambda: not busy.busy and not self.layers._rest.isActive(), LIMIT_S)

    def annotate(self) -> None:
        """Mark a tenth of the uv image."""
        annotations = self.canvas.atlas.annotations
        annotations.add("marked")
        rows, columns = np.mgrid[ROWS // 3 : ROWS // 2, : 2 * ROWS : 2]
        annotations.draw("marked", "uv", (rows.ravel(), columns.ravel()), 1)
        wait_until(lambda: self.layers.texture is not None, LIMIT_S)
        self.rest()

    def scrub(self, timepoints: Iterable[int]) -> dict[str, Any]:
        """Go through timepoints; CPU milliseconds of each, and what memory does."""
        own, shown, drawn, memory = [], [], [], []
        for timepoint in timepoints:
            self.reading.take(), self.showing.take()
            begin = time.process_time()
            self.session.set_timepoint(timepoint)
            wait_until(self._shows(timepoint), 60.0)
            # What is read ahead is counted where it is read.
            whole = time.process_time() - begin
            read, showing = self.reading.take(), self.showing.take()
            own.append(1e3 * (read + showing))
            shown.append(1e3 * showing)
            drawn.append(1e3 * max(whole - read - showing, 0.0))
            memory.append(psutil.Process().memory_info().rss / 1e6)
        return {"own": own, "showing": shown, "drawn": drawn, "memory_mb": memory}

    def _shows(self, timepoint: int) -> Callable[[], bool]:
        return lambda: self.layers.shown.frame.timepoint == timepoint


def run_once(folder: str) -> dict[str, Any]:
    """Every scrub, in this process."""
    window = Window(folder)
    window.scrub(range(WARM))
    gc.collect()
    found = {"plain": window.scrub(range(FRAMES))}
    window.annotate()
    window.scrub(range(WARM))
    found["annotated"] = window.scrub(range(FRAMES))
    found["any order"] = window.scrub(np.random.default_rng(12).permutation(FRAMES).tolist())
    window.viewer.close()
    return found


def entries_of(found: Any, vertices: int) -> Entries:
    """The slowest timepoint of all, the rate of the slowest scrub, and how memory grows."""
    if isinstance(found, str):
        return {name: bar.entry(None, note=found) for name, bar in BARS.items()}
    mean = {name: float(np.mean(item["own"])) for name, item in found.items()}
    slowest = {name: max(item["own"]) for name, item in found.items()}
    memory = {name: item["memory_mb"] for name, item in found.items()}
    growth = {name: max(values) / max(values[:WARM]) for name, values in memory.items()}
    about = {"vertices": vertices, "frames": FRAMES}
    digits = results.significant
    return {
        "movies/scrub-slowest": BARS["movies/scrub-slowest"].entry(
            max(slowest.values()), **about, **{n: digits(v, 3) for n, v in slowest.items()}
        ),
        "movies/scrub-rate": BARS["movies/scrub-rate"].entry(
            1e3 / max(mean.values()),
            **about,
            mean_ms={n: digits(v, 3) for n, v in mean.items()},
            in_the_window_ms={n: digits(float(np.mean(i["showing"])), 3) for n, i in found.items()},
            drawn_ms={n: digits(float(np.mean(i["drawn"])), 3) for n, i in found.items()},
        ),
        "movies/scrub-memory": BARS["movies/scrub-memory"].entry(
            max(growth.values()),
            **about,
            **{n: digits(v, 4) for n, v in growth.items()},
            last_mb={n: digits(values[-1], 4) for n, values in memory.items()},
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dry", action="store_true", help="do not write the results")
    options = options_of(parser, run_once, 1)
    on_a_display()
    with tempfile.TemporaryDirectory() as name:
        vertices = make_movie(Path(name) / "movie")
        folder = str(Path(name) / "movie")
        entries = entries_of(run_child(__file__, folder, limit_s=LIMIT_S), vertices)
    results.show(entries)
    if not options.dry:
        results.merge(entries)


if __name__ == "__main__":
    main()
