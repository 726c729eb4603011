"""A mesh with one border on the unit disk: harmonic, then equiareal, and never flipped.

Points of the disk are (v, u), so that a face that is wound outward in (z, y, x) has a
positive determinant there and an image of the disk is seen from outside, not mirrored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from ..errors import FlippedFacesError, NotADiskError
from ..progress import Progress
from .area_flow import area_error, area_velocity, has_stalled, move_unflipped, share_of
from .area_polish import VertexStars
from .disk_polish import polish_disk
from .holes import boundary_loops
from .laplacian import (
    Factor,
    ReusedFactor,
    cotangent_laplacian,
    cotangents_from_lengths,
    faces_to_vertices,
    laplacian_from_weights,
)
from .mesh import connected_components, euler_characteristic, face_areas

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

CYCLES = 6
POLISH_ROUNDS, POLISH_SWEEPS = 4, 5
CENTRINGS, SPREADINGS = 20, 6
# Weights of a fallback are taken down where the map shrinks, this many times at the most.
REWEIGHTINGS = 40
SMALLEST_SHARE = 1e-24
LEAST_WEIGHT = 0.05
# Edges of the border count at least this part of their mean.
SHORTEST = 1e-3
CENTRED = 1e-3


@dataclass(frozen=True)
class DiskTopology:
    """What makes a mesh a disk, or not.

    Attributes
    ----------
    pieces, loops, genus : int
        Connected pieces, loops of the border, and handles.
    """

    pieces: int
    loops: int
    genus: int

    @property
    def is_disk(self) -> bool:
        return (self.pieces, self.loops, self.genus) == (1, 1, 0)


def disk_topology(faces: Ints) -> DiskTopology:
    """Pieces, loops of the border and genus, from χ = 2 pieces − 2 g − b.

    The faces are wound consistently, and every vertex has one fan.
    """
    pieces = int(connected_components(faces)[0].max()) + 1
    loops = len(boundary_loops(faces))
    return DiskTopology(pieces, loops, (2 * pieces - loops - euler_characteristic(faces)) // 2)


def border(faces: Ints) -> Ints:
    """The vertices (k,) of the border of a disk in the order in which its faces run.

    Raises
    ------
    NotADiskError
        The mesh is in pieces, has a handle, no border, or more than one.
    """
    found = disk_topology(faces)
    if not found.is_disk:
        raise NotADiskError(
            "Only a surface with one border and without handles can be laid on a disk.",
            pieces=found.pieces,
            boundary_loops=found.loops,
            genus=found.genus,
            hint="Fill its holes, or take the sealed surface, which has no handles.",
        )
    return boundary_loops(faces)[0][::-1]


def disk_determinants(points: Floats, faces: Ints) -> Floats:
    """Twice the signed area (m,) of every face of a planar mesh; positive if not flipped."""
    a = points[faces[:, 0]]
    p, q = points[faces[:, 1]] - a, points[faces[:, 2]] - a
    determinants: Floats = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    return determinants


def flipped(points: Floats, faces: Ints) -> int:
    """Number of faces of a planar mesh that are flipped, without area, or not finite."""
    return int((~(disk_determinants(points, faces) > 0)).sum())


# Harmonic ----------------------------------------------------------------------


def harmonic_disk(vertices: Floats, faces: Ints) -> Floats:
    """The harmonic map to the unit disk: the border by its lengths, ∇²φ = 0 inside.

    With cotangent weights; where those flip a face, with positive ones, which never do
    (Tutte 1963, doi:10.1112/plms/s3-13.1.743; Floater 2003,
    doi:10.1016/S0167-8396(03)00002-5). Where a long protrusion shrinks to less than numbers
    resolve, the weights of edges that shrink are taken down until it does not (Yoshizawa,
    Belyaev and Seidel 2004, doi:10.1109/SMI.2004.1314516). Paper, "Direct 2D unwrapping of
    protrusion submeshes".

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Of disk topology, every vertex in a face.

    Returns
    -------
    ndarray, (n, 2)
        (v, u). The vertex of the border that comes first in (z, y, x) lies at the top, (−1, 0).

    Raises
    ------
    NotADiskError
        The mesh has no disk topology.
    FlippedFacesError
        Every choice of weights leaves faces that numbers do not resolve.
    """
    loop = border(faces)
    circle = _on_circle(vertices, loop)
    best = _tutte(cotangent_laplacian(vertices, faces), loop, circle)
    if flipped(best, faces) == 0:
        return best
    weights = _positive_weights(vertices, faces)
    for _ in range(REWEIGHTINGS):
        best = _tutte(laplacian_from_weights(weights, faces, len(vertices)), loop, circle)
        left = flipped(best, faces)
        if left == 0:
            return best
        weights /= _shrinking(vertices, best, faces)[:, None]
    raise FlippedFacesError(
        "The protrusion is too long to be laid on a disk.",
        flipped=left,
        hint="Remesh it with triangles of equal size, or cut it in two.",
    )


def _on_circle(vertices: Floats, loop: Ints) -> Floats:
    """Points (k, 2) of the border on the unit circle, spaced as its edges are long."""
    first = np.lexsort(vertices[loop].T[::-1])[0]
    lengths = np.linalg.norm(vertices[np.roll(loop, -1)] - vertices[loop], axis=1)
    # Two points in one place would be a face without area.
    lengths = np.maximum(lengths, SHORTEST * lengths.mean())
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    angle = 2.0 * np.pi * (along[:-1] - along[first]) / along[-1]
    return -np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _tutte(laplacian: sparse.csr_array, loop: Ints, circle: Floats) -> Floats:
    """Every inner vertex in the weighted mean of its neighbours, the border on the circle."""
    points = np.zeros((laplacian.shape[0], 2))
    points[loop] = circle
    inner = np.setdiff1d(np.arange(len(points)), loop)
    if len(inner):
        rows = laplacian[inner]
        points[inner] = Factor(-rows[:, inner]).solve(rows[:, loop] @ circle)
    return points


def _positive_weights(vertices: Floats, faces: Ints) -> Floats:
    """Cotangents of the corners (m, 3) of at least :data:`LEAST_WEIGHT`, halved."""
    corners = vertices[faces]
    across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    cotangents = cotangents_from_lengths(np.linalg.norm(across, axis=2))
    weights: Floats = 0.5 * np.clip(cotangents, LEAST_WEIGHT, 1.0 / LEAST_WEIGHT)
    return weights


def _shrinking(vertices: Floats, points: Floats, faces: Ints) -> Floats:
    """How many times smaller a map makes each face, as a length (m,)."""
    before = share_of(face_areas(vertices, faces))
    after = np.maximum(share_of(np.abs(disk_determinants(points, faces))), SMALLEST_SHARE)
    shrinking: Floats = np.sqrt(before / after)
    return shrinking


# Equiareal ---------------------------------------------------------------------


def equiareal_disk(
    vertices: Floats,
    faces: Ints,
    harmonic: Floats,
    progress: Progress,
    *,
    iterations: int = 60,
    tolerance: float = 0.005,
) -> tuple[Floats, Floats]:
    """Relax the areas of a map to the disk: every face gets its share of the surface.

    The disk is centred by a Möbius transformation and its radii are spread until every
    circle around the centre holds its share, which undoes most of what a harmonic map
    shrinks; the area-preserving flow (Zou et al. 2011, doi:10.1109/TVCG.2011.264) does the
    rest of what is smooth, and Gauss–Newton steps on single vertices what is not. The border
    slides along the circle. No step flips a face. Paper, "Direct 2D unwrapping of protrusion
    submeshes".

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    harmonic : ndarray, (n, 2)
        Points of the disk without flips, the border on the circle.
    progress : Progress
    iterations, tolerance
        Of the flow: stop after so many in a row, or when mean |log(area / target)| is below
        the tolerance.

    Returns
    -------
    points : ndarray, (n, 2)
        Never flipped; turned about the centre so that it agrees best with `harmonic`.
    history : ndarray
        Mean |log(area / target)| of `harmonic`, after every step, and of `points`, the least.
    """
    relaxation = _Relaxation(vertices, faces, harmonic)
    relaxation.centre()
    relaxation.spread()
    for cycle in range(CYCLES):
        part = progress.part(cycle / CYCLES, (cycle + 1) / CYCLES)
        relaxation.flow(iterations, tolerance, part)
        before = relaxation.error
        for _ in range(POLISH_ROUNDS):
            part.check()
            if relaxation.error > tolerance:
                relaxation.polish()
        if relaxation.error <= tolerance or relaxation.error > 0.98 * before:
            break
    return _turned_towards(relaxation.best, harmonic), np.array(relaxation.history)


class _Relaxation:
    """A map to the disk on its way to equal areas."""

    def __init__(self, vertices: Floats, faces: Ints, points: Floats) -> None:
        self.faces = faces
        self.points = points
        self.target = share_of(face_areas(vertices, faces))
        self.mass = faces_to_vertices(self.target / 3.0, faces, len(vertices))
        self.on_circle = np.zeros(len(vertices), bool)
        self.on_circle[border(faces)] = True
        self.stars = VertexStars(faces, len(vertices))
        self.solver = ReusedFactor()
        self.history = [self._error_of(points)]
        self.best = points

    @property
    def error(self) -> float:
        return self.history[-1]

    def centre(self) -> None:
        """Bring the centre of mass to the middle by Möbius transformations of the disk."""
        for _ in range(CENTRINGS):
            z = self.points[:, 0] + 1j * self.points[:, 1]
            middle = complex(self.mass @ z)
            if abs(middle) < CENTRED:
                return

            def displaced(step: Floats, z: npt.NDArray[np.complex128] = z) -> Floats:
                a = step.min() * middle  # noqa: B023 (used within the turn of the loop)
                moved = (z - a) / (1.0 - np.conj(a) * z)
                return self._rounded(np.stack([moved.real, moved.imag], axis=1))

            if not self._move(displaced):
                return

    def spread(self) -> None:
        """Give every circle around the middle the area that is inside of it."""
        for _ in range(SPREADINGS):
            radius = np.linalg.norm(self.points, axis=1)
            order = np.argsort(radius, kind="stable")
            inside = np.empty(len(order))
            inside[order] = np.cumsum(self.mass[order]) - 0.5 * self.mass[order]
            inner = ~self.on_circle & (radius > 0)
            growth = np.zeros(len(radius))
            growth[inner] = 0.5 * np.log(inside[inner]) - np.log(radius[inner])

            def displaced(step: Floats, growth: Floats = growth) -> Floats:
                return self.points * np.exp(step * growth[:, None])

            if not self._move(displaced) or self.error > 0.98 * self.history[-2]:
                return

    def flow(self, iterations: int, tolerance: float, progress: Progress) -> None:
        """Poisson flow until it is good enough or stalls."""
        start = len(self.history)
        for iteration in range(iterations):
            if self.error <= tolerance or has_stalled(self.history[start - 1 :]):
                return
            progress(iteration / iterations, f"equalising areas: |log λ| {self.error:.4f}")
            flat = np.pad(self.points, ((0, 0), (1, 0)))
            velocity = area_velocity(flat, self.faces, self.target, self.solver)[:, 1:]

            def displaced(step: Floats, velocity: Floats = velocity) -> Floats:
                return self._rounded(self.points + step * velocity)

            if not self._move(displaced):
                return

    def polish(self) -> None:
        """What the flow cannot see: the differences between neighbouring faces."""
        polished = polish_disk(
            self.points, self.faces, self.stars, self.target, self.on_circle, POLISH_SWEEPS
        )
        self._take(polished)

    def _move(self, displaced: Callable[[Floats], Floats]) -> bool:
        """Move as far as no face flips; False if that is nowhere."""
        moved = move_unflipped(
            self.points, displaced, lambda x: disk_determinants(x, self.faces), self.faces
        )
        if moved is not None:
            self._take(moved)
        return moved is not None

    def _take(self, points: Floats) -> None:
        self.points = points
        self.history.append(self._error_of(points))
        if self.history[-1] <= min(self.history):
            self.best = points

    def _error_of(self, points: Floats) -> float:
        return area_error(np.pad(points, ((0, 0), (1, 0))), self.faces, self.target)

    def _rounded(self, points: Floats) -> Floats:
        """The points of the border back on the circle."""
        length = np.linalg.norm(points, axis=1, keepdims=True)
        rounded: Floats = np.where(self.on_circle[:, None], points / length, points)
        return rounded


def _turned_towards(points: Floats, other: Floats) -> Floats:
    """A disk turned about its centre to where it agrees best with another."""
    p, q = (x[:, 0] + 1j * x[:, 1] for x in (points, other))
    turn = np.vdot(p, q)
    turned = p * (turn / abs(turn) if abs(turn) > 0 else 1.0)
    return np.stack([turned.real, turned.imag], axis=1)
