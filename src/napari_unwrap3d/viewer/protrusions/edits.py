"""Merge, split, delete and repaint protrusions; undo and redo; segment again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtWidgets import QGridLayout, QMessageBox, QPushButton, QWidget

if TYPE_CHECKING:
    from .instances import Instances

TIPS = {
    "merge": "Make one protrusion of those that are selected; the first gives its label.",
    "split": "Make two protrusions of the selected one, at the saddle between its peaks.",
    "delete": "Give the selected protrusions back to the cortex.",
    "repaint": "Draw the selected protrusion with the brush, in any view; press again to stop.",
    "undo": "Take back the last edit or stroke, in whichever view (Ctrl+Z).",
    "redo": "Make it again (Ctrl+Shift+Z).",
    "show": "Turn the cell so that the selected protrusion is in front.",
    "again": "Find the protrusions anew, with the parameters of the step.",
}
TEXTS = {
    "merge": "Merge",
    "split": "Split",
    "delete": "Delete",
    "repaint": "Repaint",
    "undo": "Undo",
    "redo": "Redo",
    "show": "Show",
    "again": "Segment again",
}
PER_ROW = 4
SELECT_TWO, SELECT_ONE, SELECT = (
    "Select two or more protrusions first.",
    "Select one protrusion first.",
    "Select a protrusion first.",
)
NOTHING_TO_UNDO, NOTHING_TO_REDO = "There is nothing to undo.", "There is nothing to redo."
RUNNING = "A run is in progress."
ASK = "Segment again?"
LOST = "What you merged, split, deleted and painted is thrown away. It cannot be undone."


class EditBar(QWidget):
    """Buttons that are pressed only where that makes sense; their tips say why not.

    Parameters
    ----------
    instances : Instances
    """

    def __init__(self, instances: Instances, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._instances = instances
        self.buttons = {name: QPushButton(text) for name, text in TEXTS.items()}
        self.buttons["repaint"].setCheckable(True)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(3)
        for place, (name, button) in enumerate(self.buttons.items()):
            grid.addWidget(button, *divmod(place, PER_ROW))
            button.clicked.connect(getattr(self, f"_{name}"))
        instances.changed.connect(self.update_buttons)
        instances.selected.connect(self.update_buttons)
        self._listening = False
        self.update_buttons()

    def update_buttons(self) -> None:
        """Which can be pressed, and why not."""
        instances = self._instances
        if instances.edits is not None and not self._listening:
            self._listening = True
            instances.annotating.edited.connect(self.update_buttons)
            instances.annotating.chosen.connect(self.update_buttons)
        for name, button in self.buttons.items():
            reason = self.why_not(name)
            button.setEnabled(not reason)
            button.setToolTip(f"{TIPS[name]}\n{reason}".strip())
        self.buttons["repaint"].setChecked(instances.repainting)

    def why_not(self, name: str) -> str:
        """Why a button cannot be pressed; empty where it can."""
        instances, chosen = self._instances, len(self._instances.selection)
        session = instances.session
        if name == "again":
            return RUNNING if session.running else session.blocked()
        reason = instances.reason()
        if instances.edits is None or (reason and name not in ("undo", "redo")):
            return reason
        annotations = instances.edits.annotations
        if name == "repaint" and instances.repainting:
            return ""
        return {
            "merge": SELECT_TWO * (chosen < 2),
            "split": SELECT_ONE * (chosen != 1),
            "delete": SELECT * (chosen == 0),
            "repaint": SELECT_ONE * (chosen != 1),
            "show": SELECT * (chosen == 0),
            "undo": NOTHING_TO_UNDO * (not annotations.can_undo),
            "redo": NOTHING_TO_REDO * (not annotations.can_redo),
        }[name]

    def _merge(self) -> None:
        self._instances.merge()

    def _split(self) -> None:
        self._instances.split()

    def _delete(self) -> None:
        self._instances.delete()

    def _repaint(self, wanted: bool) -> None:
        self._instances.repaint(wanted)

    def _undo(self) -> None:
        self._instances.annotating.undo()

    def _redo(self) -> None:
        self._instances.annotating.redo()

    def _show(self) -> None:
        self._instances.show()

    def _again(self) -> None:
        if not self._instances.edited or self.asked():
            self._instances.segment_again()

    def asked(self) -> bool:
        """Whether the person wants to lose what was edited."""
        yes = QMessageBox.StandardButton.Yes
        no = QMessageBox.StandardButton.Cancel
        return bool(QMessageBox.question(self, ASK, LOST, yes | no, no) == yes)
