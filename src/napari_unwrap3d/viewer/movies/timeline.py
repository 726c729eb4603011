"""The dock "Timeline": one slider over the timepoints of a movie, and its playback."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from napari.utils.theme import get_theme
from qtpy.QtCore import QPointF, QRectF, Qt
from qtpy.QtGui import QColor, QIcon, QPainter, QPaintEvent, QPixmap, QPolygonF
from qtpy.QtWidgets import (
    QCheckBox,
    QDockWidget,
    QHBoxLayout,
    QLabel,
    QSlider,
    QSpinBox,
    QStyle,
    QStyleOptionSlider,
    QVBoxLayout,
    QWidget,
)

from ..common.connections import disconnect, end_with_dock
from ..common.notice import small_button
from .session import HIGHEST_FPS, LOWEST_FPS, MovieSession, movie_session_of

if TYPE_CHECKING:
    import napari

    from ...motion.movie import Movie

DOCK_NAME = "Timeline"
NO_MOVIE = "There is no movie yet: unwrap one, or open it."
ICON = 14
# What is drawn on the buttons: bars (left, right) and triangles (base, tip), in shares.
SHAPES: dict[str, tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]] = {
    "first": (((0.1, 0.25),), ((0.9, 0.3),)),
    "previous": (((0.68, 0.84),), ((0.58, 0.1),)),
    "play": ((), ((0.2, 0.9),)),
    "pause": (((0.2, 0.42), (0.58, 0.8)), ()),
    "next": (((0.16, 0.32),), ((0.42, 0.9),)),
    "last": (((0.75, 0.9),), ((0.1, 0.7),)),
}
TIPS = {
    "first": "First timepoint",
    "previous": "Previous timepoint (key ,)",
    "play": "Play, or stay at this timepoint (key K)",
    "next": "Next timepoint (key .)",
    "last": "Last timepoint",
}
MARK, GAP = 3, 1
# Up to here times are given in seconds only.
SECONDS_ONLY = 120.0


class Timeline(QWidget):
    """The dock widget. Closing it loses nothing.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session: MovieSession = movie_session_of(napari_viewer)
        self._viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self._connections: list[tuple[Any, Any]] = []
        self.slider = FrameSlider()
        self.buttons = {name: small_button("", tip) for name, tip in TIPS.items()}
        self.label = QLabel(NO_MOVIE)
        self.fps_box = QSpinBox()
        self.loop_box = QCheckBox("Loop")
        self._arrange()
        self._connect()
        self._draw_icons()
        self._on_movie(self.session.movie)
        end_with_dock(self)

    def _arrange(self) -> None:
        self.slider.setToolTip(
            "The timepoint that is shown. The line below tells which frames were made."
        )
        self.fps_box.setRange(int(LOWEST_FPS), int(HIGHEST_FPS))
        self.fps_box.setSuffix(" fps")
        self.fps_box.setToolTip("Timepoints a second while the movie plays.")
        self.loop_box.setToolTip("Begin again at the end.")
        row = QHBoxLayout()
        row.setSpacing(2)
        for button in self.buttons.values():
            row.addWidget(button)
        row.addWidget(self.slider, 1)
        row.addWidget(self.label)
        row.addWidget(self.fps_box)
        row.addWidget(self.loop_box)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 2, 6, 2)
        column.addLayout(row)
        self.setMaximumHeight(44)

    def _connect(self) -> None:
        session = self.session
        actions: dict[str, Callable[[], None]] = {
            "first": lambda: session.set_timepoint(0),
            "previous": lambda: session.step(-1),
            "play": self._on_play,
            "next": lambda: session.step(1),
            "last": lambda: session.set_timepoint(self.slider.maximum()),
        }
        for name, action in actions.items():
            self.buttons[name].clicked.connect(lambda _=False, action=action: action())
        self.slider.valueChanged.connect(self._on_slider)
        self.fps_box.valueChanged.connect(self._on_fps)
        self.loop_box.toggled.connect(self._on_loop)
        session.movie_changed.connect(self._on_movie)
        session.wanted_changed.connect(self._update)
        session.frame_changed.connect(self._update)
        session.made_changed.connect(self._update)
        session.playing_changed.connect(self._draw_icons)
        session.playback_changed.connect(self._on_playback)
        theme = self._viewer.events.theme
        theme.connect(self._draw_icons)
        self._connections.append((theme, self._draw_icons))
        self.destroyed.connect(lambda _=None, known=self._connections: disconnect(known))

    # What is shown --------------------------------------------------------------

    def _on_movie(self, movie: Movie | None) -> None:
        self.slider.blockSignals(True)
        self.slider.setRange(0, 0 if movie is None else len(movie) - 1)
        self.slider.blockSignals(False)
        for widget in (self.slider, self.fps_box, self.loop_box, *self.buttons.values()):
            widget.setEnabled(movie is not None)
        widest = "" if movie is None else self._text(movie, len(movie) - 1)
        self.label.setMinimumWidth(self.label.fontMetrics().horizontalAdvance(widest) + 8)
        self._on_playback()
        self._update()

    def _on_playback(self) -> None:
        for box in (self.fps_box, self.loop_box):
            box.blockSignals(True)
        self.fps_box.setValue(round(self.session.fps))
        self.loop_box.setChecked(self.session.loop)
        for box in (self.fps_box, self.loop_box):
            box.blockSignals(False)

    def _update(self, _: Any = None) -> None:
        session = self.session
        if session.movie is None:
            self.label.setText(NO_MOVIE)
            return
        self.slider.blockSignals(True)
        self.slider.setValue(session.wanted)
        self.slider.blockSignals(False)
        self.slider.set_made(session.made)
        there = session.wanted in session.made or session.timepoint == session.wanted
        text = self._text(session.movie, session.wanted)
        self.label.setText(text if there else f"{text}  not made yet")

    @staticmethod
    def _text(movie: Movie, timepoint: int) -> str:
        return f"t {timepoint} / {len(movie) - 1}   {time_text(float(movie.times_s[timepoint]))}"

    def _draw_icons(self, _: Any = None) -> None:
        theme = get_theme(self._viewer.theme)
        for name, button in self.buttons.items():
            shown = "pause" if name == "play" and self.session.playing else name
            button.setIcon(media_icon(shown, theme.text.as_hex()))
        self.slider.set_colours(theme.current.as_hex(), theme.secondary.as_hex())

    # What the person does -------------------------------------------------------

    def _on_slider(self, value: int) -> None:
        self.session.pause()
        self.session.set_timepoint(value)

    def _on_play(self) -> None:
        self.session.toggle()

    def _on_fps(self, value: int) -> None:
        self.session.fps = value

    def _on_loop(self, on: bool) -> None:
        self.session.loop = on


class FrameSlider(QSlider):
    """A slider over timepoints, with a line that tells which frames there are."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self._made: frozenset[int] = frozenset()
        self._colours = QColor("#4a90d9"), QColor("#777777")
        self.setPageStep(10)

    @property
    def made(self) -> frozenset[int]:
        """The timepoints that are marked."""
        return self._made

    def set_made(self, made: frozenset[int]) -> None:
        """Mark these timepoints as there."""
        if made != self._made:
            self._made = made
            self.update()

    def set_colours(self, there: str, missing: str) -> None:
        """The colours of the line."""
        self._colours = QColor(there), QColor(missing)
        self.update()

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """The slider, and the line below it."""
        super().paintEvent(event)
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        control, style = QStyle.ComplexControl.CC_Slider, self.style()
        assert style is not None
        groove = style.subControlRect(control, option, QStyle.SubControl.SC_SliderGroove, self)
        handle = style.subControlRect(control, option, QStyle.SubControl.SC_SliderHandle, self)
        left = groove.left() + handle.width() / 2
        width = (groove.width() - handle.width()) / max(self.maximum(), 1)
        painter = QPainter(self)
        top = self.height() - MARK
        for first, last, there in runs(self._made, self.maximum() + 1):
            start = left + (first - 0.5) * width
            length = (last - first) * width - (GAP if width > 4 * GAP else 0)
            painter.fillRect(QRectF(start, top, length, MARK), self._colours[0 if there else 1])
        painter.end()


def runs(made: frozenset[int], count: int) -> list[tuple[int, int, bool]]:
    """Stretches (first, last + 1) of timepoints that are all there, or all missing."""
    found: list[tuple[int, int, bool]] = []
    for timepoint in range(count):
        there = timepoint in made
        if found and found[-1][2] == there:
            found[-1] = (found[-1][0], timepoint + 1, there)
        else:
            found.append((timepoint, timepoint + 1, there))
    return found


def time_text(seconds: float) -> str:
    """A time in words: seconds, and minutes where there are some."""
    if seconds < SECONDS_ONLY:
        return f"{seconds:.3g} s" if seconds < 10 else f"{seconds:.1f} s"
    minutes, rest = divmod(seconds, 60.0)
    return f"{seconds:.0f} s = {int(minutes)} min {rest:.0f} s"


def media_icon(name: str, colour: str) -> QIcon:
    """The picture of a button, one of :data:`SHAPES`."""
    pixels = QPixmap(2 * ICON, 2 * ICON)
    pixels.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixels)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(colour))
    size = 2.0 * ICON
    bars, triangles = SHAPES[name]
    for left, right in bars:
        painter.drawRect(QRectF(left * size, 0.15 * size, (right - left) * size, 0.7 * size))
    for base, tip in triangles:
        corners = [(base, 0.12), (base, 0.88), (tip, 0.5)]
        painter.drawPolygon(QPolygonF([QPointF(x * size, y * size) for x, y in corners]))
    painter.end()
    return QIcon(pixels)


def open_timeline(viewer: Any) -> Timeline:
    """The timeline of a viewer, docked below the second canvas when it is not open."""
    window = viewer.window._qt_window
    known = window.findChild(Timeline)
    if known is not None:
        return known
    timeline = Timeline(viewer)
    dock = viewer.window.add_dock_widget(timeline, name=DOCK_NAME, area="bottom")
    above = next((d for d in window.findChildren(QDockWidget) if _is_canvas(d)), None)
    if above is not None:
        window.splitDockWidget(above, dock, Qt.Orientation.Vertical)
    return timeline


def _is_canvas(dock: QDockWidget) -> bool:
    from ..views.canvas import UnwrappedCanvas

    return dock.findChild(UnwrappedCanvas) is not None
