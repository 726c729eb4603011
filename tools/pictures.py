"""Pictures of the window for the README and docs/, made by using it on a sample cell.

Every step is done through what a person sees: menus' commands, buttons, docks and canvases. A step
that does not happen within its time, and an error that a person would be told, end the script.
"""

from __future__ import annotations

import argparse
import io
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

PLUGIN = "napari-unwrap3d"
FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SMALL, LARGE = (1400, 900), (1920, 1080)
# Of a picture: all, and those that are kept as they are.
COLOURS, EXACT = 256, 32
GAP = 6
RUN_S, STEP_S = 1800.0, 180.0
# A drag is this many moves of the mouse, so that a line is drawn and not dots.
MOVES = 24
# In the uv image of the cell with blebs, as shares of the canvas.
BLEBS, POINT = ((0.726, 0.43), (0.62, 0.43)), (0.66, 0.56)
BOTTOM_UM = 2.0


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
        from qtpy.QtWidgets import QApplication

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
        from napari_unwrap3d.viewer.canvas import open_canvas

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
        from napari_unwrap3d.viewer.canvas import open_canvas

        found = open_canvas(self.viewer)
        assert found is not None, "there is no second canvas"
        return found

    @property
    def shown(self) -> Any:
        """The switches above the 3D canvas."""
        from napari_unwrap3d.viewer.showing import ShownBar

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
        from qtpy.QtCore import QPoint, Qt
        from qtpy.QtTest import QTest

        assert button.isVisible(), f"“{button.text()}” cannot be seen"
        assert button.isEnabled(), f"“{button.text()}” cannot be pressed"
        self.bring_into_view(button)
        # Beside the middle: a tick box reacts to its own width only.
        place = QPoint(min(10, button.width() // 2), button.height() // 2)
        QTest.mouseClick(button, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, place)
        self.rest(0.1)

    def bring_into_view(self, widget: Any) -> None:
        from qtpy.QtWidgets import QScrollArea

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
        self._move(native, place, pressed=False)
        self.rest(0.2)

    def tap(self, native: Any, place: tuple[float, float]) -> None:
        """Click a share (x, y) of a canvas."""
        from qtpy.QtCore import Qt
        from qtpy.QtTest import QTest

        self.hover(native, place)
        QTest.mouseClick(native, Qt.MouseButton.LeftButton, pos=_point(native, place))
        self.rest(0.3)

    def leave(self) -> None:
        """Take the pointer off the second canvas, and with it what it draws there."""
        self.canvas.model.mouse_over_canvas = False
        self.rest(0.2)

    def drag(self, native: Any, places: Iterable[tuple[float, float]]) -> None:
        """Press, move along shares (x, y) of a canvas, and release."""
        from qtpy.QtCore import Qt
        from qtpy.QtTest import QTest

        corners = list(places)
        line = list(_along(corners, MOVES))
        left, none = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
        self.hover(native, line[0])
        QTest.mousePress(native, left, none, _point(native, line[0]))
        for place in line[1:]:
            # vispy leaves out moves that follow each other too quickly.
            self.rest(0.03)
            self._move(native, place, pressed=True)
        QTest.mouseRelease(native, left, none, _point(native, line[-1]))
        self.rest(0.3)

    def _move(self, native: Any, place: tuple[float, float], *, pressed: bool) -> None:
        from qtpy.QtCore import QEvent, QPointF, Qt
        from qtpy.QtGui import QMouseEvent
        from qtpy.QtWidgets import QApplication

        point = _point(native, place)
        button = Qt.MouseButton.LeftButton if pressed else Qt.MouseButton.NoButton
        event = QMouseEvent(
            QEvent.Type.MouseMove,
            QPointF(point),
            QPointF(native.mapToGlobal(point)),
            Qt.MouseButton.NoButton,
            button,
            Qt.KeyboardModifier.NoModifier,
        )
        QApplication.sendEvent(native, event)

    # Pictures --------------------------------------------------------------------

    def picture(self, widget: Any = None) -> Image.Image:
        """What a widget shows, the whole window by default."""
        from qtpy.QtCore import QBuffer, QIODevice

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


def _point(native: Any, place: tuple[float, float]) -> Any:
    from qtpy.QtCore import QPoint

    return QPoint(round(place[0] * native.width()), round(place[1] * native.height()))


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


def beside(pictures: list[Image.Image], columns: int) -> Image.Image:
    """Pictures in rows, on one sheet."""
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    width = max(sum(p.width for p in row) + GAP * (len(row) - 1) for row in rows)
    height = sum(max(p.height for p in row) for row in rows) + GAP * (len(rows) - 1)
    sheet = Image.new("RGB", (width, height), (38, 41, 48))
    top = 0
    for row in rows:
        left = 0
        for picture in row:
            sheet.paste(picture, (left, top))
            left += picture.width + GAP
        top += max(p.height for p in row) + GAP
    return sheet


# The day of a person -----------------------------------------------------------------


def open_cell(person: Person, kind: str, project: Path | None) -> None:
    """A sample from the menu, and Run all; or a project that was saved before."""
    if project is not None:
        person.viewer.open(str(project), plugin=PLUGIN)
        person.rest(1.0)
    else:
        person.viewer.open_sample(PLUGIN, kind)
        person.viewer.window.add_plugin_dock_widget(PLUGIN, "Unwrap")
    from napari_unwrap3d.viewer.wizard import Wizard

    person.wizard = person.window.findChildren(Wizard)[0]
    session = person.wizard.session
    if project is None:
        person.rest(1.0)
        person.save("start")
        person.click(person.wizard.run_button)
        person.wait(lambda: session.running, "Run all")
    person.wait(lambda: session.atlas is not None and not session.running, "the run", RUN_S)
    person.wait(lambda: person.canvas.image("topography") is not None, "the topography")
    person.rest(2.0)
    person.settle()


def window(person: Person) -> None:
    """The window after a run."""
    person.save("window")


def light(person: Person) -> None:
    """The same on a large screen, in the light theme."""
    person.viewer.theme = "light"
    person.resize(LARGE)
    person.settle()
    person.save("light")
    person.viewer.theme = "dark"
    person.resize(SMALL)
    person.settle()


def steps(person: Person) -> None:
    """The panels of steps with a plot, opened by a click on the title."""
    panels = [person.wizard.panels[name] for name in ("reference", "sphere", "uv")]
    person.click(person.wizard.panels["stack"].title)
    pictures = []
    for panel in panels:
        person.click(panel.title)
        person.wait(lambda panel=panel: panel.plot.isVisible(), "a plot")
        person.rest(1.0)
        pictures.append(person.picture(panel))
        person.click(panel.title)
    person.save("steps", beside(pictures, 3))


def cursor(person: Person) -> None:
    """The same place in both canvases."""
    person.hover(person.second, (0.65, 0.24))
    assert person.canvas.cursor.place is not None
    person.save("cursor")
    person.leave()


def draw(person: Person) -> None:
    """The dock, an annotation, and a region drawn in uv."""
    _, person.dock = person.viewer.window.add_plugin_dock_widget(PLUGIN, "Annotations")
    person.rest()
    annotating = person.dock.annotating
    while annotating.names:
        person.click(person.dock.list.delete_button)
    for name in list(annotating.annotations.points.positions):
        annotating.annotations.points.remove(name)
    person.dock.list.name_box.setEditText("protrusion")
    person.click(person.dock.list.add_button)
    person.wait(lambda: annotating.layers.layer("protrusion", "uv"), "a layer to draw on")
    person.wait(lambda: person.viewer.layers["surface"].visible, "the surface")
    surface = person.viewer.layers["surface"]
    person.wait(lambda: annotating.painter.ready(surface), "the brush of the surface")
    person.settle()
    for label, place in enumerate(BLEBS, start=1):
        person.dock.label_box.setValue(label)
        person.press("brush")
        person.drag(person.second, circle(*place, 0.05, 0.12))
        person.press("fill")
        person.tap(person.second, place)
    assert set(np.unique(annotating.annotations.labels("protrusion"))) == {0, 1, 2}
    person.press("point")
    person.tap(person.second, POINT)
    assert len(annotating.annotations.points.positions) == 1
    person.click(person.shown.buttons["sphere"])
    look_at(person, "protrusion")
    person.press("brush")
    person.leave()
    person.save("draw")
    person.press("look")


def look_at(person: Person, name: str, chart: str = "surface") -> None:
    """Turn a mesh so that an annotation is in front."""
    annotating = person.dock.annotating
    vertices = getattr(annotating.atlas, chart).vertices
    drawn = np.asarray(annotating.annotations.image(name, chart)) > 0
    outwards = vertices[drawn].mean(axis=0) - vertices.mean(axis=0)
    up = np.cross(np.cross(outwards, (0.0, -1.0, 0.0)), outwards)
    person.viewer.scene.camera.set_view_direction(tuple(-outwards), tuple(up))
    person.click(person.shown.fit_button)


def carried(person: Person) -> None:
    """What was drawn in uv, on the surface, the sphere and the direct chart."""
    pictures = [person.picture(person.second)]
    person.click(person.canvas.chart_buttons["direct"])
    person.wait(lambda: person.canvas.image("direct") is not None, "the direct chart", RUN_S)
    person.settle()
    pictures.append(person.picture(person.second))
    for name in ("surface", "sphere"):
        _show_alone(person, name)
        look_at(person, "protrusion", name)
        pictures.append(person.picture(person.main))
    person.save("carried", beside(pictures, 2))
    _show_alone(person, "surface")
    look_at(person, "protrusion")
    person.click(person.canvas.chart_buttons["uv"])


def _show_alone(person: Person, name: str) -> None:
    from qtpy.QtCore import Qt
    from qtpy.QtTest import QTest

    button = person.shown.buttons[name]
    assert button.isEnabled()
    QTest.mouseDClick(button, Qt.MouseButton.LeftButton)
    person.settle()


def paint(person: Person) -> None:
    """The brush on the surface."""
    person.dock.label_box.setValue(3)
    person.press("brush")
    before = np.array(person.dock.annotating.annotations.labels("protrusion"))
    person.drag(person.main, [(0.42, 0.45), (0.5, 0.6), (0.58, 0.45)])
    after = np.array(person.dock.annotating.annotations.labels("protrusion"))
    assert (after != before).any(), "nothing was painted on the surface"
    person.settle()
    person.save("paint")
    person.press("look")


def topography(person: Person) -> None:
    """A slice of the signal in (d, v, u), and its maximum over depths."""
    person.click(person.canvas.chart_buttons["topography"])
    bar = person.canvas.depth_bar
    if bar.content.count() > 1:
        bar.show_content(bar.content.itemText(1))
        person.wait(lambda: not bar.busy, "the signal of the topography", RUN_S)
    person.settle()
    pictures = [person.picture(person.canvas)]
    bar.set_range("Maximum", 0.0, float(bar.d_um[-1]))
    person.settle()
    pictures.append(person.picture(person.canvas))
    person.save("topography", beside(pictures, 1))
    bar.set_depth(0.0)
    person.click(person.canvas.chart_buttons["uv"])


def regions(person: Person) -> None:
    """A half-space and the plane that fits a label."""
    person.dock.list.name_box.setEditText("cell bottom")
    person.click(person.dock.list.add_button)
    person.dock.label_box.setValue(1)
    person.rest()
    low = float(person.dock.annotating.atlas.surface.vertices[:, 0].min())
    person.dock.regions.side_box.setCurrentText("up to here")
    person.dock.regions.position.setValue(low + BOTTOM_UM)
    person.click(person.dock.regions.add_button)
    assert person.dock.annotating.annotations.labels("cell bottom").any()
    person.click(person.dock.measures.plane_button)
    person.wait(lambda: "normal" in person.dock.measures.result.text(), "the plane")
    person.rest(1.5)
    _show_alone(person, "surface")
    # From the side: z points down, as in the stack.
    person.viewer.scene.camera.set_view_direction((0.25, 0.9, 0.35), (-1.0, 0.25, 0.0))
    person.click(person.shown.fit_button)
    person.bring_into_view(person.dock.measures.result)
    person.save("plane")


SCENES = (window, light, steps, cursor, draw, carried, paint, topography, regions)


@contextmanager
def own_settings() -> Iterator[None]:
    """Neither the settings nor the unsaved cells of whoever calls this."""
    with tempfile.TemporaryDirectory() as folder:
        # napari reads this when it is imported.
        os.environ["NAPARI_CONFIG"] = str(Path(folder) / "settings.yaml")
        from napari_unwrap3d.viewer import autosave

        # An absolute folder wins over where the system keeps such files.
        autosave.FOLDER = str(Path(folder) / "unsaved")
        yield


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", default="blebs", help="of simulated cell")
    parser.add_argument("--project", type=Path, help="show a saved cell instead of a run")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    parser.add_argument("--keep", type=Path, help="save the unwrapped cell there")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    with own_settings():
        person = Person(options.output)
        open_cell(person, options.kind, options.project)
        if options.keep is not None:
            person.wizard.save(options.keep)
            person.wait(lambda: person.wizard.session.project_path, "saving", RUN_S)
        for scene in SCENES:
            scene(person)
        person.viewer.close()


if __name__ == "__main__":
    main()
