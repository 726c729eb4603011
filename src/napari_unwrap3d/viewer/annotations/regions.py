"""Regions that stay editable: shapes in the images, boxes and half-spaces in 3D."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from ...annotations import Shape
from ...errors import Unwrap3DError
from ..common.threads import tell
from .painting import LOOK
from .region_preview import RegionPreview

if TYPE_CHECKING:
    from .annotating import Annotating

AXES = ("z", "y", "x")
HALF_SPACE, BOX = "half-space", "box"
SIDES = {"from here upwards": 1.0, "up to here": -1.0}
VOLUME = "volume"


class RegionsBox(QGroupBox):
    """Draw shapes in the image, or mark all that lies in a box or half-space.

    Parameters
    ----------
    annotating : Annotating
    """

    def __init__(self, annotating: Annotating, parent: QWidget | None = None) -> None:
        super().__init__("Regions that stay editable", parent)
        self._annotating = annotating
        self.shapes_button = QPushButton("Shapes in this image")
        self.shapes_button.setToolTip(
            "Polygons, rectangles and ellipses in uv, direct or plane. They can be moved, "
            "edited and deleted later; deleting one shows again what was painted below it."
        )
        self.kind_box = QComboBox()
        self.kind_box.addItems([HALF_SPACE, BOX])
        self.kind_box.setToolTip("Marks the whole surface inside it, e.g. what is out of focus.")
        self.axis_box, self.side_box = QComboBox(), QComboBox()
        self.axis_box.addItems(AXES)
        self.side_box.addItems(list(SIDES))
        self.position = _micrometres("Where the half-space begins, along the axis.")
        self.corners = [
            [_micrometres(f"{axis} of the {which} corner.") for axis in AXES]
            for which in ("lower", "upper")
        ]
        self.add_button = QPushButton("Add")
        self.add_button.setToolTip("Mark what lies inside with the current label.")
        self.remove_button = QPushButton("Remove last")
        self.remove_button.setToolTip("What was painted there shows again.")
        self._editing = False
        self.preview = RegionPreview(annotating)
        self._arrange()
        self._connect()
        self._propose()
        self._update()

    def _arrange(self) -> None:
        half, box = QWidget(), QWidget()
        row = QVBoxLayout(half)
        first = QHBoxLayout()
        for widget in (self.axis_box, self.position):
            first.addWidget(widget)
        row.addLayout(first)
        row.addWidget(self.side_box)
        rows = QVBoxLayout(box)
        for corner in self.corners:
            line = QHBoxLayout()
            for spin in corner:
                line.addWidget(spin)
            rows.addLayout(line)
        for layout in (row, rows):
            layout.setContentsMargins(0, 0, 0, 0)
        self._pages = {HALF_SPACE: half, BOX: box}
        buttons = QHBoxLayout()
        buttons.addWidget(self.add_button)
        buttons.addWidget(self.remove_button)
        form = QFormLayout()
        form.addRow("In 3D", self.kind_box)
        column = QVBoxLayout(self)
        column.addWidget(self.shapes_button)
        column.addLayout(form)
        column.addWidget(half)
        column.addWidget(box)
        column.addLayout(buttons)

    def _connect(self) -> None:
        self.shapes_button.clicked.connect(self._on_shapes)
        self.kind_box.currentTextChanged.connect(self._on_kind)
        self.axis_box.currentIndexChanged.connect(self._on_axis)
        self.side_box.currentIndexChanged.connect(self._on_edited)
        for spin in (self.position, *self.corners[0], *self.corners[1]):
            spin.valueChanged.connect(self._on_edited)
        self.add_button.clicked.connect(self.add)
        self.remove_button.clicked.connect(self.remove)
        self._annotating.listed.connect(self._on_listed)
        self._annotating.chosen.connect(self._on_chosen)
        self._annotating.edited.connect(self._update)

    def region(self) -> Shape:
        """The region that the form describes, in µm of the surface."""
        label = self._annotating.label
        if self.kind_box.currentText() == BOX:
            corners = [[spin.value() for spin in corner] for corner in self.corners]
            return Shape(VOLUME, BOX, np.array(corners), label)
        axis = self.axis_box.currentIndex()
        point, inwards = np.zeros(3), np.zeros(3)
        point[axis] = self.position.value()
        inwards[axis] = SIDES[self.side_box.currentText()]
        return Shape(VOLUME, HALF_SPACE, np.stack([point, inwards]), label)

    def add(self) -> None:
        """Add the region on top of the others; it then follows the form."""
        self._put((*self._regions(), self.region()))
        self._editing = True

    def remove(self) -> None:
        """Take the last region away."""
        self._put(self._regions()[:-1])
        self._editing = False

    def _regions(self) -> tuple[Shape, ...]:
        return self._annotating.annotations.shapes(self._annotating.current, VOLUME)

    def _put(self, regions: tuple[Shape, ...]) -> None:
        try:
            self._annotating.annotations.set_shapes(self._annotating.current, regions, VOLUME)
        except Unwrap3DError as error:
            tell(error)
        self._annotating.edited.emit()

    def _on_edited(self, _: float = 0.0) -> None:
        """The region that was added last follows."""
        self._show_preview()
        if self._editing and self._annotating.current and self._regions():
            self._put((*self._regions()[:-1], self.region()))

    def _on_kind(self, _: str) -> None:
        self._editing = False
        self._update()
        self._show_preview()

    def _on_axis(self, _: int) -> None:
        self._propose_position()
        self._on_edited()

    def _on_chosen(self) -> None:
        if self._annotating.tool != LOOK:
            self.preview.hide()
        self._update()

    # What the form describes is seen in 3D while the pointer is in it, or it is changed ---

    def _show_preview(self) -> None:
        if self._annotating.current:
            self.preview.show(self.region())

    def enterEvent(self, event: Any) -> None:
        super().enterEvent(event)
        self._show_preview()

    def leaveEvent(self, event: Any) -> None:
        super().leaveEvent(event)
        self.preview.hide()

    def hideEvent(self, event: Any) -> None:
        super().hideEvent(event)
        self.preview.remove()

    def _on_shapes(self) -> None:
        if self._annotating.shapes.edit() is None:
            self._annotating.told.emit("Shapes are drawn in uv, direct and plane.")

    def _on_listed(self) -> None:
        self._editing = False
        self.preview.hide()
        self._propose()
        self._update()

    def _propose(self) -> None:
        """Values that fit the cell: its uppermost quarter along z."""
        atlas = self._annotating.atlas
        if atlas is None:
            return
        low, high = atlas.surface.vertices.min(axis=0), atlas.surface.vertices.max(axis=0)
        for spin, value in zip(self.corners[0], low, strict=True):
            _set(spin, float(value))
        upper = high.copy()
        upper[0] = low[0] + (high[0] - low[0]) / 4
        for spin, value in zip(self.corners[1], upper, strict=True):
            _set(spin, float(value))
        self._propose_position()

    def _propose_position(self) -> None:
        atlas = self._annotating.atlas
        if atlas is not None:
            along = atlas.surface.vertices[:, self.axis_box.currentIndex()]
            _set(self.position, float(along.min() + 0.75 * np.ptp(along)))

    def _update(self) -> None:
        kind = self.kind_box.currentText()
        for name, page in self._pages.items():
            page.setVisible(name == kind)
        drawn = bool(self._annotating.current)
        self.setEnabled(drawn)
        self.remove_button.setEnabled(drawn and bool(self._regions()))


def _micrometres(tip: str) -> QDoubleSpinBox:
    spin = QDoubleSpinBox()
    spin.setRange(-1e5, 1e5)
    spin.setDecimals(2)
    spin.setSuffix(" µm")
    spin.setToolTip(tip)
    spin.setKeyboardTracking(False)
    spin.setMinimumWidth(60)
    return spin


def _set(spin: QDoubleSpinBox, value: float) -> None:
    blocked = spin.blockSignals(True)
    spin.setValue(value)
    spin.blockSignals(blocked)
