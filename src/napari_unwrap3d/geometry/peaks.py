"""Regions of a graph around the peaks of a field, and around seeds."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from .union_find import root

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def mesh_graph(vertices: Floats, edges: Ints, chosen: Ints) -> sparse.csr_array:
    """The edges of a mesh between some of its vertices, with their lengths.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    edges : ndarray, (e, 2)
    chosen : ndarray, (k,)
        Vertices, which become the nodes in this order.

    Returns
    -------
    csr_array, (k, k)
        Symmetric.
    """
    node = np.full(len(vertices), -1, np.int64)
    node[chosen] = np.arange(len(chosen))
    a, b = node[edges[(node[edges] >= 0).all(axis=1)]].T
    length = np.linalg.norm(vertices[chosen[a]] - vertices[chosen[b]], axis=1)
    half = sparse.coo_array((length, (a, b)), (len(chosen),) * 2)
    return sparse.csr_array(half + half.T)


def around_seeds(graph: sparse.csr_array, seeds: Ints) -> Ints:
    """Which seed (k,) every node is nearest to along edges, counted from 0; the first of equals.

    Nodes that no seed reaches get 0.
    """
    apart = csgraph.dijkstra(graph, indices=seeds)
    nearest: Ints = np.argmin(apart, axis=0)
    return nearest


def around_peaks(graph: sparse.csr_array, height: Floats, count: int) -> tuple[Ints, Ints]:
    """The basins of the peaks that stand out most.

    From the top down, every node joins its highest neighbour's basin. Where two basins meet,
    the lower peak ends: it stands out by its height over this saddle (persistence), and its
    basin becomes part of the one across unless it is one of those that are asked for.

    Parameters
    ----------
    graph : csr_array, (k, k)
    height : ndarray, (k,)
    count : int
        How many basins.

    Returns
    -------
    basin : ndarray, (k,) int64
        Counted from 0, in the order of `peaks`.
    peaks : ndarray, (≤ count,) int64
        Nodes, the one that stands out most first; fewer where there are fewer peaks.
    """
    order = np.argsort(-height, kind="stable")
    peak, into, persistence = _basins(graph.indptr, graph.indices, height, order)
    found = np.flatnonzero(peak == np.arange(len(peak)))
    # Of those that never end, the highest first.
    ranked = found[np.lexsort((found, -height[found], -persistence[found]))]
    kept = ranked[:count]
    number = np.full(len(height), -1, np.int64)
    number[kept] = np.arange(len(kept))
    for node in ranked[count:]:
        end = node
        while number[end] < 0 and into[end] != end:
            end = into[end]
        number[node] = max(number[end], 0)
    return number[peak], kept


@numba.njit(nogil=True, cache=True)
def _basins(indptr, indices, height, order):  # type: ignore[no-untyped-def]
    """The peak of every node; beside which basin every peak ends, and how far it stands out.

    The basin is that across the saddle, not the highest of all that it has become part of: it
    may be one of those that are asked for. Following these leads to the highest of all.
    """
    size = len(height)
    peak = np.full(size, -1, np.int64)
    parent, into = np.arange(size), np.arange(size)
    persistence = np.full(size, np.inf)
    for node in order:
        highest = -1
        for at in range(indptr[node], indptr[node + 1]):
            other = indices[at]
            if peak[other] >= 0 and (highest < 0 or height[other] > height[highest]):
                highest = other
        peak[node] = node if highest < 0 else peak[highest]
        for at in range(indptr[node], indptr[node + 1]):
            other = indices[at]
            if peak[other] < 0:
                continue
            a, b = root(parent, peak[node]), root(parent, peak[other])
            if a == b:
                continue
            beside = peak[node]
            if height[a] < height[b] or (height[a] == height[b] and a > b):
                a, b = b, a
                beside = peak[other]
            parent[b], into[b] = a, beside
            persistence[b] = height[b] - height[node]
    return peak, into, persistence
