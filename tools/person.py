"""A napari window and someone who uses it, through what a person sees.

What does not happen within its time, and an error that a person would be told, end the script.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import mouse
import numpy as np
from PIL import Image
from qtpy.QtCore import QBuffer, QIODevice, QPoint
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication, QScrollArea

SMALL, LARGE = (1400, 900), (1920, 1080)
STEP_S = 180.0
# A drag is this many moves of the mouse, so that a line is drawn and not dots.
MOVES = 24
# Of a picture: all, and those that are kept as they are.
COLOURS, EXACT = 256, 32


class Person:
    """A napari window, and someone who uses it."""

    def __init__(self, folder: Path) -> None:
        import napari
        from napari.utils.notifications import notification_manager

        self.folder = folder
        self.told: list[str] = []
        notification_manager.notification_ready.connect(self._on_told)
        self.viewer = napari.Viewer(title="napari")
        self.window = self.viewer.window._qt_window
        self.resize(SMALL)
        self.wizard: Any = None
        self.dock: Any = None

    def _on_told(self, notification: Any) -> None:
        if str(notification.severity) in ("error", "warning"):
            self.told.append(str(notification.message))

    # Time ------------------------------------------------------------------------

    def wait(self, condition: Callable[[], Any], what: str, limit_s: float = STEP_S) -> None:
        """Let the window live until something is so."""
        stop = time.monotonic() + limit_s
        while not condition():
            if time.monotonic() > stop:
                raise TimeoutError(f"{what}: not within {limit_s:.0f} s. Told: {self.told}")
            QApplication.processEvents()
            time.sleep(0.005)
        if self.told:
            raise RuntimeError(f"{what}: {self.told}")

    def rest(self, seconds: float = 0.5) -> None:
        """Let the window live for a while: layouts, textures and tables follow in later turns."""
        stop = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > stop, "resting")

    def settle(self) -> None:
        """Until nothing is computed any more and everything is drawn."""
        from napari_unwrap3d.viewer.views.canvas import open_canvas

        if open_canvas(self.viewer) is None:
            self.rest()
            return
        self.wait(lambda: not self.canvas.colouring.busy, "colours")
        self.wait(lambda: self.canvas.cursor.ready, "the linked cursor")
        self.wait(lambda: not self.canvas.requested.running, "a chart on request")
        self.rest()

    # The parts of the window -----------------------------------------------------

    @property
    def canvas(self) -> Any:
        from napari_unwrap3d.viewer.views.canvas import open_canvas

        found = open_canvas(self.viewer)
        assert found is not None, "there is no second canvas"
        return found

    @property
    def shown(self) -> Any:
        """The switches above the 3D canvas."""
        from napari_unwrap3d.viewer.views.showing import ShownBar

        return self.window.findChildren(ShownBar)[0]

    @property
    def main(self) -> Any:
        return self.viewer.window._qt_viewer.canvas.native

    @property
    def second(self) -> Any:
        return self.canvas.qt_viewer.canvas.native

    def resize(self, size: tuple[int, int]) -> None:
        self.window.showNormal()
        self.window.resize(*size)
        self.rest()
        found = (self.window.width(), self.window.height())
        if found != size:
            raise RuntimeError(f"the window is {found}, not {size}: is the screen too small?")

    # The mouse -------------------------------------------------------------------

    def click(self, button: Any) -> None:
        """Press a button that can be seen and pressed."""
        assert button.isVisible(), f"“{button.text()}” cannot be seen"
        assert button.isEnabled(), f"“{button.text()}” cannot be pressed"
        self.bring_into_view(button)
        # Beside the middle: a tick box reacts to its own width only.
        place = QPoint(min(10, button.width() // 2), button.height() // 2)
        QTest.mouseClick(button, mouse.LEFT, mouse.NO_KEYS, place)
        self.rest(0.1)

    def bring_into_view(self, widget: Any) -> None:
        parent = widget.parentWidget()
        while parent is not None:
            if isinstance(parent, QScrollArea):
                parent.ensureWidgetVisible(widget, 0, 60)
            parent = parent.parentWidget()
        self.rest(0.1)

    def press(self, name: str) -> None:
        """Of the tools of the annotations."""
        self.click(self.dock.tools[name])

    def hover(self, native: Any, place: tuple[float, float]) -> None:
        """Point at a share (x, y) of a canvas."""
        if native is self.second:
            self.canvas.model.mouse_over_canvas = True
        mouse.move(native, mouse.point_at(native, place))
        self.rest(0.2)

    def tap(self, native: Any, place: tuple[float, float]) -> None:
        """Click a share (x, y) of a canvas."""
        self.hover(native, place)
        QTest.mouseClick(native, mouse.LEFT, pos=mouse.point_at(native, place))
        self.rest(0.3)

    def leave(self) -> None:
        """Take the pointer off the second canvas, and with it what it draws there."""
        self.canvas.model.mouse_over_canvas = False
        self.rest(0.2)

    def drag(self, native: Any, places: Iterable[tuple[float, float]]) -> None:
        """Press, move along shares (x, y) of a canvas, and release."""
        line = list(_along(list(places), MOVES))

        def follow(move: Callable[[], None]) -> None:
            self.rest(0.03)
            move()

        self.hover(native, line[0])
        mouse.drag(native, line, follow)
        self.rest(0.3)

    # Pictures --------------------------------------------------------------------

    def picture(self, widget: Any = None) -> Image.Image:
        """What a widget shows, the whole window by default."""
        self.rest(0.3)
        buffer = QBuffer()
        buffer.open(QIODevice.OpenModeFlag.WriteOnly)
        (self.window if widget is None else widget).grab().save(buffer, "PNG")
        found = Image.open(io.BytesIO(bytes(buffer.data()))).convert("RGB")
        if np.ptp(np.asarray(found)) < 50:
            raise RuntimeError("the picture is empty")
        return found

    def save(self, name: str, picture: Image.Image | None = None) -> None:
        """Write a picture, of the whole window by default."""
        self.settle()
        found = self.picture() if picture is None else picture
        found = found.quantize(palette=palette(found), dither=Image.Dither.NONE)
        path = self.folder / f"{name}.png"
        found.save(path, optimize=True)
        print(f"{path.name}: {found.width} × {found.height}, {path.stat().st_size // 1000} kB")


def palette(picture: Image.Image) -> Image.Image:
    """The colours to keep: the commonest as they are, and a small green mark as well."""
    pixels = np.asarray(picture).reshape(-1, 3)
    coarse = pixels >> 2
    _, first, count = np.unique(
        coarse @ np.array([1, 64, 4096]), return_index=True, return_counts=True
    )
    weighed = np.repeat(pixels[first], np.ceil(count**0.25).astype(int), axis=0)
    exact, often = np.unique(pixels, axis=0, return_counts=True)
    exact = exact[np.argsort(-often)[:EXACT]]
    rest = Image.fromarray(weighed[None]).quantize(COLOURS - EXACT, Image.Quantize.MAXCOVERAGE)
    found = Image.new("P", (1, 1))
    found.putpalette([*exact.ravel().tolist(), *(rest.getpalette() or [])][: 3 * COLOURS])
    return found


def _along(corners: list[tuple[float, float]], count: int) -> Iterator[tuple[float, float]]:
    steps = np.linspace(0, len(corners) - 1, count)
    xs, ys = np.transpose(corners)
    for x, y in zip(
        np.interp(steps, range(len(corners)), xs),
        np.interp(steps, range(len(corners)), ys),
        strict=True,
    ):
        yield float(x), float(y)


def circle(x: float, y: float, rx: float, ry: float) -> list[tuple[float, float]]:
    """Corners of a closed line around a place of a canvas."""
    angles = np.linspace(0, 2 * np.pi, MOVES)
    return [(x + rx * float(np.cos(a)), y + ry * float(np.sin(a))) for a in angles]
