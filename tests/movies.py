"""A small movie that several test modules share: a ball with bumps that breathes."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np

from napari_unwrap3d.charts import Mask, Stack
from napari_unwrap3d.parameters import Parameters
from shapes import QUICK, VOXEL_UM, grid

if TYPE_CHECKING:
    from napari_unwrap3d.motion.movie import Movie

TIMEPOINTS = 5
TIME_STEP_S = 2.0
SIZE = 64
BODY = 16.0
BUMPS = (
    ((1.0, 0.1, 0.2), 16.0, 6.0),
    ((-0.2, 1.0, 0.3), 16.5, 5.0),
    ((0.1, -0.4, 1.0), 15.5, 5.0),
)
# The axis is set by hand: the last bits of a number may turn a found one.
PARAMETERS = Parameters.from_dict(
    {
        **QUICK.model_dump(),
        "uv": {"rows": 64, "axis_zyx": (1.0, 0.0, 0.0)},
        "registration": {"method": "none"},
    }
)


def breathing_cell(timepoint: int) -> np.ndarray:
    """The solid (z, y, x) at a timepoint: its bumps grow and shrink."""
    points = grid(SIZE)
    breath = np.sin(np.pi * timepoint / (TIMEPOINTS - 1))
    solid = np.linalg.norm(points, axis=-1) < BODY
    for i, (axis, distance, radius) in enumerate(BUMPS):
        centre = (distance + (1 + i) * breath) * np.array(axis) / np.linalg.norm(axis)
        solid |= np.linalg.norm(points - centre, axis=-1) < radius
    return solid


def breathing_masks() -> list[Mask]:
    """The cell at all timepoints."""
    return [Mask(breathing_cell(t), (VOXEL_UM,) * 3) for t in range(TIMEPOINTS)]


def breathing_stack() -> Stack:
    """The cell in two channels (t, c, z, y, x): a bright cell, and a ramp along x."""
    ramp = np.broadcast_to(np.arange(SIZE, dtype=np.uint16), (SIZE,) * 3)
    cells = [np.stack([200 * breathing_cell(t).astype(np.uint16), ramp]) for t in range(TIMEPOINTS)]
    return Stack(
        np.stack(cells), "tczyx", (VOXEL_UM,) * 3, TIME_STEP_S, ("membrane", "ramp"), "breathing"
    )


def breathing_movie(folder: Path) -> Movie:
    """The movie of the stack, with all of its frames."""
    from napari_unwrap3d.motion.movie import unwrap_movie

    return unwrap_movie(breathing_stack(), PARAMETERS, folder=folder).compute()


def read_mp4(path: Path) -> list[np.ndarray]:
    """The frames (rows, columns, 3) of a movie file.

    By the program of imageio-ffmpeg: its own reader leaves pipes to the garbage collector.
    """
    program = imageio_ffmpeg.get_ffmpeg_exe()
    about = subprocess.run([program, "-i", path], capture_output=True, check=False).stderr
    width, height = map(int, re.findall(rb"Video:.*?, (\d+)x(\d+)", about)[0])
    as_bytes = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run([program, "-v", "error", "-i", path, *as_bytes], capture_output=True)
    assert done.returncode == 0, done.stderr
    return list(np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3))
