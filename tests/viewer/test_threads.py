"""Work in a thread: its end comes after everything that it sent."""

from __future__ import annotations

import concurrent.futures
import gc
import os
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from qtpy.QtCore import QObject, Signal

from napari_unwrap3d.viewer.common import threads
from napari_unwrap3d.viewer.common.threads import STANDS_BACK, TURN_SECONDS, QuietCollector, Task
from napari_unwrap3d.viewer.common.turns import Turns


class Sender(QObject):
    sent = Signal(str)


class Patient(concurrent.futures.ThreadPoolExecutor):
    """An executor that returns from `submit` when the work is done: the race, always lost."""

    def submit(self, *arguments: Any) -> Any:
        future = super().submit(*arguments)
        concurrent.futures.wait([future])
        return future


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "ThreadPoolExecutor", Patient)


@pytest.mark.usefixtures("patient")
def test_the_end_does_not_overtake_what_was_sent_before(qtbot: Any) -> None:
    order: list[str] = []
    sender = Sender()
    receiver = Receiver(order)
    sender.sent.connect(receiver.take)
    task = Task(lambda: sender.sent.emit("chart"))
    task.returned.connect(receiver.end)
    task.start()
    qtbot.waitUntil(lambda: "end" in order, timeout=5000)
    assert order == ["chart", "end"]


@pytest.mark.usefixtures("patient")
def test_an_error_comes_back_and_the_wait_ends(qtbot: Any) -> None:
    def fail() -> None:
        raise ValueError("no")

    task = Task(fail)
    with qtbot.waitSignal(task.failed, timeout=5000) as failed:
        task.start()
    assert isinstance(failed.args[0], ValueError)
    assert task.wait(5.0)


@pytest.mark.usefixtures("real_collector")
def test_the_collector_is_quiet_until_the_last_lets_go() -> None:
    collector, first, second = QuietCollector(), object(), object()
    before = gc.get_freeze_count()
    for holder in (first, first, second):
        collector.hold(holder)
    assert gc.get_freeze_count() > before
    collector.release(first)
    assert gc.get_freeze_count() > before
    for holder in (second, second):
        collector.release(holder)
    assert gc.get_freeze_count() == 0


@pytest.mark.usefixtures("real_collector")
def test_the_collector_also_leaves_alone_what_was_made_meanwhile() -> None:
    collector, holder = QuietCollector(), object()
    collector.renew()
    assert gc.get_freeze_count() == 0
    collector.hold(holder)
    before = gc.get_freeze_count()
    made = [[each] for each in range(2000)]
    assert gc.get_freeze_count() == before
    collector.renew()
    assert gc.get_freeze_count() >= before + len(made)
    collector.release(holder)
    assert gc.get_freeze_count() == 0


def test_threads_take_short_turns_while_a_task_runs(qtbot: Any) -> None:
    usual = sys.getswitchinterval()
    going, enough = threading.Event(), threading.Event()

    def work() -> float:
        going.set()
        enough.wait(5.0)
        return sys.getswitchinterval()

    first, second = Task(work), Task(sys.getswitchinterval)
    first.start()
    assert going.wait(5.0)
    with qtbot.waitSignal(second.returned, timeout=5000) as during:
        second.start()
    assert second.wait(5.0)
    # The first one still runs.
    assert sys.getswitchinterval() == during.args[0] == pytest.approx(TURN_SECONDS)
    with qtbot.waitSignal(first.returned, timeout=5000):
        enough.set()
    assert first.wait(5.0)
    assert sys.getswitchinterval() == usual


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a priority for each thread")
def test_threads_stand_back_for_the_window_and_leave_it_alone(qtbot: Any) -> None:
    own = os.getpriority(os.PRIO_PROCESS, 0)
    if own > 19 - STANDS_BACK:
        pytest.skip("nothing stands further back")
    started: list[int] = []

    def work() -> int:
        inner = threading.Thread(target=lambda: started.append(priority()))
        inner.start()
        inner.join()
        return priority()

    def priority() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    task = Task(work)
    with qtbot.waitSignal(task.returned, timeout=5000) as returned:
        task.start()
    assert task.wait(5.0)
    assert returned.args[0] == own + STANDS_BACK
    assert started == [own + STANDS_BACK], "those that it starts, too"
    assert priority() == own


def test_the_rest_between_two_turns_begins_when_a_turn_ends(qtbot: Any) -> None:
    due: list[bool] = []
    turns = Turns(rest_ms=1)

    def work() -> Iterator[None]:
        for _ in range(3):
            due.append(turns._timer.isActive())
            yield

    turns.add(work())
    qtbot.waitUntil(lambda: not turns.busy, timeout=5000)
    assert due == [False] * 3, "a timer that runs during a long turn is due at its end"


class Receiver(QObject):
    """A slot in the window's thread."""

    def __init__(self, order: list[str]) -> None:
        super().__init__()
        self._order = order

    def take(self, what: str) -> None:
        self._order.append(what)

    def end(self, _: Any) -> None:
        self._order.append("end")
