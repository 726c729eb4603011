"""The dock "Annotations": what is drawn, with which tool, and what it means in each view."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtGui import QShowEvent
from qtpy.QtWidgets import (
    QButtonGroup,
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QFrame,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from ..common.connections import end_with_dock
from ..common.docking import Docked
from .annotating import Annotating, annotating_of
from .colours import LABELS
from .direct import COMPUTING
from .list import AnnotationList
from .measures import MeasuresBox
from .painting import BRUSH, ERASE, FILL, LASSO, LOOK, POINT
from .regions import RegionsBox

if TYPE_CHECKING:
    import napari

TOOL_TEXTS = {
    LOOK: ("Look", "Turn and move the views; nothing is drawn."),
    BRUSH: (
        "Brush",
        "Drag over the cell, in 3D or in an image. In 3D the brush stays on the fold of the "
        "surface it touches; drag beside the cell to turn it, and hold Shift to erase.",
    ),
    ERASE: ("Erase", "Like the brush, but takes labels away."),
    LASSO: (
        "Lasso",
        "In 3D: draw around a part of the cell; what you see inside is marked. In an image: "
        "click the corners of a polygon, and double-click to end it.",
    ),
    POINT: (
        "Point",
        "Click the surface, or an image, to set a named point. In the layer “points” of the "
        "3D canvas points can be moved and deleted.",
    ),
    FILL: ("Fill", "In an image: click a region to give all of it the current label."),
}
OVERHANG_TEXTS = {
    "column": ("the whole column", "Every sheet of the surface over the pixels is marked."),
    "outermost": ("the outermost sheet", "Only what lies outermost over the pixels is marked."),
}
NO_CELL = "There is no unwrapped cell yet: unwrap one, or open a project."
NO_ANNOTATION = "Add an annotation to draw: choose a name above, and press Add."
HELP = """<b>A label belongs to a place of the surface</b>, and is seen in every view.<br>
<b>3D</b> surface: marks what the brush touches, or what you see inside the lasso. On the
reference and the sphere, and in <b>uv</b>: marks the whole column over the pixels, or only the
outermost sheet, as chosen above. uv keeps exactly what you drew in it, and shows otherwise
what lies outermost.<br>
<b>Direct</b> and <b>plane</b>: every fold has a place of its own; marks what is touched.<br>
<b>Topography</b>: marks the surface where it passes through the pixels, at this depth or
through all depths.<br>
<b>Slices</b> of the stack: marks the surface in the voxels that are touched.<br>
<b>Undo</b> takes back one stroke, in whichever view it was drawn: Ctrl+Z (⌘Z), and
Ctrl+Shift+Z (⌘⇧Z) makes it again."""
WIDTH = 320
TOOLS_PER_ROW = 3


class AnnotationWidget(Docked):
    """The dock widget. Closing it loses nothing.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.annotating: Annotating = annotating_of(napari_viewer)
        self._syncing = False
        self.list = AnnotationList(self.annotating)
        self.tools: dict[str, QPushButton] = {}
        self.label_box = QSpinBox()
        self.radius_box = QDoubleSpinBox()
        self.undo_button, self.redo_button = QPushButton("Undo"), QPushButton("Redo")
        self.overhang_box = QComboBox()
        self.all_depths = QCheckBox("In topography, through all depths")
        self.slices = QCheckBox("Draw on slices of the stack")
        self.message, self.busy = QLabel(), QProgressBar()
        self.help_button, self.help = QPushButton(), QLabel(HELP)
        self.regions = RegionsBox(self.annotating)
        self.measures = MeasuresBox(self.annotating)
        self._fill_in()
        self._arrange()
        self._connect()
        self._update()
        end_with_dock(self)

    def _fill_in(self) -> None:
        self._group = QButtonGroup(self)
        for tool, (text, tip) in TOOL_TEXTS.items():
            button = QPushButton(text)
            button.setToolTip(tip)
            button.setCheckable(True)
            self._group.addButton(button)
            self.tools[tool] = button
        self.label_box.setRange(1, LABELS - 1)
        self.label_box.setToolTip("The number that is drawn. Every label has its own colour.")
        self.radius_box.setRange(0.01, 1000.0)
        self.radius_box.setDecimals(2)
        self.radius_box.setSuffix(" µm")
        self.radius_box.setToolTip(
            "Radius of the brush on the surface. In the images, as it is at the equator."
        )
        self.undo_button.setToolTip("Take back the last stroke, in whichever view (Ctrl+Z).")
        self.redo_button.setToolTip("Make it again (Ctrl+Shift+Z).")
        for value, (text, tip) in OVERHANG_TEXTS.items():
            self.overhang_box.addItem(text, value)
            row = self.overhang_box.count() - 1
            self.overhang_box.setItemData(row, tip, Qt.ItemDataRole.ToolTipRole)
        self.overhang_box.setToolTip("What drawing in uv, on the reference and the sphere marks.")
        self.all_depths.setToolTip("Else only at the depth that is shown.")
        self.slices.setToolTip(
            "Show slices in the main canvas, with a layer per annotation to draw on."
        )
        self.busy.setRange(0, 0)
        self.busy.setMaximumHeight(6)
        self.busy.setTextVisible(False)
        self.message.setWordWrap(True)
        self.help.setWordWrap(True)
        self.help_button.setText("What drawing means in each view")
        self.help_button.setCheckable(True)

    def _arrange(self) -> None:
        tools = QGridLayout()
        tools.setSpacing(2)
        for place, button in enumerate(self.tools.values()):
            tools.addWidget(button, *divmod(place, TOOLS_PER_ROW))
        history = QHBoxLayout()
        history.addWidget(self.undo_button)
        history.addWidget(self.redo_button)
        form = QFormLayout()
        form.addRow("Label", self.label_box)
        form.addRow("Brush radius", self.radius_box)
        form.addRow("In uv, mark", self.overhang_box)
        drawing = QGroupBox("Draw")
        column = QVBoxLayout(drawing)
        column.addLayout(tools)
        column.addLayout(form)
        column.addWidget(self.all_depths)
        column.addWidget(self.slices)
        column.addLayout(history)
        content = QWidget()
        self._column = QVBoxLayout(content)
        for part in (
            self.list,
            self.message,
            self.busy,
            drawing,
            self.help_button,
            self.help,
            self.regions,
            self.measures,
        ):
            self._column.addWidget(part)
        self._column.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setWidget(content)
        self._scroll, self._content = scroll, content
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(scroll)
        self.help.hide()
        self.busy.hide()

    def showEvent(self, event: QShowEvent) -> None:
        """Nothing is cut off at the side, also when the scroll bar is there."""
        super().showEvent(event)
        bar = self._scroll.verticalScrollBar().sizeHint().width()
        self.setMinimumWidth(max(WIDTH, self._content.minimumSizeHint().width() + bar))

    def _connect(self) -> None:
        annotating = self.annotating
        for tool, button in self.tools.items():
            button.clicked.connect(lambda _=False, tool=tool: self._on_tool(tool))
        self.label_box.valueChanged.connect(self._on_label)
        self.radius_box.valueChanged.connect(self._on_radius)
        self.overhang_box.currentIndexChanged.connect(self._on_overhang)
        self.all_depths.toggled.connect(self._on_all_depths)
        self.slices.toggled.connect(self._on_slices)
        self.undo_button.clicked.connect(annotating.undo)
        self.redo_button.clicked.connect(annotating.redo)
        self.help_button.toggled.connect(self.help.setVisible)
        annotating.listed.connect(self._update)
        annotating.chosen.connect(self._update)
        annotating.edited.connect(self._update_history)
        annotating.told.connect(self._on_told)

    # What the person chooses ---------------------------------------------------------

    def _on_tool(self, tool: str) -> None:
        self.annotating.tool = tool

    def _on_label(self, label: int) -> None:
        if not self._syncing:
            self.annotating.label = label

    def _on_radius(self, radius: float) -> None:
        if not self._syncing:
            self.annotating.radius_um = radius

    def _on_overhang(self, _: int) -> None:
        if not self._syncing and self.annotating.atlas is not None:
            self.annotating.annotations.overhang = self.overhang_box.currentData()

    def _on_all_depths(self, wanted: bool) -> None:
        self.annotating.layers.all_depths = wanted

    def _on_slices(self, wanted: bool) -> None:
        self.annotating.slices = wanted

    # What is shown -------------------------------------------------------------------

    def _update(self) -> None:
        self._syncing = True
        annotating = self.annotating
        there, drawn = annotating.atlas is not None, bool(annotating.current)
        self.tools[annotating.tool].setChecked(True)
        if drawn:
            self.label_box.setMaximum(max(annotating.style(annotating.current)[0]))
        self.label_box.setValue(annotating.label)
        self.radius_box.setValue(annotating.radius_um)
        self.slices.setChecked(annotating.slices)
        if there:
            row = self.overhang_box.findData(annotating.annotations.overhang)
            self.overhang_box.setCurrentIndex(row)
        for widget in (*self.tools.values(), self.label_box, self.radius_box, self.slices):
            widget.setEnabled(drawn)
        if self.busy.isHidden():
            self._say("" if drawn else NO_ANNOTATION if there else NO_CELL)
        self._update_history()
        self._syncing = False

    def _update_history(self) -> None:
        there = self.annotating.atlas is not None
        can = self.annotating.annotations if there else None
        self.undo_button.setEnabled(can is not None and can.can_undo)
        self.redo_button.setEnabled(can is not None and can.can_redo)

    def _on_told(self, message: str) -> None:
        self.busy.setVisible(message == COMPUTING)
        self._say(message)
        if not message:
            self._update()

    def _say(self, message: str) -> None:
        self.message.setText(message)
        self.message.setVisible(bool(message))
