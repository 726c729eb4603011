"""Tracks as a graph: a node per row, an edge per link, split and merge; and back.

Most formats of tracks are graphs, in which a track has no number of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..charts import Ints, Tracks
from ..errors import FileFormatError

LINK, SPLIT, MERGE = 0, 1, 2
KINDS = ("link", "split", "merge")


@dataclass(frozen=True, eq=False)
class TrackGraph:
    """The edges between the rows of tracks.

    Attributes
    ----------
    edges : ndarray, (m, 2) int64
        (row, later row), each once.
    kind : ndarray, (m,) int64
        LINK within a track, SPLIT from a track to one that comes out of it, or MERGE from a
        track to the one that it goes into.
    """

    edges: Ints
    kind: Ints

    def lineages(self, nodes: int) -> Ints:
        """Of every row (n,), from 1: what is linked in any way is one lineage."""
        return _components(self.edges, nodes)

    def tracklets(self, nodes: int) -> Ints:
        """Of every row (n,), from 1: the longest paths without any branch or merge."""
        return _components(self.edges[_unbranched(self.edges, nodes)], nodes)


def graph_of(tracks: Tracks) -> TrackGraph:
    """The graph of tracks.

    A split is an edge from the last row of a track before the other begins to the first row of
    that, a merge from the last row of a track to the first row of the other after it. Splits
    and merges that time rules out have no edge.
    """
    track, time = tracks.track_id, tracks.timepoint
    first = np.flatnonzero(track[:-1] == track[1:])
    edges = [np.column_stack([first, first + 1])]
    kinds = [np.full(len(first), LINK)]
    for pairs, kind in ((tracks.splits, SPLIT), (tracks.merges, MERGE)):
        found = []
        for one, other in pairs.tolist():
            source, target = tracks.rows_of(one), tracks.rows_of(other)
            if kind == SPLIT:
                before = int(np.searchsorted(time[source], time[target.start], "left"))
                if before > 0:
                    found.append((source.start + before - 1, target.start))
            else:
                after = int(np.searchsorted(time[target], time[source.stop - 1], "right"))
                if target.start + after < target.stop:
                    found.append((source.stop - 1, target.start + after))
        edges.append(np.array(found, np.int64).reshape(-1, 2))
        kinds.append(np.full(len(found), kind))
    joined, kind_of = np.concatenate(edges).astype(np.int64), np.concatenate(kinds)
    _, kept = np.unique(joined, axis=0, return_index=True)
    kept = np.sort(kept)
    return TrackGraph(joined[kept], kind_of[kept].astype(np.int64))


def tracks_of_graph(timepoint: Ints, edges: Ints) -> tuple[Ints, Ints, Ints]:
    """Numbers of tracks, splits and merges of a graph.

    A track is a path without any branch or merge: where one divides, it ends, and all that
    comes out of it are others.

    Parameters
    ----------
    timepoint : ndarray, (n,)
        Of every node.
    edges : ndarray, (m, 2)
        Pairs of nodes, in either direction.

    Returns
    -------
    track_id : ndarray, (n,) int64
        From 1, in the order in which tracks begin.
    splits, merges : ndarray, (k, 2) int64

    Raises
    ------
    FileFormatError
        An edge joins two nodes of one timepoint, or is of nodes that are not there.
    """
    nodes = len(timepoint)
    edges = np.asarray(edges, np.int64).reshape(-1, 2)
    if len(edges) and (edges.min() < 0 or edges.max() >= nodes):
        raise FileFormatError("An edge is of a node that is not there.", nodes=nodes)
    back = timepoint[edges[:, 0]] > timepoint[edges[:, 1]]
    edges = np.unique(np.where(back[:, None], edges[:, ::-1], edges), axis=0)
    level = timepoint[edges[:, 0]] == timepoint[edges[:, 1]]
    if level.any():
        raise FileFormatError(
            "An edge joins two objects of one timepoint.",
            edges=int(level.sum()),
            timepoint=int(timepoint[edges[level][0, 0]]),
        )
    alone = _unbranched(edges, nodes)
    found = _components(edges[alone], nodes)
    track = _in_order_of_time(found, timepoint)
    others = edges[~alone]
    into = np.bincount(edges[:, 1], minlength=nodes)[others[:, 1]] > 1
    pairs = track[others]
    return track, np.unique(pairs[~into], axis=0), np.unique(pairs[into], axis=0)


def _unbranched(edges: Ints, nodes: int) -> npt.NDArray[np.bool_]:
    """Which edges are the only one from their first node and the only one to their last."""
    outward = np.bincount(edges[:, 0], minlength=nodes)
    inward = np.bincount(edges[:, 1], minlength=nodes)
    alone: npt.NDArray[np.bool_] = (outward[edges[:, 0]] == 1) & (inward[edges[:, 1]] == 1)
    return alone


def _components(edges: Ints, nodes: int) -> Ints:
    matrix = sparse.coo_array(
        (np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(nodes, nodes)
    )
    _, label = connected_components(matrix.tocsr(), directed=False)
    components: Ints = label.astype(np.int64) + 1
    return components


def _in_order_of_time(track: Ints, timepoint: Ints) -> Ints:
    """Numbers from 1, in the order in which tracks begin."""
    order = np.lexsort((np.arange(len(track)), timepoint))
    _, first, inverse = np.unique(track[order], return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(1, len(first) + 1)
    numbers = np.empty(len(track), np.int64)
    numbers[order] = rank[inverse.ravel()]
    return numbers
