"""How long it takes to track and to measure many protrusions.

    .venv/bin/python benchmarks/tracks_time.py
    .venv/bin/python benchmarks/tracks_time.py --seeds 10 --timepoints 40  # to try something

The protrusions of 200 timepoints, 100 each on a 512 × 256 image, are drawn on the frames of a
simulated movie that was unwrapped (its frames over and over): caps at places that stay, each
there for some time, and somewhat elsewhere and of another size every time. What is measured are
the CPU seconds for their tracks and all measurements of these, images read from disk.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import results
from common.results import Bar, Entries
from common.unwrapped import unwrapped
from tracks_links import spread

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import FrameProtrusions
from napari_unwrap3d.measuring.analysis import measure_tracks
from napari_unwrap3d.protrusions.columns import COLUMNS
from napari_unwrap3d.tracking.detections import CERTAIN, FOOT, protrusions_key
from napari_unwrap3d.tracking.objects import track_protrusions
from napari_unwrap3d.unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction

SEEDS = (0,)
UNWRAPPED = 50
TIMEPOINTS, BLEBS = 200, 100
PLACES = 160
CAP_RAD = 0.09
PRESENT_S, ABSENT_S = 25.0, 15.0

TIME_BAR = Bar(60.0, "CPU s")


def repeated(source: unwrap3d.Movie, timepoints: int, folder: Path) -> unwrap3d.Movie:
    """A movie whose timepoints are those of another one, over and over."""
    (folder / "frames").mkdir(parents=True)
    for name in ("common.unwrap3d", "common.json"):
        shutil.copy(source.folder.path / name, folder / name)
    manifest = json.loads((source.folder.path / "movie.json").read_text(encoding="utf-8"))
    manifest["timepoints"] = timepoints
    (folder / "movie.json").write_text(json.dumps(manifest), encoding="utf-8")
    movie = unwrap3d.load_movie(folder)
    for t in range(timepoints):
        frame = source.frame(t % len(source))
        key = f"{source.folder.frame_key(t % len(source))}-{t}"
        movie.folder.keep_frame(replace(frame, timepoint=t), key)
    return movie


def presence(rng: np.random.Generator, timepoints: int, step_s: float) -> np.ndarray:
    """Which places (timepoints, PLACES) have a protrusion; at most BLEBS at once."""
    there = np.zeros((timepoints, PLACES), bool)
    now = rng.random(PLACES) < PRESENT_S / (PRESENT_S + ABSENT_S)
    for t in range(timepoints):
        change = rng.random(PLACES) < step_s / np.where(now, PRESENT_S, ABSENT_S)
        now = now ^ change
        there[t] = now
        extra = np.flatnonzero(now)[BLEBS:]
        there[t, extra] = False
        there[t, np.flatnonzero(~now)[: max(BLEBS - int(now.sum()), 0)]] = True
    return there


def draw(movie: unwrap3d.Movie, parameters: unwrap3d.Parameters, seed: int) -> float:
    """Put protrusions on all timepoints; how many there are at one, on average."""
    rng = np.random.default_rng(seed)
    rows = movie.common.uv.shape[0]
    pixels = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows)
    there = presence(rng, len(movie), movie.time_step_s)
    middle = spread(PLACES)
    for t in range(len(movie)):
        now = middle[there[t]] + rng.normal(0, 0.01, (int(there[t].sum()), 3))
        now /= np.linalg.norm(now, axis=1, keepdims=True)
        size = CAP_RAD * rng.uniform(0.8, 1.0, len(now))
        nearness = pixels @ now.T
        nearest = nearness.argmax(axis=1)
        inside = np.arccos(np.clip(nearness.max(axis=1), -1, 1)) < size[nearest]
        image = np.where(inside, nearest + 1, 0).astype(np.int32).reshape(rows, 2 * rows)
        movie.folder.keep_protrusions(
            found(movie, t, image, now, size), protrusions_key(movie, t, parameters)
        )
    return float(there.sum(axis=1).mean())


def found(
    movie: unwrap3d.Movie, t: int, image: np.ndarray, now: np.ndarray, size: np.ndarray
) -> FrameProtrusions:
    frame = movie.frame(t)
    places = direction_to_uv(now, image.shape[0])
    feet = movie.common.map(places, "uv", "reference")[0]
    on_image = np.nan_to_num(frame.topography[:, 1:])
    v = np.clip(np.rint(on_image[:, 0]).astype(int), 0, image.shape[0] - 1)
    u = np.rint(on_image[:, 1]).astype(int) % image.shape[1]
    columns = {name: np.zeros(len(now)) for name in COLUMNS}
    columns |= {
        "label": np.arange(1, len(now) + 1),
        "motif": np.zeros(len(now), np.int8),
        "area_um2": 400 * size**2,
        "height_max_um": 10 * size,
        **dict(zip(("z_um", "y_um", "x_um"), feet.T, strict=True)),
        **dict(zip(FOOT, feet.T, strict=True)),
        **dict(zip(("v_px", "u_px"), places.T, strict=True)),
        CERTAIN: np.ones(len(now), bool),
    }
    return FrameProtrusions(t, image[v, u].astype(np.int32), image, columns)


def measure(seed: int, timepoints: int, methods: tuple[str, ...]) -> Entries:
    entries: Entries = {}
    source = unwrapped("blebs", seed, UNWRAPPED, protrusions=False).movie
    with tempfile.TemporaryDirectory() as name:
        movie = repeated(source, timepoints, Path(name) / "movie")
        for method in methods:
            parameters = unwrap3d.Parameters.from_dict(
                {
                    "uv": {"rows": movie.common.uv.shape[0]},
                    "protrusions": {"kind": "blebs", "threshold_um": 0.1},
                    "tracking": {"method": method},
                }
            )
            blebs = draw(movie, parameters, seed)
            start = time.process_time()
            tracks = track_protrusions(movie, parameters)
            tracking = time.process_time() - start
            start = time.process_time()
            measure_tracks(movie, tracks, parameters)
            measuring = time.process_time() - start
            entries[f"tracks/time-{method}/{timepoints}x{BLEBS}"] = TIME_BAR.entry(
                tracking + measuring,
                tracking_s=results.significant(tracking, 3),
                measuring_s=results.significant(measuring, 3),
                blebs=results.significant(blebs, 4),
                tracks=len(tracks.ids),
            )
    return entries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--timepoints", type=int, default=TIMEPOINTS)
    parser.add_argument("--methods", nargs="+", default=("surface",))
    options = parser.parse_args()
    for seed in options.seeds:
        entries = measure(seed, options.timepoints, tuple(options.methods))
        results.show(entries)
        if tuple(options.seeds) == SEEDS and options.timepoints == TIMEPOINTS:
            results.merge(entries)


if __name__ == "__main__":
    main()
