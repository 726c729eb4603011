"""Work in the window piece by piece, so that it never holds other events up."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from qtpy.QtCore import QObject, QTimer


def soon(parent: QObject | None, action: Callable[..., object], rest_ms: int = 0) -> QTimer:
    """A timer whose start does an action once, when it has rested so long since.

    Without a rest that is in the next turn of the event loop, however often it was started.
    """
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(rest_ms)
    timer.timeout.connect(action)
    return timer


class Turns(QObject):
    """Runs iterators in order, one step per turn of the event loop.

    Parameters
    ----------
    parent : QObject, optional
    rest_ms : int
        Between two turns: other events have at least so long.
    after : callable, optional
        Called after every turn.
    """

    def __init__(
        self,
        parent: QObject | None = None,
        rest_ms: int = 0,
        after: Callable[[], None] | None = None,
    ) -> None:
        super().__init__(parent)
        self._after = after
        self._work: deque[Iterator[None]] = deque()
        self._timer = soon(self, self._do_next, rest_ms)

    def add(self, work: Iterator[None]) -> None:
        """Do some work after all that was added before."""
        self._work.append(work)
        if not self._timer.isActive():
            self._timer.start()

    @property
    def busy(self) -> bool:
        """Whether something is still to be done."""
        return bool(self._work)

    def clear(self) -> None:
        """Forget what was not done yet."""
        self._work.clear()
        self._timer.stop()

    def _do_next(self) -> None:
        work = self._work[0]
        try:
            next(work)
        except StopIteration:
            if self._work and self._work[0] is work:
                self._work.popleft()
        finally:
            # Only now: a timer that goes on would be due as soon as a long turn has ended.
            if self._work:
                self._timer.start()
        if self._after is not None:
            self._after()
