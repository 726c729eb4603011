"""Which voxels over the cortex belong together: one label per protrusion.

A protrusion starts at its root, a footprint just above the cortex; what is nearer to one root
than to others, along paths through the protrusions, is that root's. Then peaks decide: roots
whose peaks hardly stand out of the saddle between them are one protrusion (an arch, two feet
of a sheet), and a region with peaks far above the saddle between them is several (blebs that
touch). All lengths here are voxels of the mask's grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.voxel_graph import (
    Floats,
    Labels,
    VoxelGraph,
    components,
    saddles,
    split_at_saddles,
    spread,
)

FOOTPRINT_LAYER = 3.0  # height over the threshold up to which a footprint reaches
FOOTPRINT_START = 1.2  # and by which it has begun
FOOTPRINT_VOXELS = 6


@dataclass(frozen=True)
class Rules:
    """How protrusions are told apart.

    Attributes
    ----------
    threshold : float
        Height over the cortex where protrusions begin.
    own : float
        A root is a protrusion of its own if its peak is by this part of its height over the
        saddle to a higher one.
    split : float
        Two peaks over one root are two protrusions if the saddle between them is lower than
        this part of the lower peak.
    least : float
        And by so many voxels in either case.
    tips_join : bool
        Whether roots that meet far above the cortex can be one protrusion at all.
    """

    threshold: float
    own: float
    split: float
    least: float
    tips_join: bool


def find_instances(graph: VoxelGraph, height: Floats, rules: Rules) -> Labels:
    """A label (n,) per voxel over the threshold, 0 where no root is below it.

    Parameters
    ----------
    graph : VoxelGraph
        Of the mask's voxels that are higher than the threshold.
    height : ndarray, (n,)
    rules : Rules
    """
    labels = spread(graph, footprints(graph, height, rules.threshold))
    labels = join(graph, labels, height, rules)
    return split_at_saddles(graph, labels, height, rules.split, rules.least)


def footprints(graph: VoxelGraph, height: Floats, threshold: float) -> Labels:
    """Connected layers just above the cortex that touch it, a label each."""
    layer = components(graph, height < threshold + FOOTPRINT_LAYER)
    size = np.bincount(layer, minlength=1)
    touching = np.bincount(layer[height < threshold + FOOTPRINT_START], minlength=len(size))
    is_root = (size >= FOOTPRINT_VOXELS) & (touching > 0)
    is_root[0] = False
    return np.where(is_root[layer], layer, 0).astype(np.int32)


def join(graph: VoxelGraph, labels: Labels, height: Floats, rules: Rules) -> Labels:
    """Regions made one where the lower peak is hardly above the saddle between them."""
    peak = np.full(int(labels.max(initial=0)) + 1, -np.inf)
    np.maximum.at(peak, labels, height)
    into = np.arange(len(peak))

    def root(label: int) -> int:
        while into[label] != label:
            label = int(into[label])
        return label

    found = saddles(graph, labels, height)
    for (one, other), level in zip(found.pairs.tolist(), found.height.tolist(), strict=True):
        a, b = root(one), root(other)
        aloft = level > rules.threshold + 2 * FOOTPRINT_LAYER
        if a == b or (aloft and not rules.tips_join):
            continue
        high, low = (a, b) if peak[a] >= peak[b] else (b, a)
        if peak[low] - level < max(rules.least, rules.own * peak[low]):
            into[low] = high
    joined = np.array([root(label) for label in range(len(into))], np.int32)
    return joined[labels]
