"""Make a mesh a manifold by cutting it where sheets meet in an edge or a vertex.

The idea of cutting and stitching is that of Guéziec, Taubin, Lazarus and Horn (2001),
doi:10.1109/2945.928166: every fan of faces around a vertex gets a vertex of its own.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from .mesh import (
    Bools,
    Edges,
    Floats,
    Ints,
    edges_with_faces,
    face_areas,
    half_edges,
    link_corners,
    unit,
)


def dangling_faces(vertices: Floats, faces: Ints) -> Bools:
    """True for faces of open sheets that hang on the surface along branching edges.

    A sheet is a set of faces connected through edges with two faces. One with a free
    rim that is attached to others along edges with three or more faces encloses
    nothing. The sheet of largest area is the surface itself and never counts.
    """
    edges = edges_with_faces(faces)
    first = edges.first[edges.valence == 2]
    f, g = edges.slots[first] // 3, edges.slots[first + 1] // 3
    links = sparse.coo_array((np.ones(len(f), np.int8), (f, g)), (len(faces),) * 2)
    count, sheet = csgraph.connected_components(links, directed=False)
    valence = edges.valence[edges.of_face]
    free = np.bincount(sheet, (valence == 1).any(axis=1), count) > 0
    attached = np.bincount(sheet, (valence > 2).any(axis=1), count) > 0
    hanging = free & attached
    hanging[np.bincount(sheet, face_areas(vertices, faces), count).argmax()] = False
    found: Bools = hanging[sheet]
    return found


def cut_apart(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, Ints]:
    """Give every fan of faces its own vertex, and every pair of sheets its own edge.

    Where four or more faces meet in an edge, they are paired around it so that each
    pair bounds one wedge of the solid. Faces without a partner get a free rim.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Wound consistently across edges with two faces.

    Returns
    -------
    vertices : ndarray, (n + k, 3)
    faces : ndarray, (p, 3)
    origin : ndarray, (k,) int64
        The vertex that each new one was split from.
    """
    edges = edges_with_faces(faces)
    first = edges.first[edges.valence == 2]
    here, there = [edges.slots[first]], [edges.slots[first + 1]]
    for edge in np.flatnonzero(edges.valence > 2):
        for a, b in _pairs_around(vertices, faces, edges, int(edge)):
            here.append(np.array([a]))
            there.append(np.array([b]))
    count, fan = link_corners(faces, np.concatenate(here), np.concatenate(there))
    old = np.zeros(count, dtype=np.int64)
    old[fan.ravel()] = faces.ravel()
    order = np.argsort(old, kind="stable")
    repeated = np.concatenate([[False], old[order][1:] == old[order][:-1]])
    name = old.copy()
    name[order[repeated]] = len(vertices) + np.arange(int(repeated.sum()))
    origin = old[order[repeated]]
    return _split_shared_edges(np.concatenate([vertices, vertices[origin]]), name[fan], origin)


def _pairs_around(vertices: Floats, faces: Ints, edges: Edges, edge: int) -> list[tuple[int, int]]:
    """Pairs of half-edges (3 f + k) at one edge whose faces bound a wedge of the solid."""
    a, b = edges.vertices[edge]
    begin = edges.first[edge]
    slots = edges.slots[begin : begin + edges.valence[edge]]
    along = half_edges(faces[slots // 3])[np.arange(len(slots)), slots % 3, 0] == a
    axis = unit((vertices[b] - vertices[a])[None])[0]
    arms = vertices[faces[slots // 3, slots % 3]] - vertices[a]
    arms = arms - np.outer(arms @ axis, axis)
    ahead, aside = arms[0], np.cross(axis, arms[0])
    order = np.argsort(np.arctan2(arms @ aside, arms @ ahead), kind="stable")
    # A face that runs along the axis has the solid behind it, the others before it, so
    # a wedge opens with a face of the second kind and closes with one of the first.
    pairs: list[tuple[int, int]] = []
    waiting: list[int] = []
    for i in [*order.tolist(), *order.tolist()]:
        if any(i in pair for pair in pairs):
            continue
        if not along[i]:
            if i not in waiting:
                waiting.append(i)
        elif waiting:
            pairs.append((waiting.pop(), i))
    return [(int(slots[i]), int(slots[j])) for i, j in pairs]


def _split_shared_edges(vertices: Floats, faces: Ints, origin: Ints) -> tuple[Floats, Ints, Ints]:
    """Put a vertex on all but one of the edges that still run between the same two vertices.

    Two sheets may share both ends of an edge though each end has one fan only: then
    the edges become distinct when one of them goes through a vertex of its own.
    """
    while True:
        edges = edges_with_faces(faces)
        shared = np.flatnonzero(edges.valence > 2)
        touched: set[int] = set()
        for edge in shared:
            pairs = _pairs_around(vertices, faces, edges, int(edge))
            members = {slot // 3 for pair in pairs for slot in pair}
            if len(pairs) < 2 or members & touched:
                continue
            touched |= members
            ends = edges.vertices[edge]
            vertices = np.concatenate([vertices, vertices[ends].mean(axis=0)[None]])
            origin = np.append(origin, ends[0])
            faces = _through(faces, pairs[0], len(vertices) - 1)
        if not touched:
            return vertices, faces, origin


def _through(faces: Ints, pair: tuple[int, int], vertex: int) -> Ints:
    """Split the two faces of an edge so that the edge goes through `vertex`."""
    faces = faces.copy()
    extra = []
    for slot in pair:
        f, k = divmod(slot, 3)
        second = faces[f].copy()
        second[(k + 1) % 3] = vertex
        faces[f, (k + 2) % 3] = vertex
        extra.append(second)
    return np.concatenate([faces, np.stack(extra)])
