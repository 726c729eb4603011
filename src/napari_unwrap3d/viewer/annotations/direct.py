"""The direct chart for who draws: it gives every sheet of the surface a place of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, Signal

from ..common.threads import Task, tell

if TYPE_CHECKING:
    from .annotating import Annotating

COMPUTING = (
    "Computing the direct chart, to show every fold of the surface. You can draw meanwhile; "
    "under overhangs the surface shows what lies outermost until then."
)
CLOSE_SECONDS = 5.0


class DirectForDrawing(QObject):
    """Computes the direct chart as soon as there is something to draw on.

    Signals
    -------
    computed()
        It is there.
    told(str)
        What the person should know, empty when it is over.
    """

    computed = Signal()
    told = Signal(str)

    def __init__(self, annotating: Annotating) -> None:
        super().__init__(annotating)
        self._annotating = annotating
        self._task: Task | None = None

    def prepare(self) -> None:
        """Compute it if it is not there: in the second canvas, where there is one."""
        atlas, canvas = self._annotating.atlas, self._annotating.canvas
        if atlas is None or self._task is not None or atlas.has("direct"):
            return
        if "reason" in atlas.quality.get("direct", {}) or not atlas.has("topography"):
            return
        if canvas is not None:
            canvas.compute("direct")
            return
        self.told.emit(COMPUTING)
        self._task = Task(getattr, atlas, "direct")
        self._task.returned.connect(self._on_direct)
        self._task.failed.connect(self._on_no_direct)
        self._task.start()

    def on_requested(self) -> None:
        """The second canvas began to compute a chart, or ended."""
        canvas = self._annotating.canvas
        if canvas is not None and self._annotating.names:
            self.told.emit(COMPUTING if canvas.requested.running == "direct" else "")

    def close(self) -> None:
        """Leave no thread."""
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)

    def _on_direct(self, _: object) -> None:
        self._task = None
        self.told.emit("")
        self.computed.emit()

    def _on_no_direct(self, error: BaseException) -> None:
        self._task = None
        self.told.emit("")
        if self._annotating.atlas is not None:
            tell(error)
