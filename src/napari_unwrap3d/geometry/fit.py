"""Fit one mesh to another: rigidly, stretched as a whole, then bent, softer and softer.

Every vertex is drawn to the plane of the nearest place of the target, and every place of the
target draws the nearest place of the mesh, so that what has grown pulls as much as what has
shrunk pushes. Sliding along the surface costs nothing by itself: how the mesh stretches is left
to its resistance (Sorkine and Alexa 2007, doi:10.2312/SGP/SGP07/109-116), whose share falls.
Point to plane after Chen and Medioni 1992, doi:10.1016/0262-8856(92)90066-C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from ..progress import Progress
from .laplacian import Factor, Floats, Ints, cotangent_laplacian, vertex_mass
from .locate import SurfaceLocator, interpolate
from .mesh import vertex_normals
from .rigid import Rigid

RIGID_ITERATIONS = 40
# A step that turns or moves the mesh by less than this part of its size is the last one.
RIGID_STILL = 1e-5
AFFINE_ITERATIONS, AFFINE_STILL, AFFINE_HOLD = 40, 1e-4, 0.01
# Features larger than this part of the radius are followed, first and last.
STIFFNESSES = (0.5, 0.2, 0.06, 0.02)
ITERATIONS = 6
# Where the planes lie farther away than so many times the median, and than this part of the
# radius, they draw less.
FAR, NEAR = 3.0, 0.1


def fit_mesh(vertices: Floats, faces: Ints, target: Target, progress: Progress) -> Floats:
    """Vertices (n, 3) of a mesh brought onto another, its places with it as far as can be told.

    Rigidly first, then stretched as a whole, and bent last, with as little strain beyond that
    as leads there: of a smooth body its shape tells no more.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    target : Target
    progress : Progress
    """
    motion = fit_rigid(vertices, faces, target, progress.part(0.0, 0.3))
    stretched = fit_affine(motion.apply(vertices), faces, target, progress.part(0.3, 0.5))
    return fit_soft(stretched, stretched, faces, target, progress.part(0.5, 1.0))


@dataclass(frozen=True, eq=False)
class Pulls:
    """Planes that draw places of a mesh.

    Attributes
    ----------
    corners : ndarray, (k, 3)
        The vertices of the face that each place lies in, and `weights` (k, 3) of them.
    planes, normals : ndarray, (k, 3)
        A point of each plane and its unit normal.
    strength : ndarray, (k,)
        The area that stands behind each.
    """

    corners: Ints
    weights: Floats
    planes: Floats
    normals: Floats
    strength: Floats

    def places(self, vertices: Floats) -> Floats:
        """Where the places (k, 3) of the mesh are."""
        found: Floats = np.einsum("ijk,ij->ik", vertices[self.corners], self.weights)
        return found


@dataclass(frozen=True, eq=False)
class Target:
    """The mesh that is fitted to, and what is needed of it again and again."""

    vertices: Floats
    faces: Ints
    normals: Floats
    areas: Floats
    locator: SurfaceLocator

    @classmethod
    def of(cls, vertices: Floats, faces: Ints) -> Target:
        """Prepare a closed mesh: vertices (n, 3), faces (m, 3)."""
        return cls(
            vertices,
            faces,
            vertex_normals(vertices, faces),
            vertex_mass(vertices, faces),
            SurfaceLocator(vertices, faces),
        )

    @property
    def radius(self) -> float:
        """Of the ball with the same area."""
        return float(np.sqrt(self.areas.sum() / (4.0 * np.pi)))

    def pulls(self, vertices: Floats, faces: Ints) -> Pulls:
        """How the target draws a mesh."""
        normals = vertex_normals(vertices, faces)
        face, weights, _ = self.locator.closest(vertices)
        own = np.zeros((len(vertices), 3))
        own[:, 0] = 1.0
        index = np.arange(len(vertices))
        planes = interpolate(self.vertices, self.faces, face, weights)
        towards = interpolate(self.normals, self.faces, face, weights)
        there, place, _ = SurfaceLocator(vertices, faces).closest(self.vertices)
        facing = interpolate(normals, faces, there, place)
        pulls = Pulls(
            np.concatenate([np.stack([index] * 3, axis=1), faces[there]]),
            np.concatenate([own, place]),
            np.concatenate([planes, self.vertices]),
            np.concatenate([towards, self.normals]),
            np.concatenate([vertex_mass(vertices, faces), self.areas]),
        )
        agreement = np.einsum("ij,ij->i", pulls.normals, np.concatenate([normals, facing]))
        gap = np.abs(_gaps(pulls, vertices))
        limit = max(FAR * float(np.median(gap)), NEAR * self.radius)
        strength = pulls.strength * np.maximum(agreement, 0.0) ** 2 / (1.0 + (gap / limit) ** 2)
        return Pulls(pulls.corners, pulls.weights, pulls.planes, pulls.normals, strength)


def _gaps(pulls: Pulls, vertices: Floats) -> Floats:
    """Signed distance (k,) of every place below its plane."""
    gaps: Floats = np.einsum("ij,ij->i", pulls.planes - pulls.places(vertices), pulls.normals)
    return gaps


def fit_rigid(vertices: Floats, faces: Ints, target: Target, progress: Progress) -> Rigid:
    """The motion that brings a mesh onto another.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    target : Target
    progress : Progress
    """
    motion = Rigid()
    size = target.radius
    for iteration in range(RIGID_ITERATIONS):
        progress(iteration / RIGID_ITERATIONS, "fitting rigidly")
        moved = motion.apply(vertices)
        step = _rigid_step(target.pulls(moved, faces), moved)
        motion = step @ motion
        shift = np.linalg.norm(step.apply(moved) - moved, axis=1).max()
        if shift < RIGID_STILL * size:
            break
    return motion


def _rigid_step(pulls: Pulls, vertices: Floats) -> Rigid:
    """The small motion that brings the places closest to their planes, made a rotation."""
    centre = vertices.mean(axis=0)
    arms = pulls.places(vertices) - centre
    rows = np.concatenate([np.cross(arms, pulls.normals), pulls.normals], axis=1)
    weighted = rows * pulls.strength[:, None]
    square = weighted.T @ rows
    # A ball may turn as it likes: it does not.
    square += 1e-6 * np.diag(np.diag(square)) + 1e-12 * np.trace(square) * np.eye(6)
    found = np.linalg.solve(square, weighted.T @ _gaps(pulls, vertices))
    return Rigid.about(centre, rotation_of(found[:3]), found[3:])


def fit_affine(vertices: Floats, faces: Ints, target: Target, progress: Progress) -> Floats:
    """Vertices (n, 3) of a mesh stretched and sheared as a whole onto another.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
        Fitted rigidly.
    faces : ndarray, (m, 3)
    target : Target
    progress : Progress
    """
    size = target.radius
    current = vertices
    for iteration in range(AFFINE_ITERATIONS):
        progress(iteration / AFFINE_ITERATIONS, "fitting the stretch")
        pulls = _anchored(target.pulls(current, faces), vertices, AFFINE_HOLD)
        moved = _affine_step(pulls, current, size)
        shift = np.linalg.norm(moved - current, axis=1).max()
        current = moved
        if shift < AFFINE_STILL * size:
            break
    return current


def _anchored(pulls: Pulls, start: Floats, hold: float) -> Pulls:
    """With a weak pull of every vertex to where it started.

    Of a smooth body many stretches fit nearly as well, turned along its surface: the one that
    moves it least is taken.
    """
    size = len(start)
    corners = np.repeat(np.arange(3 * size) // 3, 3).reshape(-1, 3)
    weights = np.zeros((3 * size, 3))
    weights[:, 0] = 1.0
    strength = np.full(3 * size, hold * pulls.strength.sum() / size)
    return Pulls(
        np.concatenate([pulls.corners, corners]),
        np.concatenate([pulls.weights, weights]),
        np.concatenate([pulls.planes, np.repeat(start, 3, axis=0)]),
        np.concatenate([pulls.normals, np.tile(np.eye(3), (size, 1))]),
        np.concatenate([pulls.strength, strength]),
    )


def _affine_step(pulls: Pulls, vertices: Floats, size: float) -> Floats:
    centre = vertices.mean(axis=0)
    arms = (pulls.places(vertices) - centre) / size
    rows = np.einsum("ij,ik->ijk", pulls.normals, arms).reshape(-1, 9)
    rows = np.concatenate([rows, pulls.normals], axis=1)
    weighted = rows * pulls.strength[:, None]
    square = weighted.T @ rows
    found = np.linalg.solve(square, weighted.T @ _gaps(pulls, vertices))
    stretch, shift = found[:9].reshape(3, 3), found[9:]
    moved: Floats = vertices + (vertices - centre) / size @ stretch.T + shift
    return moved


def rotation_of(vector: Floats) -> Floats:
    """The rotation (3, 3) about a vector (3,) by its length in radians (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    a, b, c = vector / angle
    cross = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    turn: Floats = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turn


def fit_soft(
    start: Floats,
    rest: Floats,
    faces: Ints,
    target: Target,
    progress: Progress,
    stiffnesses: tuple[float, ...] = STIFFNESSES,
    iterations: int = ITERATIONS,
) -> Floats:
    """Vertices (n, 3) of a mesh bent onto another.

    Parameters
    ----------
    start : ndarray, (n, 3)
        Where the mesh is.
    rest : ndarray, (n, 3)
        Its shape without strain, anywhere.
    faces : ndarray, (m, 3)
    target : Target
    progress : Progress
    stiffnesses : tuple of float
        One after the other; details smaller than this part of the target's radius are not
        followed.
    iterations : int
        For each.
    """
    resistance = _Resistance(rest, faces)
    radius = target.radius
    current, total = start, len(stiffnesses) * iterations
    for index, stiffness in enumerate(stiffnesses):
        for iteration in range(iterations):
            progress((index * iterations + iteration) / total, "fitting")
            pulls = target.pulls(current, faces)
            current = resistance.solve(current, pulls, (stiffness * radius) ** 2)
    return current


class _Resistance:
    """As-rigid-as-possible energy of a mesh against its shape at rest."""

    def __init__(self, rest: Floats, faces: Ints) -> None:
        laplacian = sparse.coo_array(cotangent_laplacian(rest, faces))
        off = laplacian.row != laplacian.col
        i, j = laplacian.row[off], laplacian.col[off]
        # Obtuse faces have negative weights, which would reward strain.
        weight = np.maximum(laplacian.data[off], 1e-3)
        size = len(rest)
        between = sparse.coo_array((weight, (i, j)), shape=(size, size)).tocsr()
        degree = np.asarray(between.sum(axis=1)).ravel()
        self._stiffness = sparse.csr_array(sparse.diags_array(degree) - between)
        self._i, self._j, self._weight = i, j, weight
        self._edges = rest[i] - rest[j]
        self._size = size

    def solve(self, current: Floats, pulls: Pulls, share: float) -> Floats:
        """Where planes draw the mesh against its resistance; `share` in µm²."""
        size = self._size
        rows = np.repeat(np.arange(len(pulls.strength)), 3)
        blocks = [
            sparse.coo_array(
                (
                    (pulls.weights * pulls.normals[:, axis, None]).ravel(),
                    (rows, pulls.corners.ravel()),
                ),
                shape=(len(pulls.strength), size),
            )
            for axis in range(3)
        ]
        jacobian = sparse.csr_array(sparse.hstack(blocks))
        weighted = sparse.csr_array(sparse.diags_array(pulls.strength) @ jacobian)
        matrix = jacobian.T @ weighted + share * sparse.block_diag([self._stiffness] * 3)
        wanted = np.einsum("ij,ij->i", pulls.planes, pulls.normals)
        right = weighted.T @ wanted + share * self._turned(current).T.ravel()
        # A vertex that nothing draws across stays; a millionth of the rest holds nothing up.
        hold = 1e-6 * float(matrix.diagonal().mean())
        matrix = sparse.csr_array(matrix + hold * sparse.eye_array(3 * size))
        found = Factor(matrix).solve(right + hold * current.T.ravel())
        return np.ascontiguousarray(found.reshape(3, size).T)

    def _turned(self, current: Floats) -> Floats:
        """Right-hand side (n, 3): the edges at rest, turned as the mesh around them is."""
        edges = current[self._i] - current[self._j]
        outer = self._weight[:, None, None] * self._edges[:, :, None] * edges[:, None, :]
        spread = np.empty((self._size, 3, 3))
        for a, b in np.ndindex(3, 3):
            spread[:, a, b] = np.bincount(self._i, outer[:, a, b], minlength=self._size)
        turns = nearest_rotations(spread)
        both = 0.5 * self._weight[:, None, None] * (turns[self._i] + turns[self._j])
        wanted = np.einsum("ijk,ik->ij", both, self._edges)
        return np.stack(
            [np.bincount(self._i, wanted[:, a], minlength=self._size) for a in range(3)], axis=1
        )


def nearest_rotations(spread: Floats) -> Floats:
    """Proper rotations (n, 3, 3) R that best turn a onto b, of sums of a bᵀ (n, 3, 3) (Kabsch)."""
    u, _, vt = np.linalg.svd(spread)
    proper = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    vt[:, 2] *= proper[:, None]
    turns: Floats = np.einsum("nji,nkj->nik", vt, u)
    return turns
