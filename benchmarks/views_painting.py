"""What drawing costs: our own CPU per mouse event, with 300 000 faces and 1024 × 512 pixels.

    .venv/bin/python benchmarks/views_painting.py

Real mouse events of a stroke of 200 go through Qt and napari; the CPU time inside of our
own functions is added up for each. Painting the window is left out, and measured in a
second stroke ("rendered_ms" per event, with everything that napari and Qt do). Without a
display it starts itself anew on a virtual one.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.cases import FULL, simulated
from common.children import options_of, run_child
from common.results import Bar, Entries
from common.window import mouse, on_a_display

import napari_unwrap3d as unwrap3d

LIMIT_S, READY_S = 900.0, 120.0
EVENTS = 200
# A working voxel that gives the bleb cell 300 000 faces.
FINER = 0.86
PAUSE_S = 0.01
BARS = {
    "views/paint-uv-to-surface": Bar(5.0, "CPU ms per event"),
    "views/paint-surface-to-uv": Bar(5.0, "CPU ms per event"),
    "views/pick": Bar(1.0, "CPU ms"),
}


class OwnTime:
    """CPU time inside of some functions, those that they call included, counted once."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0

    def watch(self, owner: Any, name: str) -> None:
        """Count the time in a method from now on."""
        method = getattr(owner, name)

        def timed(*arguments: Any, **more: Any) -> Any:
            with self:
                found = method(*arguments, **more)
            return self._steps(found) if hasattr(found, "send") else found

        timed.__name__ = name
        setattr(owner, name, timed)

    def _steps(self, steps: Iterator[Any]) -> Iterator[Any]:
        """A mouse callback is a generator: every step of it counts."""
        while True:
            with self:
                try:
                    step = next(steps)
                except StopIteration:
                    return
            yield step

    def __enter__(self) -> None:
        if self._depth == 0:
            self._begin = time.process_time()
        self._depth += 1

    def __exit__(self, *_: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.process_time() - self._begin

    def take(self) -> float:
        seconds, self.seconds = self.seconds, 0.0
        return seconds


class Strokes:
    """A window with the cell, and a hand that draws in it."""

    def __init__(self, atlas: unwrap3d.Atlas) -> None:
        import napari
        from qtpy.QtWidgets import QApplication

        from napari_unwrap3d.viewer.annotations import drawing, painting, texturing
        from napari_unwrap3d.viewer.annotations.annotating import annotating_of
        from napari_unwrap3d.viewer.session import session_of
        from napari_unwrap3d.viewer.views.canvas import canvas_of
        from napari_unwrap3d.viewer.views.layers import atlas_layers, split_layers
        from napari_unwrap3d.viewer.views.placing import place_layers

        self.own, self.picks = OwnTime(), OwnTime()
        self.own.watch(painting.SurfacePainter, "drag")
        self.picks.watch(painting.SurfacePainter, "pick")
        for name in ("_on_drawn", "_on_changed", "show_changes"):
            self.own.watch(drawing.DrawnLabels, name)
        for name in ("_on_changed", "_show"):
            self.own.watch(texturing.Texturing, name)
        self.viewer = napari.Viewer(ndisplay=3)
        self.app = QApplication.instance()
        self.viewer.window.resize(1400, 1000)
        own, _ = split_layers(atlas_layers(atlas))
        shown = ("surface", "reference")
        place_layers(self.viewer, [each for each in own if each[1]["name"] in shown])
        self.canvas = canvas_of(self.viewer)
        self.annotating = annotating_of(self.viewer)
        session = session_of(self.viewer)
        session.atlas = atlas
        session.finished.emit(atlas)
        atlas.annotations.add("drawn")
        self.natives = [
            self.viewer.window._qt_viewer.canvas.native,
            self.canvas.qt_viewer.canvas.native,
        ]
        self.wait(self.ready)
        self.viewer.reset_view()
        self.wait(lambda: True)

    def ready(self) -> bool:
        annotating, viewer = self.annotating, self.viewer
        return (
            annotating.layers.layer("drawn", "uv") is not None
            and annotating.painter.ready(viewer.layers["surface"])
            and annotating.texturing.texture_of(viewer.layers["surface"]) is not None
            and annotating.texturing.texture_of(viewer.layers["reference"]) is not None
        )

    def wait(self, condition: Callable[[], bool]) -> None:
        stop = time.monotonic() + READY_S
        while not condition():
            if time.monotonic() > stop:
                raise TimeoutError("The window did not get ready.")
            self.app.processEvents()
        for _ in range(20):
            self.app.processEvents()

    def draw(self, canvas: Any, tool: str, rendered: bool) -> tuple[list[float], list[float]]:
        """CPU seconds per event of a stroke: our own, and of everything."""
        self.annotating.tool = tool
        self.wait(lambda: True)
        turn = np.linspace(0.0, 2.0 * np.pi, EVENTS + 1)
        places = [(0.5 + 0.15 * float(np.cos(t)), 0.5 + 0.2 * float(np.sin(t))) for t in turn]
        own: list[float] = []
        whole: list[float] = []

        def follow(move: Callable[[], None]) -> None:
            if not own:
                self.app.processEvents()
                self.own.take(), self.picks.take()
            begin = time.process_time()
            move()
            # napari takes one event per some milliseconds; the timers of this one run in the
            # next turns of the event loop.
            for _ in range(3):
                time.sleep(PAUSE_S)
                self.app.processEvents()
            whole.append(time.process_time() - begin)
            own.append(self.own.take())

        for each in self.natives:
            each.setUpdatesEnabled(rendered)
        mouse().drag(canvas, places, follow)
        for each in self.natives:
            each.setUpdatesEnabled(True)
        self.wait(lambda: True)
        return own, whole

    def pick(self) -> list[float]:
        """CPU seconds of picks all over the canvas."""
        direction = np.asarray(self.viewer.scene.camera.view_direction)
        surface = self.viewer.layers["surface"]
        chosen = np.random.default_rng(0).integers(0, len(surface.data[0]), EVENTS)
        self.picks.take()
        seconds = []
        for point in surface.data[0][chosen]:
            self.annotating.painter.pick(surface.data_to_world(point), direction)
            seconds.append(self.picks.take())
        return seconds

    def marked(self) -> int:
        return int((self.annotating.annotations.labels("drawn") > 0).sum())


def run_once(project: str) -> dict[str, Any]:
    """Milliseconds of every stroke, in this process."""
    atlas = unwrap3d.load(project)
    strokes = Strokes(atlas)
    main, second = strokes.natives
    found: dict[str, Any] = {"faces": len(atlas.surface.faces)}
    for name, canvas in (("surface-to-uv", main), ("uv-to-surface", second)):
        before = strokes.marked()
        own, whole = strokes.draw(canvas, "brush", rendered=False)
        if strokes.marked() == before:
            raise RuntimeError(f"The stroke {name} marked nothing.")
        _, rendered = strokes.draw(canvas, "erase", rendered=True)
        found[name] = {
            "own_ms": 1e3 * float(np.median(own)),
            "slowest_ms": 1e3 * float(np.max(own)),
            "with_napari_ms": 1e3 * float(np.median(whole)),
            "rendered_ms": 1e3 * float(np.median(rendered)),
        }
    picks = strokes.pick()
    found["pick"] = {"own_ms": 1e3 * float(np.median(picks)), "slowest_ms": 1e3 * float(max(picks))}
    strokes.viewer.close()
    return found


def unwrapped_cell(folder: str) -> str:
    """The project of a bleb cell with 300 000 faces and its direct chart."""
    mask = simulated("blebs", 0).truth.mask
    parameters = {
        "stack": {"working_voxel_um": FINER * mask.voxel_size[0]},
        "uv": {"rows": FULL},
        "direct": {"rows": FULL},
    }
    atlas = unwrap3d.unwrap(mask, unwrap3d.Parameters.from_dict(parameters))
    _ = atlas.direct
    return str(atlas.save(Path(folder) / "cell.unwrap3d"))


def entries_of(found: Any) -> Entries:
    if isinstance(found, str):
        return {name: bar.entry(None, note=found) for name, bar in BARS.items()}
    entries = {}
    for name, bar in BARS.items():
        measured = dict(found[name.removeprefix("views/").removeprefix("paint-")])
        value = measured.pop("own_ms")
        more = {key: results.significant(item, 3) for key, item in measured.items()}
        entries[name] = bar.entry(value, faces=found["faces"], **more)
    return entries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--project", help="an unwrapped cell to use instead")
    parser.add_argument("--dry", action="store_true", help="do not write the results")
    options = options_of(parser, run_once, 1)
    on_a_display()
    with tempfile.TemporaryDirectory() as folder:
        project = options.project or unwrapped_cell(folder)
        entries = entries_of(run_child(__file__, project, limit_s=LIMIT_S))
    results.show(entries)
    if not options.dry:
        results.merge(entries)


if __name__ == "__main__":
    main()
