"""A mouse over a canvas: what a person does with it, as Qt's own events.

The tests, the pictures and the benchmarks draw with it. vispy leaves out moves that follow
each other too quickly, so whoever drags says what is to be waited for at every place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from qtpy.QtCore import QEvent, QPoint, QPointF, Qt
from qtpy.QtGui import QMouseEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

LEFT, NO_BUTTON = Qt.MouseButton.LeftButton, Qt.MouseButton.NoButton
NO_KEYS = Qt.KeyboardModifier.NoModifier


def point_at(native: Any, place: tuple[float, float]) -> QPoint:
    """The pixel at a share (x, y) of a canvas."""
    return QPoint(round(place[0] * native.width()), round(place[1] * native.height()))


def move(native: Any, point: QPoint, *, pressed: bool = False, keys: Any = NO_KEYS) -> None:
    """Move to a pixel, with the left button pressed or none."""
    event = QMouseEvent(
        QEvent.Type.MouseMove,
        QPointF(point),
        QPointF(native.mapToGlobal(point)),
        NO_BUTTON,
        LEFT if pressed else NO_BUTTON,
        keys,
    )
    QApplication.sendEvent(native, event)


def drag(
    native: Any,
    places: Iterable[tuple[float, float]],
    follow: Callable[[Callable[[], None]], None],
    keys: Any = NO_KEYS,
) -> None:
    """Press, move along shares (x, y) of a canvas, and release.

    Parameters
    ----------
    follow : callable
        Called for every place but the first with what moves there, which it calls once or
        more, and waits as it needs to.
    """
    points = [point_at(native, place) for place in places]
    QTest.mousePress(native, LEFT, keys, points[0])
    for point in points[1:]:
        follow(lambda point=point: move(native, point, pressed=True, keys=keys))  # type: ignore[misc]
    QTest.mouseRelease(native, LEFT, keys, points[-1])
