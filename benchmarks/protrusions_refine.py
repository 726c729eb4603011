"""Blebs that touch above their necks under one label: are they told apart, and only they?

    .venv/bin/python benchmarks/protrusions_refine.py

Bodies with pairs of blebs at all overlaps and with single blebs (common/touching.py), and the
blebs of the simulated cells, none of which touch. The labels are the true ones, those of a pair
made one. A pair is split when it has two parts that match its two blebs with IoU ≥ 0.5 each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from common import results
from common.cases import SEEDS, simulated
from common.on_surface import labels_at_vertices
from common.results import Bar
from common.touching import touching_cell

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.parameters import RefinementParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions.refine import refine

PAIRS = Bar(0.9, "part of the pairs split", at_least=True)
SINGLES = Bar(0.95, "part of the blebs left whole", at_least=True)
LEAST_IOU = 0.5


def refined(mask: unwrap3d.Mask, surface: unwrap3d.Surface, labels: Any) -> Any:
    return refine(surface, labels, mask.voxel_size[0], RefinementParameters(), silent())


def is_split(parts: Any, truth: Any, first: int, mass: Any) -> bool:
    """Whether a pair's two blebs, `first` and the next, are two parts that match them."""
    pair = (truth == first) | (truth == first + 1)
    names = np.unique(parts[pair])
    if len(names) != 2:
        return False
    table = [[_iou(parts == k, truth == t, mass) for t in (first, first + 1)] for k in names]
    straight, crossed = (table[0][0], table[1][1]), (table[0][1], table[1][0])
    return max(min(straight), min(crossed)) >= LEAST_IOU


def _iou(one: Any, other: Any, mass: Any) -> float:
    return float(mass[one & other].sum() / mass[one | other].sum())


def touching(seed: int) -> tuple[list[bool], list[bool]]:
    """Which pairs are split, and which single blebs stay whole, on one cell."""
    cell = touching_cell(seed)
    surface = unwrap3d.Pipeline(cell.mask).run(until="surface").surface
    truth = labels_at_vertices(cell.mask, cell.labels, surface)
    start = cell.united(truth)
    parts = refined(cell.mask, surface, start)
    mass = vertex_mass(surface.vertices, surface.faces)
    pairs = [is_split(parts, truth, 2 * p + 1, mass) for p in range(cell.pairs)]
    return pairs, _whole(parts, start, cell.pairs)


def apart(seed: int) -> list[bool]:
    """Which blebs of a simulated cell stay whole."""
    cell = simulated("blebs", seed)
    surface = unwrap3d.Pipeline(cell.truth.mask).run(until="surface").surface
    start = labels_at_vertices(cell.truth.mask, cell.truth.labels.data, surface)
    return _whole(refined(cell.truth.mask, surface, start), start, 0)


def _whole(parts: Any, start: Any, after: int) -> list[bool]:
    names = np.unique(start[start > after])
    return [len(np.unique(parts[start == name])) == 1 for name in names]


def main() -> None:
    pairs: list[bool] = []
    singles: list[bool] = []
    for seed in SEEDS:
        split, whole = touching(seed)
        pairs += split
        singles += whole + apart(seed)
    entries = {
        "protrusions/refine/pairs": PAIRS.entry(float(np.mean(pairs)), pairs=len(pairs)),
        "protrusions/refine/singles": SINGLES.entry(float(np.mean(singles)), blebs=len(singles)),
    }
    results.show(entries)
    results.merge(entries)


if __name__ == "__main__":
    main()
