"""The one reporter of progress, through which every caller can also cancel.

A step receives a :class:`Progress` and calls it with the fraction done. The
call raises :class:`~napari_unwrap3d.errors.Cancelled` when the user asked to
stop. Long calls into compiled code go through :meth:`Progress.run`, which
returns to the caller within a tenth of a second after a cancellation.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

from .errors import Cancelled

Result = TypeVar("Result")
Callback = Callable[[str, float, str], None]

POLL_SECONDS = 0.05


class Progress:
    """Progress of one step, and of the parts of it.

    Parameters
    ----------
    callback : callable, optional
        Called as ``callback(step, fraction, message)``, ``fraction`` in 0..1.
    step : str
        Name of the step that is reported.
    cancelled : threading.Event, optional
        Set it (or call :meth:`cancel`) from any thread to stop the computation.
    """

    def __init__(
        self,
        callback: Callback | None = None,
        step: str = "",
        cancelled: threading.Event | None = None,
        span: tuple[float, float] = (0.0, 1.0),
    ) -> None:
        self.callback = callback
        self.step = step
        self.cancelled = cancelled if cancelled is not None else threading.Event()
        self._span = span

    def __call__(self, fraction: float, message: str = "") -> None:
        """Report that `fraction` (0..1) of this part is done; raise if cancelled."""
        self.check()
        if self.callback is not None:
            start, stop = self._span
            done = start + (stop - start) * min(max(float(fraction), 0.0), 1.0)
            self.callback(self.step, done, message)

    def check(self) -> None:
        """Raise :class:`Cancelled` if the user asked to stop."""
        if self.cancelled.is_set():
            raise Cancelled(hint="Run again to continue from the last finished step.")

    def cancel(self) -> None:
        """Ask the computation to stop; safe to call from any thread."""
        self.cancelled.set()

    def part(self, start: float, stop: float) -> Progress:
        """A reporter for the part of this step between two fractions."""
        a, b = self._span
        span = (a + (b - a) * start, a + (b - a) * stop)
        return Progress(self.callback, self.step, self.cancelled, span)

    def named(self, step: str) -> Progress:
        """A reporter for another step with the same callback and cancellation."""
        return Progress(self.callback, step, self.cancelled)

    def run(self, function: Callable[..., Result], *args: Any, **kwargs: Any) -> Result:
        """Call `function`, which cannot be interrupted, and stay cancellable.

        The function runs in a thread of its own. When the user cancels, this
        method raises at once; the thread finishes in the background and its
        result is dropped. `function` must therefore not write to anything that
        others read.
        """
        self.check()
        outcome: dict[str, Any] = {}
        finished = threading.Event()

        def target() -> None:
            try:
                outcome["result"] = function(*args, **kwargs)
            except BaseException as error:  # handed to the caller below, never lost
                outcome["error"] = error
            finally:
                finished.set()

        threading.Thread(target=target, daemon=True, name="unwrap3d-compute").start()
        while not finished.wait(POLL_SECONDS):
            self.check()
        self.check()
        if "error" in outcome:
            # Not kept here: the error's traceback would keep what this call was given.
            raise outcome.pop("error")
        result: Result = outcome["result"]
        return result


def silent() -> Progress:
    """A reporter that reports to nobody and is never cancelled."""
    return Progress()
