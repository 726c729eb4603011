"""Direct and plane in the second canvas: computed when somebody asks, or refused and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, Signal

from ...errors import ChartMissingError, Unwrap3DError
from ...geometry.apart import apart
from ..common.notice import Notice
from ..common.threads import Task, tell

if TYPE_CHECKING:
    from ...atlas import Atlas
    from ..session import Session

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
        self.running = ""
        self.refused: dict[str, str] = {}
        session.finished.connect(self._on_finished)
        session.stopped.connect(self._on_stopped)

    def compute(self, chart: str) -> None:
        """Compute a chart in a thread: as a step of a run, where the cell can be run on."""
        atlas = self._session.atlas
        if atlas is None or self.running or self._session.running:
            return
        self.running = chart
        if self._session.blocked():
            # An atlas from a file, whose source is not open.
            self._task = Task(_computed, atlas, chart)
            self._task.returned.connect(self._on_returned)
            self._task.failed.connect(self._on_failed)
            self._task.start()
        else:
            try:
                self._session.run(until=chart)
            except Unwrap3DError as error:
                self.running = ""
                tell(error)
        self.changed.emit()

    def look(self, atlas: Atlas) -> None:
        """Take what an atlas says about its charts."""
        self.refused = {}
        for chart in ON_REQUEST:
            numbers = atlas.quality.get(chart, {})
            if "reason" in numbers and not atlas.has(chart):
                self.refused[chart] = f"{numbers['reason']}\n{numbers.get('hint', '')}".strip()

    def _on_finished(self, atlas: Atlas) -> None:
        self.look(atlas)
        self._end()

    def _on_stopped(self, _: str) -> None:
        self._end()

    def _end(self) -> None:
        """A run is over; a task of our own is not."""
        if self._task is None:
            self.running = ""
        self.changed.emit()

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
            busy = bool(self.running) or self._session.running
            notice.say(f"{MEANINGS[chart]}\nIt takes a while.", "Compute" * (not busy), chart)

    def _on_returned(self, computed: tuple[Atlas, str]) -> None:
        atlas, chart = computed
        self.running, self._task = "", None
        if atlas is self._session.atlas:
            self.look(atlas)
            self.computed.emit(chart)
        self.changed.emit()

    def _on_failed(self, error: BaseException) -> None:
        self.running, self._task = "", None
        self.changed.emit()
        tell(error)

    def close(self) -> None:
        """Listen no longer."""
        self._session.finished.disconnect(self._on_finished)
        self._session.stopped.disconnect(self._on_stopped)


def _computed(atlas: Atlas, chart: str) -> tuple[Atlas, str]:
    """Compute a chart by reading it; one that is refused says so in the atlas' quality."""
    try:
        with apart():
            getattr(atlas, chart)
    except ChartMissingError:
        if "reason" not in atlas.quality.get(chart, {}):
            raise
    return atlas, chart
