"""One field, colormap and limits for every view of a cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from napari.utils.colormaps import AVAILABLE_COLORMAPS, ensure_colormap
from qtpy.QtCore import QObject, QSize, Qt, Signal
from qtpy.QtGui import QDoubleValidator, QIcon, QImage, QPixmap
from qtpy.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QSizePolicy,
    QWidget,
)

from ...charts import Stack
from ...errors import ChartMissingError
from ...fields import CHARTS, CURVATURE, Colours, Fields, fields_of
from ..common.notice import small_button
from ..common.threads import Task, tell
from ..common.turns import Turns
from .layers import FRAME, KEY, MISSING, image_layer

if TYPE_CHECKING:
    from napari.layers import Layer

    from ...atlas import Atlas
    from .canvas import UnwrappedCanvas

COLORMAPS = ("coolwarm", "viridis", "magma", "gray", "inferno", "plasma", "turbo", "PiYG")
IMAGES = ("uv", "direct", "plane")
BAR = (72, 12)
ICON = QSize(32, 12)
LIMIT_WIDTH = 58
FIELD_WIDTH = 360


class Colouring(QObject):
    """The field that colours every view of a viewer, and how.

    Attributes
    ----------
    field : str
        Name of the field that is shown, see :mod:`napari_unwrap3d.fields`.
    colormap : napari.utils.Colormap
    limits : (float, float)
    fields : Fields or None
        The catalogue of the atlas that is shown; None before there is one.

    Signals
    -------
    changed()
        The field, its values, the colormap or the limits.
    listed()
        There are other fields to choose from.
    working(bool)
        Values are being computed.
    """

    changed = Signal()
    listed = Signal()
    working = Signal(bool)

    def __init__(self, viewer: Any, canvas: UnwrappedCanvas) -> None:
        super().__init__(canvas)
        self._viewers: tuple[Any, ...] = (viewer, canvas.model)
        self._canvas = canvas
        self.fields: Fields | None = None
        self.field = CURVATURE
        self.colormap = ensure_colormap("coolwarm")
        self.limits = (-1.0, 1.0)
        #: Gives the fields of an atlas (and of the stack it was made from).
        self.catalogue: Callable[[Atlas, Stack | None], Fields] = fields_of
        # What the user chose for a field is there again when the field is.
        self._chosen: dict[str, tuple[Any, tuple[float, float]]] = {}
        self._wanted = ""
        self._task: Task | None = None
        self._again = False
        self._turns = Turns(self)
        self._setting = False
        self._linked: list[Layer] = []
        canvas.session.finished.connect(self._on_atlas)
        canvas.charts_changed.connect(self.refresh)
        for each in self._viewers:
            each.layers.events.inserted.connect(self._on_inserted)
            each.layers.events.removed.connect(self._on_removed)
            for layer in each.layers:
                self._link(layer)

    # What is shown --------------------------------------------------------------

    def set_field(self, name: str) -> None:
        """Colour every view by another field; one that takes time appears when it is there."""
        if self.fields is None:
            return
        self.fields.field(name)
        self._wanted = name
        self._compute()

    def set_colormap(self, colormap: Any) -> None:
        """Draw the field with another colormap (its name, or one of napari's) everywhere."""
        self.colormap = ensure_colormap(colormap)
        self._recolour()

    def set_limits(self, low: float, high: float) -> None:
        """Draw the field between other values everywhere."""
        if high > low:
            self.limits = (float(low), float(high))
            self._recolour()

    def restore(self, field: str, colormap: Any, limits: tuple[float, float]) -> None:
        """Colour by a field with a colormap and limits that were chosen before."""
        if self.fields is not None and limits[1] > limits[0]:
            self._chosen[self.fields.field(field).name] = (ensure_colormap(colormap), limits)
            self.set_field(field)

    @property
    def busy(self) -> bool:
        """Whether values are being computed, or brought to the views."""
        return self._task is not None or self._turns.busy

    def reset(self) -> None:
        """Back to the field's own colormap and limits."""
        if self.fields is not None and self.field in self.fields.names:
            self._take(self.fields.colours(self.field))
            self._recolour()

    def values(self, chart: str) -> npt.NDArray[np.float32] | None:
        """Values of the field on a chart; None where they are not there (yet)."""
        if self.fields is None or not self.fields.known(self.field, chart):
            return None
        return self.fields.values(self.field, chart)

    def renew(self) -> None:
        """The atlas has other protrusions now."""
        if self.fields is not None and self.fields.renew():
            if self.field not in self.fields.names:
                self._wanted = CURVATURE
            self.listed.emit()
            self.refresh()

    def show_fields(self, fields: Fields) -> bool:
        """Go on with the fields of another timepoint.

        Returns whether the field that is shown is known there, so that who calls this can give
        its layers their values now; the others are given theirs by :meth:`refresh`.
        """
        before, self.fields = self.fields, fields
        if before is None or before.names != fields.names:
            self._list_fields(fields)
            return False
        return fields.known(self.field, "uv")

    def refresh(self) -> None:
        """Colour what is new: charts computed on request, layers put in again."""
        if self.fields is not None:
            self._wanted = self._wanted or self.field
            self._compute()

    def _take(self, colours: Colours) -> None:
        self.colormap, self.limits = ensure_colormap(colours.colormap), colours.limits

    # Values come from a thread --------------------------------------------------

    def _on_atlas(self, atlas: Atlas) -> None:
        source = self._canvas.session.source_data
        before = self.fields
        self.fields = self.catalogue(atlas, source if isinstance(source, Stack) else None)
        if before is not None:
            self.fields.adopt(before)
        self._list_fields(self.fields)

    def _list_fields(self, fields: Fields) -> None:
        """Offer other fields, and show the one that was shown, if it is among them."""
        self._wanted = self.field if self.field in fields.names else CURVATURE
        if self._wanted not in fields.names:
            self._wanted = fields.names[0] if fields.names else ""
        self.listed.emit()
        if self._wanted:
            self._compute()

    def _compute(self) -> None:
        """Values of the wanted field on every chart that is there, then :meth:`_show`."""
        if self.fields is None:
            return
        if self._task is not None:
            self._again = True
            return
        self._again = False
        name, fields = self._wanted, self.fields
        self._task = Task(_values_everywhere, fields, name)
        self._task.returned.connect(self._on_values)
        self._task.failed.connect(self._on_failed)
        # Before the start: what is known already comes back within it.
        self.working.emit(True)
        self._task.start()

    def _on_values(self, computed: tuple[Fields, str]) -> None:
        self._task = None
        self.working.emit(False)
        if self.fields is None or computed != (self.fields, self._wanted) or self._again:
            self._compute()
            return
        self.field = self._wanted
        chosen = self._chosen.get(self.field)
        if chosen is None:
            self._take(self.fields.colours(self.field))
        else:
            self.colormap, self.limits = chosen
        self._turns.clear()
        self._turns.add(self._show())

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self._wanted = self.field
        self.working.emit(False)
        self.listed.emit()
        tell(error)

    # Layers ---------------------------------------------------------------------

    def _show(self) -> Iterator[None]:
        """Bring every view to the field, one layer per turn of the event loop."""
        for chart in IMAGES:
            values, image = self.values(chart), self._canvas.image(chart)
            if values is not None and image is None:
                yield from self._canvas.place([image_layer(chart, values, self.field)])
            elif values is not None and image is not None and image.data is not values:
                image.data = values
                image.metadata[KEY]["field"] = self.field
                self._paint(image)
                yield
        # What is seen first comes first.
        for layer in sorted(self._linked, key=lambda layer: not layer.visible):
            if self._colour_mesh(layer):
                self._paint(layer)
                yield
        self._recolour()

    def _colour_mesh(self, layer: Layer) -> bool:
        """Give a mesh its values; False where there was nothing to do."""
        if type(layer).__name__ != "Surface":
            return False
        known = layer.metadata[KEY]
        if known["values_on"] == FRAME:
            # Who shows a timepoint gives its mesh the values with it.
            return False
        values = self.values(known["values_on"])
        known["field"] = self.field
        if values is None:
            return False
        if "vertices" in known:
            values = values[known["vertices"]]
        shown, known[MISSING] = np.nan_to_num(values), np.isnan(values)
        if len(shown) != len(layer.data[0]) or np.array_equal(shown, layer.vertex_values):
            return False
        layer.vertex_values = shown
        return True

    def _recolour(self) -> None:
        """Give every linked layer that shows the field the colormap and the limits."""
        self._chosen[self.field] = (self.colormap, self.limits)
        for layer in self._linked:
            if layer.metadata[KEY]["field"] == self.field:
                self._paint(layer)
        self.changed.emit()

    def _paint(self, layer: Layer) -> None:
        """Give a layer the colormap and the limits."""
        self._setting = True
        if layer.colormap != self.colormap:
            layer.colormap = self.colormap
        if tuple(layer.contrast_limits) != self.limits:
            # The range of napari's slider: twice as far as the limits.
            low, high = self.limits
            half = (high - low) / 2
            layer.contrast_limits_range = (low - half, high + half)
            layer.contrast_limits = self.limits
        self._setting = False

    def follow(self, layer: Layer, chart: str) -> None:
        """Draw a layer, which shows the field on a chart now, like all others."""
        layer.metadata[KEY] |= {"values_on": chart, "field": self.field}
        self._link(layer)
        self._paint(layer)

    def unfollow(self, layer: Layer) -> None:
        """Leave a layer alone that shows something else now."""
        layer.metadata[KEY] |= {"values_on": "", "field": ""}
        self._unlink(layer)

    def _link(self, layer: Layer) -> None:
        if layer.metadata.get(KEY, {}).get("values_on") and layer not in self._linked:
            self._linked.append(layer)
            layer.events.colormap.connect(self._on_colormap)
            layer.events.contrast_limits.connect(self._on_limits)

    def _on_inserted(self, event: Any) -> None:
        self._link(event.value)

    def _on_removed(self, event: Any) -> None:
        self._unlink(event.value)

    def _unlink(self, layer: Layer) -> None:
        if layer in self._linked:
            self._linked.remove(layer)
            layer.events.colormap.disconnect(self._on_colormap)
            layer.events.contrast_limits.disconnect(self._on_limits)

    def _on_colormap(self, event: Any) -> None:
        """The user chose it in napari's own controls."""
        if self._follows(event.source):
            self.set_colormap(event.source.colormap)

    def _on_limits(self, event: Any) -> None:
        if self._follows(event.source):
            self.set_limits(*event.source.contrast_limits)

    def _follows(self, layer: Layer) -> bool:
        """Whether a change of a layer is the user's, of the field that is shown."""
        return (
            not self._setting
            and self.fields is not None
            and layer.metadata.get(KEY, {}).get("field") == self.field
        )

    def close(self) -> None:
        """Listen no longer."""
        self._turns.clear()
        self._canvas.session.finished.disconnect(self._on_atlas)
        for each in self._viewers:
            each.layers.events.inserted.disconnect(self._on_inserted)
            each.layers.events.removed.disconnect(self._on_removed)
        self._viewers = ()
        self._linked.clear()


def _values_everywhere(fields: Fields, name: str) -> tuple[Fields, str]:
    """Compute a field on every chart of its atlas; runs in a thread."""
    for chart in CHARTS:
        if fields.reachable(name, chart):
            fields.values(name, chart)
    return fields, name


class ColouringBar(QWidget):
    """Colour by …: the field, its colormap and its limits, with a colour bar.

    Parameters
    ----------
    colouring : Colouring
    """

    def __init__(self, colouring: Colouring, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.colouring = colouring
        self._build()
        self.field_box.activated.connect(self._on_field)
        self.colormap_box.activated.connect(self._on_colormap)
        self.low.editingFinished.connect(self._on_limits)
        self.high.editingFinished.connect(self._on_limits)
        self.reset_button.clicked.connect(colouring.reset)
        colouring.listed.connect(self._list)
        colouring.changed.connect(self._update)
        colouring.working.connect(self._on_working)
        self._list()
        self._update()

    def _build(self) -> None:
        self.field_box = QComboBox()
        self.field_box.setToolTip("Colours the 3D view and this one alike.")
        self.field_box.setMinimumContentsLength(18)
        self.field_box.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.field_box.setMaximumWidth(FIELD_WIDTH)
        self.colormap_box = QComboBox()
        self.colormap_box.setIconSize(ICON)
        for name in COLORMAPS:
            if name in AVAILABLE_COLORMAPS or name == "coolwarm":
                self._add_colormap(name)
        self.low, self.high = _limit_box("Lower limit."), _limit_box("Upper limit.")
        self.bar = QLabel()
        self.bar.setFixedSize(*BAR)
        self.bar.setScaledContents(True)
        self.unit = QLabel()
        self.reset_button = small_button("↺", "Back to this field's own colormap and limits.")
        self.busy = QLabel("")
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(4)
        row.addWidget(QLabel("Colour by"))
        for widget in (
            self.field_box,
            self.colormap_box,
            self.low,
            self.bar,
            self.high,
            self.unit,
            self.reset_button,
            self.busy,
        ):
            row.addWidget(widget, 1 if widget is self.field_box else 0)
        row.addStretch(0)

    def _add_colormap(self, name: str) -> None:
        """A colormap is its picture; there is no room for its name."""
        row = self.colormap_box.count()
        self.colormap_box.addItem(QIcon(_gradient(name, ICON.width())), "", name)
        self.colormap_box.setItemData(row, name, Qt.ItemDataRole.ToolTipRole)

    def _list(self) -> None:
        fields = self.colouring.fields
        self.field_box.clear()
        if fields is not None:
            for name in fields.names:
                self.field_box.addItem(fields.field(name).title, name)
            # A long name is cut off in the box, never in the list.
            self.field_box.view().setMinimumWidth(self.field_box.view().sizeHintForColumn(0) + 30)
        self.setEnabled(fields is not None)
        self._update()

    def _update(self) -> None:
        colouring = self.colouring
        self.field_box.setCurrentIndex(self.field_box.findData(colouring.field))
        name = colouring.colormap.name
        if self.colormap_box.findData(name) < 0:
            self._add_colormap(name)
        self.colormap_box.setCurrentIndex(self.colormap_box.findData(name))
        self.colormap_box.setToolTip(f"Colormap of every view: {name}.")
        low, high = colouring.limits
        digits = _decimals(high - low)
        for box, value in ((self.low, low), (self.high, high)):
            box.setText(f"{value:.{digits}f}")
        self.bar.setPixmap(_gradient(colouring.colormap, BAR[0]))
        fields = colouring.fields
        known = fields is not None and colouring.field in fields.names
        unit = fields.field(colouring.field).unit if fields is not None and known else ""
        self.unit.setText(unit)

    def _on_field(self, index: int) -> None:
        try:
            self.colouring.set_field(self.field_box.itemData(index))
        except ChartMissingError as error:
            tell(error)

    def _on_colormap(self, index: int) -> None:
        self.colouring.set_colormap(self.colormap_box.itemData(index))

    def _on_limits(self) -> None:
        # Only what was edited: the texts are rounded.
        old = self.colouring.limits
        typed = [
            float(box.text()) if box.isModified() and box.hasAcceptableInput() else value
            for box, value in zip((self.low, self.high), old, strict=True)
        ]
        if typed[1] > typed[0]:
            self.colouring.set_limits(*typed)
        else:
            self._update()

    def _on_working(self, working: bool) -> None:
        self.busy.setText("…" if working else "")
        self.busy.setToolTip("The values are being computed." if working else "")


def _limit_box(tip: str) -> QLineEdit:
    box = QLineEdit()
    box.setToolTip(tip)
    box.setValidator(QDoubleValidator(box))
    box.setFixedWidth(LIMIT_WIDTH)
    box.setAlignment(Qt.AlignmentFlag.AlignRight)
    return box


def _decimals(width: float) -> int:
    """Digits after the point that tell a hundredth of the limits' distance apart."""
    return int(np.clip(np.ceil(2 - np.log10(max(width, 1e-9))), 0, 6))


def _gradient(colormap: Any, width: int) -> QPixmap:
    """A colormap as a picture, from its lower end to its upper."""
    colours = ensure_colormap(colormap).map(np.linspace(0.0, 1.0, width))
    row = np.ascontiguousarray((255 * colours).astype(np.uint8))[None]
    image = QImage(row.tobytes(), width, 1, 4 * width, QImage.Format.Format_RGBA8888)
    return QPixmap.fromImage(image.copy()).scaled(width, BAR[1])
