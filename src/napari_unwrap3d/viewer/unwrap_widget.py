"""The dock widget "Unwrap cell": choose a layer, set the main parameters, run."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from magicgui.widgets import ComboBox
from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QCheckBox,
    QDoubleSpinBox,
    QFileDialog,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from ..errors import Unwrap3DError
from ..files.project import SUFFIX, save_project
from ..parameters import PRESETS, Parameters, StackParameters
from ..pipeline import STEP_NAMES
from .forms import ParametersForm
from .session import session_of
from .sources import is_source, layer_axes, layer_voxel_size
from .steps import TITLES, StepList
from .threads import Task, tell

if TYPE_CHECKING:
    import napari
    from napari.layers import Layer

    from ..atlas import Atlas

MAIN = (
    "stack.timepoint",
    "stack.channel",
    "stack.label",
    "stack.smoothing_voxels",
    "stack.threshold",
    "reference.curvature_limit",
    "reference.extra_iterations",
    "sphere.blend",
    "uv.rows",
    "uv.axis_weight",
    "topography.depth_um",
)
# How the names of those parameters begin that find a cell in an image.
SEGMENTING = (
    "background",
    "deconvolution",
    "edge",
    "interior",
    "local_contrast",
    "psf",
    "richardson",
    "smoothing",
    "threshold",
    "wiener",
)
DEFAULTS = "defaults"
NO_LAYER = "Open a stack, a label image or a mesh (File > Open, or File > Open Sample)."
ASK_VOXEL_SIZE = "The layer is in pixels. Fill in its voxel size (z, y, x) in µm."


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
    def value(self) -> tuple[float, float, float] | None:
        sizes = tuple(box.value() for box in self.boxes)
        return (sizes[0], sizes[1], sizes[2]) if all(size > 0 for size in sizes) else None

    @value.setter
    def value(self, sizes: tuple[float, float, float] | None) -> None:
        for box, size in zip(self.boxes, sizes or (0.0, 0.0, 0.0), strict=True):
            box.setValue(size)


class UnwrapWidget(QWidget):
    """Runs the pipeline on a layer and adds every chart as layers.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        # napari may hand out a proxy, whose layers are proxies of another type again.
        self.viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.session = session_of(napari_viewer)
        self._connections: list[tuple[Any, Any]] = []
        self._layer_connections: list[tuple[Any, Any]] = []
        self._layer: Layer | None = None
        self._build()
        self._connect()
        self._on_layers_changed()
        self.step_list.show_states(self.session.steps)
        self._on_running(self.session.running)

    # Building ----------------------------------------------------------------

    def _build(self) -> None:
        self.layer_box = ComboBox(choices=self._sources, nullable=False, name="layer")
        self.layer_box.tooltip = "The stack, label image or mesh of the cell."
        self.voxel_size = VoxelSizeBox()
        self.preset_box = ComboBox(choices=[DEFAULTS, *PRESETS], value=DEFAULTS, name="preset")
        self.preset_box.tooltip = "The paper's values for a kind of protrusion."
        self.reset_button = QPushButton("Reset")
        self.reset_button.setToolTip("Back to the values of the preset.")
        self.note = QLabel()
        self.note.setWordWrap(True)
        self.note.setStyleSheet("color: #ffa000;")
        self.form = ParametersForm(Parameters(), MAIN)
        self.all_parameters = QCheckBox("All parameters")
        self.all_parameters.setToolTip("Show every parameter, by step.")
        self.run_button = QPushButton("Run")
        self.cancel_button = QPushButton("Cancel")
        self.progress_bar = QProgressBar()
        self.progress_bar.setRange(0, 1000)
        self.message = QLabel()
        self.message.setWordWrap(True)
        self.step_list = StepList()
        self.save_button = QPushButton("Save project …")
        self.save_button.setToolTip("Every chart, map and parameter in one *.unwrap3d file.")
        self._arrange()

    def _arrange(self) -> None:
        presets = QHBoxLayout()
        presets.addWidget(self.preset_box.native, 1)
        presets.addWidget(self.reset_button)
        top = QGridLayout()
        top.setColumnStretch(1, 1)
        for row, title in enumerate(("Cell in layer", "Voxel size (µm)", "Preset")):
            top.addWidget(QLabel(title), row, 0)
        top.addWidget(self.layer_box.native, 0, 1)
        top.addWidget(self.voxel_size, 1, 1)
        top.addLayout(presets, 2, 1)

        parameters = QWidget()
        column = QVBoxLayout(parameters)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.form)
        column.addWidget(self.all_parameters)
        column.addStretch(1)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setWidget(parameters)
        buttons = QHBoxLayout()
        buttons.addWidget(self.run_button, 1)
        buttons.addWidget(self.cancel_button)

        layout = QVBoxLayout(self)
        layout.addLayout(top)
        layout.addWidget(self.note)
        layout.addWidget(scroll, 1)
        layout.addLayout(buttons)
        layout.addWidget(self.progress_bar)
        layout.addWidget(self.message)
        layout.addWidget(self.step_list)
        layout.addWidget(self.save_button)
        self.setMinimumWidth(380)

    def _connect(self) -> None:
        for event in ("inserted", "removed", "reordered"):
            self._listen(getattr(self.viewer.layers.events, event), self._on_layers_changed)
        self.layer_box.changed.connect(self._on_layer_chosen)
        for box in self.voxel_size.boxes:
            box.valueChanged.connect(self._update_ready)
        self.preset_box.changed.connect(self._on_preset)
        self.reset_button.clicked.connect(self._on_preset)
        self.form.changed.connect(self._on_parameters)
        self.all_parameters.toggled.connect(self.form.show_all)
        self.run_button.clicked.connect(self.run)
        self.cancel_button.clicked.connect(self._on_cancel)
        self.save_button.clicked.connect(self._on_save)
        self.session.progressed.connect(self._on_progress)
        self.session.steps_changed.connect(self._on_steps)
        self.session.running_changed.connect(self._on_running)
        self.session.finished.connect(self._on_finished)
        self.session.stopped.connect(self._on_stopped)
        # The lists, not self: the widget is gone when Qt says so.
        self.destroyed.connect(partial(_disconnect, self._connections))
        self.destroyed.connect(partial(_disconnect, self._layer_connections))

    def _listen(self, emitter: Any, callback: Any) -> None:
        emitter.connect(callback)
        self._connections.append((emitter, callback))

    # The source --------------------------------------------------------------

    def _sources(self, _: Any = None) -> list[Layer]:
        return [layer for layer in self.viewer.layers if is_source(layer)]

    def _on_layers_changed(self, _: Any = None) -> None:
        self.layer_box.reset_choices()
        self._on_layer_chosen(self.layer_box.value)

    def _on_layer_chosen(self, layer: Layer | None) -> None:
        if layer is not self._layer:
            self._layer = layer
            self._listen_to_layer(layer)
            self.voxel_size.value = None
            if layer is not None and type(layer).__name__ == "Labels":
                self.form.entries["stack.label"].value = max(int(layer.selected_label), 1)
        self._on_scale_changed()
        self._update_rows()

    def _listen_to_layer(self, layer: Layer | None) -> None:
        _disconnect(self._layer_connections)
        if layer is not None:
            for emitter in (layer.events.scale, layer.events.units):
                emitter.connect(self._on_scale_changed)
                self._layer_connections.append((emitter, self._on_scale_changed))

    def _on_scale_changed(self, _: Any = None) -> None:
        """Show the layer's voxel size; a known one is changed at the layer, not here."""
        known = None if self._layer is None else layer_voxel_size(self._layer)
        self.voxel_size.setEnabled(known is None and self._layer is not None)
        if known is not None:
            self.voxel_size.value = known
        self._update_ready()

    def _update_rows(self) -> None:
        """Hide the parameters that make no sense for this kind of layer."""
        hidden = {"stack.timepoint", "stack.channel", "stack.label"}
        kind = type(self._layer).__name__
        if self._layer is not None and kind in ("Image", "Labels"):
            axes = layer_axes(self._layer)
            hidden -= {"stack.timepoint"} if "t" in axes else set()
            hidden -= {"stack.channel"} if "c" in axes else set()
        if kind == "Labels":
            hidden -= {"stack.label"}
        names = StackParameters.model_fields
        if kind == "Labels":
            hidden |= {f"stack.{name}" for name in names if name.startswith(SEGMENTING)}
        elif kind == "Surface":
            hidden |= {f"stack.{name}" for name in names if name != "working_voxel_um"}
        self.form.hide_entries(hidden)

    def _update_ready(self) -> None:
        if self._layer is None:
            note = NO_LAYER
        elif self.voxel_size.value is None:
            note = ASK_VOXEL_SIZE
        else:
            note = ""
        self.note.setText(note)
        self.note.setVisible(bool(note))
        self.run_button.setEnabled(not note and not self.session.running)

    # The parameters ----------------------------------------------------------

    def parameters(self) -> Parameters:
        """What the form says; a :class:`ParameterError` names what is out of range."""
        values = self.form.values()
        if type(self._layer).__name__ != "Labels":
            values["stack"]["label"] = None
        return Parameters.from_dict(values)

    def _on_preset(self, _: Any = None) -> None:
        name = self.preset_box.value
        parameters = Parameters() if name == DEFAULTS else Parameters.preset(name)
        label = self.form.entries["stack.label"].value
        self.form.set_values(parameters)
        self.form.entries["stack.label"].value = label

    def _on_parameters(self) -> None:
        try:
            parameters = self.parameters()
        except Unwrap3DError as error:
            self.message.setText(str(error))
            return
        self.message.setText("")
        self.session.parameters_changed(parameters)

    # The run -----------------------------------------------------------------

    def run(self) -> None:
        """Start the pipeline on the chosen layer; what is wrong is shown as a notification."""
        if self._layer is None:
            return
        try:
            self.session.run(self._layer, self.parameters(), self.voxel_size.value)
        except Unwrap3DError as error:
            self.message.setText(str(error))
            tell(error)

    def _on_cancel(self) -> None:
        self.message.setText("Cancelling …")
        self.session.cancel()

    def _on_running(self, running: bool) -> None:
        self.cancel_button.setEnabled(running)
        self.progress_bar.setVisible(running)
        self.progress_bar.setFormat("")
        self.progress_bar.setValue(0)
        self._update_save()
        self.form.setEnabled(not running)
        for widget in (self.layer_box.native, self.preset_box.native, self.reset_button):
            widget.setEnabled(not running)
        if running:
            self.message.setText("")
        self._update_ready()

    def _on_progress(self, step: str, fraction: float, message: str) -> None:
        # Steps that run on request come after the others, and have no row of their own.
        position = STEP_NAMES.index(step) if step in STEP_NAMES else len(STEP_NAMES) - 1
        self.progress_bar.setValue(round(1000 * (position + fraction) / len(STEP_NAMES)))
        self.progress_bar.setFormat(f"{position + 1}/{len(STEP_NAMES)} {TITLES[step]}")
        if self.session.running and message:
            self.message.setText(message)

    def _on_steps(self) -> None:
        self.step_list.show_states(self.session.steps)

    def _on_finished(self, atlas: Atlas) -> None:
        seconds = sum(step.seconds or 0.0 for step in self.session.steps.values())
        repairs = atlas.provenance.get("repairs", [])
        lines = [f"Done in {seconds:.1f} s.", *repairs]
        self.message.setText("\n".join(lines))

    def _on_stopped(self, reason: str) -> None:
        self.message.setText(reason)

    # Saving ------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Save the atlas in a thread; an error is shown as a notification."""
        if self.session.atlas is None:
            return
        self.save_button.setEnabled(False)
        self._saving = Task(save_project, self.session.atlas, path)
        self._saving.returned.connect(self._on_saved)
        self._saving.failed.connect(self._on_not_saved)
        self._saving.start()

    def _on_save(self) -> None:
        name, _ = QFileDialog.getSaveFileName(
            self, "Save project", f"cell{SUFFIX}", f"unwrap3d project (*{SUFFIX})"
        )
        if name:
            self.save(name)

    def _on_saved(self, path: Path) -> None:
        self.message.setText(f"Saved {path}.")
        self._update_save()

    def _on_not_saved(self, error: BaseException) -> None:
        tell(error)
        self._update_save()

    def _update_save(self) -> None:
        self.save_button.setEnabled(not self.session.running and self.session.atlas is not None)


def _disconnect(connections: list[tuple[Any, Any]], *_: Any) -> None:
    for emitter, callback in connections:
        emitter.disconnect(callback)
    connections.clear()
