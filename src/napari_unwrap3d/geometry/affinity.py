"""Affinity of neighbouring vertices by distance and bend, and labels that spread by it.

Zhou et al. (2003), "Learning with local and global consistency": F ← α S F + (1 − α) Y with
the symmetrically normalised affinity S and the labels given Y.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from .mesh import edges_with_faces, vertex_normals

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


def edge_affinity(vertices: Floats, faces: Ints, weight: float) -> sparse.csr_array:
    """Affinity (n, n) of the vertices at the ends of every edge, and 1 of each to itself.

    ``γ exp(−L² / 2 mean(L)²) + (1 − γ) exp(−B² / 2 mean(B)²)``, with the lengths of the edges
    L and their bends B = (1 − cos of the angle between the normals at their ends) / 2.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    weight : float
        γ in 0…1.
    """
    a, b = edges_with_faces(faces).vertices.T
    normals = vertex_normals(vertices, faces)
    length = np.linalg.norm(vertices[a] - vertices[b], axis=1)
    bend = 0.5 * (1.0 - np.einsum("ij,ij->i", normals[a], normals[b]))
    value = weight * _bell(length) + (1.0 - weight) * _bell(bend)
    half = sparse.coo_array((value, (a, b)), shape=(len(vertices),) * 2)
    return sparse.csr_array(half + half.T + sparse.eye_array(len(vertices)))


def _bell(distance: Floats) -> Floats:
    mean = max(float(distance.mean()), 1e-300)
    return np.asarray(np.exp(-0.5 * (distance / mean) ** 2))


def normalised(affinity: sparse.csr_array) -> sparse.csr_array:
    """S = D^−½ A D^−½ with the sums of the rows D."""
    root = sparse.diags_array(1.0 / np.sqrt(np.asarray(affinity.sum(axis=1)).ravel()))
    return sparse.csr_array(root @ affinity @ root)


def spread_labels(
    affinity: sparse.csr_array, labels: npt.NDArray[np.integer], iterations: int, clamping: float
) -> npt.NDArray[np.int32]:
    """Labels (n,) that spread over vertices without one, a ring of neighbours per iteration.

    Parameters
    ----------
    affinity : sparse array, (n, n)
        As from :func:`edge_affinity`.
    labels : ndarray, (n,)
        From 1, 0 = none.
    clamping : float
        α in 0…1: how much comes from the neighbours, not from `labels`.
    """
    spread = normalised(affinity)
    names, column = np.unique(labels[labels > 0], return_inverse=True)
    given = np.zeros((len(labels), len(names)), np.float32)
    given[np.flatnonzero(labels > 0), column] = 1.0
    chance = given
    step = spread.astype(np.float32)
    for _ in range(iterations):
        chance = np.float32(clamping) * (step @ chance) + np.float32(1.0 - clamping) * given
    if len(names) == 0:
        return np.zeros(len(labels), np.int32)
    best = names[chance.argmax(axis=1)]
    return np.where(chance.max(axis=1) > 0, best, 0).astype(np.int32)


def spread_binary(
    affinity: sparse.csr_array,
    marked: Bools,
    never: Bools,
    iterations: int,
    clamping: float,
    threshold: float,
) -> Bools:
    """Two classes that spread over each other, made binary before each iteration.

    Parameters
    ----------
    affinity : sparse array, (n, n)
    marked : ndarray, (n,) bool
        The first class; the others are the second.
    never : ndarray, (n,) bool
        Vertices that stay in the second class, whatever their neighbours are.
    iterations : int
    clamping : float
        α in 0…1.
    threshold : float
        Least chance of the first class that makes a vertex one of it. Up to about ¼ a
        straight front moves on in every iteration, and only `never` ends it.
    """
    spread = normalised(affinity)
    given = np.stack([marked & ~never, ~marked | never], axis=1).astype(np.float64)
    now = given
    for _ in range(iterations):
        chance = clamping * (spread @ now) + (1.0 - clamping) * given
        first = (chance[:, 0] >= threshold * chance.sum(axis=1)) & ~never
        now = np.stack([first, ~first], axis=1).astype(np.float64)
    return now[:, 0] > 0
