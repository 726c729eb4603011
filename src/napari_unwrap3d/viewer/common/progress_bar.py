"""A progress bar that is drawn when the window is."""

from __future__ import annotations

from qtpy.QtWidgets import QProgressBar


class ProgressBar(QProgressBar):
    """Qt's, but a new value waits for the next frame.

    Qt draws a bar at once whenever its value changes, and in a window with OpenGL that puts
    the whole window together anew, many times in a second.
    """

    def setValue(self, value: int) -> None:
        """Show another value in the next frame."""
        self.setUpdatesEnabled(False)
        super().setValue(value)
        self.setUpdatesEnabled(True)
