"""What was drawn stays with the cell when its charts are computed anew."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...annotations.state import State, moved
from ..common.threads import Task, tell

if TYPE_CHECKING:
    from ...atlas import Atlas


def keeping(old: Atlas | None, new: Atlas) -> Iterator[None]:
    """Bring what was drawn on one atlas to another of the same cell; yields while it waits.

    Where the surface has changed every vertex looks for the nearest one, which is done in a
    thread.
    """
    drawn = None if old is None else old.annotated
    if drawn is None or old is new:
        return
    states: list[State] = []
    errors: list[BaseException] = []
    task = Task(moved, drawn, new)
    task.returned.connect(lambda state: states.append(state))
    task.failed.connect(lambda error: errors.append(error))
    task.start()
    while not task.wait(0.0) or not (states or errors):
        yield
    if errors:
        tell(errors[0])
    else:
        new.annotations.restore(states[0])
