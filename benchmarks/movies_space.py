"""A movie in its common space: do places keep their (u, v), and what does a frame take.

    .venv/bin/python benchmarks/movies_space.py
    .venv/bin/python benchmarks/movies_space.py --seeds 10 --timepoints 12   # to try something

Simulated blebbing cells drift, turn and bleach; the whole chain is run on what the microscope
recorded. Points that are fixed in the cell's body are followed in two ways: as places in the
cell, which shows the registration alone, and as places on every frame's own surface, where no
protrusion covers them, which adds the segmentation and the mesh. The movement is the angle to
the median direction over the movie, in pixels of the equator.

Memory is that of a process that unwraps 200 frames, over that of one with 20.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.children import options_of, run_child
from common.results import Bar, Entries

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.locate import SurfaceLocator, interpolate
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.unwrapping.uv import uv_to_direction

SEEDS = (0, 1, 2)
TIMEPOINTS = 30
VOXEL_UM = 0.104
SIZE = 150
ROWS = 256
BODY_POINTS = 2000
WITHIN_PIXELS = 1.0
LIMIT_S = 3600.0

FIXED_BAR = Bar(0.99, "of the body points within 1 pixel", at_least=True)
TIME_BAR = Bar(4.0, "CPU s")
MEMORY_BAR = Bar(1.3, "× the memory of 20 frames")
# Drift of five voxels and three degrees, as for the registration.
DRIFT_VOXELS, ROTATION_DEG = 5.0, 3.0
SMALL = 88


def simulated(seed: int, timepoints: int, size: int = SIZE) -> Any:
    """A blebbing cell with everything that a microscope adds."""
    voxel = VOXEL_UM
    return unwrap3d.simulate.movie(
        "blebs",
        seed,
        timepoints=timepoints,
        size=size,
        voxel_size=(0.3, voxel, voxel),
        working_voxel_um=voxel,
        drift_um=DRIFT_VOXELS * voxel,
        rotation_deg=ROTATION_DEG,
    )


def parameters(rows: int = ROWS) -> unwrap3d.Parameters:
    """The defaults on the grid of the bars, with rotation."""
    return unwrap3d.Parameters.from_dict(
        {
            "uv": {"rows": rows},
            "registration": {"method": "rigid"},
            "stack": {"threshold": "edge"},
        }
    )


def on_disk(movie: Any, folder: Path) -> unwrap3d.Stack:
    """The stack in a file, read by the timepoint: making it is not part of what is measured."""
    file = folder / "stack.npy"
    shape = (len(movie), *movie.frame_shape)
    data = np.lib.format.open_memmap(file, "w+", np.uint16, shape)
    for t in range(len(movie)):
        data[t] = movie.frame(t)
    data.flush()
    return dataclasses.replace(movie.stack, data=np.load(file, mmap_mode="r"))


def directions(movie: Any, film: unwrap3d.Movie, count: int) -> dict[str, np.ndarray]:
    """Where body points lie on the sphere at every timepoint, in two ways; NaN: not there."""
    body, rows = movie.body_points(count), film.common.uv.shape[0]
    work = film.work
    assert work is not None
    found = {name: np.full((len(film), count, 3), np.nan) for name in ("place", "surface")}
    for t in range(len(film)):
        frame = film.frame(t)
        points = work.registered(t).pose.apply(body.at(t))
        image = work.space.locate(points, Progress())
        found["place"][t] = uv_to_direction(image[:, 1:], rows)
        free = body.free(t)
        locator = SurfaceLocator(frame.surface.vertices, frame.surface.faces)
        face, weights, _ = locator.closest(points[free])
        on_sphere = uv_to_direction(frame.topography[:, 1:], rows)
        found["surface"][t, free] = interpolate(on_sphere, frame.surface.faces, face, weights)
    return found


def movements(directions: np.ndarray, rows: int) -> np.ndarray:
    """Largest angle (n,) of every point to its median direction, in pixels."""
    # Points that a protrusion covers at all timepoints are nowhere.
    directions = directions[:, np.isfinite(directions).all(axis=2).any(axis=0)]
    middle = np.nanmedian(directions, axis=0)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    length = np.linalg.norm(directions, axis=2)
    cosine = np.einsum("tni,ni->tn", directions, middle) / length
    angle = np.arccos(np.clip(cosine, -1, 1))
    return angle * rows / np.pi


def measure(seed: int, timepoints: int) -> Entries:
    """The entries of one movie."""
    movie = simulated(seed, timepoints)
    with tempfile.TemporaryDirectory() as folder:
        film = unwrap3d.unwrap_movie(on_disk(movie, Path(folder)), parameters(), folder=folder)
        work = film.work
        assert work is not None
        frames = []
        for t in range(len(film)):
            start = time.process_time()
            film.frame(t)
            frames.append(time.process_time() - start)
        found = directions(movie, film, BODY_POINTS)
        entries: Entries = {}
        for way, where in found.items():
            moved = movements(where, ROWS)
            within = float(np.mean(moved[np.isfinite(moved)] <= WITHIN_PIXELS))
            always = float(np.mean(np.nanmax(moved, axis=0) <= WITHIN_PIXELS))
            entries[f"movies/fixed-{way}/blebs-{seed}"] = FIXED_BAR.entry(
                within,
                at_all_timepoints=results.significant(always, 4),
                median_px=results.significant(float(np.nanmedian(moved)), 3),
                worst_px=results.significant(float(np.nanmax(moved)), 3),
            )
        check = film.check_table()
        entries[f"movies/time-frame/blebs-{seed}"] = TIME_BAR.entry(
            float(np.median(frames[1:])),
            slowest_s=results.significant(max(frames[1:]), 3),
            voxels="x".join(map(str, film.frame(0).mask.shape)),
            vertices=len(film.frame(0).surface.vertices),
        )
        print(
            f"  seed {seed}: {film.record['method']}, outside at most "
            f"{check.outside_fraction.max():.2%}, empty at most {check.empty_fraction.max():.2%}"
        )
    return entries


def peak_gb(timepoints: int) -> float:
    """Peak memory of this process after a movie of small frames."""
    movie = simulated(0, timepoints, SMALL)
    with tempfile.TemporaryDirectory() as folder:
        stack = on_disk(movie, Path(folder))
        unwrap3d.unwrap_movie(stack, parameters(64), folder=folder).compute()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def memory() -> Entries:
    """Peak of 200 frames over that of 20."""
    core = max(os.sched_getaffinity(0))
    peaks = {}
    for count in (20, 200):
        found = run_child(__file__, str(count), limit_s=LIMIT_S, core=core)
        if isinstance(found, str):
            return {"movies/memory/blebs-0": MEMORY_BAR.entry(None, note=found)}
        peaks[count] = found
    more = {f"peak_{count}_gb": results.significant(peak, 3) for count, peak in peaks.items()}
    return {"movies/memory/blebs-0": MEMORY_BAR.entry(peaks[200] / peaks[20], **more)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--timepoints", type=int, default=TIMEPOINTS)
    parser.add_argument("--no-memory", action="store_true")
    options = options_of(parser, lambda count: peak_gb(int(count)), 1)
    scored = tuple(options.seeds) == SEEDS and options.timepoints == TIMEPOINTS
    for seed in options.seeds:
        entries = measure(seed, options.timepoints)
        results.show(entries)
        if scored:
            results.merge(entries)
    if not options.no_memory:
        entries = memory()
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
