"""The flow that smooths protrusions away, and where it stops (paper, Step 1).

Conformalized mean curvature flow (Kazhdan, Solomon and Ben-Chen 2012,
doi:10.1111/j.1467-8659.2012.03179.x) keeps the Laplacian of the start; plain mean
curvature flow computes it anew at every iteration.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from ..charts import Floats, Ints
from ..errors import MeshError
from ..geometry.curvature import total_absolute_curvature
from ..geometry.intrinsic import LAPLACIANS
from ..geometry.laplacian import Factor, mass_matrix
from ..geometry.mesh import face_areas, signed_volume
from ..parameters import ReferenceParameters
from ..progress import Progress

logger = logging.getLogger(__name__)

MASS_FLOOR = 1e-14
FIT_ROUNDS = 10
# A change point is where a step falls to this fraction of the steepest since the last one.
ELBOW = 0.1
# SuperLU says that a matrix is singular by a RuntimeError.
BREAKDOWNS = (RuntimeError, MeshError)


@dataclass(frozen=True, eq=False)
class Flow:
    """The flow's vertices (n, 3) at its stop, around the origin, and the curve that stopped it.

    Their area is 1, or, where the volume is kept, that of the start divided by its area^(3/2).
    """

    vertices: Floats
    iteration: int
    total_curvature: Floats
    stopped_by: str


def curvature_flow(
    vertices: Floats,
    faces: Ints,
    parameters: ReferenceParameters,
    progress: Progress,
    *,
    mean_over: int | None = None,
    on_iteration: Callable[[Floats], None] | None = None,
) -> Flow:
    """Run the flow until its stopping rule fires.

    Parameters
    ----------
    vertices, faces : ndarray, (n, 3) and (m, 3)
        A closed mesh of any size and place.
    parameters : ReferenceParameters
    progress : Progress
    mean_over : int, optional
        Number of vertices of the mesh whose mean |K| the paper's rule speaks of, where the
        flow runs on a coarser one.
    on_iteration : callable, optional
        Called after every iteration with its vertices (n, 3).

    Raises
    ------
    MeshError
        The flow breaks down at its first iteration. Later it stops before that.
    """
    points = _normalized(vertices, faces)
    volume = signed_volume(points, faces) if parameters.keep_volume else None
    laplacian = LAPLACIANS[parameters.laplacian]
    stiffness = parameters.delta * laplacian(points, faces)
    curve = [total_absolute_curvature(points, faces)]
    rule = "maximum iterations"
    stop_at: int | None = None
    for iteration in range(1, parameters.iterations + 1):
        progress((iteration - 1) / parameters.iterations, f"smoothing, iteration {iteration}")
        try:
            if parameters.flow == "MCF" and iteration > 1:
                stiffness = parameters.delta * laplacian(points, faces)
            moved = flow_step(points, faces, stiffness, parameters.mass, progress)
            moved = _normalized(moved, faces, volume)
        except BREAKDOWNS as error:
            if iteration == 1:
                raise MeshError(
                    f"The smoothing flow breaks down at once: {error}",
                    hint="Choose the robust Laplacian, the barycentric mass or a smaller δ.",
                ) from error
            rule = "breakdown"
            logger.warning("the flow broke down after iteration %d: %s", iteration - 1, error)
            break
        points = moved
        if on_iteration is not None:
            on_iteration(points)
        curve.append(total_absolute_curvature(points, faces))
        if stop_at is None:
            fired = stopping_rule(np.array(curve), mean_over or len(vertices), parameters)
            if fired:
                rule, stop_at = fired, iteration + parameters.extra_iterations
        if stop_at is not None and iteration >= stop_at:
            break
    iteration = len(curve) - 1
    logger.info("%s stopped at iteration %d (%s)", parameters.flow, iteration, rule)
    return Flow(points, iteration, np.array(curve), rule)


def flow_step(points: Floats, faces: Ints, stiffness: Any, mass: str, progress: Progress) -> Floats:
    """One implicit step: ``(M_t − δ L) v(t+1) = M_t v(t)``.

    Parameters
    ----------
    points : ndarray, (n, 3)
        In units in which the masses are well above 1e-14.
    stiffness : sparse array, (n, n)
        δ L.
    mass : str
        See :func:`napari_unwrap3d.geometry.laplacian.mass_matrix`.
    """
    weights = mass_matrix(points, faces, mass, MASS_FLOOR)
    matrix = sparse.csr_array(weights - stiffness)
    moved: Floats = progress.run(Factor, matrix).solve(weights @ points)
    return moved


def stopping_rule(curve: Floats, vertices: int, parameters: ReferenceParameters) -> str:
    """The name of the rule that has fired by the last point of the curve, or an empty string.

    A rule that fires before the minimum iterations stops the flow there: the paper's
    max(t_min, t_K).

    Parameters
    ----------
    curve : ndarray, (t + 1,)
        Total |K| / 4π at iterations 0..t.
    vertices : int
        Number of vertices; the paper's rule speaks of the mean over them.
    """
    iteration = len(curve) - 1
    rule = parameters.stop
    if rule == "fixed":
        return rule if iteration >= parameters.fixed_iteration else ""
    if iteration < max(parameters.minimum_iterations, 1):
        return ""
    if rule == "total_curvature":
        fired = bool((curve[1:] < parameters.curvature_limit).any())
    elif rule == "paper":
        change = np.diff(curve) * 4.0 * np.pi / vertices
        fired = bool((change > -parameters.threshold).any())
    else:
        fired = len(change_points(curve)) >= parameters.change_point
    return rule if fired else ""


def change_points(curve: Floats) -> list[int]:
    """Iterations at which a falling curve has an elbow, in order.

    An elbow is where a step, not the first since the last elbow, is at most a tenth of the
    steepest one since then.
    """
    steps = -np.diff(curve)
    found: list[int] = []
    first = 0
    for last in range(len(steps)):
        if last > first and steps[last] <= ELBOW * steps[first : last + 1].max():
            found.append(last + 1)
            first = last
    return found


def fit_to(moved: Floats, original: Floats, mass: Floats, *, scale: float | None = None) -> Floats:
    """Scale and shift flowed vertices back onto the cortex they came from.

    The flow has its own size and no position. Vertices of the cortex hardly move, those of
    protrusions move far; minimising the sum of distances (not of squares), by iteratively
    reweighted least squares, follows the cortex. A given `scale` is kept.
    """
    weights = mass.copy()
    scale_length = np.sqrt(mass.sum())
    result = moved
    for _ in range(FIT_ROUNDS):
        share = weights / weights.sum()
        centre_moved, centre = share @ moved, share @ original
        a, b = moved - centre_moved, original - centre
        size = scale or float(
            share @ np.einsum("ij,ij->i", a, b) / (share @ np.einsum("ij,ij->i", a, a))
        )
        result = size * a + centre
        distance = np.linalg.norm(result - original, axis=1)
        weights = mass / np.maximum(distance, 1e-3 * scale_length)
    return result


def _normalized(points: Floats, faces: Ints, volume: float | None = None) -> Floats:
    """Unit area, or the given volume; the area-weighted centroid at the origin."""
    area = face_areas(points, faces)
    total = float(area.sum())
    if not 0.0 < total < np.inf:
        raise MeshError("The surface has collapsed.", area=total)
    centroid = area @ points[faces].mean(axis=1) / area.sum()
    if volume is None:
        normalized: Floats = (points - centroid) / np.sqrt(area.sum())
        return normalized
    enclosed = signed_volume(points, faces)
    if not enclosed > 0.0:
        raise MeshError("The surface encloses nothing any more.", volume=enclosed)
    normalized = (points - centroid) * np.cbrt(volume / enclosed)
    return normalized
