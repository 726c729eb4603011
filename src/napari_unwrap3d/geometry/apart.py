"""Another Python process, for calls that would hold up a window.

Some libraries let no other thread of Python run for half a second at a time. While someone
asks for it with :func:`apart`, what they do is done in a process beside this one, with the
same results to the last bit; otherwise, and wherever no process can be started, it is done
here.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from ..errors import Cancelled
from . import compiled

START = "import sys; sys.path.insert(0, sys.argv[1]); from {} import serve; serve()"
# Windows would open a console for it.
NO_CONSOLE = getattr(subprocess, "CREATE_NO_WINDOW", 0)


class Gone(Exception):
    """The process has ended: what it should have done is still to be done."""


class Helper:
    """A process that calls functions of :mod:`napari_unwrap3d.geometry.compiled`.

    It begins with the first call, and ends with :meth:`close` or with this process. Several
    threads may use it; one waits for the other.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._lost = self._closed = False

    def call(self, name: str, *arguments: Any) -> Any:
        """What a function returns, or raises; :class:`Gone` if the process ended before."""
        with self._lock:
            if self._closed or self._lost:
                raise Gone
            try:
                questions, answers = self._pipes()
                _send(questions, (name, arguments))
                good, answer = pickle.load(answers)
            except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
                self._lost = True
                self._end()
                raise (Cancelled() if self._closed else Gone()) from error
        if good:
            return answer
        raise answer

    def close(self) -> None:
        """End the process; who still waits for it is of a cancelled run, and gets that."""
        self._closed = True
        if self._process is not None:
            self._process.kill()
        with self._lock:
            self._end()

    def _pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        """To and from the process, which is started if it is not there yet."""
        if self._process is None:
            # Elsewhere than in Python's own program (in a bundle's), this would open a window.
            if not Path(sys.executable or "").stem.lower().startswith("python"):
                raise FileNotFoundError("There is no Python program to start.")
            root = str(Path(__file__).parents[2])
            self._process = subprocess.Popen(
                [sys.executable, "-c", START.format(__name__), root],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                creationflags=NO_CONSOLE,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin, self._process.stdout

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            # What was not sent any more is of no use.
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()


def _send(pipe: IO[bytes], message: Any) -> None:
    pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.flush()


def serve() -> None:
    """What the process does: answer until nobody asks any more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    while True:
        try:
            name, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            answer = getattr(compiled, name)(*arguments)
        except Exception as error:  # noqa: BLE001 - it is raised where it was asked for
            _send(answers, (False, error))
            continue
        _send(answers, (True, answer))


_lock = threading.Lock()
_users = 0
_helper: Helper | None = None


@contextlib.contextmanager
def apart() -> Iterator[None]:
    """Within it, in any thread, what would hold the others up is done in another process."""
    global _users, _helper
    with _lock:
        _users += 1
        if _users == 1:
            _helper = Helper()
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            ended = None
            if not _users:
                ended, _helper = _helper, None
        if ended is not None:
            ended.close()


def call(name: str, *arguments: Any) -> Any:
    """What a function of :mod:`napari_unwrap3d.geometry.compiled` returns, made apart or here."""
    helper = _helper
    if helper is not None:
        with contextlib.suppress(Gone):
            return helper.call(name, *arguments)
    return getattr(compiled, name)(*arguments)
