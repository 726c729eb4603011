"""Topographic cMCF: the surface in (d, u, v) flows flat, onto the (u, v) plane."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ..charts import Floats, Ints
from ..geometry.intrinsic import delaunay_edges, mollified
from ..geometry.laplacian import (
    Factor,
    conjugate_gradient,
    cotangents_from_lengths,
    faces_to_vertices,
)
from ..geometry.mesh import edges_with_faces, half_edges
from ..geometry.poles import Cylinder, corners
from ..parameters import PlaneParameters
from ..progress import Progress

logger = logging.getLogger(__name__)

# Edges have at least this weight where weights must be positive (an equilateral triangle's
# are 0.58): then the limit of the flow is Tutte's embedding, which has no flipped face.
SMALLEST_WEIGHT = 1e-2
STILL_PIXELS = 1e-3
SOLVER_TOLERANCE = 1e-13
SOLVER_ITERATIONS = 40
MASS_FLOOR = 1e-14


@dataclass(frozen=True)
class Stiffness:
    """The Laplacian L_0 of the inner vertices of a mesh whose u is periodic.

    Attributes
    ----------
    inner : sparse array, (n, n)
        Between inner vertices, negative definite.
    border : sparse array, (n, 6)
        From inner vertices to the copies of the poles, which stay where they are.
    turns : ndarray, (n,)
        What the edges over the seam add to L_0 u.
    """

    inner: sparse.csr_array
    border: sparse.csr_array
    turns: Floats

    def pull(self, fixed: Floats) -> Floats:
        """What borders and seam add to L_0 (d, v, u), (n, 3)."""
        right: Floats = self.border @ fixed
        right[:, 2] += self.turns
        return right


def stiffness(cylinder: Cylinder, rows: int, kind: str) -> Stiffness:
    """Weights of the surface in (d, u, v), in pixels; see :class:`Stiffness`.

    Parameters
    ----------
    kind : str
        "robust": cotangents of the intrinsic Delaunay triangulation; "cotangent": of the
        mesh's own triangles; "positive": these, raised to at least `SMALLEST_WEIGHT`.
    """
    # Corner k is opposite to the edge from corner k + 1 to corner k + 2.
    over = np.roll(cylinder.turns, -2, axis=1) - np.roll(cylinder.turns, -1, axis=1)
    edges = edges_with_faces(cylinder.faces)
    if kind == "robust":
        lengths = mollified(cylinder.lengths, edges.of_face)
        ends, weights, over = delaunay_edges(lengths, cylinder.faces, over)
    else:
        slots = edges.slots[edges.first]
        halves = 0.5 * cotangents_from_lengths(cylinder.lengths)
        weights = np.asarray(np.bincount(edges.of_face.ravel(), halves.ravel()), np.float64)
        if kind == "positive":
            weights = np.maximum(weights, SMALLEST_WEIGHT)
        ends, over = half_edges(cylinder.faces).reshape(-1, 2)[slots], over.ravel()[slots]
    step = np.asarray(2.0 * rows * over, np.float64)
    return _assembled(ends, weights, step, len(cylinder.points))


def _assembled(ends: Ints, weights: Floats, step: Floats, size: int) -> Stiffness:
    """From edges (k, 2), which may repeat, with weights (k,) and what u gains along them."""
    start, end = ends.T
    turns = np.bincount(start, weights * step, size) - np.bincount(end, weights * step, size)
    half = sparse.coo_array((weights, (start, end)), shape=(size, size)).tocsr()
    full = half + half.T
    # An edge from a vertex to itself counts in both sums and does nothing.
    laplacian = sparse.csr_array(full - sparse.diags_array(full.sum(axis=1)))
    inner = size - 6
    return Stiffness(
        inner=sparse.csr_array(laplacian[:inner, :inner]),
        border=sparse.csr_array(laplacian[:inner, inner:]),
        turns=np.asarray(turns[:inner], np.float64),
    )


def flow(
    cylinder: Cylinder,
    operator: Stiffness,
    rows: int,
    parameters: PlaneParameters,
    progress: Progress,
) -> tuple[Floats, int]:
    """Run the topographic cMCF until nothing moves any more (paper, Step 7).

    ``(M_t − δ L_0) x(t+1) = M_t x(t)`` for x = (d, v, u) in pixels. On the border the paper
    lets no flux through in u and v and d flow along it: the border is a point of the surface
    per pole, along which d is one and the same, so that it stays where it is.

    Returns
    -------
    points : ndarray, (n + 6, 3)
        The last (d, v, u).
    iterations : int
    """
    points = cylinder.points.copy()
    inner = len(points) - 6
    pull = parameters.delta * operator.pull(points[inner:])
    scaled = parameters.delta * operator.inner
    factor: Factor | None = None
    iteration = 0
    for iteration in range(1, parameters.iterations + 1):
        progress((iteration - 1) / parameters.iterations, f"flattening, iteration {iteration}")
        mass = _mass(points, cylinder, rows)
        matrix = sparse.csr_array(sparse.diags_array(mass) - scaled)
        right = mass[:, None] * points[:inner] + pull
        if factor is None:
            factor = progress.run(Factor, matrix)
        solution, converged = progress.run(
            conjugate_gradient,
            matrix,
            right,
            factor,
            tolerance=SOLVER_TOLERANCE,
            iterations=SOLVER_ITERATIONS,
        )
        if not converged:
            factor = progress.run(Factor, matrix)
            solution = factor.solve(right)
        moved = float(np.abs(solution[:, 1:] - points[:inner, 1:]).max())
        points[:inner] = solution
        logger.info("topographic cMCF, iteration %d: moved up to %.3g pixels", iteration, moved)
        if moved < STILL_PIXELS:
            break
    return points, iteration


def limit(cylinder: Cylinder, operator: Stiffness, progress: Progress) -> Floats:
    """Where the flow ends: (d, v, u) (n + 6, 3) with L_0 x = 0, by one solution."""
    points = cylinder.points.copy()
    inner = len(points) - 6
    pull = operator.pull(points[inner:])
    factor = progress.run(Factor, sparse.csr_array(-operator.inner))
    solution = factor.solve(pull)
    solution += factor.solve(pull + operator.inner @ solution)
    points[:inner] = solution
    return points


def _mass(points: Floats, cylinder: Cylinder, rows: int) -> Floats:
    """Barycentric mass (n,) of the inner vertices in pixels², as the surface now lies."""
    corner = corners(points, cylinder.faces, cylinder.turns, rows)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    mass = faces_to_vertices(area / 3.0, cylinder.faces, len(points))
    return np.maximum(mass[: len(points) - 6], MASS_FLOOR)
