"""What a triangle mesh is and measures: edges, neighbours, topology, quality.

All functions take vertices (n, 3) and faces (m, 3) as plain arrays. Corner k of a
face and the edge opposite to it share the index k: edge k of face f runs from
``faces[f, (k + 1) % 3]`` to ``faces[f, (k + 2) % 3]``. Orientation is that of the
stored coordinates: the normal is ``(b - a) × (c - a)`` of the array as it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from ..errors import MeshError, NotManifoldError, NotWatertightError

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

# A face counts as degenerate below this radius ratio: its corners are in line to within
# a thousandth of its longest edge.
DEGENERATE_RATIO = 1e-5


class Edges(NamedTuple):
    """The edges of a mesh and the faces at them.

    Attributes
    ----------
    vertices : ndarray, (e, 2) int64
        The two ends, the smaller index first.
    of_face : ndarray, (m, 3) int64
        The edge opposite to each corner.
    valence : ndarray, (e,) int64
        How many faces meet at each edge.
    slots : ndarray, (3 m,) int64
        Half-edges 3 f + k in the order of their edges.
    first : ndarray, (e,) int64
        Where the half-edges of each edge begin in `slots`.
    """

    vertices: Ints
    of_face: Ints
    valence: Ints
    slots: Ints
    first: Ints


# Geometry --------------------------------------------------------------------


def _face_vectors(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Floats:
    """Normals (m, 3) whose length is twice the area of the face."""
    a, b, c = (np.asarray(vertices, dtype=np.float64)[corner] for corner in np.asarray(faces).T)
    vectors: Floats = np.cross(b - a, c - a)
    return vectors


def face_areas(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Floats:
    """Area (m,) of each face, in the square of the unit of `vertices`."""
    areas: Floats = 0.5 * np.linalg.norm(_face_vectors(vertices, faces), axis=1)
    return areas


def face_normals(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Floats:
    """Unit normals (m, 3); zero for a face without area."""
    return unit(_face_vectors(vertices, faces))


def vertex_normals(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Floats:
    """Unit normals (n, 3), the mean of the faces around weighted by their area."""
    vertices = np.asarray(vertices, dtype=np.float64)
    corners = np.asarray(faces).ravel()
    vectors = np.repeat(_face_vectors(vertices, faces), 3, axis=0)
    summed = [np.bincount(corners, vectors[:, i], len(vertices)) for i in range(3)]
    return unit(np.stack(summed, axis=1))


def unit(vectors: Floats) -> Floats:
    """Vectors (n, 3) scaled to length 1; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    scaled: Floats = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    return scaled


def signed_volume(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> float:
    """Volume enclosed by a closed mesh; positive when its normals point outwards."""
    vertices = np.asarray(vertices, dtype=np.float64)
    # Around the centroid, so that a cell far from the origin loses no digits.
    a, b, c = np.moveaxis((vertices - vertices.mean(axis=0))[np.asarray(faces)], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def radius_ratio(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Floats:
    """Quality (m,) of each face: 2 r_in / r_circum, 1 = equilateral, 0 = degenerate."""
    corners = [np.asarray(vertices, dtype=np.float64)[corner] for corner in np.asarray(faces).T]
    a, b, c = (np.linalg.norm(corners[i] - corners[i - 1], axis=1) for i in range(3))
    product = a * b * c
    height = (b + c - a) * (c + a - b) * (a + b - c)
    ratio = np.divide(height, product, out=np.zeros_like(product), where=product > 0)
    clipped: Floats = np.clip(ratio, 0.0, 1.0)
    return clipped


def degenerate_faces(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Bools:
    """True (m,) for faces with a repeated vertex or corners (next to) in line."""
    found: Bools = radius_ratio(vertices, faces) < DEGENERATE_RATIO
    return found


# Edges and neighbours --------------------------------------------------------


def half_edges(faces: npt.ArrayLike) -> Ints:
    """Start and end (m, 3, 2) of the directed edge opposite to each corner."""
    faces = np.asarray(faces, dtype=np.int64)
    return np.stack([np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)], axis=2)


def edges_with_faces(faces: npt.ArrayLike) -> Edges:
    """The edges, the edges of each face and the number of faces at each edge."""
    ends = half_edges(faces).reshape(-1, 2)
    stride = int(ends.max()) + 1
    keys = ends.min(axis=1) * stride + ends.max(axis=1)
    slots = np.argsort(keys)
    ordered = keys[slots]
    new = np.concatenate([[True], ordered[1:] != ordered[:-1]])
    first = np.flatnonzero(new)
    of_face = np.empty(len(keys), dtype=np.int64)
    of_face[slots] = np.cumsum(new) - 1
    valence = np.diff(first, append=len(keys))
    vertices = np.stack([ordered[first] // stride, ordered[first] % stride], axis=1)
    return Edges(vertices, of_face.reshape(-1, 3), valence, slots, first)


def _sorted_edges(faces: npt.ArrayLike) -> Ints:
    """A number for the edge of every half-edge (3 m,), sorted: quicker than all of `Edges`."""
    ends = half_edges(faces)
    low, high = np.minimum(ends[..., 0], ends[..., 1]), np.maximum(ends[..., 0], ends[..., 1])
    keys: Ints = (low * (int(high.max()) + 1) + high).ravel()
    keys.sort()
    return keys


def face_neighbors(faces: npt.ArrayLike) -> Ints:
    """The face (m, 3) across the edge opposite to each corner of a closed manifold.

    Raises
    ------
    NotWatertightError
        An edge has only one face.
    NotManifoldError
        An edge has more than two faces.
    """
    edges = edges_with_faces(faces)
    _require_closed(edges)
    slots = edges.slots.reshape(-1, 2)
    across = np.empty(edges.of_face.size, dtype=np.int64)
    across[slots[:, 0]] = slots[:, 1] // 3
    across[slots[:, 1]] = slots[:, 0] // 3
    return across.reshape(-1, 3)


def _require_closed(edges: Edges) -> None:
    branching = int((edges.valence > 2).sum())
    if branching:
        raise NotManifoldError(
            "The mesh is not a manifold: edges belong to more than two faces.",
            nonmanifold_edges=branching,
            hint="Repair it first (geometry.repair.repair).",
        )
    open_edges = int((edges.valence < 2).sum())
    if open_edges:
        raise NotWatertightError(
            "The mesh is not watertight: edges belong to one face only.",
            boundary_edges=open_edges,
            hint="Repair it first (geometry.repair.repair).",
        )


def boundary_edges(faces: npt.ArrayLike) -> Ints:
    """Edges (k, 2) that belong to one face only."""
    edges = edges_with_faces(faces)
    found: Ints = edges.vertices[edges.valence == 1]
    return found


def nonmanifold_edges(faces: npt.ArrayLike) -> Ints:
    """Edges (k, 2) that belong to more than two faces."""
    edges = edges_with_faces(faces)
    found: Ints = edges.vertices[edges.valence > 2]
    return found


def is_watertight(faces: npt.ArrayLike) -> bool:
    """True when every edge belongs to exactly two faces."""
    keys = _sorted_edges(faces)
    pairs = len(keys) % 2 == 0 and bool((keys[::2] == keys[1::2]).all())
    return pairs and bool((keys[1:-1:2] != keys[2::2]).all())


def is_consistently_wound(faces: npt.ArrayLike) -> bool:
    """True when no two faces run along a shared edge in the same direction."""
    ends = half_edges(faces).reshape(-1, 2)
    keys = ends[:, 0] * (int(ends.max()) + 1) + ends[:, 1]
    return len(np.unique(keys)) == len(keys)


# Fans: the faces around a vertex ---------------------------------------------


def corner_fans(faces: npt.ArrayLike, edges: Edges | None = None) -> tuple[int, Ints]:
    """Group the corners at each vertex into fans connected through shared edges.

    Only edges with exactly two faces connect. A vertex of a manifold has one fan.

    Returns
    -------
    count : int
        Number of fans.
    fan : ndarray, (m, 3) int64
        The fan that each corner belongs to.
    """
    faces = np.asarray(faces, dtype=np.int64)
    edges = edges_with_faces(faces) if edges is None else edges
    first = edges.first[edges.valence == 2]
    return link_corners(faces, edges.slots[first], edges.slots[first + 1])


def link_corners(faces: Ints, here: Ints, there: Ints) -> tuple[int, Ints]:
    """Fans when the half-edges `here` and `there` (indices 3 f + k) are glued pairwise."""
    flat = faces.ravel()
    start, end = (3 * (here // 3) + (here % 3 + i) % 3 for i in (1, 2))
    other_start, other_end = (3 * (there // 3) + (there % 3 + i) % 3 for i in (1, 2))
    # Two faces wound alike run along a shared edge in opposite directions.
    same = flat[start] == flat[other_start]
    at_start = np.where(same, other_start, other_end)
    at_end = np.where(same, other_end, other_start)
    rows = np.concatenate([start, end])
    columns = np.concatenate([at_start, at_end])
    links = sparse.coo_array((np.ones(len(rows), np.int8), (rows, columns)), (flat.size,) * 2)
    count, fan = csgraph.connected_components(links, directed=False)
    return int(count), fan.astype(np.int64).reshape(-1, 3)


def nonmanifold_vertices(faces: npt.ArrayLike) -> Ints:
    """Vertices (k,) whose faces form more than one fan."""
    faces = np.asarray(faces, dtype=np.int64)
    count, fan = corner_fans(faces)
    vertex_of_fan = np.zeros(count, dtype=np.int64)
    vertex_of_fan[fan.ravel()] = faces.ravel()
    return np.flatnonzero(np.bincount(vertex_of_fan) > 1)


# Topology --------------------------------------------------------------------


def connected_components(faces: npt.ArrayLike, n_vertices: int | None = None) -> tuple[Ints, Ints]:
    """Components of faces that share vertices.

    Parameters
    ----------
    faces : ndarray, (m, 3)
    n_vertices : int, optional
        Number of vertices; by default up to the largest index in `faces`.

    Returns
    -------
    of_face : ndarray, (m,) int64
        Component of each face, counted from 0.
    of_vertex : ndarray, (n,) int64
        Component of each vertex; -1 for a vertex without a face.
    """
    faces = np.asarray(faces, dtype=np.int64)
    n = int(faces.max()) + 1 if n_vertices is None else n_vertices
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    links = sparse.coo_array((np.ones(len(rows), np.int8), (rows, columns)), (n, n))
    _, label = csgraph.connected_components(links, directed=False)
    of_face = np.unique(label[faces[:, 0]], return_inverse=True)[1].astype(np.int64)
    of_vertex = np.full(n, -1, dtype=np.int64)
    of_vertex[faces.ravel()] = np.repeat(of_face, 3)
    return of_face, of_vertex


def euler_characteristic(faces: npt.ArrayLike) -> int:
    """χ = V − E + F, counting only vertices that have a face."""
    faces = np.asarray(faces, dtype=np.int64)
    keys = _sorted_edges(faces)
    edges = 1 + int((keys[1:] != keys[:-1]).sum())
    used = int((np.bincount(faces.ravel()) > 0).sum())
    return used - edges + len(faces)


def genus(faces: npt.ArrayLike) -> int:
    """Number of handles of a closed orientable manifold, summed over its components.

    Raises
    ------
    NotWatertightError, NotManifoldError
        The genus of an open, branching or one-sided mesh is not defined.
    """
    faces = wind_consistently(faces)
    _require_closed(edges_with_faces(faces))
    pinched = len(nonmanifold_vertices(faces))
    if pinched:
        raise NotManifoldError(
            "The mesh touches itself in single vertices, so its genus is not defined.",
            nonmanifold_vertices=pinched,
            hint="Repair it first (geometry.repair.repair).",
        )
    of_face, _ = connected_components(faces)
    components = int(of_face.max()) + 1
    return (2 * components - euler_characteristic(faces)) // 2


# Orientation -----------------------------------------------------------------


def wind_consistently(faces: npt.ArrayLike) -> Ints:
    """Turn faces so that neighbours across two-face edges agree.

    The first face of every component connected through such edges keeps its winding.

    Raises
    ------
    NotManifoldError
        The mesh is one-sided, like a Klein bottle.
    """
    faces = np.asarray(faces, dtype=np.int64)
    edges = edges_with_faces(faces)
    first = edges.first[edges.valence == 2]
    here, there = edges.slots[first], edges.slots[first + 1]
    start = half_edges(faces).reshape(-1, 2)[:, 0]
    disagree = start[here] == start[there]
    f, g, m = here // 3, there // 3, len(faces)
    # The orientation double cover: node f is the face as it is, node m + f turned over.
    rows = np.concatenate([f, f + m])
    columns = np.concatenate([g + m * disagree, g + m * ~disagree])
    links = sparse.coo_array((np.ones(len(rows), np.int8), (rows, columns)), (2 * m, 2 * m))
    _, label = csgraph.connected_components(links, directed=False)
    as_is, turned = label[:m], label[m:]
    one_sided = int((as_is == turned).sum())
    if one_sided:
        raise NotManifoldError(
            "The mesh is one-sided: inside and outside cannot be told apart.",
            faces_on_one_sided_parts=one_sided,
            hint="Close the cell again from its mask; a mesh of a solid always has two sides.",
        )
    sheet = np.unique(np.minimum(as_is, turned), return_inverse=True)[1]
    leader = np.full(int(sheet.max()) + 1, m)
    np.minimum.at(leader, sheet, np.arange(m))
    wrong = as_is != as_is[leader[sheet]]
    result = faces.copy()
    result[wrong] = result[wrong][:, ::-1]
    return result


def orient_outward(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Ints:
    """Wind the faces of each component consistently, with positive signed volume.

    Raises
    ------
    NotManifoldError
        The mesh is one-sided.
    MeshError
        A face refers to a vertex that does not exist.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    result = wind_consistently(faces)
    if result.max() >= len(vertices):
        raise MeshError(
            "A face refers to a vertex that does not exist.",
            largest_index=int(result.max()),
            vertices=len(vertices),
        )
    of_face, of_vertex = connected_components(result, len(vertices))
    parts = int(of_face.max()) + 1
    used = of_vertex >= 0
    size = np.bincount(of_vertex[used], minlength=parts)[:, None]
    centre = np.stack(
        [np.bincount(of_vertex[used], vertices[used, i], parts) for i in range(3)], axis=1
    )
    a, b, c = np.moveaxis(vertices[result] - (centre / size)[of_face][:, None], 1, 0)
    volume = np.bincount(of_face, np.einsum("ij,ij->i", a, np.cross(b, c)), parts)
    inverted = (volume < 0)[of_face]
    result[inverted] = result[inverted][:, ::-1]
    return result


# Report ----------------------------------------------------------------------


def mesh_report(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> dict[str, Any]:
    """What a mesh measures, JSON-able; any mesh, also a damaged one.

    Returns
    -------
    dict
        ``vertices``, ``faces``, ``components``, ``euler_characteristic``, ``genus`` (None
        unless closed and manifold), ``boundary_edges``, ``nonmanifold_edges``,
        ``nonmanifold_vertices``, ``watertight``, ``degenerate_faces``,
        ``radius_ratio_mean``, ``radius_ratio_min``, ``radius_ratio_p1`` (1st percentile),
        ``area_um2`` and ``volume_um3`` (None unless watertight).
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    faces = np.asarray(faces, dtype=np.int64)
    edges = edges_with_faces(faces)
    fans, _ = corner_fans(faces, edges)
    used = int((np.bincount(faces.ravel()) > 0).sum())
    of_face, _ = connected_components(faces, len(vertices))
    components = int(of_face.max()) + 1
    euler = used - len(edges.vertices) + len(faces)
    watertight = bool((edges.valence == 2).all())
    pinched = len(nonmanifold_vertices(faces)) if fans > used else 0
    ratio = radius_ratio(vertices, faces)
    return {
        "vertices": len(vertices),
        "faces": len(faces),
        "components": components,
        "euler_characteristic": euler,
        "genus": (2 * components - euler) // 2 if watertight and not pinched else None,
        "boundary_edges": int((edges.valence == 1).sum()),
        "nonmanifold_edges": int((edges.valence > 2).sum()),
        "nonmanifold_vertices": pinched,
        "watertight": watertight,
        "degenerate_faces": int((ratio < DEGENERATE_RATIO).sum()),
        "radius_ratio_mean": float(ratio.mean()),
        "radius_ratio_min": float(ratio.min()),
        "radius_ratio_p1": float(np.percentile(ratio, 1)),
        "area_um2": float(face_areas(vertices, faces).sum()),
        "volume_um3": signed_volume(vertices, faces) if watertight else None,
    }
