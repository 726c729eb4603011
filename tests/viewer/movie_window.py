"""A window with the breathing cell, and a mouse that draws in its uv image."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.viewer.movies.session import movie_session_of
from viewer.opened import SECONDS, open_atlas

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
TURNS = 20


class MovieWindow:
    """A viewer that shows the movie, with one of our docks."""

    def __init__(self, viewer: Any, movie: Any, qtbot: Any) -> None:
        self.viewer, self.movie, self.qtbot = viewer, movie, qtbot
        self.session = movie_session_of(viewer)
        if hasattr(self.session, "shown"):  # it shows the common space itself
            from viewer.playing import Projector

            self.canvas = Projector(viewer, movie, qtbot).canvas
        else:
            self.canvas = open_atlas(viewer, movie.common, qtbot, names=("surface", "uv"))
            self.session.set_movie(movie)
            qtbot.waitUntil(lambda: self.session.frame is not None, timeout=SECONDS)

    def dock(self, kind: Any, name: str) -> Any:
        widget = kind(self.viewer)
        self.viewer.window.add_dock_widget(widget, name=name)
        self.lay_out()
        return widget

    @property
    def second(self) -> Any:
        return self.canvas.qt_viewer.canvas.native

    def go_to(self, timepoint: int) -> None:
        self.session.set_timepoint(timepoint)
        self.at(timepoint)

    def at(self, timepoint: int) -> None:
        self.qtbot.waitUntil(lambda: self.session.timepoint == timepoint, timeout=SECONDS)
        self.lay_out()

    def lay_out(self) -> None:
        """Let the window find its sizes, and the second canvas fit its image to them."""
        same, last = 0, None
        while same < TURNS:
            QApplication.processEvents()
            now = self.second.size(), self.canvas._fit_timer.isActive()
            same, last = (same + 1 if now == last and not now[1] else 0), now

    def pixel(self, v: float, u: float) -> QPoint:
        """Where on the second canvas a place of the image is."""
        camera, native = self.canvas.model.scene.camera, self.second
        return QPoint(
            round((u - camera.center[-1]) * camera.zoom + native.width() / 2),
            round((v - camera.center[-2]) * camera.zoom + native.height() / 2),
        )

    def move(self, v: float, u: float, **keys: Any) -> None:
        """Move there until napari has noticed: vispy leaves moves out that follow too quickly."""
        import mouse

        def there() -> bool:
            mouse.move(self.second, self.pixel(v, u), **keys)
            now = self.canvas.model.cursor.position[-2:]
            return abs(now[0] - v) < 1.5 and abs(now[1] - u) < 1.5

        self.qtbot.waitUntil(there, timeout=SECONDS)

    def click(self, v: float, u: float) -> None:
        self.move(v, u)
        QTest.mouseClick(self.second, LEFT, NONE, self.pixel(v, u))

    def double_click(self, v: float, u: float) -> None:
        self.click(v, u)
        QTest.mouseDClick(self.second, LEFT, NONE, self.pixel(v, u))

    def drag(self, *places: tuple[float, float]) -> None:
        self.move(*places[0])
        QTest.mousePress(self.second, LEFT, NONE, self.pixel(*places[0]))
        for place in places[1:]:
            self.move(*place, pressed=True)
        QTest.mouseRelease(self.second, LEFT, NONE, self.pixel(*places[-1]))


def press_plot(plot: Any, x: float, y: float) -> None:
    """Click with the mouse at data coordinates of a plot of matplotlib."""
    canvas = plot.canvas
    canvas.draw()
    right, up = plot._axes.transData.transform((x, y)) / canvas.device_pixel_ratio
    place = QPoint(round(right), round(canvas.height() - up))
    QTest.mouseClick(canvas, LEFT, NONE, place)
