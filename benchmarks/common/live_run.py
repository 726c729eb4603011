"""A whole run in a window, started with the mouse: how long it stands, and what is seen when."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import napari_unwrap3d as unwrap3d
from common.window import wait_until

LIMIT_S = 1200.0
BEAT_MS = 5
# Smaller charts for the small cell, as someone would choose who is in a hurry.
PARAMETERS: dict[int, dict[str, Any]] = {
    120: {"uv": {"rows": 256}, "reference": {"vertices": 30_000}},
    200: {},
}


class Spent:
    """What the calling thread has spent so far, in seconds: on the clock, at work, in the queue.

    In the queue it could work, but other threads and programs have the cores; only Linux tells.
    """

    def __init__(self) -> None:
        self._file = -1
        if sys.platform == "linux":
            path = f"/proc/self/task/{threading.get_native_id()}/schedstat"
            self._file = os.open(path, os.O_RDONLY)

    def now(self) -> tuple[float, float, float]:
        if self._file < 0:
            return time.monotonic(), time.thread_time(), 0.0
        work, queue = os.pread(self._file, 100, 0).split()[:2]
        return time.monotonic(), int(work) / 1e9, int(queue) / 1e9


class Drawing:
    """Sums up what the thread spends on drawing canvases."""

    def __init__(self, backend: Any, spent: Spent) -> None:
        self.total = [0.0, 0.0, 0.0]
        draw, depth = backend.paintGL, 0

        def timed(canvas: Any) -> None:
            nonlocal depth
            start = spent.now()
            depth += 1
            try:
                draw(canvas)
            finally:
                depth -= 1
                if not depth:
                    self.total = [
                        total + after - before
                        for total, before, after in zip(self.total, start, spent.now(), strict=True)
                    ]

        backend.paintGL = timed


class Heartbeat:
    """A timer of the window's thread, and what held it up between two beats.

    Parameters
    ----------
    drawing : Drawing
    spent : Spent
        Of the window's thread.
    there : callable
        Names what was there last, at every beat.

    Attributes
    ----------
    gaps : list of tuple
        Per beat the milliseconds (own, waiting, queue, drawing, clock) and what was there.
    """

    def __init__(self, drawing: Drawing, spent: Spent, there: Callable[[], str]) -> None:
        from qtpy.QtCore import Qt, QTimer

        self.gaps: list[tuple[float, float, float, float, float, str]] = []
        self._drawing, self._spent, self._there = drawing, spent, there
        self._timer = QTimer()
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._beat)

    def start(self) -> None:
        self._begin()
        self._timer.start(BEAT_MS)

    def stop(self) -> None:
        self._timer.stop()

    def _begin(self) -> None:
        self._last = [*self._spent.now(), *self._drawing.total]
        self._others = time.process_time()

    def _beat(self) -> None:
        now, computed = [*self._spent.now(), *self._drawing.total], time.process_time()
        clock, work, queue, *drawn = (1000 * (b - a) for a, b in zip(self._last, now, strict=True))
        own = work - drawn[1]
        waiting = clock - drawn[0] - own - (queue - drawn[2])
        # Whoever has what it waits for may itself stand in the queue behind other programs.
        waiting = max(min(waiting, 1000 * (computed - self._others) - work), 0.0)
        self.gaps.append((own, waiting, queue, drawn[0], clock, self._there()))
        self._begin()


class StepEnds(logging.Handler):
    """When each step ended, as the pipeline's log has it."""

    def __init__(self) -> None:
        super().__init__()
        self.at: dict[str, float] = {}
        logger = logging.getLogger("napari_unwrap3d.pipeline")
        logger.setLevel(logging.INFO)
        logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        if isinstance(record.args, tuple) and record.msg.startswith("%s took"):
            self.at[str(record.args[0])] = time.monotonic()


def first_paint_watch(bar: Any) -> dict[str, float]:
    """When a progress bar was first painted, and first with a step's name; the work until then."""
    from qtpy.QtCore import QEvent, QObject

    seen: dict[str, float] = {}

    class Watch(QObject):
        def eventFilter(self, watched: Any, event: Any) -> bool:
            if event.type() == QEvent.Type.Paint:
                seen.setdefault("bar", time.monotonic())
                seen.setdefault("work", time.thread_time())
                if watched.format() != "starting":
                    seen.setdefault("step", time.monotonic())
            return False

    bar.installEventFilter(Watch(bar))
    return seen


def run(size: int) -> dict[str, Any]:
    """Unwrap a simulated cell in a window of its own.

    Parameters
    ----------
    size : int
        Edge of its stack in voxels, one of :data:`PARAMETERS`.

    Returns
    -------
    dict
        ``gaps``, per heartbeat the milliseconds (own, waiting, queue, drawing, clock) and what
        was there last; ``seen``, seconds from the click to the progress ``bar`` and the first
        ``step`` in it, and the ``work`` of the window's thread until the bar; ``ends``, to the
        end of each step; ``placed``, to the layer of each chart; ``seconds``, to the run's end.
    """
    import napari
    from napari.layers import Layer
    from qtpy.QtCore import Qt
    from qtpy.QtTest import QTest

    from napari_unwrap3d.viewer.demo import WINDOW
    from napari_unwrap3d.viewer.files.samples import sample
    from napari_unwrap3d.viewer.views.canvas import open_canvas
    from napari_unwrap3d.viewer.views.placing import chart_of
    from napari_unwrap3d.viewer.wizard import open_wizard

    viewer = napari.Viewer()
    viewer.window.resize(*WINDOW)
    spent, ends = Spent(), StepEnds()
    drawing = Drawing(type(viewer.window._qt_viewer.canvas._scene_canvas._backend), spent)
    stack, *others = [Layer.create(*each) for each in sample("blebs", size=size, seed=0)]
    viewer.layers.extend([stack, *others])
    viewer.layers.selection.active = stack
    wizard = open_wizard(viewer)
    session = wizard.session
    session.set_source(stack)
    session.set_parameters(unwrap3d.Parameters.from_dict(PARAMETERS[size]))
    stop = time.monotonic() + 2.0
    wait_until(lambda: time.monotonic() > stop, LIMIT_S)

    placed: dict[str, float] = {}

    def there() -> str:
        canvas = open_canvas(viewer)
        layers = [*viewer.layers, *(canvas.model.layers if canvas is not None else ())]
        for layer in layers:
            if chart_of(layer):
                placed.setdefault(chart_of(layer), time.monotonic())
        return next(reversed(placed), "")

    heart = Heartbeat(drawing, spent, there)
    seen = first_paint_watch(wizard.progress_bar)
    heart.start()
    clicked, worked = time.monotonic(), time.thread_time()
    QTest.mouseClick(wizard.run_button, Qt.MouseButton.LeftButton)
    wait_until(lambda: not session.running, LIMIT_S)
    ended = time.monotonic()
    # What is shown and linked after the run's end belongs to it.
    wait_until(lambda: not session.turns.busy and time.monotonic() > ended + 2.0, LIMIT_S)
    heart.stop()
    layers = len(viewer.layers)
    viewer.close()
    return {
        "gaps": heart.gaps,
        "seen": {n: at - (worked if n == "work" else clicked) for n, at in seen.items()},
        "ends": {name: at - clicked for name, at in ends.at.items()},
        "placed": {name: at - clicked for name, at in placed.items()},
        "seconds": ended - clicked,
        "layers": layers,
    }
