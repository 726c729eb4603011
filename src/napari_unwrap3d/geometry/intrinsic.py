"""Intrinsic Delaunay triangulation of a mesh given by its edges' lengths.

Sharp and Crane (2020), "A Laplacian for nonmanifold triangle meshes",
doi:10.1111/cgf.14069: lengths are raised a little so that no triangle is degenerate, and
edges are flipped within the surface until all cotangent weights are non-negative. Only
the manifold case is needed here.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..errors import MeshError
from .laplacian import cotangent_laplacian, cotangents_from_lengths
from .mesh import edges_with_faces

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# The paper's mollify factor: by how much, in mean edge lengths, two edges of a triangle are
# longer than the third.
MOLLIFY = 1e-5
# Where triangles are thinner than this, lengths alone do not say which way to flip.
THINNEST = 1e-6
# Sums of two cotangents down to this are rounding.
DELAUNAY_TOLERANCE = 1e-9
FLIPS_PER_EDGE = 50


def mollified(lengths: Floats, of_face: Ints, factor: float = MOLLIFY) -> Floats:
    """Lengths (m, 3) by which every triangle inequality holds strictly.

    Parameters
    ----------
    lengths : ndarray, (m, 3)
        Of the edges opposite to the corners.
    of_face : ndarray, (m, 3)
        The number of each of these edges.
    factor : float
    """
    edge = np.zeros(int(of_face.max()) + 1)
    edge[of_face] = lengths
    # Lengths that no triangle has, such as around a point where u has no meaning.
    for _ in range(3):
        placed = edge[of_face]
        longest = placed.sum(axis=1, keepdims=True) - placed
        np.minimum.at(edge, of_face, longest)
    placed = edge[of_face]
    excess = 2.0 * placed - placed.sum(axis=1, keepdims=True)
    raised: Floats = placed + max(float(excess.max()) + factor * float(edge.mean()), 0.0)
    return raised


def delaunay_edges(lengths: Floats, faces: Ints, over: Ints) -> tuple[Ints, Floats, Ints]:
    """Edges and weights of the intrinsic Delaunay triangulation.

    Parameters
    ----------
    lengths : ndarray, (m, 3)
        Of the edges opposite to the corners; see :func:`mollified`.
    faces : ndarray, (m, 3)
        A manifold, with or without boundary.
    over : ndarray, (m, 3) int64
        A number that is carried along each edge from corner k + 1 to corner k + 2, and adds
        up along paths, such as the turns around a periodic coordinate.

    Returns
    -------
    ends : ndarray, (3 m, 2)
        Start and end of every corner's opposite edge; most edges come twice.
    weights : ndarray, (3 m,)
        Half cotangents.
    over : ndarray, (3 m,)
        The number along each.
    """
    edges = edges_with_faces(faces)
    twin = np.full(faces.size, -1, np.int64)
    first = edges.first[edges.valence == 2]
    one, other = edges.slots[first], edges.slots[first + 1]
    twin[one], twin[other] = other, one
    faces, lengths, over = faces.copy(), lengths.copy(), over.copy()
    _flip_until_delaunay(
        faces, lengths, over, twin.reshape(-1, 3), FLIPS_PER_EDGE * len(edges.first)
    )
    ends = np.stack([np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)], axis=2)
    weights = 0.5 * cotangents_from_lengths(lengths)
    return ends.reshape(-1, 2), weights.ravel(), over.ravel()


@numba.njit(nogil=True, cache=True)
def _cotangent(a, b, c):  # type: ignore[no-untyped-def]
    """Cotangent of the angle opposite to the side a."""
    s = 0.5 * (a + b + c)
    area = np.sqrt(max(s * (s - a) * (s - b) * (s - c), 1e-300))
    return (b * b + c * c - a * a) / (4.0 * area)


@numba.njit(nogil=True, cache=True)
def _flip_until_delaunay(faces, lengths, over, twin, limit):  # type: ignore[no-untyped-def]
    """Flip edges in place until all are Delaunay, or `limit` flips are done."""
    stack = [np.int64(3 * f + k) for f in range(len(faces)) for k in range(3)]
    flips = 0
    while len(stack) and flips < limit:
        slot = stack.pop()
        f, k = slot // 3, slot % 3
        opposite = twin[f, k]
        if opposite < 0 or opposite // 3 == f:
            continue
        g, j = opposite // 3, opposite % 3
        k1, k2, j1, j2 = (k + 1) % 3, (k + 2) % 3, (j + 1) % 3, (j + 2) % 3
        bc, ca, ab = lengths[f, k], lengths[f, k1], lengths[f, k2]
        bd, dc = lengths[g, j1], lengths[g, j2]
        if _cotangent(bc, ca, ab) + _cotangent(bc, bd, dc) >= -DELAUNAY_TOLERANCE:
            continue
        # b at 0, c on the axis, a above and d below.
        ax = (ab * ab + bc * bc - ca * ca) / (2.0 * bc)
        dx = (bd * bd + bc * bc - dc * dc) / (2.0 * bc)
        ay, dy = np.sqrt(max(ab * ab - ax * ax, 0.0)), np.sqrt(max(bd * bd - dx * dx, 0.0))
        ad = np.sqrt((ax - dx) ** 2 + (ay + dy) ** 2)
        a, b, c, d = faces[f, k], faces[f, k1], faces[f, k2], faces[g, j]
        a_to_b, c_to_a = over[f, k2], over[f, k1]
        b_to_d, d_to_c = over[g, j1], over[g, j2]
        t_ab, t_ca, t_bd, t_dc = twin[f, k2], twin[f, k1], twin[g, j1], twin[g, j2]
        faces[f, 0], faces[f, 1], faces[f, 2] = a, b, d
        lengths[f, 0], lengths[f, 1], lengths[f, 2] = bd, ad, ab
        over[f, 0], over[f, 1], over[f, 2] = b_to_d, -(a_to_b + b_to_d), a_to_b
        faces[g, 0], faces[g, 1], faces[g, 2] = a, d, c
        lengths[g, 0], lengths[g, 1], lengths[g, 2] = dc, ca, ad
        over[g, 0], over[g, 1], over[g, 2] = d_to_c, c_to_a, a_to_b + b_to_d
        # A flap whose two sides are one edge keeps being glued to itself.
        here = (3 * f, 3 * f + 2, 3 * g + 1, 3 * g)
        before = (3 * g + j1, 3 * f + k2, 3 * f + k1, 3 * g + j2)
        across = (t_bd, t_ab, t_ca, t_dc)
        for i in range(4):
            partner = across[i]
            for h in range(4):
                if partner == before[h]:
                    partner = here[h]
                    break
            twin[here[i] // 3, here[i] % 3] = partner
            if partner >= 0:
                twin[partner // 3, partner % 3] = here[i]
        twin[f, 1], twin[g, 2] = 3 * g + 2, 3 * f + 1
        flips += 1
        stack.extend(here)
    return flips


def intrinsic_delaunay_laplacian(vertices: Floats, faces: Ints) -> sparse.csr_array:
    """Cotangent Laplacian (n, n) of the intrinsic Delaunay triangulation of the same surface.

    Edges are flipped within the surface, by their lengths alone, until no weight is negative
    (Fisher et al. 2007, doi:10.1007/s00607-007-0249-8), so that a maximum principle holds. A
    mesh that is Delaunay keeps its cotangent weights.

    Raises
    ------
    MeshError
        Triangles are collapsed: their edge lengths do not say which way to flip.
    """
    lengths, slack = _edge_lengths(vertices, faces)
    collapsed = int((slack < THINNEST * lengths.mean()).any(axis=1).sum())
    if collapsed:
        raise MeshError(
            "Triangles are too thin for the intrinsic Delaunay Laplacian.",
            collapsed_faces=collapsed,
            hint="Choose the robust Laplacian, which mollifies them.",
        )
    return _laplacian_of_lengths(lengths, faces, len(vertices))


def robust_laplacian(
    vertices: Floats, faces: Ints, *, mollify: float = MOLLIFY
) -> sparse.csr_array:
    """The intrinsic Delaunay Laplacian (n, n) of mollified edge lengths.

    Sharp and Crane 2020, doi:10.1111/cgf.14069, for manifold meshes: one length is added to
    every edge, the smallest with which no triangle is thinner than `mollify` times the mean
    edge. Without such triangles it is the intrinsic Delaunay Laplacian.
    """
    lengths, _ = _edge_lengths(vertices, faces)
    of_face = edges_with_faces(faces).of_face
    return _laplacian_of_lengths(mollified(lengths, of_face, mollify), faces, len(vertices))


def _edge_lengths(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Length (m, 3) of the edge opposite to each corner, and what the other two have more."""
    corners = vertices[faces]
    across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    lengths = np.sqrt(np.einsum("ijk,ijk->ij", across, across))
    return lengths, lengths.sum(axis=1, keepdims=True) - 2.0 * lengths


def _laplacian_of_lengths(lengths: Floats, faces: Ints, size: int) -> sparse.csr_array:
    ends, weights, _ = delaunay_edges(lengths, faces, np.zeros_like(faces))
    half = sparse.coo_array((weights, (ends[:, 0], ends[:, 1])), shape=(size, size)).tocsr()
    full = half + half.T
    # An edge from a vertex to itself counts in both sums and does nothing.
    return sparse.csr_array(full - sparse.diags_array(np.asarray(full.sum(axis=1)).ravel()))


LAPLACIANS = {
    "cotangent": cotangent_laplacian,
    "intrinsic-delaunay": intrinsic_delaunay_laplacian,
    "robust": robust_laplacian,
}
