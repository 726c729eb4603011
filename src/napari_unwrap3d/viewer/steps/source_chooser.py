"""Which layer is the cell, and the size of its voxels."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from magicgui.widgets import ComboBox
from qtpy.QtWidgets import (
    QDoubleSpinBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QWidget,
)

from ..common.connections import disconnect
from ..views.sources import layer_voxel_size

if TYPE_CHECKING:
    from napari.layers import Layer

    from ...charts import Size3
    from ..session import Session


def show_number(box: QDoubleSpinBox, value: float) -> None:
    """Show a number; one that stands there already is not written anew while it is typed."""
    if box.value() != round(value, box.decimals()):
        box.setValue(value)


class VoxelSizeBox(QWidget):
    """Three numbers (z, y, x) in µm; zero shows as "?" and means not known."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(3)
        self.boxes = [QDoubleSpinBox() for _ in range(3)]
        for box, axis in zip(self.boxes, "zyx", strict=True):
            box.setRange(0.0, 1000.0)
            box.setDecimals(4)
            box.setSingleStep(0.01)
            box.setPrefix(f"{axis} ")
            box.setSpecialValueText(f"{axis} ?")
            box.setButtonSymbols(QDoubleSpinBox.ButtonSymbols.NoButtons)
            box.setMinimumWidth(48)
            box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            box.setToolTip(f"Voxel size along {axis} in µm.")
            row.addWidget(box)

    @property
    def value(self) -> Size3 | None:
        sizes = tuple(box.value() for box in self.boxes)
        return (sizes[0], sizes[1], sizes[2]) if all(size > 0 for size in sizes) else None

    @value.setter
    def value(self, sizes: Size3 | None) -> None:
        for box, size in zip(self.boxes, sizes or (0.0, 0.0, 0.0), strict=True):
            show_number(box, size)


class SourceChooser(QWidget):
    """Chooses the session's source; several of them show the same."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session = session
        self._connections: list[tuple[Any, Any]] = []
        self._layer_connections: list[tuple[Any, Any]] = []
        self._layer: Layer | None = None
        self._showing = False
        self.layer_box = ComboBox(choices=self._choices, nullable=False, name="layer")
        self.layer_box.tooltip = "The stack, label image or mesh of the cell."
        self.layer_box.native.setMinimumWidth(60)
        self.voxel_size = VoxelSizeBox()
        self.note = QLabel()
        self.note.setWordWrap(True)
        self.note.setStyleSheet("color: #ffa000;")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setColumnStretch(1, 1)
        grid.addWidget(QLabel("Cell in layer"), 0, 0)
        grid.addWidget(self.layer_box.native, 0, 1)
        grid.addWidget(QLabel("Voxel size (µm)"), 1, 0)
        grid.addWidget(self.voxel_size, 1, 1)
        grid.addWidget(self.note, 2, 0, 1, 2)
        self._connect()
        self._on_layers_changed()
        self._show()
        self._on_running(session.running)

    def _choices(self, _: Any = None) -> list[Layer]:
        return self.session.sources()

    def _connect(self) -> None:
        viewer = self.session.viewer
        if viewer is not None:
            for name in ("inserted", "removed", "reordered"):
                emitter = getattr(viewer.layers.events, name)
                emitter.connect(self._on_layers_changed)
                self._connections.append((emitter, self._on_layers_changed))
        self.layer_box.changed.connect(self._on_chosen)
        for box in self.voxel_size.boxes:
            box.valueChanged.connect(self._on_voxel_size)
        self.session.source_changed.connect(self._show)
        self.session.running_changed.connect(self._on_running)
        # The lists, not self: the widget is gone when Qt says so.
        self.destroyed.connect(partial(disconnect, self._connections))
        self.destroyed.connect(partial(disconnect, self._layer_connections))

    def _on_layers_changed(self, _: Any = None) -> None:
        chosen = self.session.source
        self._showing = True
        self.layer_box.reset_choices()
        if chosen in self.layer_box.choices:
            self.layer_box.value = chosen
        self._showing = False
        if chosen is None or chosen not in self.layer_box.choices:
            self.session.set_source(self.layer_box.value)

    def _on_chosen(self, layer: Layer | None) -> None:
        if not self._showing:
            self.session.set_source(layer)

    def _on_voxel_size(self) -> None:
        if not self._showing:
            self.session.set_source(self.session.source, self.voxel_size.value)

    def _show(self) -> None:
        """Show the session's source; a known voxel size is changed at the layer, not here."""
        layer = self.session.source
        if layer is not self._layer:
            self._listen_to(layer)
        known = None if layer is None else layer_voxel_size(layer)
        self._showing = True
        if layer is not None and layer in self.layer_box.choices:
            self.layer_box.value = layer
        self.voxel_size.setEnabled(known is None and layer is not None)
        size = self.session.voxel_size
        # What is half filled in stays.
        if size is not None or known is not None or layer is None or self._layer is not layer:
            self.voxel_size.value = size
        self._showing = False
        self._layer = layer
        note = self.session.blocked()
        self.note.setText(note)
        self.note.setVisible(bool(note))

    def _listen_to(self, layer: Layer | None) -> None:
        disconnect(self._layer_connections)
        if layer is not None:
            for emitter in (layer.events.scale, layer.events.units):
                emitter.connect(self._on_layer_edited)
                self._layer_connections.append((emitter, self._on_layer_edited))

    def _on_layer_edited(self, _: Any = None) -> None:
        self.session.source_was_edited()

    def _on_running(self, running: bool) -> None:
        self.layer_box.native.setEnabled(not running)
