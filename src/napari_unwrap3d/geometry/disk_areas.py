"""From any map to the unit disk without flips to one that keeps areas, without flips.

What shrinks most is undone by Tutte embeddings with weights that yield there
(:func:`.disk.spread_disk`) and by spreading the radii; the rest by Gauss–Newton steps on the
logarithms of all areas at once, damped by how much they deform, each followed by one on every
single vertex, which frees the faces that hold up a step of all (:mod:`.disk_polish`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from ..progress import Progress
from .area_polish import VertexStars
from .disk import border, disk_determinants, spread_disk
from .disk_polish import polish_disk
from .laplacian import Factor, faces_to_vertices, laplacian_from_weights
from .mesh import face_areas

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A step may shrink a face's determinant to this fraction at the most.
KEPT_DETERMINANT = 0.1
# Up to this fraction of bad faces only their own vertices are slowed down, so many times.
FEW_FACES, SLOWINGS, SHORTENINGS = 0.02, 25, 80
CENTRINGS, SPREADINGS = 20, 20
# How well a map is centred, in radii of the part whose centre is sought; down to which part
# of the mass, and of how many vertices at least.
CENTRED = 0.05
SMALLEST_CORE, FEWEST = 0.02, 8
# Radii that differ by less than this part are one.
TIE = 1e-6
# Damping per squared error: far from the goal the map must not be crumpled.
DAMPING = 10.0
# The steps end when so many of them gained less than this part.
PATIENCE, SMALLEST_GAIN = 20, 0.05


def equiareal_disk(
    vertices: Floats,
    faces: Ints,
    start: Floats,
    progress: Progress,
    *,
    iterations: int = 100,
    tolerance: float = 0.01,
) -> tuple[Floats, Floats]:
    """Relax the areas of a map to the disk: every face gets its share of the surface.

    The border slides along the circle. No step flips a face. Takes the place of the paper's
    area-preserving flow ("Direct 2D unwrapping of protrusion submeshes"), which stalls far
    from the goal on what is thin and long.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Of disk topology.
    start : ndarray, (n, 2)
        Points of the disk without flips, the border on the circle.
    progress : Progress
    iterations, tolerance
        Stop after so many steps, or when mean |log(area / target)| is below the tolerance.

    Returns
    -------
    points : ndarray, (n, 2)
        The best that was met, turned about the centre to agree with `start`.
    history : ndarray
        Mean |log(area / target)| at the start and after every step.
    """
    progress(0.0, "spreading over the disk")
    relaxation = _Relaxation(vertices, faces, progress.run(spread_disk, vertices, faces, start))
    relaxation.spread()
    for iteration in range(iterations):
        if relaxation.least <= tolerance or relaxation.has_stalled():
            break
        message = f"equalising areas: |log λ| {relaxation.least:.3f}"
        progress(0.3 + 0.7 * iteration / iterations, message)
        if not progress.run(relaxation.step):
            break
    return _turned_towards(relaxation.best, start), np.array(relaxation.history)


class _Relaxation:
    """A map to the disk on its way to equal areas."""

    def __init__(self, vertices: Floats, faces: Ints, points: Floats) -> None:
        self.faces = faces
        areas = face_areas(vertices, faces)
        self.target: Floats = areas / areas.sum()
        self.mass = faces_to_vertices(self.target / 3.0, faces, len(vertices))
        self.on_circle = np.zeros(len(vertices), bool)
        self.on_circle[border(faces)] = True
        self.stars = VertexStars(faces, len(vertices))
        self.points = self.best = points
        # By their place, so that it does not matter how they are numbered.
        self.order = np.lexsort(vertices.T[::-1])
        self.history = [self._error_of(points)]

    @property
    def least(self) -> float:
        """The least error so far."""
        return min(self.history)

    def has_stalled(self) -> bool:
        if len(self.history) <= PATIENCE:
            return False
        return self.least > (1.0 - SMALLEST_GAIN) * min(self.history[:-PATIENCE])

    # The radii -----------------------------------------------------------------

    def spread(self) -> None:
        """Give every circle around the middle the area that is inside of it.

        The middle is where most shrinks or the centre of mass, whichever is the better; or
        nothing is changed, if that is best.
        """
        start = self.points
        tried = [start]
        for least in (SMALLEST_CORE, 1.0):
            self.points = start
            self._centre(least)
            self._spread_radii()
            tried.append(self.points)
        self.points = self.best = min(tried, key=self._error_of)
        self.history.append(self._error_of(self.best))

    def _centre(self, least: float) -> None:
        """Bring the middle of a map to (0, 0) by Möbius transformations of the disk.

        The centre of mass, then that of the half of the vertices next to it, and so on while
        they have more than `least` of the mass: the end of a tube, which shrinks with every
        width of it.
        """
        for _ in range(CENTRINGS):
            z = self.points[:, 0] + 1j * self.points[:, 1]
            middle, part = complex(self.mass @ z), 1.0
            chosen = np.arange(len(z))
            while part > least and len(chosen) > FEWEST:
                away = np.abs(z[chosen] - middle)
                near = away <= (1.0 + TIE) * np.median(away)
                if near.all():
                    break
                chosen = chosen[near]
                part = float(self.mass[chosen].sum())
                middle = complex(self.mass[chosen] @ z[chosen]) / part
            if abs(middle) < max(CENTRED * float(np.abs(z[chosen] - middle).max()), 1e-15):
                return

            def displaced(
                step: Floats, z: npt.NDArray[np.complex128] = z, middle: complex = middle
            ) -> Floats:
                a = float(step.min()) * middle
                moved = (z - a) / (1.0 - np.conj(a) * z)
                return self._rounded(np.stack([moved.real, moved.imag], axis=1))

            if not self._move(displaced):
                return

    def _spread_radii(self) -> None:
        before = self._error_of(self.points)
        for _ in range(SPREADINGS):
            growth = self._growth()

            def displaced(step: Floats, growth: Floats = growth) -> Floats:
                return self.points * np.exp(step * growth[:, None])

            if not self._move(displaced):
                return
            error = self._error_of(self.points)
            if error > (1.0 - SMALLEST_GAIN) * before:
                return
            before = error

    def _growth(self) -> Floats:
        """By how much the logarithm of each radius (n,) grows: smooth, 0 on the circle.

        Interpolated between some radii, so that vertices of one radius keep one.
        """
        radius = np.linalg.norm(self.points, axis=1)
        order = np.argsort(radius, kind="stable")
        inside = np.cumsum(self.mass[order])
        count = max(int(np.sqrt(len(order))), FEWEST)
        knots = np.unique(np.linspace(0, len(order) - 1, count).astype(np.int64)[1:])
        knots = knots[radius[order[knots]] > 0]
        at = np.log(radius[order[knots]])
        last = np.concatenate([np.diff(at) > TIE, [True]])
        growth = 0.5 * np.log(inside[knots]) - at
        inner = ~self.on_circle & (radius > 0)
        found = np.zeros(len(radius))
        found[inner] = np.interp(np.log(radius[inner]), at[last], growth[last])
        return found

    # The areas -----------------------------------------------------------------

    def step(self) -> bool:
        """One step of all vertices, then one of each; False if nothing could move."""
        displacement = self._gauss_newton(DAMPING * self.history[-1] ** 2)

        def displaced(step: Floats) -> Floats:
            return self._rounded(self.points + step * displacement)

        if not self._move(displaced):
            return False
        self.points = polish_disk(
            self.points, self.faces, self.stars, self.target, self.on_circle, self.order
        )
        error = self._error_of(self.points)
        if error < self.least:
            self.best = self.points
        self.history.append(error)
        return True

    def _gauss_newton(self, damping: float) -> Floats:
        """The displacement (n, 2) for which Σ (log ratio of the areas)² falls fastest.

        `damping` weighs the squared gradient of the displacement, summed over the faces.
        """
        faces, size = self.faces, len(self.points)
        double = disk_determinants(self.points, faces)
        # Limited, so that what is far off does not outweigh all else.
        residual = np.tanh(np.log(double / double.sum() / self.target))
        corners = self.points[faces]
        across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        slope = np.stack([-across[..., 1], across[..., 0]], axis=2) / double[:, None, None]
        free = self._freedoms()
        columns = (2 * faces[..., None] + np.arange(2)).ravel()
        rows = np.repeat(np.arange(len(faces)), 6)
        shape = (len(faces), 2 * size)
        jacobian = sparse.csr_array((slope.ravel(), (rows, columns)), shape=shape) @ free
        dot = np.einsum("ijk,ijk->ij", np.roll(across, -1, axis=1), np.roll(across, -2, axis=1))
        # The Dirichlet energy of each face over its area.
        bending = laplacian_from_weights(-dot / double[:, None] ** 2, faces, size)
        deforming = free.T @ sparse.kron(-bending, sparse.eye_array(2)) @ free
        matrix = jacobian.T @ jacobian + damping * deforming
        matrix = matrix + 1e-12 * abs(matrix).max() * sparse.eye_array(matrix.shape[0])
        displacement: Floats = free @ Factor(matrix).solve(-(jacobian.T @ residual))
        return displacement.reshape(size, 2)

    def _freedoms(self) -> sparse.csr_array:
        """Displacements (2 n, k): both ways inside, along the circle on the border."""
        inner, rim = np.flatnonzero(~self.on_circle), np.flatnonzero(self.on_circle)
        along = np.stack([-self.points[rim, 1], self.points[rim, 0]], axis=1)
        values = np.concatenate([np.ones(2 * len(inner)), along.ravel()])
        rows = np.concatenate([(2 * each[:, None] + [0, 1]).ravel() for each in (inner, rim)])
        columns = np.concatenate(
            [np.arange(2 * len(inner)), 2 * len(inner) + np.repeat(np.arange(len(rim)), 2)]
        )
        shape = (2 * len(self.points), 2 * len(inner) + len(rim))
        return sparse.csr_array((values, (rows, columns)), shape=shape)

    # Moving --------------------------------------------------------------------

    def _move(self, displaced: Callable[[Floats], Floats]) -> bool:
        """Move as far as no face flips; False if that is nowhere.

        `displaced` gives the points for a step (n, 1) of each. Where a few faces object, their
        vertices are slowed down; where many do, or it does not help, all are.
        """
        least = KEPT_DETERMINANT * disk_determinants(self.points, self.faces)
        step = np.ones((len(self.points), 1))
        for shortening in range(SHORTENINGS):
            moved = displaced(step)
            bad = ~(disk_determinants(moved, self.faces) > least)
            if not bad.any():
                self.points = moved
                return True
            if bad.mean() > FEW_FACES or shortening > SLOWINGS:
                step *= 0.6
            else:
                step[np.unique(self.faces[bad])] *= 0.5
        return False

    def _error_of(self, points: Floats) -> float:
        double = disk_determinants(points, self.faces)
        return float(np.abs(np.log(double / double.sum() / self.target)).mean())

    def _rounded(self, points: Floats) -> Floats:
        """The points of the border back on the circle."""
        length = np.linalg.norm(points, axis=1, keepdims=True)
        rounded: Floats = np.where(
            self.on_circle[:, None], points / np.maximum(length, 1e-300), points
        )
        return rounded


def _turned_towards(points: Floats, other: Floats) -> Floats:
    """A disk turned about its centre to where it agrees best with another."""
    p, q = (x[:, 0] + 1j * x[:, 1] for x in (points, other))
    turn = np.vdot(p, q)
    turned = p * (turn / abs(turn) if abs(turn) > 0 else 1.0)
    return np.stack([turned.real, turned.imag], axis=1)
