"""A small square of a colour, as the icon of a row."""

from __future__ import annotations

from typing import Any

from qtpy.QtGui import QColor, QIcon, QPixmap

SWATCH = 14


def swatch(colour: Any) -> QIcon:
    """A small square of a colour."""
    pixels = QPixmap(SWATCH, SWATCH)
    pixels.fill(QColor.fromRgbF(*(float(part) for part in colour)))
    icon = QIcon(pixels)
    # Qt would tint it in the row that is selected.
    icon.addPixmap(pixels, QIcon.Mode.Selected)
    return icon
