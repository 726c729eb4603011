"""How long the window is held up during a whole run: the longest gap between two heartbeats.

    .venv/bin/python benchmarks/views_heartbeat.py

A timer beats every 5 ms while a simulated cell is unwrapped in a window and every chart is
placed in it. A gap is held against the bar by the CPU time that the window's thread spent in
it, as the time on the clock also counts what other programs and the computing thread take;
that is given beside it, as is what drawing the canvas took of it.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from common import results
from common.children import options_of, run_child
from common.results import Bar, Entries
from common.window import on_a_display, wait_until

import napari_unwrap3d as unwrap3d

LIMIT_S = 1200.0
SIZE = 120
BEAT_MS = 5
BAR = Bar(100.0, "CPU ms of the window's thread")
NAME = "views/heartbeat"


def run_all() -> dict[str, Any]:
    """The longest gaps in milliseconds, drawing left out, and how long the run took."""
    import napari
    from qtpy.QtCore import QTimer

    from napari_unwrap3d.viewer import demo

    viewer = napari.Viewer()
    drawing = {"cpu": 0.0}
    canvas = type(viewer.window._qt_viewer.canvas._scene_canvas._backend)
    draw = canvas.paintGL
    depth = 0

    def timed(backend: Any) -> None:
        nonlocal depth
        start = time.thread_time()
        depth += 1
        try:
            draw(backend)
        finally:
            depth -= 1
            if not depth:
                drawing["cpu"] += time.thread_time() - start

    canvas.paintGL = timed
    wait_until(lambda: True, 5.0)
    gaps: list[tuple[float, float, float, str]] = []
    last = [time.thread_time(), time.monotonic(), 0.0]

    def beat() -> None:
        now = [time.thread_time(), time.monotonic(), drawing["cpu"]]
        cpu, clock, drawn = (1000 * (b - a) for a, b in zip(last, now, strict=True))
        gaps.append((cpu - drawn, clock, drawn, viewer.layers[-1].name if viewer.layers else ""))
        last[:] = now

    parameters = unwrap3d.Parameters.from_dict(
        {"uv": {"rows": 256}, "reference": {"vertices": 30_000}}
    )
    wizard = demo.start_demo(viewer, "blebs", parameters=parameters, size=SIZE)
    wait_until(lambda: True, 1.0)
    last[:] = [time.thread_time(), time.monotonic(), drawing["cpu"]]
    timer = QTimer()
    timer.timeout.connect(beat)
    timer.start(BEAT_MS)
    start = time.monotonic()
    wait_until(lambda: not wizard.session.running, LIMIT_S)
    seconds = time.monotonic() - start
    timer.stop()
    layers = len(viewer.layers)
    viewer.close()
    return {
        "gaps": sorted(gaps, reverse=True)[:10],
        "clock": max(g[1] for g in gaps),
        "beats": len(gaps),
        "seconds": seconds,
        "layers": layers,
    }


def entries_of(found: Any) -> Entries:
    """The longest gap against the bar."""
    if isinstance(found, str):
        return {NAME: BAR.entry(None, note=found)}
    return {
        NAME: BAR.entry(
            found["gaps"][0][0],
            clock_ms=results.significant(found["clock"], 3),
            beats=found["beats"],
            run_s=results.significant(found["seconds"], 3),
            layers=found["layers"],
        )
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, run_all)
    on_a_display()
    found = run_child(__file__, limit_s=LIMIT_S)
    entries = entries_of(found)
    results.show(entries)
    if not isinstance(found, str):
        for own, clock, drawn, layer in found["gaps"]:
            print(f"    {own:6.1f} ms ({clock:.1f} on the clock, drawing {drawn:.1f}), at {layer}")
    results.merge(entries)


if __name__ == "__main__":
    main()
