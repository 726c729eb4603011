"""What the topography shows: its content, and a slice or a projection over depths."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QComboBox, QHBoxLayout, QLabel, QSlider, QStackedWidget, QWidget
from superqt import QRangeSlider

from ...charts import Stack
from ...fields import SIGNAL, Fields, channel_titles
from ...shell import ShellVolume
from ..common.threads import Task, tell
from .layers import volume_layer

if TYPE_CHECKING:
    from ...atlas import Atlas
    from .canvas import UnwrappedCanvas

FIELD, MASK = "Field", "Mask"
SLICE, MAXIMUM, MEAN = "Slice", "Maximum", "Mean"
PROJECTIONS = {SLICE: "none", MAXIMUM: "max", MEAN: "mean"}
TITLE_WIDTH = 130


class DepthBar(QWidget):
    """Content, projection and depth of the topography.

    Parameters
    ----------
    canvas : UnwrappedCanvas
    """

    def __init__(self, canvas: UnwrappedCanvas) -> None:
        super().__init__()
        self._canvas = canvas
        self._task: Task | None = None
        self._contents: dict[str, Any] = {}
        self._shown: Any = ""
        self._of: Atlas | None = None
        self._moving = False
        self._range = (-1, -1)
        self._limits = (0.0, 1.0)
        self._build()
        self.content.textActivated.connect(self.show_content)
        canvas.chart_changed.connect(self._update_content)
        canvas.colouring.changed.connect(self._update_content)
        self.mode.currentTextChanged.connect(self._on_mode)
        self.slider.valueChanged.connect(self._apply)
        self.range.valueChanged.connect(self._apply)
        canvas.model.dims.events.point.connect(self._on_point)
        canvas.model.layers.events.inserted.connect(self._on_inserted)
        canvas.session.finished.connect(self._on_atlas)

    def _build(self) -> None:
        self.content = QComboBox()
        self.content.addItems([FIELD, MASK])
        self.content.setToolTip(
            "What is shown in (d, v, u): the field that colours every view, the cell's mask, or "
            "a signal in grey."
        )
        self.content.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        self.mode = QComboBox()
        self.mode.addItems([*PROJECTIONS])
        self.mode.setToolTip("One depth, or the maximum or mean over a range of depths.")
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.range = QRangeSlider(Qt.Orientation.Horizontal)
        for slider in (self.slider, self.range):
            slider.setToolTip("Depth d: the distance from the reference, outwards positive.")
        self.sliders = QStackedWidget()
        self.sliders.addWidget(self.slider)
        self.sliders.addWidget(self.range)
        self.sliders.setMaximumHeight(26)
        self.label = QLabel()
        self.label.setMinimumWidth(TITLE_WIDTH)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.content)
        row.addWidget(self.mode)
        row.addWidget(self.sliders, 1)
        row.addWidget(self.label)

    # The depth ------------------------------------------------------------------

    @property
    def d_um(self) -> npt.NDArray[np.floating]:
        """Depth of every layer in µm; empty before there is a topography."""
        atlas = self._canvas.atlas
        there = atlas is not None and atlas.has("topography")
        return atlas.topography.d_um if atlas is not None and there else np.zeros(0)

    @property
    def busy(self) -> bool:
        """Whether the content is being carried."""
        return self._task is not None

    def set_depth(self, d_um: float) -> None:
        """Show the slice at a depth in µm."""
        self.mode.setCurrentText(SLICE)
        self.slider.setValue(self._layer(d_um))

    def set_range(self, mode: str, low_um: float, high_um: float) -> None:
        """Show the "Maximum" or the "Mean" over a range of depths in µm."""
        self.mode.setCurrentText(mode)
        self.range.setValue((self._layer(low_um), self._layer(high_um)))

    def state(self) -> dict[str, Any]:
        """What is shown, as plain data."""
        return {
            "content": self.content.currentText(),
            "mode": self.mode.currentText(),
            "slice": int(self.slider.value()),
            "range": [int(layer) for layer in self.range.value()],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Show what :meth:`state` said; KeyError, TypeError or ValueError if it makes no sense."""
        low, high = (int(layer) for layer in state["range"])
        self.show_content(str(state["content"]))
        self.mode.setCurrentText(str(state["mode"]))
        self.slider.setValue(int(state["slice"]))
        self.range.setValue((low, high))

    def _layer(self, d_um: float) -> int:
        return int(np.argmin(np.abs(self.d_um - d_um)))

    def _on_inserted(self, _: Any = None) -> None:
        self._update_range()

    def _update_range(self) -> None:
        """Fit the sliders to the layers that there are, starting at the reference."""
        image = self._canvas.image("topography")
        if image is None:
            return
        last = len(image.data) - 1
        zero = self._layer(0.0) if len(self.d_um) == last + 1 else last // 2
        known = (last, zero)
        if known != self._range:
            self._range = known
            self._moving = True
            for slider in (self.slider, self.range):
                slider.setRange(0, last)
            self.slider.setValue(zero)
            self.range.setValue((zero, last))
            self._moving = False
        self._apply()

    def _on_mode(self, _: str = "") -> None:
        self.sliders.setCurrentIndex(0 if self.mode.currentText() == SLICE else 1)
        self._apply()
        self._set_limits()

    def _apply(self, _: Any = None) -> None:
        """Bring the canvas to what the bar says."""
        image = self._canvas.image("topography")
        if self._moving or image is None:
            return
        low, high = self.slider.value(), self.slider.value()
        if self.mode.currentText() != SLICE:
            low, high = self.range.value()
        self._moving = True
        if isinstance(image.data, ShellVolume):
            image.data.projection = PROJECTIONS[self.mode.currentText()]
        dims = self._canvas.model.dims
        # Before d there may be the time of tracks.
        dims.set_point(dims.ndim - 3, (low + high) / 2)
        around = np.zeros(dims.ndim)
        around[-3] = (high - low) / 2
        dims.margin_left = dims.margin_right = tuple(around)
        image.projection_mode = PROJECTIONS[self.mode.currentText()]
        self._moving = False
        self._say(low, high)

    def _on_point(self, _: Any = None) -> None:
        """The depth was changed by a key, or by a script."""
        point = self._canvas.model.dims.point
        if not self._moving and self.mode.currentText() == SLICE and len(point) > 2:
            self.slider.setValue(round(point[-3]))

    def _say(self, low: int, high: int) -> None:
        if high >= len(self.d_um):
            self.label.setText("")
        elif low == high:
            self.label.setText(f"d = {_signed(self.d_um[low])} µm")
        else:
            ends = _signed(self.d_um[low]), _signed(self.d_um[high])
            self.label.setText(f"d = {ends[0]} … {ends[1]} µm")

    # The content ----------------------------------------------------------------

    def show_content(self, title: str) -> None:
        """Show the field that colours every view, the mask, or the signal of a channel."""
        self.content.setCurrentText(title)
        self._update_content()

    def _wanted(self) -> str:
        """What is to be shown: the name of a field, or :data:`MASK`."""
        title, colouring = self.content.currentText(), self._canvas.colouring
        if title == FIELD:
            there = colouring.values("surface") is not None
            return colouring.field if there else ""
        return MASK if title == MASK else str(self.content.currentData())

    def _update_content(self, _: Any = None) -> None:
        """Show what is wanted; it is computed in a thread first, once somebody looks at it."""
        image, fields = self._canvas.image("topography"), self._canvas.colouring.fields
        wanted = self._wanted()
        if image is None or fields is None or self._of is None or not wanted:
            return
        if wanted in self._contents:
            self._show(wanted)
        elif self._task is None and self._canvas.chart == "topography":
            self._canvas.colouring.unfollow(image)
            self._shown = ""
            self.label.setText("carrying …")
            self._task = Task(_carried, self._of, fields, wanted)
            self._task.returned.connect(self._on_carried)
            self._task.failed.connect(self._on_failed)
            self._task.start()

    def _on_carried(self, carried: tuple[Atlas, str, Any]) -> None:
        atlas, name, values = carried
        self._task = None
        if atlas is self._of:
            # One at a time: a large signal takes hundreds of megabytes.
            self._contents = {MASK: self._contents[MASK], name: values}
        self._update_content()
        self._apply()

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self.show_content(MASK)
        self._apply()
        tell(error)

    def _show(self, name: str) -> None:
        image, values = self._canvas.image("topography"), self._contents[name]
        followed = self.content.currentText() == FIELD
        if image is None or self._shown == (name, followed):
            return
        self._shown = name, followed
        colouring = self._canvas.colouring
        colouring.unfollow(image)
        if isinstance(values, ShellVolume):
            values.projection = PROJECTIONS[self.mode.currentText()]
            image.data = values
        else:
            image.data, attributes, _ = volume_layer(values)
            self._limits = attributes["contrast_limits"]
        if followed:
            colouring.follow(image, "topography")
        else:
            image.colormap = "gray"
            self._set_limits()

    def _set_limits(self) -> None:
        """Contrast of the whole content, or of the projection: a maximum is brighter."""
        image = self._canvas.image("topography")
        if image is None or self.content.currentText() == FIELD:
            return
        if self.mode.currentText() == SLICE or self.content.currentText() == MASK:
            low, high = self._limits
            image.contrast_limits_range = (low, max(high, image.contrast_limits_range[1]))
            image.contrast_limits = (low, high)
        else:
            image.reset_contrast_limits("slice")

    def _on_atlas(self, atlas: Atlas) -> None:
        if not atlas.has("topography"):
            return
        before, self._of = self._of, atlas
        # Its layer may have been given the mask again.
        self._shown = ""
        if before is None or before.topography is not atlas.topography:
            self._list(atlas)
            self._contents = {MASK: atlas.topography.mask}
        self._update_range()
        self._update_content()

    def _list(self, atlas: Atlas) -> None:
        """Offer what there is of this cell; what was chosen stays where it can."""
        chosen = self.content.currentText()
        self.content.clear()
        for title in (FIELD, MASK):
            self.content.addItem(title)
        source = self._canvas.session.source_data
        if isinstance(source, Stack) and atlas.parameters.stack.label is None:
            for channel, title in enumerate(channel_titles(source)):
                self.content.addItem(title, f"{SIGNAL}{channel}")
        self.content.setCurrentIndex(max(self.content.findText(chosen), 0))

    def close_bar(self) -> None:
        """Listen no longer."""
        self._canvas.session.finished.disconnect(self._on_atlas)


def _carried(atlas: Atlas, fields: Fields, name: str) -> tuple[Atlas, str, Any]:
    """What comes back from the thread, with what it belongs to."""
    return atlas, name, fields.in_topography(name)


def _signed(d_um: float) -> str:
    return f"{d_um:+.2f}".replace("-", "−")
