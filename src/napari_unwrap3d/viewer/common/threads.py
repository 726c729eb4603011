"""Work in a thread, and how its end comes back to the window.

napari's ``thread_worker`` changes the process's warning filters while it runs, which
are not made for threads: the window's own code then sees the wrong ones. A thread of
our own leaves them alone.
"""

from __future__ import annotations

import gc
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from napari.utils.notifications import notification_manager, show_error
from qtpy.QtCore import QObject, Signal

from ...errors import Unwrap3DError
from ...progress import Callback, Progress

THREAD_NAME = "unwrap3d"
# How long a thread keeps Python while another waits for it.
TURN_SECONDS = 0.0001
# How much our threads, and those that they start, stand back for the window's (Unix's nice).
STANDS_BACK = 5


class Task(QObject):
    """A function that runs once in a thread of its own.

    Signals
    -------
    returned(object)
        What the function returned.
    failed(object)
        The exception that it raised.
    """

    returned = Signal(object)
    failed = Signal(object)

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        super().__init__()
        self._function = function
        self._arguments = arguments
        self._ended = threading.Event()

    def start(self) -> None:
        """Start the thread."""
        short_turns.hold(self)
        executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix=THREAD_NAME)
        future = executor.submit(self._run)
        # In the thread as well. A callback of the future would be called here when the function
        # has already returned, and the end would overtake the signals that the function sent.
        executor.submit(self._hand_over, future)
        executor.shutdown(wait=False)

    def wait(self, seconds: float) -> bool:
        """Wait for the end; True when it came."""
        return self._ended.wait(seconds)

    def _run(self) -> Any:
        stand_back()
        return self._function(*self._arguments)

    def _hand_over(self, future: Future[Any]) -> None:
        """Called in the thread; Qt delivers the signals in the window's."""
        short_turns.release(self)
        error = future.exception()
        if error is None:
            self.returned.emit(future.result())
        else:
            self.failed.emit(error)
        self._ended.set()


class ProgressTask(Task):
    """A function of a progress, through which it reports, and is cancelled.

    Parameters
    ----------
    function : callable(Progress)
    report : callable(stage, fraction, message), optional
        Called in the thread.
    """

    def __init__(self, function: Callable[[Progress], Any], report: Callback | None = None) -> None:
        progress = Progress(report)
        super().__init__(function, progress)
        self._progress = progress

    def cancel(self) -> None:
        """Ask the function to stop; returns at once."""
        self._progress.cancel()


def stand_back() -> None:
    """Let the window's thread go first where there are fewer cores than threads.

    Only Linux has a priority for each thread; elsewhere the system knows which window is used.
    """
    if sys.platform == "linux":
        thread = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, thread, os.getpriority(os.PRIO_PROCESS, 0) + STANDS_BACK)


def tell(error: BaseException) -> None:
    """Show an error to the user: ours in words, any other with its traceback to open."""
    if isinstance(error, Unwrap3DError):
        show_error(str(error))
    else:
        notification_manager.receive_error(type(error), error, error.__traceback__)


class Held:
    """Something that holds from when the first holder asks until the last one lets go.

    Holders may be in any thread.
    """

    def __init__(self) -> None:
        self._holders: set[int] = set()
        self._lock = threading.Lock()

    def hold(self, holder: object) -> None:
        """Begin, if it has not begun; asking twice is asking once."""
        with self._lock:
            if not self._holders:
                self._begin()
            self._holders.add(id(holder))

    def release(self, holder: object) -> None:
        """Let go; harmless for who holds nothing."""
        with self._lock:
            if id(holder) in self._holders:
                self._holders.remove(id(holder))
                if not self._holders:
                    self._end()

    def _begin(self) -> None:
        raise NotImplementedError

    def _end(self) -> None:
        raise NotImplementedError


class QuietCollector(Held):
    """Keeps Python's garbage collector from looking at all of napari while something runs.

    A full collection of the objects of a napari window holds up every thread for a quarter
    of a second, and a run makes enough objects to set off several. What exists when the first
    holder asks is left alone until the last one lets go; what is new is collected as ever,
    until :meth:`renew`.
    """

    def renew(self) -> None:
        """Leave alone what exists now, if anything is: each layer is ten thousand objects."""
        with self._lock:
            if self._holders:
                gc.freeze()

    def _begin(self) -> None:
        gc.freeze()

    def _end(self) -> None:
        gc.unfreeze()


class ShortTurns(Held):
    """Lets Python's threads take turns sooner while one of ours works.

    Every call of OpenGL gives Python away, and a working thread that has got it keeps it for
    a whole turn: with Python's 5 ms a window of a few hundred calls stands for a second.
    """

    def _begin(self) -> None:
        self._usual = sys.getswitchinterval()
        sys.setswitchinterval(min(TURN_SECONDS, self._usual))

    def _end(self) -> None:
        sys.setswitchinterval(self._usual)


quiet_collector = QuietCollector()
short_turns = ShortTurns()
