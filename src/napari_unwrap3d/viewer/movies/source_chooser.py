"""Which layers are the timelapse, the size of their voxels, and the time between two of them."""

from __future__ import annotations

from typing import Any

from magicgui.widgets import ComboBox
from qtpy.QtWidgets import QDoubleSpinBox, QGridLayout, QLabel, QSizePolicy, QWidget

from ..steps.source_chooser import VoxelSizeBox, show_number
from .run import MovieRun
from .sources import Candidate


class TimeStepBox(QDoubleSpinBox):
    """Seconds; zero shows as "?" and means not known."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setRange(0.0, 1e6)
        self.setDecimals(4)
        self.setSingleStep(0.1)
        self.setSuffix(" s")
        self.setSpecialValueText("?")
        self.setButtonSymbols(QDoubleSpinBox.ButtonSymbols.NoButtons)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setToolTip("Time between two timepoints in s.")


class MovieSourceChooser(QWidget):
    """Chooses the timelapse of a :class:`MovieRun`; several of them show the same."""

    def __init__(self, run: MovieRun, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.run = run
        self._showing = False
        self._shown: Candidate | None = None
        self.layer_box = ComboBox(choices=self._choices, nullable=False, name="timelapse")
        self.layer_box.tooltip = (
            "A layer with a t axis; or several masks, stacks, label images or meshes, one for "
            "each timepoint, in the order of their names."
        )
        self.layer_box.native.setMinimumWidth(60)
        self.voxel_size, self.time_step = VoxelSizeBox(), TimeStepBox()
        self.note = QLabel()
        self.note.setWordWrap(True)
        self.note.setStyleSheet("color: #ffa000;")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setColumnStretch(1, 1)
        for row, (title, widget) in enumerate(
            (
                ("Timelapse", self.layer_box.native),
                ("Voxel size (µm)", self.voxel_size),
                ("Time step (s)", self.time_step),
            )
        ):
            grid.addWidget(QLabel(title), row, 0)
            grid.addWidget(widget, row, 1)
        grid.addWidget(self.note, 3, 0, 1, 2)
        self.layer_box.changed.connect(self._on_chosen)
        for box in (*self.voxel_size.boxes, self.time_step):
            box.valueChanged.connect(self._on_filled_in)
        run.source_changed.connect(self._show)
        run.running_changed.connect(self._on_running)
        self._show()
        self._on_running(run.running)

    def _choices(self, _: Any = None) -> list[tuple[str, Candidate]]:
        return [(each.title, each) for each in self.run.chosen.candidates()]

    def _on_chosen(self, source: Candidate | None) -> None:
        if not self._showing:
            self.run.chosen.choose(source)

    def _on_filled_in(self) -> None:
        if not self._showing:
            seconds = self.time_step.value() or None
            self.run.chosen.choose(self.run.chosen.source, self.voxel_size.value, seconds)

    def _show(self) -> None:
        """Show the source; what a layer tells is changed at the layer, not here."""
        source = self.run.chosen.source
        self._showing = True
        self.layer_box.reset_choices()
        if source is not None and source in self.layer_box.choices:
            self.layer_box.value = source
        known = None if source is None else source.voxel_size
        step = None if source is None else source.time_step
        self.voxel_size.setEnabled(source is not None and known is None)
        self.time_step.setEnabled(source is not None and step is None)
        # What is half filled in stays.
        another, self._shown = source is not self._shown, source
        if another or self.run.chosen.voxel_size is not None:
            self.voxel_size.value = self.run.chosen.voxel_size
        if another or self.run.chosen.time_step is not None:
            show_number(self.time_step, self.run.chosen.time_step or 0.0)
        self._showing = False
        note = "" if self.run.movie is not None and source is None else self.run.chosen.blocked()
        self.note.setText(note)
        self.note.setVisible(bool(note))

    def _on_running(self, running: bool) -> None:
        self.setEnabled(not running)
