"""Another Python process, for calls that would hold up a window.

Some libraries let no other thread of Python run for half a second at a time. While someone
asks for it with :func:`apart`, what they do is done in a process beside this one, with the
same results to the last bit; otherwise, and wherever no process can be started, it is done
here.
"""

from __future__ import annotations

import contextlib
import importlib
import itertools
import os
import pickle
import subprocess
import sys
import threading
import weakref
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from ..errors import Cancelled
from . import compiled
from .compiled import Floats, Found, Ints, Tree

START = "import sys; sys.path.insert(0, sys.argv[1]); from {} import serve; serve()"
# Imported there at once, while the first step runs here.
LIBRARIES = ("skimage.measure._marching_cubes_lewiner", "igl", "fast_simplification")
# Windows would open a console for it.
NO_CONSOLE = getattr(subprocess, "CREATE_NO_WINDOW", 0)


class Gone(Exception):
    """The process has ended: what it should have done is still to be done."""


class Helper:
    """A process that calls functions of :mod:`napari_unwrap3d.geometry.compiled`.

    It ends with :meth:`close`, or with this process. Several threads may use it; one waits
    for the other.

    Raises
    ------
    OSError
        It cannot be started.
    """

    def __init__(self) -> None:
        # Elsewhere than in Python's own program (in a bundled one), this would start a window.
        if not Path(sys.executable or "").stem.lower().startswith("python"):
            raise OSError("There is no Python program to start.")
        root = str(Path(__file__).parents[2])
        self._process = subprocess.Popen(
            [sys.executable, "-c", START.format(__name__), root],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            creationflags=NO_CONSOLE,
        )
        self._lock = threading.Lock()
        self._closed = False
        self._keys = itertools.count()
        # Objects may be given up in the middle of anything: the process is told of it later.
        self._dropped: deque[int] = deque()

    def call(self, name: str, *arguments: Any) -> Any:
        """What a function returns, or raises; :class:`Gone` if the process ended before."""
        return self._ask("call", name, arguments)

    def keep(self, owner: object, name: str, *arguments: Any) -> int:
        """Make an object of a class there, and keep it as long as `owner` lives; its key."""
        key = next(self._keys)
        self._ask("keep", name, arguments, key)
        weakref.finalize(owner, self._dropped.append, key).atexit = False
        return key

    def call_kept(self, key: int, name: str, *arguments: Any) -> Any:
        """What a method of a kept object returns."""
        return self._ask("call_kept", name, arguments, key)

    def close(self) -> None:
        """End the process; who still waits for it is of a cancelled run, and gets that."""
        self._closed = True
        self._process.kill()
        self._process.wait()
        with self._lock:
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                with contextlib.suppress(OSError):
                    pipe.close()

    def _ask(self, kind: str, name: str, arguments: tuple[Any, ...], key: int = -1) -> Any:
        with self._lock:
            if self._closed:
                raise Gone
            dropped = [self._dropped.popleft() for _ in range(len(self._dropped))]
            try:
                assert self._process.stdin is not None
                assert self._process.stdout is not None
                _send(self._process.stdin, (kind, name, arguments, key, dropped))
                good, answer = pickle.load(self._process.stdout)
            except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
                raise (Cancelled() if self._closed else Gone()) from error
        if good:
            return answer
        raise answer


def _send(pipe: BinaryIO, message: Any) -> None:
    pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.flush()


def serve() -> None:
    """What the process does: answer until nobody asks any more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    for library in LIBRARIES:
        importlib.import_module(library)
    kept: dict[int, Any] = {}
    while True:
        try:
            kind, name, arguments, key, dropped = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        for each in dropped:
            kept.pop(each, None)
        try:
            answer = getattr(kept[key] if kind == "call_kept" else compiled, name)(*arguments)
        except Exception as error:  # it is raised where it was asked for
            _send(answers, (False, error))
            continue
        if kind == "keep":
            kept[key], answer = answer, None
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
            with contextlib.suppress(OSError):
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


class TreeOf:
    """A :class:`~napari_unwrap3d.geometry.compiled.Tree`, in the other process while it is there.

    Parameters and methods are the tree's.
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        self._mesh = vertices, faces
        self._helper = _helper
        self._tree: Tree | None = None
        if self._helper is not None:
            with contextlib.suppress(Gone):
                self._key = self._helper.keep(self, "Tree", vertices, faces)
                return
        self._come_here()

    def closest(self, points: Floats) -> Found:
        """See :meth:`Tree.closest`."""
        return self._call("closest", points)

    def first_hit(self, origin: Floats, direction: Floats) -> Found:
        """See :meth:`Tree.first_hit`."""
        return self._call("first_hit", origin, direction)

    def _call(self, name: str, *arguments: Floats) -> Found:
        if self._helper is not None:
            try:
                found: Found = self._helper.call_kept(self._key, name, *arguments)
            except Gone:
                self._come_here()
            else:
                return found
        here: Found = getattr(self._tree, name)(*arguments)
        return here

    def _come_here(self) -> None:
        self._tree = Tree(*self._mesh)
        self._helper = None
