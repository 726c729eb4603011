"""The protrusion that is selected, alone: unwrapped to a square image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from napari.utils.colormaps import ensure_colormap
from qtpy.QtCore import Qt
from qtpy.QtGui import QImage, QPixmap
from qtpy.QtWidgets import QHBoxLayout, QLabel, QWidget

from ...errors import Unwrap3DError
from ...fields import CURVATURE, PROTRUSION
from ...protrusions.disk import Disk, unwrap_disk
from ..common.threads import Task, tell
from ..common.turns import soon
from ..views.canvas import canvas_of

if TYPE_CHECKING:
    from ...charts import Protrusions, Surface
    from ..views.colouring import Colouring
    from .instances import Instances

SIDE = 150
REST_MS = 150
# Where a field has no value.
NO_VALUE = (178, 178, 178, 255)
NOTHING = "Select one protrusion to see it unwrapped to a square."
SEVERAL = "Several are selected: choose one to see it unwrapped."
WORKING = "Unwrapping …"

Result = tuple["Protrusions", int, Disk | str]


class SquareView(QWidget):
    """The square image of the selected protrusion, in the field's colours; or why there is none.

    Parameters
    ----------
    instances : Instances
    """

    def __init__(self, instances: Instances, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._instances = instances
        self.disk: Disk | None = None
        self._of: tuple[Any, int] = (None, 0)
        self._task: Task | None = None
        self.picture, self.text = QLabel(), QLabel()
        self.picture.setFixedSize(SIDE, SIDE)
        self.picture.setScaledContents(True)
        self.text.setWordWrap(True)
        self.text.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        # Also without a picture: else the rows above would jump.
        self.setFixedHeight(SIDE)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.picture)
        row.addWidget(self.text, 1)
        self._timer = soon(self, self._unwrap, REST_MS)
        instances.selected.connect(self._timer.start)
        instances.changed.connect(self._timer.start)
        instances.styled.connect(self._draw)
        self._unwrap()

    @property
    def busy(self) -> bool:
        """Whether an image is being made, or about to be."""
        return self._task is not None or self._timer.isActive()

    def follow_colours(self) -> None:
        """Draw in the field's colours as they are now."""
        self._draw()

    def _unwrap(self) -> None:
        """Unwrap what is selected, in a thread."""
        instances, atlas = self._instances, self._instances.session.atlas
        chosen, found = instances.selection, instances.found
        if found is None or atlas is None or len(chosen) != 1:
            self._say(SEVERAL if len(chosen) > 1 else NOTHING)
            return
        if self._task is not None or self._of == (found, chosen[0]):
            return
        self._say(WORKING)
        self._task = Task(_unwrapped, atlas.surface, found, chosen[0])
        self._task.returned.connect(self._on_unwrapped)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_unwrapped(self, result: Result) -> None:
        self._task = None
        found, label, disk = result
        if found is not self._instances.found or self._instances.selection != (label,):
            self._unwrap()
            return
        if isinstance(disk, str):
            self._say(disk)
            return
        self.disk, self._of = disk, (found, label)
        quality = disk.quality
        self.text.setText(
            f"Protrusion {label}, {disk.pixels} × {disk.pixels} pixels.\n"
            f"Mean |log λ| {quality['mean_abs_log_area']:.3f}, Q {quality['mean_q']:.2f}, "
            f"{quality['flips']} flips."
        )
        self._draw()

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self._say("")
        tell(error)

    def _say(self, text: str) -> None:
        self.disk, self._of = None, (None, 0)
        self.text.setText(text)
        self._draw()

    def _draw(self) -> None:
        self.picture.setVisible(self.disk is not None)
        viewer = self._instances.viewer
        if self.disk is None or viewer is None:
            return
        shown = _field(canvas_of(viewer).colouring)
        if shown is None:
            self.picture.clear()
            return
        title, values, colormap, (low, high) = shown
        image = self.disk.scalars_to_square(values)
        share = np.nan_to_num((image - low) / max(high - low, 1e-300))
        colours = colormap.map(np.clip(share, 0.0, 1.0).ravel())
        pixels = np.rint(255 * np.asarray(colours)).astype(np.uint8).reshape(*image.shape, 4)
        pixels[np.isnan(image)] = NO_VALUE
        pixels = np.ascontiguousarray(pixels)
        rows, columns = image.shape
        kind = QImage.Format.Format_RGBA8888
        picture = QImage(pixels.tobytes(), columns, rows, 4 * columns, kind).copy()
        self.picture.setPixmap(QPixmap.fromImage(picture))
        self.picture.setToolTip(f"{title}, from {low:.3g} to {high:.3g}.")


def _field(colouring: Colouring) -> tuple[str, Any, Any, tuple[float, float]] | None:
    """Title, values, colormap and limits of the field of every view.

    A measure of protrusions is one colour all over one of them: then it is the curvature.
    """
    fields = colouring.fields
    if fields is None:
        return None
    name = CURVATURE if colouring.field.startswith(PROTRUSION) else colouring.field
    if name not in fields.names or not fields.known(name, "surface"):
        return None
    values = np.asarray(fields.values(name, "surface"), dtype=float)
    if name == colouring.field:
        return fields.field(name).label, values, colouring.colormap, colouring.limits
    own = fields.colours(name)
    return fields.field(name).label, values, ensure_colormap(own.colormap), own.limits


def _unwrapped(surface: Surface, found: Protrusions, label: int) -> Result:
    """The disk of a protrusion, or in words why it has none."""
    try:
        return found, label, unwrap_disk(surface, found.labels, label)
    except Unwrap3DError as error:
        return found, label, str(error)
