"""Direct and plane in the second canvas: computed when somebody asks, or refused and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject, Signal

from .notice import Notice
from .threads import Task

if TYPE_CHECKING:
    from ..atlas import Atlas
    from .session import Session

ON_REQUEST = ("direct", "plane")
MEANINGS = {
    "uv": "The surface unwrapped through the reference: what lies outermost over each (v, u).",
    "direct": "The surface unwrapped one to one: everything is seen, also under overhangs.",
    "plane": "The topographic surface flattened to (u, v): everything is seen, one to one.",
    "topography": "The space above and below the reference, slice by slice: (d, v, u).",
}


class RequestedCharts(QObject):
    """Computes direct and plane of a session's atlas, one at a time.

    Signals
    -------
    changed()
        One was started, computed or refused.
    computed(str)
        One is there.
    """

    changed = Signal()
    computed = Signal(str)

    def __init__(self, session: Session, parent: QObject) -> None:
        super().__init__(parent)
        self._session = session
        self._task: Task | None = None
        self._of: Atlas | None = None
        self.running = ""
        self.refused: dict[str, str] = {}

    def compute(self, chart: str) -> None:
        """Compute a chart in a thread."""
        atlas = self._session.atlas
        if atlas is None or self._task is not None:
            return
        self.running, self._of = chart, atlas
        self._task = Task(getattr, atlas, chart)
        self._task.returned.connect(self._on_returned)
        self._task.failed.connect(self._on_failed)
        self._task.start()
        self.changed.emit()

    def forget(self) -> None:
        """Another atlas may have what this one was refused."""
        self.refused.clear()

    def explain(self, chart: str, notice: Notice) -> None:
        """Say why a chart is not shown, and offer what can be done."""
        atlas = self._session.atlas
        if chart in self.refused:
            # Where the plane cannot be one to one, the direct chart can.
            notice.say(self.refused[chart], "Show the direct chart" * (chart == "plane"), chart)
        elif chart == self.running:
            notice.wait(f"Computing the {chart} chart …")
        elif chart not in ON_REQUEST or atlas is None or not atlas.has("topography"):
            notice.say(f"{MEANINGS[chart]}\nIt appears when its step has run.", "", chart)
        elif atlas.has(chart):
            notice.wait("Drawing …")
        else:
            busy = self._task is not None
            notice.say(f"{MEANINGS[chart]}\nIt takes a while.", "Compute" * (not busy), chart)

    def _on_returned(self, _: Any) -> None:
        chart, self.running, self._task = self.running, "", None
        if self._of is self._session.atlas:
            self.computed.emit(chart)
        self.changed.emit()

    def _on_failed(self, error: BaseException) -> None:
        chart, self.running, self._task = self.running, "", None
        if self._of is self._session.atlas:
            self.refused[chart] = str(error)
        self.changed.emit()
