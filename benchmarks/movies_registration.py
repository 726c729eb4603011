"""How exactly drift and rotation are found, and the shift between two channels.

    .venv/bin/python benchmarks/movies_registration.py
    .venv/bin/python benchmarks/movies_registration.py --seeds 10 --timepoints 8  # to try something

Simulated cells drift by up to five voxels along each axis and turn by up to three degrees while
blebs, filopodia or ruffles come and go, the dye bleaches by 30 %, and the microscope blurs and adds
noise. The error of a timepoint is how far the body's middle is from where it belongs
(registration-middle) and the angle by which the cell is turned too far (registration-angle); and,
of both together, the largest displacement of any point of the body (registration-rigid). A voxel
is one of the working grid. What limits the angle is told in docs/method.md: with the true places of
the blebs left out, noise alone puts the worst timepoint of a movie beyond a tenth of a degree.
Between the channels, the second one is recorded off its place by a known shift.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from typing import Any

import numpy as np
from common import results
from common.children import options_of, run_child
from common.results import Bar, Entries

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import Volume
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging.register import register, register_channel
from napari_unwrap3d.parameters import RegistrationParameters
from napari_unwrap3d.progress import silent

KINDS = ("blebs", "filopodia", "ruffles")
SEEDS = (0, 1, 2)
TIMEPOINTS = 20
SIZE, VOXEL_UM, PLANES_UM = 150, 0.104, 0.3
DRIFT_VOXELS, ROTATION_DEG = 5.0, 3.0
BETWEEN_CHANNELS_VOXELS = np.array([1.7, -0.8, 2.3])
BODY_POINTS = 2000
LIMIT_S = 1800.0

SHIFT_BAR = Bar(0.1, "voxel")
ANGLE_BAR = Bar(0.1, "°")
TIME_BAR = Bar(1.5, "CPU s per timepoint")


def simulated(kind: str, seed: int, timepoints: int, rotation_deg: float) -> Any:
    """A cell that moves, with everything that a microscope adds."""
    return unwrap3d.simulate.movie(
        kind,
        seed,
        timepoints=timepoints,
        size=SIZE,
        voxel_size=(PLANES_UM, VOXEL_UM, VOXEL_UM),
        working_voxel_um=VOXEL_UM,
        drift_um=DRIFT_VOXELS * VOXEL_UM,
        rotation_deg=rotation_deg,
    )


def drift(kind: str, seed: int, timepoints: int, method: str) -> dict[str, list[float]]:
    """Errors and CPU seconds of every timepoint but the first."""
    movie = simulated(kind, seed, timepoints, ROTATION_DEG if method == "rigid" else 0.0)
    body = movie.body_points(BODY_POINTS)
    size = movie.recording.voxel_size
    chosen = RegistrationParameters(method=method)
    first = Volume(movie.frame(0)[0], size)
    # Compiled once, not timed.
    register(first, first, chosen, silent())
    parts = ("voxels", "middle", "degrees", "seconds", "residual")
    found: dict[str, list[float]] = {part: [] for part in parts}
    for t in range(1, timepoints):
        this = Volume(movie.frame(t)[0], size)
        start = time.process_time()
        pose, numbers = register(first, this, chosen, silent())
        found["seconds"].append(time.process_time() - start)
        wrong = pose.apply(body.at(t)) - body.at(0)
        found["voxels"].append(float(np.linalg.norm(wrong, axis=1).max()) / VOXEL_UM)
        found["middle"].append(float(np.linalg.norm(wrong.mean(axis=0))) / VOXEL_UM)
        found["degrees"].append((pose @ movie.poses[t]).angle_deg)
        found["residual"].append(numbers["residual"])
    return found


def channels(seed: int) -> float:
    """Error in voxels of the shift between the channels of the first timepoint."""
    movie = simulated("blebs", seed, 2, 0.0)
    shift = BETWEEN_CHANNELS_VOXELS * VOXEL_UM
    aside = tuple(Rigid(translation=shift) @ pose for pose in movie.poses)
    other = dataclasses.replace(movie, poses=aside).frame(0)[1]
    size = movie.recording.voxel_size
    pose, _ = register_channel(
        Volume(movie.frame(0)[0], size), Volume(other, size), RegistrationParameters(), silent()
    )
    return float(np.linalg.norm(pose.translation + shift)) / VOXEL_UM


def measure(kind: str, seed: int, timepoints: int) -> dict[str, Any]:
    """Everything of one seed; translation alone, and channels, of blebbing cells only."""
    found: dict[str, Any] = {"rigid": drift(kind, seed, timepoints, "rigid")}
    if kind == "blebs":
        found["translation"] = drift(kind, seed, timepoints, "translation")
        found["channels"] = channels(seed)
    return found


def entries_of(kind: str, seed: int, found: Any) -> Entries:
    """An entry for the worst of all timepoints, with the median beside it."""
    case = f"{kind}-{seed}"
    if isinstance(found, str):
        return {f"movies/registration/{case}": SHIFT_BAR.entry(None, note=found)}
    entries: Entries = {}
    for method in ("rigid", "translation"):
        if method in found:
            rows = found[method]
            entries[f"movies/registration-{method}/{case}"] = _worst(SHIFT_BAR, rows["voxels"])
    rigid = found["rigid"]
    entries[f"movies/registration-middle/{case}"] = _worst(SHIFT_BAR, rigid["middle"])
    entries[f"movies/registration-angle/{case}"] = _worst(ANGLE_BAR, rigid["degrees"])
    if "channels" in found:
        entries[f"movies/registration-channels/{case}"] = SHIFT_BAR.entry(found["channels"])
    entries[f"movies/time-registration/{case}"] = TIME_BAR.entry(
        float(np.median(rigid["seconds"])),
        slowest_s=results.significant(max(rigid["seconds"]), 3),
    )
    return entries


def _worst(bar: Bar, values: list[float]) -> dict[str, Any]:
    return bar.entry(
        max(values),
        median=results.significant(float(np.median(values)), 3),
        timepoints=len(values),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--timepoints", type=int, default=TIMEPOINTS)
    options = options_of(parser, lambda kind, *given: measure(kind, *(int(n) for n in given)), 3)
    scored = tuple(options.seeds) == SEEDS and options.timepoints == TIMEPOINTS
    for kind in options.kinds:
        for seed in options.seeds:
            given = kind, str(seed), str(options.timepoints)
            entries = entries_of(kind, seed, run_child(__file__, *given, limit_s=LIMIT_S))
            results.show(entries)
            if scored:
                results.merge(entries)


if __name__ == "__main__":
    main()
