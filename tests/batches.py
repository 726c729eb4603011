"""What the tests of batches share: tiny cells in files, and comparisons to the last bit."""

from __future__ import annotations

import dataclasses
import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from napari_unwrap3d.batch import worker
from napari_unwrap3d.batch.cells import RECORD
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.files.project import load_project
from napari_unwrap3d.files.stacks import write_image

VOXEL = (0.25, 0.25, 0.25)
SIZES = dict(zip("zyx", VOXEL, strict=True))
TINY = {
    "uv": {"rows": 32},
    "registration": {"method": "none"},
    "reference": {"vertices": 2000},
}


def ball(size: int, centre: tuple[float, float, float], radius: float) -> np.ndarray:
    z, y, x = np.indices((size,) * 3)
    return (z - centre[0]) ** 2 + (y - centre[1]) ** 2 + (x - centre[2]) ** 2 < radius**2


def moving_ball(timepoint: int, timepoints: int, size: int = 34) -> np.ndarray:
    """A ball with a bump that moves around it."""
    middle = (size - 1) / 2
    angle = 2 * np.pi * timepoint / timepoints
    place = (middle, middle + 9 * np.sin(angle), middle + 9 * np.cos(angle))
    return ball(size, (middle,) * 3, 10) | ball(size, place, 4)


def write_masks(folder: Path, timepoints: int) -> list[Path]:
    """A file for each timepoint of the ball."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"t{timepoint}.tif" for timepoint in range(timepoints)]
    for timepoint, path in enumerate(paths):
        write_image(path, moving_ball(timepoint, timepoints), sizes=SIZES)
    return paths


def label_image(size: int = 48) -> np.ndarray:
    """Three cells, the third of which is too small to be unwrapped."""
    labels = np.zeros((size,) * 3, np.uint16)
    labels[ball(size, (14, 14, 14), 9)] = 3
    labels[ball(size, (33, 33, 33), 10)] = 7
    labels[4:6, 40:42, 40:42] = 9
    return labels


def same(one: Any, other: Any) -> bool:
    """Whether two charts, or anything made of arrays, agree to the last bit."""
    if isinstance(one, np.ndarray):
        other = np.asarray(other)
        return one.dtype == other.dtype and np.array_equal(
            one, other, equal_nan=one.dtype.kind == "f"
        )
    if isinstance(one, Mapping):
        return set(one) == set(other) and all(same(one[name], other[name]) for name in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one):
        names = [each.name for each in dataclasses.fields(one)]
        return all(same(getattr(one, n), getattr(other, n)) for n in names)
    return bool(one == other or (one != one and other != other))


def assert_same_movie(one: Path, other: Path, timepoints: int) -> None:
    """Masks, frames and the atlas of the common space agree to the last bit."""
    first, second = MovieFolder(one), MovieFolder(other)
    spaces = [load_project(folder.common_path) for folder in (first, second)]
    for chart in ("mask", "surface", "sealed", "reference", "sphere", "uv", "topography"):
        assert same(getattr(spaces[0], chart), getattr(spaces[1], chart)), chart
    for timepoint in range(timepoints):
        assert same(first.mask(timepoint), second.mask(timepoint)), timepoint
        assert same(first.frame(timepoint), second.frame(timepoint)), timepoint


def assert_same_tracked(one: Path, other: Path, timepoints: int) -> None:
    """Protrusions of every timepoint, and the tracks of two movies, agree to the last bit."""
    first, second = MovieFolder(one), MovieFolder(other)
    for timepoint in range(timepoints):
        found = first.protrusions(timepoint)
        assert found is not None
        assert same(found, second.protrusions(timepoint)), timepoint
    assert first.track_names() == second.track_names() != []
    for name in first.track_names():
        assert same(first.tracks(name), second.tracks(name)), name
        assert first.tracks_key(name) == second.tracks_key(name)


def assert_same_files(measured: Path, by_hand: Path) -> None:
    """All files of two folders agree to the last byte, but for the batch's own note."""
    found, expected = (
        {
            path.relative_to(folder): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }
        for folder in (measured, by_hand)
    )
    assert found.pop(Path(RECORD))
    assert set(found) == set(expected) != set()
    assert [path for path in found if found[path] != expected[path]] == []


def worker_pids() -> list[int]:
    """The processes of the workers that this process has started."""
    children = psutil.Process().children(recursive=True)
    return [each.pid for each in children if any("spawn_main" in word for word in each.cmdline())]


def dying_piece(path: str, digest: str, stages: Any, timepoint: int, keys: Any) -> worker.Done:
    """As a worker's piece of work, but that of a cell named hog takes its process along."""
    if Path(path).name.startswith("hog"):
        os.kill(os.getpid(), signal.SIGKILL)
    return worker.run_piece(path, digest, stages, timepoint, keys)
