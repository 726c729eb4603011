"""The paper's protrusions by topography: time and memory, and the same wherever the axis is.

    .venv/bin/python benchmarks/protrusions_topography.py

CPU seconds and peak memory of all steps, from a bleb cell's charts at 1024 × 512 to labels
and volumes, in a child that is held to one core and one thread. Then cells whose axis is put
through the tip of a protrusion, with the seam somewhere else, too: the smaller of the adjusted
Rand indices of their vertices' and voxels' labels. How right the labels are is measured in
protrusions_accuracy.py for both methods.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.cases import FULL, HALF, simulated
from common.children import run_child
from common.results import Bar, Entries
from core_speed import parameters, tiny_cell
from sklearn.metrics import adjusted_rand_score

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions.segment import Segmentation
from napari_unwrap3d.protrusions.topographic.method import by_topography

LIMIT_S = 600.0
TIME_BAR = Bar(20.0, "CPU s")
MEMORY_BAR = Bar(2.0, "GB")
AXIS_BAR = Bar(0.95, "adjusted Rand index", at_least=True)
AXIS_KINDS = ("blebs", "lamellipodia", "filopodia")
WARM_UP_ROWS = 32
ROLL_DEGREES = 70.0


def segmented(atlas: unwrap3d.Atlas) -> Segmentation:
    """By topography, whatever the atlas was asked for."""
    charts = (atlas.mask, atlas.surface, atlas.uv, atlas.topography)
    return by_topography(*charts, atlas.parameters, silent())


def run_once(atlas_file: str) -> dict[str, Any]:
    """CPU seconds, wall seconds and peak memory (GB), the charts in memory included."""
    segmented(unwrap3d.unwrap(tiny_cell(), parameters(WARM_UP_ROWS)))
    atlas = unwrap3d.load(atlas_file)
    _ = atlas.topography
    wall, cpu = time.perf_counter(), time.process_time()
    found = segmented(atlas)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    # Linux counts ru_maxrss in KiB, macOS in bytes.
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    instances = int(found.labels.max(initial=0))
    return {"cpu_s": cpu, "wall_s": wall, "peak_gb": peak / 1e9, "instances": instances}


def time_and_memory() -> Entries:
    """The entries of one bleb cell."""
    case = f"blebs-{2 * FULL}x{FULL}"
    time_name, memory_name = (
        f"protrusions/topography/{what}/{case}" for what in ("time", "memory")
    )
    core = sorted(os.sched_getaffinity(0))[-1]
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "blebs.unwrap3d")
        unwrap3d.unwrap(simulated("blebs", 0).truth.mask, parameters(FULL)).save(file)
        found = run_child(__file__, file, limit_s=LIMIT_S, core=core)
    if isinstance(found, str):
        return {
            time_name: TIME_BAR.entry(None, note=found),
            memory_name: MEMORY_BAR.entry(None, note=found),
        }
    more = {"wall_s": results.significant(found["wall_s"], 3), "instances": found["instances"]}
    return {
        time_name: TIME_BAR.entry(found["cpu_s"], **more),
        memory_name: MEMORY_BAR.entry(found["peak_gb"]),
    }


def axis(kind: str) -> Entries:
    """One cell as it is, and with the north pole under the tip of its highest protrusion."""
    atlas = unwrap3d.unwrap(simulated(kind, 0).truth.mask, parameters(HALF))
    before = segmented(atlas)
    tip = atlas.surface.vertices[np.argmax(before.height_um)]
    north = tuple(map(float, tip - atlas.reference.vertices.mean(axis=0)))
    change = {"axis_zyx": north, "axis_roll_degrees": ROLL_DEGREES}
    uv = atlas.parameters.uv.model_copy(update=change)
    turned = atlas.parameters.model_copy(update={"uv": uv})
    after = segmented(Pipeline.resumed(atlas).run(turned))
    cell = atlas.mask.data
    surface = adjusted_rand_score(before.labels, after.labels)
    volume = adjusted_rand_score(before.volume[cell], after.volume[cell])
    entry = AXIS_BAR.entry(
        min(surface, volume),
        surface=results.significant(surface),
        volume=results.significant(volume),
        instances=int(before.labels.max(initial=0)),
        kind=before.numbers["kind"],
    )
    return {f"protrusions/topography/axis/{kind}-0": entry}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        file, answer = options.child
        Path(answer).write_text(json.dumps(run_once(file)), "utf-8")
        return
    for measure in (time_and_memory, *(lambda kind=kind: axis(kind) for kind in AXIS_KINDS)):
        entries = measure()
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
