"""Laplacians, mass matrices, and a factorised solver.

Sign convention: the Laplacian is negative semidefinite, so ``mass - delta * L`` is
positive definite (paper, Step 1).
"""

from __future__ import annotations

import threading
import weakref
from queue import SimpleQueue
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A triangle is treated as having at least this area relative to its longest edge squared,
# so that a collapsed triangle gives a large but finite cotangent, never NaN.
AREA_FLOOR = 1e-12


def cotangent_laplacian(vertices: Floats, faces: Ints) -> sparse.csr_array:
    """Cotangent Laplacian (n, n), negative semidefinite, symmetric, rows summing to zero."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    edges = (c - b, a - c, b - a)
    longest = np.max([np.einsum("ij,ij->i", e, e) for e in edges], axis=0)
    double_area = np.linalg.norm(np.cross(edges[1], edges[2]), axis=1)
    double_area = np.maximum(double_area, AREA_FLOOR * longest + 1e-300)
    cotangents = np.stack(
        [
            -np.einsum("ij,ij->i", edges[1], edges[2]),
            -np.einsum("ij,ij->i", edges[2], edges[0]),
            -np.einsum("ij,ij->i", edges[0], edges[1]),
        ],
        axis=1,
    )
    weights = 0.5 * cotangents / double_area[:, None]
    return laplacian_from_weights(weights, faces, len(vertices))


def cotangents_from_lengths(lengths: Floats) -> Floats:
    """Cotangents (m, 3) of the angles opposite to edges of given lengths (m, 3).

    The area is Heron's, with the floor of :data:`AREA_FLOOR`: lengths that no triangle has
    give large but finite numbers.
    """
    squared = lengths**2
    half = 0.5 * lengths.sum(axis=1)
    heron = half * np.prod(half[:, None] - lengths, axis=1)
    double_area = 2.0 * np.sqrt(np.maximum(heron, 0.0))
    double_area = np.maximum(double_area, AREA_FLOOR * squared.max(axis=1) + 1e-300)
    others = squared.sum(axis=1, keepdims=True) - 2.0 * squared
    return np.asarray(0.5 * others / double_area[:, None])


def laplacian_from_weights(weights: Floats, faces: Ints, size: int) -> sparse.csr_array:
    """Laplacian from one weight per corner, belonging to the edge opposite to the corner."""
    i = faces[:, [1, 2, 0]].ravel()
    j = faces[:, [2, 0, 1]].ravel()
    half = sparse.coo_array((weights.ravel(), (i, j)), shape=(size, size)).tocsr()
    full = half + half.T
    return sparse.csr_array(full - sparse.diags_array(np.asarray(full.sum(axis=1)).ravel()))


def pinned(laplacian: sparse.csr_array) -> sparse.csr_array:
    """The negative Laplacian (n, n) with one vertex tied to 0: positive definite.

    What it solves for a right-hand side that sums to zero is the Laplacian's own solution, 0
    at that vertex.
    """
    tie = sparse.coo_array(([1.0], ([0], [0])), shape=laplacian.shape)
    return sparse.csr_array(tie - laplacian)


def vertex_mass(vertices: Floats, faces: Ints) -> Floats:
    """Barycentric mass: a third of the area of the faces around each vertex, (n,)."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return faces_to_vertices(area / 3.0, faces, len(vertices))


def mass_matrix(vertices: Floats, faces: Ints, kind: str, floor: float = 0.0) -> sparse.dia_array:
    """Mass matrix (n, n), whose entries sum to the area.

    Parameters
    ----------
    kind : str
        "barycentric": a third of the faces around each vertex; "voronoi": the part of them
        that is nearest to the vertex (with the usual correction in obtuse faces); "full": the
        integrals of products of hat functions, not diagonal.
    floor : float
        Least entry of the diagonal, for vertices whose faces are collapsed.
    """
    if kind == "barycentric":
        return sparse.diags_array(np.maximum(vertex_mass(vertices, faces), floor))
    import igl

    types = {"voronoi": igl.MASSMATRIX_TYPE_VORONOI, "full": igl.MASSMATRIX_TYPE_FULL}
    matrix = sparse.csr_array(igl.massmatrix(vertices, faces, types[kind]))
    # A collapsed face has no circumcentre: what is not finite is no area.
    matrix.data[~np.isfinite(matrix.data)] = 0.0
    diagonal = matrix.diagonal()
    return matrix + sparse.diags_array(np.maximum(diagonal, floor) - diagonal)


def faces_to_vertices(values: Floats, faces: Ints, size: int) -> Floats:
    """Sum of a value per face, (m,) or (m, k), over the faces around each vertex."""
    flat = faces.ravel()
    if values.ndim == 1:
        return np.asarray(np.bincount(flat, np.repeat(values, 3), minlength=size), np.float64)
    columns = [np.bincount(flat, np.repeat(v, 3), minlength=size) for v in values.T]
    return np.stack(columns, axis=1)


class Factor:
    """Factorisation of a symmetric positive definite sparse matrix, made once, used often.

    Minimum degree ordering of A's own pattern is several times faster than SuperLU's
    default for the Laplacians of surfaces, and no larger supernodes than the factor itself
    has a third faster again.
    """

    def __init__(self, matrix: Any) -> None:
        # SciPy gives a factor's memory back only in the thread that made it, which must
        # therefore live as long; elsewhere it would be lost without a word.
        made: SimpleQueue[Any] = SimpleQueue()
        over: SimpleQueue[None] = SimpleQueue()
        threading.Thread(
            target=_factorise, args=([matrix], made, over), name="factor", daemon=True
        ).start()
        del matrix
        self._lu = made.get()
        if isinstance(self._lu, BaseException):
            raise self._lu
        # The garbage collector may come at any time, also while a lock is held: putting into
        # this kind of queue is all that it may do.
        weakref.finalize(self, over.put, None).atexit = False

    def solve(self, right: Floats) -> Floats:
        """Solution of A x = right, for right (n,) or (n, k)."""
        solution: Floats = self._lu[0].solve(right)
        return solution


def _factorise(matrix: list[Any], made: SimpleQueue[Any], over: SimpleQueue[None]) -> None:
    """Make a factor, and wait until it is over with it; runs in a thread of its own."""
    factor: list[Any] = []
    try:
        factor.append(_factorised(matrix.pop()))
    except BaseException as error:  # noqa: BLE001 (raised in the thread that asked)
        made.put(error)
        return
    made.put(factor)
    over.get()
    factor.clear()


def _factorised(matrix: Any) -> Any:
    return splu(
        sparse.csc_array(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        relax=1,
        panel_size=1,
        options={"SymmetricMode": True},
    )


def conjugate_gradient(
    matrix: Any, right: Floats, preconditioner: Factor, *, tolerance: float, iterations: int
) -> tuple[Floats, bool]:
    """Solve A X = right, (n, k), with an older factor as preconditioner.

    Returns the solution and whether the residual fell below `tolerance` times the
    largest entry of `right` within `iterations`.
    """
    limit = tolerance * np.abs(right).max()
    x = preconditioner.solve(right)
    r = right - matrix @ x
    if np.abs(r).max() < limit:
        return x, True
    z = preconditioner.solve(r)
    p = z.copy()
    rz = np.einsum("ij,ij->j", r, z)
    for _ in range(iterations):
        ap = matrix @ p
        step = rz / np.maximum(np.einsum("ij,ij->j", p, ap), 1e-300)
        x = x + step * p
        r = r - step * ap
        if np.abs(r).max() < limit:
            return x, True
        z = preconditioner.solve(r)
        rz_next = np.einsum("ij,ij->j", r, z)
        p = z + (rz_next / np.maximum(rz, 1e-300)) * p
        rz = rz_next
    return x, False


class ReusedFactor:
    """Solves with slowly changing matrices: the factor of an early one preconditions."""

    def __init__(self, factor: Factor | None = None) -> None:
        self.factor = factor

    def solve(self, matrix: sparse.csr_array, right: Floats) -> Floats:
        """Solution of A x = right, for right (n,) or (n, k)."""
        if self.factor is not None:
            columns = right[:, None] if right.ndim == 1 else right
            solution, solved = conjugate_gradient(
                matrix, columns, self.factor, tolerance=1e-10, iterations=40
            )
            if solved:
                return solution.reshape(right.shape)
        self.factor = Factor(matrix)
        return self.factor.solve(right)
