"""A batch in a process of its own: the window stays free, and workers never start it anew."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from qtpy.QtCore import QObject, QProcess, Signal

from ...batch.child import Request

MODULE = "napari_unwrap3d.batch.child"
CLOSE_MS = 5_000


class BatchProcess(QObject):
    """Runs one request.

    Signals
    -------
    told(object)
        A message of the process, a dict; see :mod:`napari_unwrap3d.batch.child`.
    ended(str)
        It is over: empty, or why it failed as a whole.
    """

    told = Signal(object)
    ended = Signal(str)

    def __init__(self, request: Request, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._folder = tempfile.TemporaryDirectory(prefix="unwrap3d-batch-")
        path = Path(self._folder.name) / "request.json"
        path.write_text(request.model_dump_json(), encoding="utf-8")
        self._rest, self._errors, self._reason = b"", b"", ""
        self._process = QProcess(self)
        self._process.setProgram(sys.executable)
        self._process.setArguments(["-m", MODULE, str(path)])
        self._process.readyReadStandardOutput.connect(self._on_output)
        self._process.readyReadStandardError.connect(self._on_errors)
        self._process.finished.connect(self._on_finished)
        self._process.errorOccurred.connect(self._on_error)

    @property
    def running(self) -> bool:
        return bool(self._process.state() != QProcess.ProcessState.NotRunning)

    def start(self) -> None:
        """Start the process."""
        self._process.start()

    def cancel(self) -> None:
        """Ask it to stop; what was made stays."""
        if self.running:
            self._process.write(b"cancel\n")

    def close(self) -> None:
        """End it, and wait for that."""
        self.blockSignals(True)
        if self.running:
            self.cancel()
            if not self._process.waitForFinished(CLOSE_MS):
                self._process.kill()
                self._process.waitForFinished(CLOSE_MS)
        self._folder.cleanup()

    def _on_output(self) -> None:
        self._rest += self._process.readAllStandardOutput().data()
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            message = _message(line)
            if message.get("kind") == "error":
                self._reason = str(message["text"])
            if message:
                self.told.emit(message)

    def _on_errors(self) -> None:
        # Of a process that ends by an exception, which we did not foresee, the last lines.
        self._errors = (self._errors + self._process.readAllStandardError().data())[-4000:]

    def _on_error(self, error: Any) -> None:
        if error == QProcess.ProcessError.FailedToStart:
            self.ended.emit(f"Python could not be started: {self._process.errorString()}.")

    def _on_finished(self, code: int, _: Any) -> None:
        self._on_output()
        if code and not self._reason:
            self._reason = self._errors.decode(errors="replace").strip() or f"Exit code {code}."
        self._folder.cleanup()
        self.ended.emit(self._reason)


def _message(line: bytes) -> dict[str, Any]:
    """A line of the process; empty where a library printed something of its own."""
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) and "kind" in found else {}
