"""How long the window is held up while a movie is unwrapped in it.

    .venv/bin/python benchmarks/movies_heartbeat.py

As views_heartbeat.py, for a simulated timelapse of a blebbing cell: a click on "Run all", all four
stages, the movie's first pictures, and then a scrub through all its timepoints.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from common import results
from common.children import options_of, run_child
from common.live_run import LIMIT_S, Drawing, Heartbeat, Spent
from common.window import on_a_display, wait_until
from views_heartbeat import entries_of, show_longest

import napari_unwrap3d as unwrap3d

NAME = "movies/heartbeat"
TIMEPOINTS, SIZE, ROWS = 8, 112, 256
PER_TIMEPOINT_S = 0.3


def run() -> dict[str, Any]:
    """Unwrap a simulated timelapse in a window of its own; the gaps between its heartbeats."""
    import napari
    from napari.layers import Layer
    from qtpy.QtCore import Qt
    from qtpy.QtTest import QTest

    from napari_unwrap3d.viewer.demo import WINDOW
    from napari_unwrap3d.viewer.files.samples import timelapse_layer
    from napari_unwrap3d.viewer.wizard import open_wizard

    viewer = napari.Viewer()
    viewer.window.resize(*WINDOW)
    spent = Spent()
    drawing = Drawing(type(viewer.window._qt_viewer.canvas._scene_canvas._backend), spent)
    simulated = unwrap3d.simulate.movie("blebs", 0, timepoints=TIMEPOINTS, size=SIZE)
    viewer.layers.append(Layer.create(*timelapse_layer(simulated.stack)))
    panel = open_wizard(viewer).show_movie()
    parameters = unwrap3d.Parameters.from_dict({"uv": {"rows": ROWS}})
    panel.run.session.set_parameters(parameters)
    _rest(2.0)
    heart = Heartbeat(drawing, spent, lambda: panel.progress_bar.format())
    heart.start()
    started = time.monotonic()
    QTest.mouseClick(panel.run_button, Qt.MouseButton.LeftButton)
    wait_until(lambda: not panel.run.running, LIMIT_S)
    seconds = time.monotonic() - started
    _rest(2.0)
    for timepoint in range(TIMEPOINTS):
        panel.movies.set_timepoint(timepoint)
        _rest(PER_TIMEPOINT_S)
    heart.stop()
    layers = len(viewer.layers)
    viewer.close()
    return {"gaps": heart.gaps, "seconds": seconds, "layers": layers}


def _rest(seconds: float) -> None:
    stop = time.monotonic() + seconds
    wait_until(lambda: time.monotonic() > stop, LIMIT_S)


def main() -> None:
    options_of(argparse.ArgumentParser(description=__doc__.splitlines()[0]), run)
    on_a_display()
    found = run_child(__file__, limit_s=LIMIT_S)
    entries = entries_of(NAME, found)
    results.show(entries)
    show_longest(found)
    results.merge(entries, drop=[NAME])


if __name__ == "__main__":
    main()
