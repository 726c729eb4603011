"""A dock that shows what is computed in a thread, anew when something changes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from qtpy.QtWidgets import QLabel

from ...errors import Unwrap3DError
from ..common.docking import Docked
from ..common.threads import Task, tell
from ..common.turns import soon


class ComputingDock(Docked):
    """Computes one thing at a time; what changes meanwhile is computed after it.

    Attributes
    ----------
    status : QLabel
        Says what went wrong.
    """

    status: QLabel

    def __init__(self) -> None:
        super().__init__()
        self._task: Task | None = None
        self._again = False
        self._wait = soon(self, self._compute)

    @property
    def busy(self) -> bool:
        """Whether something is being computed."""
        return self._task is not None or self._wait.isActive()

    def _later(self, _: Any = None) -> None:
        self._wait.start()

    def _compute(self) -> None:
        """Begin, unless there is nothing to compute, or :meth:`_postponed`."""
        raise NotImplementedError

    def _postponed(self) -> bool:
        """Whether something is being computed, after which it is this thing's turn."""
        if self._task is not None:
            self._again = True
        return self._task is not None

    def _start(self, show: Callable[[Any], object], work: Callable[..., Any], *of: Any) -> None:
        """Compute in a thread, and show the result."""
        self._task = Task(work, *of)
        self._task.returned.connect(partial(self._on_returned, show))
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_returned(self, show: Callable[[Any], object], result: Any) -> None:
        self._task = None
        show(result)
        self._do_again()

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        # Of what was asked for: a line that is not finished yet may be none.
        if isinstance(error, Unwrap3DError):
            self.status.setText(str(error))
        else:
            tell(error)
        self._do_again()

    def _do_again(self) -> None:
        if self._again:
            self._again = False
            self._compute()
