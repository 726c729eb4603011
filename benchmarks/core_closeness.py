"""How close the reference is to the cell's body, which is known of a simulated cell.

    .venv/bin/python benchmarks/core_closeness.py

The reference should be the cortex without protrusions: voxels of protrusions inside it are
swallowed, and neither see nor carry a height. The bars are what the authors' library swallows
of comparable cells, and how much larger than the body its references are. Every kind is measured
with the defaults; filopodia also with the preset for them, which smooths longer.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from common import measures, results
from common.cases import SEEDS, simulated
from common.children import options_of, run_child
from common.results import Bar, Entries
from scipy import ndimage

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.voxelize import voxelize

LIMIT_S = 1200.0
BARS = {
    "blebs": Bar(0.67, "of protrusion voxels inside"),
    "lamellipodia": Bar(0.44, "of protrusion voxels inside"),
    "filopodia": Bar(0.06, "of protrusion voxels inside"),
}
DEFAULTS = "defaults"
RUNS = [(kind, DEFAULTS) for kind in BARS] + [("filopodia", "filopodia")]
VOLUME = Bar(12.0, "% of the body's volume")


def run_cell(kind: str, preset: str, seed: int) -> dict[str, Any]:
    """What the reference swallows, its distance to the body's surface, and its volume."""
    truth = simulated(kind, seed).truth
    chosen = unwrap3d.Parameters() if preset == DEFAULTS else unwrap3d.Parameters.preset(preset)
    start = time.process_time()
    reference = unwrap3d.Pipeline(truth.mask).run(chosen, until="reference").reference
    seconds = time.process_time() - start
    body, protrusions = truth.body, truth.labels.data > 0
    inside = voxelize(body.to_index(reference.vertices), reference.faces, body.data.shape)
    distance = body_distance(body, reference.vertices)
    mesh = measures.trimesh_of(body.to_index(reference.vertices), reference.faces)
    return {
        "seed": seed,
        "inside": float((inside & protrusions).sum() / protrusions.sum()),
        "protrusion_fraction": float(protrusions.sum() / truth.mask.data.sum()),
        "body_outside": float((body.data & ~inside).sum() / body.data.sum()),
        "distance_voxels": float(np.abs(distance).mean()),
        "distance_p95_voxels": float(np.percentile(np.abs(distance), 95)),
        "offset_voxels": float(distance.mean()),
        "volume_percent": 100.0 * (float(mesh.volume) / float(body.data.sum()) - 1.0),
        "iteration": int(reference.iteration),
        "cpu_s": seconds,
    }


def body_distance(body: unwrap3d.Mask, points: Any) -> Any:
    """Signed distance (n,) in voxels from points to the body's surface, outward positive.

    The surface lies half a voxel from the centres of the outermost voxels.
    """
    outside = ndimage.distance_transform_edt(~body.data)
    inside = ndimage.distance_transform_edt(body.data)
    signed = np.where(body.data, 0.5 - inside, outside - 0.5)
    return ndimage.map_coordinates(signed, body.to_index(points).T, order=1, mode="nearest")


def entries_of(kind: str, preset: str, found: list[Any]) -> Entries:
    """The worst cell of a kind against the bars, and all of them in the entry."""
    name, bar = f"core/closeness/{kind}", BARS[kind]
    if preset != DEFAULTS:
        name += "-preset"
    failed = [item for item in found if isinstance(item, str)]
    if failed:
        note = "; ".join(failed)
        return {name: bar.entry(None, note=note), f"{name}-volume": VOLUME.entry(None, note=note)}
    cells = [{key: results.significant(item, 4) for key, item in cell.items()} for cell in found]
    volumes = [cell["volume_percent"] for cell in cells]
    return {
        name: bar.entry(max(cell["inside"] for cell in cells), cells=cells),
        f"{name}-volume": VOLUME.entry(max(map(abs, volumes)), signed=volumes),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, lambda kind, preset, seed: run_cell(kind, preset, int(seed)), 3)
    for kind, preset in RUNS:
        found = [run_child(__file__, kind, preset, str(seed), limit_s=LIMIT_S) for seed in SEEDS]
        entries = entries_of(kind, preset, found)
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
