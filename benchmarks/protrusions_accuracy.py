"""Segmented protrusions against the truth of simulated cells.

    .venv/bin/python benchmarks/protrusions_accuracy.py                       # everything
    .venv/bin/python benchmarks/protrusions_accuracy.py --kinds blebs --seeds 0 --clean
    .venv/bin/python benchmarks/protrusions_accuracy.py --method topography

Clean: the true mask is given. Noisy: the recorded stack, segmented with the threshold at the
steepest place of the outline (``stack.threshold = edge``), or another (``--imaging otsu``).
The error of the volume that the mask alone has, whoever's its voxels are, is ``of_imaging``.
Then: a rotated cell, protrusions nearly as thick as the body with several radii of the ball,
and time and memory of a bleb cell on one core.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
from common import results
from common.cases import SEEDS, simulated
from common.children import run_child
from common.protrusion_truth import Comparison, compare, shell
from common.results import Bar, Entries
from core_speed import tiny_cell
from scipy import ndimage
from scipy.spatial import KDTree

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.imaging.segment import segment
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions.segment import find_protrusions

KINDS = ("blebs", "lamellipodia", "filopodia")
F1_CLEAN = {"blebs": 0.98, "lamellipodia": 0.98, "filopodia": 0.95}
F1_NOISY = {"blebs": 0.95, "lamellipodia": 0.95, "filopodia": 0.90}
ALIKE = Bar(0.95, "adjusted Rand index", at_least=True)
THICK_RADII = (0.3, 0.45, 0.6, 0.8)
THICK_SEEDS = (0, 1, 2)
LIMIT_S = 1200.0
CPU = {"cortex": Bar(10.0, "CPU s"), "topography": Bar(20.0, "CPU s")}
MEMORY = Bar(2.0, "GB")
ROWS = 512  # of the uv image that the paper's method needs


# What is measured -----------------------------------------------------------------


def found_in(
    mask: unwrap3d.Mask, method: str, parameters: dict[str, Any] | None = None
) -> tuple[Any, unwrap3d.Mask, Any, float]:
    """The protrusions of a mask by a method, the mask and surface they are of, CPU seconds."""
    chosen = unwrap3d.Parameters.from_dict(
        {"uv": {"rows": ROWS}, "protrusions": {"method": method, **(parameters or {})}}
    )
    until = "surface" if method == "cortex" else "topography"
    atlas = unwrap3d.Pipeline(mask).run(chosen, until=until)
    start = time.process_time()
    found = find_protrusions(partial(getattr, atlas), chosen, silent())
    return found, atlas.mask, atlas.surface, time.process_time() - start


def recorded(cell: Any, threshold: str) -> unwrap3d.Mask:
    """The cell as it is segmented from its recording."""
    parameters = unwrap3d.Parameters.from_dict({"stack": {"threshold": threshold}})
    return segment(cell.stack, parameters.stack)[0]


def measure(kind: str, seed: int, noisy: bool, method: str, imaging: str) -> Entries:
    """All entries of one cell."""
    cell = simulated(kind, seed)
    mask = recorded(cell, imaging) if noisy else cell.truth.mask
    found, mask, surface, seconds = found_in(mask, method)
    against = compare(found, mask, surface, cell.truth)
    parts = int((found.volume > 0).sum()) + int(found.cortex.sum())
    whole = int(mask.data.sum())
    numbers = found.numbers
    entries = accuracy(against, kind, noisy)
    entries["f1"] |= {"kind": str(numbers.get("kind", "")), "cpu_s": round(seconds, 2)}
    entries["whole"] = Bar(0.005, "of the cell's volume").entry(abs(parts / whole - 1))
    before = "protrusions" if method == "cortex" else f"protrusions/{method}"
    suffix = "" if not noisy else "-noisy" if imaging == "edge" else f"-noisy-{imaging}"
    return {f"{before}/{name}{suffix}/{kind}-{seed}": item for name, item in entries.items()}


def accuracy(against: Comparison, kind: str, noisy: bool) -> Entries:
    """Entries of the bars, whatever the case."""
    median = Bar(0.10 if noisy else 0.03, "median relative error")
    bias = Bar(0.05 if noisy else 0.02, "mean relative error, absolute")
    f1 = Bar((F1_NOISY if noisy else F1_CLEAN)[kind], "F1 at IoU ½", at_least=True)
    iou = Bar(0.88 if noisy else 0.95, "IoU of areas", at_least=True)
    cortex = Bar(0.8 if noisy else 0.3, "voxels, mean")
    entries = {
        "iou": iou.entry(against.iou),
        "f1": f1.entry(against.f1, found=against.found, true=against.true),
        "cortex": cortex.entry(against.cortex, under=results.significant(against.under, 3)),
    }
    for name in ("volume", "area", "height"):
        error = getattr(against, name)
        more = {}
        if name == "volume" and noisy and len(error):
            more = {"of_imaging": results.significant(float(np.median(np.abs(against.imaging))), 3)}
            bias_more = {"of_imaging": results.significant(float(against.imaging.mean()), 3)}
        else:
            bias_more = {}
        some = bool(len(error))
        middle = float(np.median(np.abs(error))) if some else None
        mean = float(error.mean()) if some else None
        entries[name] = median.entry(middle, **more)
        signed = {} if mean is None else {"signed": results.significant(mean, 3)}
        entries[f"{name}-bias"] = bias.entry(
            None if mean is None else abs(mean), **signed, **bias_more
        )
    return entries


# The same cell, turned --------------------------------------------------------------


def turned(kind: str, seed: int, method: str) -> Entries:
    """Labels of a cell against those of the same cell, turned, on its outermost voxels."""
    from scipy.spatial.transform import Rotation

    mask = simulated(kind, seed).truth.mask
    first, mask, _, _ = found_in(mask, method)
    outermost = shell(mask.data)
    before = first.volume[tuple(outermost.T)]
    entries = {}
    for name, turn in {
        "90": Rotation.from_euler("x", 90, degrees=True),
        "oblique": Rotation.from_rotvec(np.deg2rad(37.0) * np.array([0.6, 0.48, 0.64])),
    }.items():
        there, matrix, middle, centre = _turned_mask(mask, turn.as_matrix())
        second, _, _, _ = _on_its_grid(there, method)
        places = (outermost - middle) @ matrix.T + centre
        shells = shell(there.data)
        _, nearest = KDTree(shells).query(places)
        after = second[tuple(shells[nearest].T)]
        key = f"protrusions/turned-{name}/{kind}-{seed}"
        entries[key] = ALIKE.entry(rand_index(before, after))
    return entries


def _on_its_grid(mask: unwrap3d.Mask, method: str) -> tuple[Any, Any, Any, Any]:
    """The labels on the given mask's own grid (the pipeline may crop it)."""
    found, used, surface, seconds = found_in(mask, method)
    labels = np.zeros(mask.shape, np.int32)
    inside = np.argwhere(found.volume > 0)
    place = np.rint(mask.to_index(used.to_world(inside))).astype(np.int64)
    labels[tuple(place.T)] = found.volume[tuple(inside.T)]
    return labels, used, surface, seconds


def _turned_mask(
    mask: unwrap3d.Mask, matrix: npt.NDArray[np.float64]
) -> tuple[unwrap3d.Mask, npt.NDArray[np.float64], Any, Any]:
    """A mask turned about its middle, on a grid that it fits into."""
    from napari_unwrap3d.geometry.distance import signed_distance

    edge = int(np.ceil(np.linalg.norm(mask.shape))) + 4
    middle = (np.array(mask.shape) - 1) / 2
    # A quarter turn of voxels falls on voxels.
    centre = np.full(3, (edge - 1) // 2) + np.round(matrix @ middle, 9) % 1.0
    level = signed_distance(mask.data)
    offset = middle - matrix.T @ centre
    level = ndimage.affine_transform(
        level, matrix.T, offset, (edge,) * 3, order=1, mode="constant", cval=1e3
    )
    return unwrap3d.Mask(level < 0, mask.voxel_size), matrix, middle, centre


def rand_index(one: npt.NDArray[Any], other: npt.NDArray[Any]) -> float:
    """Adjusted Rand index of two labellings."""
    from sklearn.metrics import adjusted_rand_score

    return float(adjusted_rand_score(one, other))


# Protrusions nearly as thick as the body ---------------------------------------------


def thick_cell(seed: int) -> Any:
    """A body with blebs of half to nine tenths of its smallest half-axis, as a truth."""
    from napari_unwrap3d.geometry.spread import spread_directions
    from napari_unwrap3d.simulate.bodies import draw_body
    from napari_unwrap3d.simulate.protrusions import bleb
    from napari_unwrap3d.simulate.solids import build

    rng = np.random.default_rng([seed, 77])
    voxel, size = 0.104, 200
    body = draw_body(rng, np.full(3, size / 2 * voxel), 45 * voxel)
    least = float(body.semi_axes.min())
    shapes = []
    for direction in spread_directions(4):
        radius = least * rng.uniform(0.5, 0.9)
        shapes.append(
            bleb(body, direction, radius, 0.75 * radius, np.zeros(3), 0.2 * radius, 0.2 * radius)
        )
    solids = build(body, shapes, [], size, voxel)
    voxels = (voxel,) * 3
    return SimpleNamespace(
        mask=unwrap3d.Mask(solids.mask, voxels),
        body=unwrap3d.Mask(solids.body, voxels),
        labels=SimpleNamespace(data=solids.labels),
        kinds=("bleb",) * len(shapes),
        heights_um=np.ones(len(shapes)),
    )


def thick() -> Entries:
    """F1 and IoU where protrusions are nearly as thick as the body, by the ball's radius."""
    entries = {}
    for seed in THICK_SEEDS:
        truth = thick_cell(seed)
        for radius in THICK_RADII:
            found, mask, surface, _ = found_in(truth.mask, "cortex", {"radius": radius})
            against = compare(found, mask, surface, truth)
            bar = Bar(0.0, "F1 at IoU ½ (no bar)", at_least=True)
            more = {"iou": results.significant(against.iou, 3), "found": against.found}
            name = f"protrusions/thick-radius-{radius}/blebs-{seed}"
            entries[name] = bar.entry(against.f1, true=against.true, **more)
    return entries


# Time and memory -----------------------------------------------------------------------


def run_once(mask_file: str, method: str) -> dict[str, float]:
    """CPU seconds and peak memory (GB) of segmenting one cell in this process."""
    with np.load(mask_file) as saved:
        mask = unwrap3d.Mask(saved["mask"], tuple(saved["voxel_size"]))
    found_in(tiny_cell(), method)
    _, _, _, seconds = found_in(mask, method)
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return {"cpu_s": seconds, "peak_gb": peak / 1e9}


def speed(method: str) -> Entries:
    """Entries of time and memory, on one core."""
    mask = simulated("blebs", 0).truth.mask
    core = sorted(os.sched_getaffinity(0))[-1]
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "mask.npz")
        np.savez(file, mask=mask.data, voxel_size=mask.voxel_size)
        found = run_child(__file__, file, method, limit_s=LIMIT_S, core=core)
    time_name = f"protrusions/time-{method}/blebs-0"
    memory_name = f"protrusions/memory-{method}/blebs-0"
    if isinstance(found, str):
        failed = CPU[method].entry(None, note=found)
        return {time_name: failed, memory_name: MEMORY.entry(None, note=found)}
    return {
        time_name: CPU[method].entry(found["cpu_s"]),
        memory_name: MEMORY.entry(found["peak_gb"]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", choices=tuple(CPU), default="cortex")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    parser.add_argument("--imaging", choices=("edge", "otsu"), default="edge")
    parser.add_argument("--clean", action="store_true", help="only the true masks")
    parser.add_argument("--noisy", action="store_true", help="only the recordings")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        mask_file, method, answer = options.child
        Path(answer).write_text(json.dumps(run_once(mask_file, method)), "utf-8")
        return
    which = [True] if options.noisy else [False] if options.clean else [False, True]
    for kind in options.kinds:
        for seed in options.seeds:
            for noisy in which:
                keep(measure(kind, seed, noisy, options.method, options.imaging))
    if options.clean or options.noisy:
        return
    for kind in options.kinds:
        keep(turned(kind, 0, options.method))
    if options.method == "cortex":
        keep(thick())
    keep(speed(options.method))


def keep(entries: Entries) -> None:
    """Print entries and write them into the file of results."""
    results.show(entries)
    results.merge(entries)


if __name__ == "__main__":
    main()
