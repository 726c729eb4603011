"""Regions of a solid's voxels: geodesic spreading of labels, and peaks with their saddles.

The voxels of a solid are the nodes of a graph in which every one is joined to those of its 26
neighbours that are in the solid, too.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from .union_find import root

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Labels = npt.NDArray[np.int32]
Solid = npt.NDArray[np.bool_]

STEPS = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
STEPS = STEPS[np.abs(STEPS).sum(axis=1) > 0]
LENGTHS: Floats = np.sqrt((STEPS**2).sum(axis=1).astype(float))


@dataclass(frozen=True, eq=False)
class VoxelGraph:
    """The voxels of a solid as nodes, in the order of the array.

    Attributes
    ----------
    shape : (int, int, int)
    flat : ndarray, (n,) int64
        Place of every node in the raveled array.
    neighbours : ndarray, (n, 26) int32
        Along :data:`STEPS`; −1 where the solid ends.
    """

    shape: tuple[int, int, int]
    flat: Ints
    neighbours: Labels

    def on_grid(self, values: npt.NDArray[np.int32]) -> Labels:
        """Values (n,) of the nodes on the grid (z, y, x), 0 elsewhere."""
        grid = np.zeros(self.shape, np.int32)
        grid.ravel()[self.flat] = values
        return grid


def voxel_graph(solid: Solid) -> VoxelGraph:
    """The graph of a solid (z, y, x)."""
    z, y, x = solid.shape
    node = np.full((z + 2, y + 2, x + 2), -1, np.int32)
    flat = np.flatnonzero(solid)
    node[1:-1, 1:-1, 1:-1][solid] = np.arange(len(flat), dtype=np.int32)
    offsets = STEPS @ np.array([(y + 2) * (x + 2), x + 2, 1])
    padded = np.flatnonzero(node.ravel() >= 0)
    return VoxelGraph((z, y, x), flat, _neighbours(node.ravel(), padded, offsets))


@numba.njit(nogil=True, cache=True)
def _neighbours(node, padded, offsets):  # type: ignore[no-untyped-def]
    out = np.empty((len(padded), len(offsets)), np.int32)
    for i in range(len(padded)):
        for k in range(len(offsets)):
            out[i, k] = node[padded[i] + offsets[k]]
    return out


def components(graph: VoxelGraph, chosen: Solid) -> Labels:
    """Connected components (n,) of the chosen nodes, counted from 1; 0 for the others."""
    found: Labels = _components(graph.neighbours, chosen)
    return found


@numba.njit(nogil=True, cache=True)
def _components(neighbours, chosen):  # type: ignore[no-untyped-def]
    out = np.zeros(len(chosen), np.int32)
    stack = np.empty(len(chosen), np.int64)
    count = 0
    for start in range(len(chosen)):
        if not chosen[start] or out[start] > 0:
            continue
        count += 1
        out[start] = count
        stack[0], size = start, 1
        while size > 0:
            size -= 1
            i = stack[size]
            for k in range(neighbours.shape[1]):
                j = neighbours[i, k]
                if j >= 0 and chosen[j] and out[j] == 0:
                    out[j] = count
                    stack[size] = j
                    size += 1
    return out


def spread(graph: VoxelGraph, seeds: Labels, reach: float = np.inf) -> Labels:
    """The label of the seed that is nearest along paths within the solid.

    Parameters
    ----------
    seeds : ndarray, (n,) int32
        0 where a label is wanted.
    reach : float
        Length of the longest path, in voxels.

    Returns
    -------
    ndarray, (n,) int32
        0 where no seed is within reach. Of two seeds as near, the smaller label.
    """
    labels: Labels = _spread(graph.neighbours, LENGTHS, seeds, reach)
    return labels


@numba.njit(nogil=True, cache=True)
def _spread(neighbours, lengths, seeds, reach):  # type: ignore[no-untyped-def]
    out = seeds.copy()
    best = np.full(len(seeds), np.inf)
    heap = [(0.0, np.int64(0), np.int64(0)) for _ in range(0)]
    for i in range(len(seeds)):
        if seeds[i] > 0:
            best[i] = 0.0
            for k in range(neighbours.shape[1]):
                j = np.int64(neighbours[i, k])
                if j >= 0 and seeds[j] == 0:  # others have nothing to tell
                    heapq.heappush(heap, (0.0, np.int64(seeds[i]), np.int64(i)))
                    break
    while len(heap) > 0:
        distance, label, node = heapq.heappop(heap)
        if distance > best[node] or label != out[node]:
            continue
        for k in range(neighbours.shape[1]):
            j = np.int64(neighbours[node, k])
            if j < 0:
                continue
            there = distance + lengths[k]
            if there > reach:
                continue
            nearer = there < best[j] - 1e-9
            if nearer or (there <= best[j] + 1e-9 and label < out[j]):
                best[j] = min(there, best[j])
                out[j] = label
                heapq.heappush(heap, (best[j], label, j))
    return out


@dataclass(frozen=True, eq=False)
class Saddles:
    """Where labelled regions meet: pairs (k, 2) of labels, and the highest voxel there (k,)."""

    pairs: Labels
    height: Floats


def saddles(graph: VoxelGraph, labels: Labels, height: Floats) -> Saddles:
    """The highest place at which any two regions meet, highest first."""
    first, second, level = _meetings(graph.neighbours, labels, height)
    key = first * (int(labels.max(initial=0)) + 1) + second
    # By pair, and the highest of every pair first.
    order = np.lexsort((-level, key))
    key, level = key[order], level[order]
    leading = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else order
    chosen = order[leading]
    highest = np.lexsort((key[leading], -level[leading]))
    pairs = np.stack([first[chosen], second[chosen]], axis=1)[highest].astype(np.int32)
    return Saddles(pairs, level[leading][highest])


@numba.njit(nogil=True, cache=True)
def _meetings(neighbours, labels, height):  # type: ignore[no-untyped-def]
    count = 0
    for i in range(len(labels)):
        for k in range(neighbours.shape[1]):
            j = neighbours[i, k]
            if j >= 0 and 0 < labels[i] < labels[j]:
                count += 1
    first, second = np.empty(count, np.int64), np.empty(count, np.int64)
    level = np.empty(count)
    n = 0
    for i in range(len(labels)):
        for k in range(neighbours.shape[1]):
            j = neighbours[i, k]
            if j >= 0 and 0 < labels[i] < labels[j]:
                first[n], second[n] = labels[i], labels[j]
                level[n] = min(height[i], height[j])
                n += 1
    return first, second, level


def split_at_saddles(
    graph: VoxelGraph, labels: Labels, height: Floats, share: float, least: float
) -> Labels:
    """Regions cut into one part per peak that stands out (a watershed by persistence).

    From the top down, two peaks of one region that meet at a saddle become one part where the
    saddle is above `share` of the lower peak, or less than `least` below it.

    Parameters
    ----------
    labels : ndarray, (n,) int32
        0 for nodes that stay 0.
    height : ndarray, (n,)

    Returns
    -------
    ndarray, (n,) int32
        Counted from 1 in the order of the nodes.
    """
    order = np.argsort(-height, kind="stable")
    roots = _watershed(graph.neighbours, labels, height, order, share, least)
    kept = labels > 0
    out = np.zeros(len(labels), np.int32)
    found, first, which = np.unique(roots[kept], return_index=True, return_inverse=True)
    rank = np.empty(len(found), np.int32)
    rank[np.argsort(first)] = np.arange(1, len(found) + 1)
    out[kept] = rank[which]
    return out


@numba.njit(nogil=True, cache=True)
def _watershed(neighbours, labels, height, order, share, least):  # type: ignore[no-untyped-def]
    n = len(labels)
    parent = np.arange(n)  # of basins, named after their peaks
    basin = np.full(n, -1)
    for q in range(n):
        i = order[q]
        if labels[i] == 0:
            continue
        above = -1
        for k in range(neighbours.shape[1]):
            j = neighbours[i, k]
            mine = j >= 0 and basin[j] >= 0 and labels[j] == labels[i]
            if mine and (above < 0 or height[j] > height[above]):
                above = j
        if above < 0:
            basin[i] = i
            continue
        basin[i] = basin[above]
        for k in range(neighbours.shape[1]):
            j = neighbours[i, k]
            if j >= 0 and basin[j] >= 0 and labels[j] == labels[i]:
                a, b = root(parent, basin[i]), root(parent, basin[j])
                if a != b:
                    if height[a] < height[b]:
                        a, b = b, a
                    if height[i] > share * height[b] or height[b] - height[i] < least:
                        parent[b] = a
    for i in range(n):
        if basin[i] >= 0:
            basin[i] = root(parent, basin[i])
    return basin
