"""Edits with an inverse, and the one stack of them over everything that can be edited."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

# What was done before is forgotten.
STEPS_KEPT, BYTES_KEPT = 200, 256 * 2**20


class Edit(Protocol):
    """What was changed, which can be taken back and made again."""

    @property
    def nbytes(self) -> int:
        """What keeping it costs."""

    def apply(self, *, forward: bool) -> None:
        """Make the change again (forward), or take it back."""


class History:
    """Strokes, each of several edits, done and undone.

    Parameters
    ----------
    settle : callable
        Called after edits were made again or taken back, to tell whoever watches.
    """

    def __init__(self, settle: Callable[[], None]) -> None:
        self._settle = settle
        self._done: deque[Sequence[Edit]] = deque(maxlen=STEPS_KEPT)
        self._undone: list[Sequence[Edit]] = []
        self._open: list[Edit] = []
        self._depth = 0

    @property
    def can_undo(self) -> bool:
        return bool(self._done) and self._depth == 0

    @property
    def can_redo(self) -> bool:
        return bool(self._undone) and self._depth == 0

    @contextmanager
    def stroke(self) -> Iterator[None]:
        """All edits inside are one step; of nested strokes the outermost counts.

        What was edited before an error stays, and can be taken back.
        """
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
            if self._depth == 0 and self._open:
                self._done.append(tuple(self._open))
                self._open = []
                self._forget()

    def _forget(self) -> None:
        """Let go of the oldest strokes, but never of the last one."""
        sizes = [sum(edit.nbytes for edit in stroke) for stroke in self._done]
        while len(sizes) > 1 and sum(sizes) > BYTES_KEPT:
            self._done.popleft()
            sizes.pop(0)

    def record(self, edit: Edit) -> None:
        """Keep an edit that was made; what was undone before cannot be redone any more."""
        with self.stroke():
            self._open.append(edit)
            self._undone.clear()

    def undo(self) -> None:
        """Take back the last stroke, if there is one and none is being drawn."""
        if self.can_undo:
            stroke = self._done.pop()
            self._undone.append(stroke)
            for edit in reversed(stroke):
                edit.apply(forward=False)
            self._settle()

    def redo(self) -> None:
        """Make the stroke again that was taken back last."""
        if self.can_redo:
            stroke = self._undone.pop()
            self._done.append(stroke)
            for edit in stroke:
                edit.apply(forward=True)
            self._settle()

    def clear(self) -> None:
        """Forget everything."""
        self._done.clear()
        self._undone.clear()
