"""Sliced Wasserstein distance: between vertices as in the paper, and between surfaces.

Paper, "Assessment of geometrical difference between two meshes". The Wasserstein distance
between projections onto a line is exact; only the directions (and samples) are random.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import InputError, MeshError
from ..progress import Progress, silent
from .mesh import face_areas

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Statistic = Literal["max", "mean"]

# The paper's numbers of directions and of repetitions.
PROJECTIONS = 50
EVALUATIONS = 10
SAMPLES = 20_000


class Sampled(NamedTuple):
    """A distance between random samples of two surfaces.

    Attributes
    ----------
    distance : float
    noise_floor : float
        The same distance between two independent samples of one and the same surface,
        the larger of both surfaces': a `distance` that is not above it is no difference.
    """

    distance: float
    noise_floor: float


def sliced_wasserstein(
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    *,
    projections: int = PROJECTIONS,
    evaluations: int = EVALUATIONS,
    order: int = 1,
    statistic: Statistic = "max",
    seed: int = 0,
    progress: Progress | None = None,
) -> float:
    """Sliced Wasserstein distance between two sets of points, every point weighing the same.

    The points are projected onto random directions, where the Wasserstein distance is that
    of the sorted coordinates. By default as in the paper: the largest of 50 directions, on
    average over 10 evaluations (POT's ``max_sliced_wasserstein_distance``; its own default
    is order 2, the paper speaks of order 1). A set moved by t is at n / (n + 1) times
    the length of t for n directions then, at half of it with the mean and order 1.

    The number depends on where the vertices are, not on the surface alone: a surface meshed
    anew is at a distance from itself. :func:`sampled_sliced_wasserstein` is free of that.

    Parameters
    ----------
    first, second : ndarray, (n, 3) and (m, 3)
    projections : int
        Directions per evaluation.
    evaluations : int
    order : int
        p of the p-Wasserstein distance: 1 or more.
    statistic : "max" or "mean"
        The largest over the directions, or the mean (of the p-th powers).
    seed : int
    progress : Progress, optional

    Returns
    -------
    float
        In the unit of the points.
    """
    _check_numbers(projections=projections, evaluations=evaluations, order=order)
    report = progress if progress is not None else silent()
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    values = []
    for evaluation in range(evaluations):
        directions = _directions(projections, np.random.default_rng([seed, evaluation]))
        part = report.part(evaluation / evaluations, (evaluation + 1) / evaluations)
        values.append(_sliced(a, b, directions, order, _statistic(statistic), part))
    return float(np.mean(values))


def sampled_sliced_wasserstein(
    first: tuple[Floats, Ints],
    second: tuple[Floats, Ints],
    *,
    samples: int = SAMPLES,
    projections: int = PROJECTIONS,
    evaluations: int = EVALUATIONS,
    order: int = 1,
    statistic: Statistic = "max",
    seed: int = 0,
    progress: Progress | None = None,
) -> Sampled:
    """Sliced Wasserstein distance between random points of two surfaces, uniform by area.

    Every evaluation draws new points and new directions. The noise floor has the same
    points per area as the distance, and falls as their number grows.

    Parameters
    ----------
    first, second : (vertices (n, 3), faces (m, 3))
    samples : int
        Points on each surface.
    projections, evaluations, order, statistic, seed, progress
        See :func:`sliced_wasserstein`.

    Raises
    ------
    MeshError
        A mesh has no area.
    """
    _check_numbers(samples=samples, projections=projections, evaluations=evaluations, order=order)
    report = progress if progress is not None else silent()
    reduce = _statistic(statistic)
    draw = _sampler(*first), _sampler(*second)
    values = np.zeros((evaluations, 3))
    for evaluation in range(evaluations):
        rng = np.random.default_rng([seed, evaluation])
        directions = _directions(projections, rng)
        (a, again), (b, anew) = (tuple(one(samples, rng) for _ in range(2)) for one in draw)
        for column, (x, y) in enumerate(((a, b), (a, again), (b, anew))):
            done = evaluation + column / 3
            part = report.part(done / evaluations, (done + 1 / 3) / evaluations)
            values[evaluation, column] = _sliced(x, y, directions, order, reduce, part)
    distance, *floors = values.mean(axis=0).tolist()
    return Sampled(distance, max(floors))


def _check_numbers(**numbers: int) -> None:
    for name, value in numbers.items():
        if value < 1:
            measured: dict[str, Any] = {name: value}
            raise InputError(f"What is given as {name!r} is at least 1.", **measured)


def _statistic(name: str) -> Callable[[Floats], Any]:
    if name not in ("max", "mean"):
        raise InputError(f"There is no statistic {name!r}.", hint="Choose 'max' or 'mean'.")
    return np.max if name == "max" else np.mean


def _directions(count: int, rng: np.random.Generator) -> Floats:
    """Unit vectors (count, 3), uniform on the sphere."""
    vectors = rng.normal(size=(count, 3))
    directions: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return directions


def _sampler(vertices: Floats, faces: Ints) -> Callable[[int, np.random.Generator], Floats]:
    """A function that draws points (count, 3) of the surface, uniform by area.

    The faces in their order are divided into `count` parts of equal area, and each part gets
    one point: neighbours in the order are mostly neighbours in space, so that far fewer
    points settle the distances than independent ones would.
    """
    filled = np.cumsum(face_areas(vertices, faces))
    if not filled.size or not filled[-1] > 0:
        raise MeshError("The mesh has no area.", faces=len(faces))
    corners = vertices[faces]

    def draw(count: int, rng: np.random.Generator) -> Floats:
        area = (np.arange(count) + rng.random(count)) * (filled[-1] / count)
        face = np.searchsorted(filled, area).clip(max=len(faces) - 1)
        weights = rng.random((2, count))
        weights = np.where(weights.sum(axis=0) > 1, 1 - weights, weights)
        a, b, c = np.moveaxis(corners[face], 1, 0)
        points: Floats = a + weights[0, :, None] * (b - a) + weights[1, :, None] * (c - a)
        return points

    return draw


def _sliced(
    first: Floats,
    second: Floats,
    directions: Floats,
    order: int,
    reduce: Callable[[Floats], Any],
    report: Progress,
) -> float:
    share, i, j = _quantiles(len(first), len(second))
    powers = np.empty(len(directions))
    for index, direction in enumerate(directions):
        report(index / len(directions), "sliced Wasserstein")
        gap = np.abs(_projected(first, direction)[i] - _projected(second, direction)[j])
        powers[index] = (share * (gap if order == 1 else gap**order)).sum()
    return float(reduce(powers) ** (1.0 / order))


def _projected(points: Floats, direction: Floats) -> Floats:
    """Sorted coordinates (n,) along a direction."""
    # No matrix product: its threads cost more than they save, and wait for other processes.
    along: Floats = np.sort(np.einsum("ij,j->i", points, direction))
    return along


def _quantiles(n: int, m: int) -> tuple[Floats, Ints, Ints]:
    """Which of n sorted values is moved to which of m, and how much of the mass goes so.

    Returns
    -------
    share : ndarray, (k,)
        Sums to 1.
    first, second : ndarray, (k,) int64
        Indices into the n and the m values.
    """
    # In multiples of 1 / (n m), so that equal levels are equal.
    ends = np.union1d(np.arange(1, n + 1) * m, np.arange(1, m + 1) * n)
    return np.diff(ends, prepend=0) / (n * m), (ends - 1) // m, (ends - 1) // n
