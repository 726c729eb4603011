"""Movies on several workers: how much sooner, what a kill costs, and memory.

    .venv/bin/python benchmarks/movies_batch.py
    .venv/bin/python benchmarks/movies_batch.py --seed 10 --timepoints 12   # to try something

Two workers against one: wall time of a whole simulated blebbing movie, from the files to the
summary, with the start of the workers and with the common space, which only one worker builds.
Every worker has one thread. Other work on the machine disturbs this number.

Kill: a run of the same movie is ended by SIGKILL in the middle and started again. Arrays of
masks, frames and the common space are compared with those of the run that was not disturbed;
pieces of work that the second run made although the first one had begun them are counted.

Memory: the largest memory of a worker's process over 200 frames, over that with 20.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.children import ONE_THREAD
from common.results import Bar, Entries

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.batch import Reading, run_batch
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.files.project import load_project
from napari_unwrap3d.files.stacks import write_image

SEED = 0
TIMEPOINTS = 80
SIZE = 96
ROWS = 128
WORKERS = 2
VOXEL_UM = 0.25
MOVIE = "movie"
FRAMES = (20, 200)

FASTER_BAR = Bar(1.6, "× faster", at_least=True)
DIFFERENT_BAR = Bar(0, "arrays that differ")
LOST_BAR = Bar(WORKERS, "items made again")
MEMORY_BAR = Bar(1.3, "× the memory of 20 frames")
CHARTS = ("mask", "surface", "sealed", "reference", "sphere", "uv", "topography")

SETTINGS = {"uv": {"rows": ROWS}, "stack": {"threshold": "edge"}}
TINY = {
    "uv": {"rows": 32},
    "reference": {"vertices": 2000},
    "registration": {"method": "none"},
}


# A movie -----------------------------------------------------------------------------


def write_movie(folder: Path, seed: int, timepoints: int) -> list[str]:
    """A simulated movie, a file for each timepoint: making it is not part of what is measured."""
    movie = unwrap3d.simulate.movie("blebs", seed, timepoints=timepoints, size=SIZE)
    folder.mkdir(parents=True, exist_ok=True)
    sizes = dict(zip("zyx", movie.stack.voxel_size, strict=True))
    axes = movie.stack.axes.replace("t", "")
    for timepoint in range(timepoints):
        frame = np.asarray(movie.frame(timepoint))
        write_image(folder / f"t{timepoint}.ome.tif", frame, axes, sizes=sizes)
    return [str(folder / f"t{timepoint}.ome.tif") for timepoint in range(timepoints)]


def run(files: list[str], output: Path, workers: int, **more: Any) -> float:
    """Seconds of a whole run."""
    start = time.perf_counter()
    result = run_batch(
        files,
        unwrap3d.Parameters.from_dict(SETTINGS),
        output,
        reading=Reading(time_step=1.0),
        timelapse=True,
        workers=workers,
        threads=1,
        **more,
    )
    if result.exit_code:
        raise SystemExit("\n".join(row.reason for row in result.failed))
    return time.perf_counter() - start


def two_workers(files: list[str], folder: Path) -> Entries:
    """Wall time with one worker over that with two."""
    run(files[:3], folder / "warm", WORKERS)  # kernels are compiled once for each worker
    seconds = {count: run(files, folder / f"workers-{count}", count) for count in (WORKERS, 1)}
    walls = {f"wall_{count}_s": results.significant(s, 3) for count, s in seconds.items()}
    ratio = seconds[1] / seconds[WORKERS]
    name = f"movies/batch-two-workers/blebs-{len(files)}"
    return {name: FASTER_BAR.entry(ratio, **walls, cores=len(os.sched_getaffinity(0)))}


# Killing -----------------------------------------------------------------------------


def pieces(output: Path) -> list[str]:
    """The pieces of work that the logs call done."""
    lines = [x for log in (output / "log").glob("*.log") for x in log.read_text().splitlines()]
    return [x.split(":")[0] for x in lines if x.startswith("== ") and ": done in" in x]


def killed_and_resumed(files: list[str], folder: Path) -> Entries:
    """A run that is killed while frames are made, and what the next one does."""
    output, total = folder / "killed", 2 * len(files) + 1
    command = [sys.executable, __file__, "--run", str(output), *files]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        for line in child.stdout:
            if float(line) > 0.7:
                os.kill(child.pid, signal.SIGKILL)
                break
    told = len(pieces(output))
    run(files, output, WORKERS)
    again = len(pieces(output)) - told
    # Every worker had begun one that it told nobody of.
    lost = again - (total - told - WORKERS)
    different = differing(folder / f"workers-{WORKERS}", output, len(files))
    more = {"killed_after": told, "of": total}
    return {
        "movies/batch-kill/lost": LOST_BAR.entry(max(lost, 0), **more),
        "movies/batch-kill/different": DIFFERENT_BAR.entry(different, **more),
    }


def differing(one: Path, other: Path, timepoints: int) -> int:
    """How many arrays of two movies are not the same to the last bit."""
    folders = [MovieFolder(output / MOVIE) for output in (one, other)]
    spaces = [load_project(folder.common_path) for folder in folders]
    count = sum(different(getattr(spaces[0], c), getattr(spaces[1], c)) for c in CHARTS)
    for timepoint in range(timepoints):
        count += different(*(folder.mask(timepoint) for folder in folders))
        count += different(*(folder.frame(timepoint) for folder in folders))
    return count


def different(one: Any, other: Any) -> int:
    """How many arrays, numbers and words differ in two things of the same kind."""
    if isinstance(one, np.ndarray):
        nan = one.dtype.kind == "f"
        return int(one.dtype != other.dtype or not np.array_equal(one, other, equal_nan=nan))
    if isinstance(one, Mapping):
        missing = len(set(one) ^ set(other))
        return missing + sum(different(one[name], other[name]) for name in set(one) & set(other))
    if isinstance(one, list | tuple):
        return abs(len(one) - len(other)) + sum(map(different, one, other))
    if dataclasses.is_dataclass(one):
        names = [each.name for each in dataclasses.fields(one)]
        return sum(different(getattr(one, name), getattr(other, name)) for name in names)
    return int(not (one == other or (one != one and other != other)))


def told_run(output: str, *files: str) -> None:
    """A run that prints how far it is, to be killed."""
    run(list(files), Path(output), WORKERS, progress=lambda stage, f, m: print(f, flush=True))


# Memory ------------------------------------------------------------------------------


def moving_ball(timepoint: int, size: int = 34) -> np.ndarray:
    """A ball with a bump that goes around it."""
    grid = np.stack(np.indices((size,) * 3), axis=-1) - (size - 1) / 2
    angle = 2 * np.pi * timepoint / FRAMES[0]
    bump = 9 * np.array([0, np.sin(angle), np.cos(angle)])
    return (np.linalg.norm(grid, axis=-1) < 10) | (np.linalg.norm(grid - bump, axis=-1) < 4)


def memory(folder: Path) -> Entries:
    """The largest memory of a worker over many frames, over that over few."""
    peaks = {}
    for count in FRAMES:
        files = folder / f"tiny-{count}"
        files.mkdir()
        for timepoint in range(count):
            sizes = dict.fromkeys("zyx", VOXEL_UM)
            write_image(files / f"t{timepoint}.tif", moving_ball(timepoint), sizes=sizes)
        result = run_batch(
            [files],
            unwrap3d.Parameters.from_dict(TINY),
            folder / f"memory-{count}",
            reading=Reading(mask=True, time_step=1.0),
            timelapse=True,
            workers=1,
            threads=1,
        )
        peaks[count] = max(row.peak_memory_gb for row in result.rows)
    ratio = peaks[FRAMES[1]] / peaks[FRAMES[0]]
    more = {f"peak_{count}_gb": peak for count, peak in peaks.items()}
    return {"movies/batch-memory/200-frames": MEMORY_BAR.entry(ratio, **more)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--timepoints", type=int, default=TIMEPOINTS)
    parser.add_argument("--run", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    if options.run:
        told_run(*options.run)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = write_movie(folder / MOVIE, options.seed, options.timepoints)
        entries = two_workers(files, folder)
        entries |= killed_and_resumed(files, folder)
        entries |= memory(folder)
    if (options.seed, options.timepoints) == (SEED, TIMEPOINTS):
        results.merge(entries)
    results.show(entries)


if __name__ == "__main__":
    main()
