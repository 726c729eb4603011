"""Frames as a movie: MP4 through imageio-ffmpeg, or a folder of numbered PNG pictures."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Generator, Iterable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import Cancelled, InputError, ParameterError
from .atomic import replacing

Image = npt.NDArray[np.uint8]

MP4 = ".mp4"
FRAME = re.compile(r"frame_\d{5,}\.png")
INSTALL = 'Install it with `pip install "napari-unwrap3d[video]"`, or write PNG frames.'
FPS = 10.0
# imageio-ffmpeg's scale, 1 to 10; 8 shows no blocks in flat colours.
QUALITY = 8.0
FASTEST = 240.0
# Same frames, same bytes; and players can begin before the file is complete.
OPTIONS = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-movflags", "+faststart"]


def check_video() -> None:
    """Raise :class:`InputError` where MP4 cannot be written."""
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise InputError("MP4 needs the package imageio-ffmpeg, which is missing.", hint=INSTALL)


class FrameWriter:
    """Takes the frames of a movie one by one; the file or folder appears when all are there.

    A context manager: an error in it leaves what was there before.

    Parameters
    ----------
    path : path
        ``*.mp4``, or a folder for ``frame_00000.png`` …, which is new, empty, or holds frames.
    fps : float
        Frames per second of an MP4.
    quality : float
        1 to 10, of an MP4.

    Attributes
    ----------
    frames : int
        That were taken.

    Raises
    ------
    InputError
        MP4 cannot be written here, or the folder holds something else.
    ParameterError
        `fps` or `quality` are out of their range.
    """

    def __init__(self, path: str | Path, fps: float = FPS, quality: float = QUALITY) -> None:
        self.path = Path(path)
        self.frames = 0
        self._fps, self._quality = _checked(fps, quality)
        self._shape: tuple[int, ...] = ()
        self._encoder: Generator[None, Any, None] | None = None
        self._video = self.path.suffix.lower() == MP4
        if self._video:
            check_video()
        else:
            check_frames_folder(self.path)
        self._stack = ExitStack()
        self._partial = self._stack.enter_context(replacing(self.path))
        if not self._video:
            self._partial.mkdir()

    def add(self, frame: Image) -> None:
        """Take the next frame.

        Parameters
        ----------
        frame : ndarray, (rows, columns, 3) uint8
            RGB, all of one size. In an MP4 an odd size is continued by one row or column.

        Raises
        ------
        InputError
            It is no such image, or has another size than the ones before.
        """
        image = np.asarray(frame)
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
            raise InputError(
                "A frame is an RGB image of bytes.", shape=image.shape, dtype=str(image.dtype)
            )
        if self._shape and image.shape != self._shape:
            raise InputError(
                "All frames of a movie have one size.", first=self._shape, this=image.shape
            )
        self._shape = image.shape
        if self._video:
            self._encode(image)
        else:
            from matplotlib.image import imsave

            name = self._partial / f"frame_{self.frames:05d}.png"
            options: dict[str, Any] = {"metadata": {"Software": None}}
            imsave(name, np.ascontiguousarray(image), **options)
        self.frames += 1

    def _encode(self, image: Image) -> None:
        even = np.pad(image, [(0, n % 2) for n in image.shape[:2]] + [(0, 0)], mode="edge")
        if self._encoder is None:
            import imageio_ffmpeg

            self._encoder = imageio_ffmpeg.write_frames(
                str(self._partial),
                (even.shape[1], even.shape[0]),
                fps=self._fps,
                quality=self._quality,
                codec="libx264",
                macro_block_size=2,
                output_params=OPTIONS,
            )
            self._encoder.send(None)
        self._encoder.send(np.ascontiguousarray(even))

    def close(self) -> Path:
        """Everything is there: put it in its place.

        Raises
        ------
        InputError
            There was no frame.
        OSError
            The encoder could not write them all; what was there before stays.
        """
        if not self.frames:
            self.abandon()
            raise InputError("A movie has at least one frame.")
        self._end_encoder()
        if self._video and (there := count_frames(self._partial)) != self.frames:
            self.abandon()
            raise OSError(f"{self.path.name}: {there} of {self.frames} frames were written.")
        self._stack.close()
        return self.path

    def abandon(self) -> None:
        """Leave what was there before."""
        self._end_encoder()
        self._stack.__exit__(Cancelled, Cancelled(), None)

    def _end_encoder(self) -> None:
        encoder, self._encoder = self._encoder, None
        if encoder is not None:
            encoder.close()

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()


def write_frames(
    path: str | Path, frames: Iterable[Image], fps: float = FPS, quality: float = QUALITY
) -> Path:
    """Write frames, an iterable of (rows, columns, 3) uint8; see :class:`FrameWriter`."""
    with FrameWriter(path, fps, quality) as writer:
        for frame in frames:
            writer.add(frame)
    return writer.path


def count_frames(path: Path) -> int:
    """How many frames a movie file holds; 0 where it is none."""
    import imageio_ffmpeg

    try:
        return int(imageio_ffmpeg.count_frames_and_secs(str(path))[0])
    except RuntimeError:
        return 0


def check_frames_folder(path: Path) -> None:
    """Raise :class:`InputError` where a folder for frames holds anything else, or is a file."""
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(
            f"{path.name!r} is a file.", hint="Name a folder for PNG frames, or a file *.mp4."
        )
    others = [entry.name for entry in path.iterdir() if not FRAME.fullmatch(entry.name)]
    if others:
        raise InputError(
            f"The folder {path.name!r} holds other things than frames.",
            first=sorted(others)[0],
            hint="Choose a new folder: an earlier movie's frames are replaced as a whole.",
        )


def _checked(fps: float, quality: float) -> tuple[float, float]:
    if not 0 < fps <= FASTEST:
        raise ParameterError("There are more than 0 frames per second, up to 240.", fps=float(fps))
    if not 1 <= quality <= 10:
        raise ParameterError("The quality lies between 1 and 10.", quality=float(quality))
    return float(fps), float(quality)
