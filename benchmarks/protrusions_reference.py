"""The opened cell as the reference, against the flow's and against the simulated body.

    .venv/bin/python benchmarks/protrusions_reference.py [--method cortex]

How far each reference lies from the body without protrusions, what it swallows of them, and
what that costs in distortion and folds. The cell is unwrapped at 512×256 from the true mask.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from common import results
from common.cases import SEEDS, simulated
from common.children import options_of, run_child
from common.results import Bar, Entries
from core_closeness import body_distance

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.geometry.voxelize import voxelize

LIMIT_S = 1200.0
KINDS = ("blebs", "lamellipodia", "filopodia")
METHODS = ("flow", "cortex", "second_cortex")
# The paper's flow is measured for comparison and has no bar here.
DISTANCE = Bar(0.3, "voxels from the true body (mean)")
FOLDED = Bar(0.0, "of cells would fold")


def run_cell(kind: str, seed: int, method: str) -> dict[str, Any]:
    """The numbers of one cell with one kind of reference."""
    truth = simulated(kind, seed).truth
    chosen = unwrap3d.Parameters.from_dict({"reference": {"method": method}, "uv": {"rows": 256}})
    atlas = unwrap3d.unwrap(truth.mask, chosen)
    reference, body = atlas.reference, truth.body
    distance = body_distance(body, reference.vertices)
    mass = vertex_mass(reference.vertices, reference.faces)
    inside = voxelize(body.to_index(reference.vertices), reference.faces, body.data.shape)
    protrusions = truth.labels.data > 0
    sphere, topography = atlas.quality["sphere"], atlas.quality["topography"]
    return {
        "seed": seed,
        "distance_voxels": float(mass @ np.abs(distance) / mass.sum()),
        "offset_voxels": float(mass @ distance / mass.sum()),
        "distance_p95_voxels": float(np.percentile(np.abs(distance), 95)),
        "swallowed": float((inside & protrusions).sum() / protrusions.sum()),
        "volume_percent": 100.0 * (float(inside.sum()) / float(body.data.sum()) - 1.0),
        "mean_q": sphere["conformal_mean_q"],
        "mean_abs_log_lambda": sphere["mean_abs_log_lambda"],
        "folded": topography["folded_fraction"],
        "unmapped": topography["unmapped_fraction"],
        "chamfer_voxels": topography["chamfer_voxels"],
        "area_difference": topography["area_difference"],
        "volume_difference": topography["volume_difference"],
    }


def entries_of(kind: str, method: str, found: list[Any]) -> Entries:
    """The worst cell of a kind against the bars, and all of them in the entry."""
    name = f"protrusions/reference/{method}/{kind}"
    failed = [item for item in found if isinstance(item, str)]
    if failed:
        return {name: DISTANCE.entry(None, note="; ".join(failed))}
    cells = [{key: results.significant(item, 4) for key, item in cell.items()} for cell in found]
    return {
        name: DISTANCE.entry(max(cell["distance_voxels"] for cell in cells), cells=cells),
        f"{name}/folded": FOLDED.entry(max(cell["folded"] for cell in cells)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", choices=METHODS, action="append")
    options = options_of(parser, lambda kind, seed, method: run_cell(kind, int(seed), method), 3)
    for method in options.method or METHODS:
        for kind in KINDS:
            found = [
                run_child(__file__, kind, str(seed), method, limit_s=LIMIT_S) for seed in SEEDS
            ]
            entries = entries_of(kind, method, found)
            results.show(entries)
            results.merge(entries)


if __name__ == "__main__":
    main()
