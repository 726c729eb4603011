"""Records a movie from a window: one frame per turn of the event loop, encoded in a thread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject, Qt, Signal
from qtpy.QtGui import QColor, QFont, QImage, QPainter

from ...errors import InputError
from ...files.movie_export import FrameWriter
from ..common.threads import Task
from ..common.turns import soon
from ..views.canvas import open_canvas

if TYPE_CHECKING:
    from ...charts import Frame
    from .session import MovieSession

Image = npt.NDArray[np.uint8]

# Turns of the event loop after a frame is shown until everything about it is drawn.
TURNS = 3
STAMP_SHARE = 1 / 28
MAIN, SECOND, BOTH = "main", "second", "both"


class Recording(QObject):
    """Writes one picture for each timepoint.

    Subclasses say how a picture comes about, in :meth:`_begin_picture`, and hand it to
    :meth:`_write`.

    Parameters
    ----------
    timepoints : sequence of int
    path : Path
        ``*.mp4``, or a folder for PNG frames.
    fps, quality : float

    Signals
    -------
    progressed(int, int)
        So many pictures of so many are written.
    ended(object)
        The path; None when it was cancelled.
    failed(object)
        The exception.
    """

    progressed = Signal(int, int)
    ended = Signal(object)
    failed = Signal(object)

    def __init__(
        self,
        timepoints: Sequence[int],
        path: Path,
        fps: float,
        quality: float,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        self.timepoints = list(timepoints)
        self._writer = FrameWriter(path, fps, quality)
        self._done = 0
        self._cancelled = False
        self._finished = False
        self._task: Task | None = None
        self._next = soon(self, self._on_next)

    def start(self) -> None:
        """Begin with the first timepoint."""
        self._next.start()

    def cancel(self) -> None:
        """Stop after the picture that is being made; nothing is written."""
        self._cancelled = True
        self._next.start()

    @property
    def running(self) -> bool:
        return not self._finished

    def _begin_picture(self, timepoint: int) -> None:
        raise NotImplementedError

    def _on_next(self) -> None:
        if self._finished or self._task is not None:
            return
        if self._cancelled:
            self._end(None, self._writer.abandon)
        elif self._done == len(self.timepoints):
            self._end(self._writer.path, self._writer.close)
        else:
            self._begin_picture(self.timepoints[self._done])

    def _write(self, work: Callable[[], Any]) -> None:
        """Run in a thread what makes and writes a picture."""
        self._run(work, self._on_written)

    def _on_written(self, _: Any = None) -> None:
        self._task = None
        self._done += 1
        self.progressed.emit(self._done, len(self.timepoints))
        self._next.start()

    def _run(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        self._task = Task(work)
        self._task.returned.connect(then)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _end(self, path: Path | None, work: Callable[[], Any]) -> None:
        self._run(work, lambda _: self._on_end(path))

    def _on_end(self, path: Path | None) -> None:
        self._task, self._finished = None, True
        self._leave()
        self.ended.emit(path)

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        if self._finished:
            return
        self._finished = True
        self._writer.abandon()
        self._leave()
        self.failed.emit(error)

    def _leave(self) -> None:
        """The recording is over."""


class WindowRecording(Recording):
    """Pictures of the canvases as they are shown.

    Parameters
    ----------
    session : MovieSession
    what : str
        "main", "second" or "both": which canvas; both are side by side.
    stamped : bool
        Whether the time is written into the picture.
    """

    def __init__(self, session: MovieSession, what: str, stamped: bool, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._session, self._what, self._stamped = session, what, stamped
        self._before = session.timepoint
        self._wanted = -1
        self._shape: tuple[int, ...] = ()
        self._turns = 0
        self._look = soon(self, self._on_turn)
        session.frame_changed.connect(self._on_frame)

    def _begin_picture(self, timepoint: int) -> None:
        self._wanted = timepoint
        self._session.set_timepoint(timepoint)

    def _on_frame(self, frame: Frame) -> None:
        if frame.timepoint == self._wanted and self._task is None and not self._finished:
            self._wanted, self._turns = -1, 0
            self._look.start()

    def _on_turn(self) -> None:
        """Look once the views have followed."""
        if self._finished or self._task is not None:
            return
        viewer = self._session.viewer
        canvas = None if viewer is None else open_canvas(viewer)
        busy = canvas is not None and canvas.colouring.busy
        self._turns = 0 if busy else self._turns + 1
        if self._turns < TURNS:
            self._look.start()
            return
        frame = self._session.frame
        if viewer is None or frame is None:
            self._on_failed(InputError("The movie was closed while it was recorded."))
            return
        image = shown_picture(viewer, self._what)
        if self._stamped:
            image = stamped(image, f"{frame.time_s:g} s")
        self._shape = self._shape or image.shape
        self._write(lambda: self._writer.add(fitted(image, self._shape)))

    def _leave(self) -> None:
        self._session.frame_changed.disconnect(self._on_frame)
        self._look.stop()
        self._session.set_timepoint(self._before)


class DrawnRecording(Recording):
    """Pictures that are drawn without the window.

    Parameters
    ----------
    prepare : callable
        Gives, in a thread, a function from a timepoint to a picture.
    """

    def __init__(self, prepare: Callable[[], Callable[[int], Image]], *arguments: Any) -> None:
        super().__init__(*arguments)
        self._prepare: Callable[[], Callable[[int], Image]] | None = prepare
        self._draw: Callable[[int], Image] | None = None

    def _begin_picture(self, timepoint: int) -> None:
        if self._prepare is not None:
            prepare, self._prepare = self._prepare, None
            self._run(prepare, self._on_prepared)
        elif self._draw is not None:
            draw = self._draw
            self._write(lambda: self._writer.add(draw(timepoint)))

    def _on_prepared(self, draw: Callable[[int], Image]) -> None:
        self._task, self._draw = None, draw
        self._next.start()


# Pictures ------------------------------------------------------------------------------


def shown_picture(viewer: Any, what: str) -> Image:
    """What the canvases show, as RGB.

    Raises
    ------
    InputError
        The second canvas is not there.
    """
    canvas = open_canvas(viewer)
    pictures = []
    if what in (MAIN, BOTH):
        pictures.append(viewer.screenshot(canvas_only=True, flash=False)[..., :3])
    if what in (SECOND, BOTH):
        if canvas is None:
            raise InputError("There is no unwrapped image.", hint="Unwrap a cell or open a movie.")
        pictures.append(canvas.qt_viewer.screenshot(flash=False)[..., :3])
    rows = max(len(picture) for picture in pictures)
    return np.concatenate([centred(picture, rows) for picture in pictures], axis=1)


def centred(image: Image, rows: int) -> Image:
    """More rows above and below, in the colour of the corner."""
    missing = rows - len(image)
    full = np.empty((rows, *image.shape[1:]), np.uint8)
    full[:] = image[0, 0]
    full[missing // 2 : missing // 2 + len(image)] = image
    return full


def fitted(image: Image, shape: tuple[int, ...]) -> Image:
    """Cut or continued to a size: a window may change its own."""
    if image.shape == shape:
        return image
    full = np.empty(shape, np.uint8)
    full[:] = image[0, 0]
    rows, columns = (min(a, b) for a, b in zip(image.shape[:2], shape[:2], strict=True))
    full[:rows, :columns] = image[:rows, :columns]
    return full


def stamped(image: Image, text: str) -> Image:
    """With words in the upper left corner, light on dark and dark on light."""
    rows, columns = image.shape[:2]
    picture = QImage(
        np.ascontiguousarray(image).tobytes(),
        columns,
        rows,
        3 * columns,
        QImage.Format.Format_RGB888,
    ).convertToFormat(QImage.Format.Format_RGBA8888)
    size = max(round(rows * STAMP_SHARE), 10)
    dark = image[: 2 * size, : 6 * size].mean() < 128
    painter = QPainter(picture)
    font = QFont()
    font.setPixelSize(size)
    painter.setFont(font)
    painter.setPen(QColor("white" if dark else "black"))
    place = picture.rect().adjusted(size // 2, size // 3, 0, 0)
    painter.drawText(place, int(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignTop), text)
    painter.end()
    bits = picture.constBits()
    if hasattr(bits, "setsize"):  # PyQt; PySide gives a memoryview
        bits.setsize(4 * rows * columns)
    return np.frombuffer(bytes(bits), np.uint8).reshape(rows, columns, 4)[..., :3].copy()
