"""Every true protrusion of simulated cells on the disk, and cut off and capped in space.

    .venv/bin/python benchmarks/protrusions_disk.py
    .venv/bin/python benchmarks/protrusions_disk.py --only blebs-0 filopodia-2

Flips count on all protrusions of disk topology. The volumes of the paper's Cartesian baseline
stand beside the bar on what its parts add up to; they are for comparison.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from common import results
from common.cases import SEEDS, simulated, simulated_name
from common.on_surface import labels_at_vertices
from common.results import Bar, Entries

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.errors import MapError, MeshError, TooSmallError
from napari_unwrap3d.geometry.mesh import signed_volume
from napari_unwrap3d.protrusions.capping import decompose
from napari_unwrap3d.protrusions.disk import unwrap_disk

KINDS = ("blebs", "lamellipodia", "filopodia")
OTHERS = ("touching_filopodia", "handles", "mix")
CASES = [(kind, seed) for kind in KINDS for seed in SEEDS] + [(kind, 0) for kind in OTHERS]
FLIPS = Bar(0, "faces")
AREA = Bar(0.9, "part with |log λ| ≤ 0.05", at_least=True)
SUM = Bar(0.005, "relative")
LARGEST_LOG = 0.05


def measure(kind: str, seed: int) -> Entries:
    """The entries of one cell."""
    cell = simulated(kind, seed)
    mask = cell.truth.mask
    surface = unwrap3d.Pipeline(mask).run(until="surface").surface
    labels = labels_at_vertices(mask, cell.truth.labels.data, surface)
    name = simulated_name(kind, seed)
    return disks(name, surface, labels) | capped(name, surface, labels, cell.truth)


def disks(name: str, surface: unwrap3d.Surface, labels: Any) -> Entries:
    """Flips and areas of the disks."""
    flips, logs, q, refused, failed = 0, [], [], 0, 0
    start = time.process_time()
    for label in np.unique(labels[labels > 0]):
        try:
            quality = unwrap_disk(surface, labels, int(label)).quality
        except (MeshError, TooSmallError):
            refused += 1
            continue
        except MapError:
            failed += 1
            continue
        flips += quality["flips"]
        logs.append(quality["mean_abs_log_area"])
        q.append(quality["mean_q"])
    seconds = time.process_time() - start
    share = float(np.mean(np.array(logs) <= LARGEST_LOG)) if logs else None
    more: dict[str, Any] = {"disks": len(logs), "no_disks": refused, "failed": failed}
    numbers = {
        "median": results.significant(float(np.median(logs)), 3),
        "worst": results.significant(max(logs), 3),
        "median_q": results.significant(float(np.median(q)), 3),
        "cpu_s": results.significant(seconds, 3),
    }
    return {
        f"protrusions/disk/flips/{name}": FLIPS.entry(flips + failed, **more),
        f"protrusions/disk/area/{name}": AREA.entry(share, **numbers),
    }


def capped(name: str, surface: unwrap3d.Surface, labels: Any, truth: Any) -> Entries:
    """What the parts of the Cartesian baseline add up to, and their volumes against truth."""
    parts = decompose(surface, labels)
    whole = signed_volume(surface.vertices, surface.faces)
    total = sum(parts.volumes_um3.values()) + parts.cortex_um3
    voxel = float(np.prod(truth.mask.voxel_size))
    true = np.bincount(truth.labels.data.ravel()) * voxel
    errors = np.array([volume / true[k] - 1.0 for k, volume in parts.volumes_um3.items()])
    more = {
        "volume_median_error": results.significant(float(np.median(np.abs(errors))), 3),
        "volume_bias": results.significant(float(errors.mean()), 3),
        "cortex_error": results.significant(
            parts.cortex_um3 / (truth.body.data.sum() * voxel) - 1.0, 3
        ),
    }
    return {f"protrusions/capping/sum/{name}": SUM.entry(abs(total / whole - 1.0), **more)}


def main() -> None:
    names = {simulated_name(kind, seed): (kind, seed) for kind, seed in CASES}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=names, default=list(names))
    for name in parser.parse_args().only:
        entries = measure(*names[name])
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
