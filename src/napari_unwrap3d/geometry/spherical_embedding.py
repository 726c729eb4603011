"""Any closed genus-0 mesh on the unit sphere, one to one: the hierarchical embedding.

The mesh is taken apart to a tetrahedron, which lies on the sphere without a flip, and put
together again (:mod:`.hierarchy`); every time it has grown by a third, its distortion is
lowered (:mod:`.spherical_energy`). No step flips a face, so the end is a homeomorphism,
which :func:`certificate` proves from the numbers alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import FlippedFacesError
from ..progress import Progress
from .distortion import spherical_determinants
from .hierarchy import VertexHierarchy
from .laplacian import faces_to_vertices
from .mesh import Floats, Ints, face_areas
from .spherical_energy import rest_frames, sweep

GROWTH = 1.35
# A vertex counts at least this fraction of the mean, a face this fraction: specks of noise
# need room to be placed in.
LEAST_MASS, LEAST_AREA = 1e-3, 0.02
# Sweeps while there are fewer vertices than this; then `sweeps`, and at the end `final_sweeps`.
# What moves as a whole is moved while the mesh is coarse: a fine one takes far more sweeps.
COARSE_SWEEPS = ((300, 150), (3_000, 150), (30_000, 60))
# So small a mesh is turned to its directions as a whole.
TURNED_BELOW, TURNED_EVERY = 3_000, 10
SETTLED = 1e-5


@dataclass(frozen=True)
class Certificate:
    """What proves that a spherical mesh is a homeomorphism of the sphere.

    Attributes
    ----------
    holds : bool
    flipped_faces : int
        Faces whose determinant is not positive; NaN counts.
    degree : float
        Total solid angle over 4π; 1 for a map that covers the sphere once.
    smallest_determinant : float
    largest_norm_error : float
        How far a vertex is off the unit sphere.
    euler_characteristic : int
        V − F/2, 2 for a sphere.
    """

    holds: bool
    flipped_faces: int
    degree: float
    smallest_determinant: float
    largest_norm_error: float
    euler_characteristic: float


def certificate(directions: Floats, faces: Ints) -> Certificate:
    """Whether unit vectors and faces are a homeomorphism of the sphere, and the numbers.

    Every face positively oriented, finite, on the unit sphere, Euler characteristic 2, and
    the solid angles sum to one sphere.
    """
    a, b, c = directions[faces[:, 0]], directions[faces[:, 1]], directions[faces[:, 2]]
    determinant = spherical_determinants(directions, faces)
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    # Van Oosterom and Strackee (1983, doi:10.1109/TBME.1983.325207).
    solid_angle = 2.0 * np.arctan2(determinant, 1.0 + ab + bc + ca)
    flipped = int((~(determinant > 0)).sum())
    degree = float(solid_angle.sum() / (4.0 * np.pi))
    off = float(np.abs(np.linalg.norm(directions, axis=1) - 1.0).max(initial=0.0))
    chi = len(directions) - len(faces) / 2
    finite = bool(np.isfinite(directions).all())
    holds = finite and flipped == 0 and abs(degree - 1.0) < 1e-6 and off < 1e-9 and chi == 2
    smallest = float(determinant.min(initial=np.inf))
    return Certificate(bool(holds), flipped, degree, smallest, off, chi)


@dataclass(frozen=True)
class EmbeddingWeights:
    """What the embedding keeps, and how long it is worked on.

    Attributes
    ----------
    shape : float
        Weight of angles against areas.
    tie : float
        Weight of the given directions.
    slack : float
        How far (chord of the unit sphere) a vertex may be from its direction at no cost.
    sweeps, final_sweeps : int
        Rounds over the vertices at every size of the mesh, and at the end.
    """

    shape: float = 0.05
    tie: float = 30.0
    slack: float = 0.0
    sweeps: int = 20
    final_sweeps: int = 40


def embed_on_sphere(
    vertices: Floats,
    faces: Ints,
    progress: Progress,
    *,
    towards: Floats | None = None,
    confidence: Floats | None = None,
    weights: EmbeddingWeights | None = None,
) -> Floats:
    """Map a closed genus-0 mesh onto the unit sphere without flips.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Closed, genus 0, positive signed volume.
    progress : Progress
    towards : ndarray, (n, 3), optional
        Unit vectors near which vertices should come to lie.
    confidence : ndarray, (n,), optional
        From 0 (free) to 1, how far each vertex's direction is to be trusted.
    weights : EmbeddingWeights, optional

    Returns
    -------
    ndarray, (n, 3) float64
        Unit vectors. Keep them in double precision: faces may be tiny.

    Raises
    ------
    NotGenusZeroError
        The mesh is no topological sphere.
    FlippedFacesError
        The certificate does not hold.
    """
    chosen = weights or EmbeddingWeights()
    trust = np.zeros(len(vertices)) if confidence is None else np.asarray(confidence, float)
    goal = np.zeros_like(vertices) if towards is None else np.ascontiguousarray(towards, float)
    goal = np.where((trust > 0)[:, None], goal, 0.0)
    areas = face_areas(vertices, faces)
    mass = faces_to_vertices(areas / 3.0, faces, len(vertices))
    mass = np.maximum(mass, LEAST_MASS * mass.mean())
    progress(0.0, "taking the mesh apart")
    hierarchy = progress.run(VertexHierarchy, vertices, faces, mass / mass.sum())
    builder = _Builder(hierarchy, vertices, np.asarray(faces), goal, trust, chosen)
    sizes = _sizes(len(vertices))
    work = [size * _sweeps(size, len(vertices), chosen) for size in sizes]
    for number, size in enumerate(sizes):
        builder.grow(size, progress.part(0.02 + 0.98 * sum(work[:number]) / sum(work), 1.0))
    proof = certificate(hierarchy.positions, faces)
    if not proof.holds:
        raise FlippedFacesError(
            "The mesh could not be mapped to the sphere one to one.",
            flips=proof.flipped_faces,
            faces=len(faces),
            degree=proof.degree,
            hint="Repair or remesh the surface: faces without area cannot be placed.",
        )
    return hierarchy.positions


def _sweeps(size: int, full: int, weights: EmbeddingWeights) -> int:
    if size == full:
        return weights.final_sweeps
    for below, sweeps in COARSE_SWEEPS:
        if size < below:
            return sweeps
    return weights.sweeps


def _sizes(full: int) -> list[int]:
    """Numbers of vertices at which the mesh stops growing to be worked on."""
    sizes = [4]
    while sizes[-1] < full:
        sizes.append(min(full, max(sizes[-1] + 4, int(GROWTH * sizes[-1]))))
    return sizes[1:]


@dataclass
class _Builder:
    """Grows a hierarchy and lowers the distortion of what is there."""

    hierarchy: VertexHierarchy
    vertices: Floats
    final_faces: Ints
    towards: Floats
    confidence: Floats
    weights: EmbeddingWeights

    def __post_init__(self) -> None:
        count = len(self.final_faces)
        self._frames = np.zeros((count, 3, 3))
        self._shares = np.zeros(count)

    def grow(self, size: int, progress: Progress) -> None:
        """Insert vertices up to `size` and sweep."""
        tree = self.hierarchy
        full = len(self.vertices)
        progress(0.0, f"putting the mesh on the sphere: {size} of {full} vertices")
        tree.insert(tree.missing - (full - size))
        present = np.flatnonzero(tree.alive)
        self._prepare(present, finished=size == full)
        pull = np.zeros(full)
        pull[present] = self.weights.tie * (self.confidence * tree.mass)[present]
        if size <= TURNED_BELOW:
            self._turn(present)
        for number in range(_sweeps(size, full, self.weights)):
            order = present if number % 2 else present[::-1]
            progress.check()
            fallen = sweep(
                tree.positions,
                tree.faces,
                (tree.star, tree.degree),
                order,
                self._frames,
                self._shares,
                self.weights.shape,
                (self.towards, pull, self.weights.slack),
            )
            if fallen < SETTLED:
                break
            if size <= COARSE_SWEEPS[0][0] and number % TURNED_EVERY == TURNED_EVERY - 1:
                self._turn(present)

    def _prepare(self, present: Ints, finished: bool) -> None:
        """Shapes and areas that the present faces should have."""
        tree = self.hierarchy
        chosen = tree.present_faces()
        faces = tree.faces[chosen]
        if finished:
            share = face_areas(self.vertices, faces)
            share = np.maximum(share, LEAST_AREA * share.mean())
        else:
            share = (tree.mass / np.maximum(tree.degree, 1))[faces].sum(axis=1)
        share = share / share.sum()
        self._frames[chosen] = rest_frames(self.vertices, faces, 4.0 * np.pi * share)
        self._shares[chosen] = share

    def _turn(self, present: Ints) -> None:
        """Turn everything so that the trusted vertices are closest to their directions."""
        tied = present[self.confidence[present] > 0]
        if len(tied) < 4:
            return
        tree = self.hierarchy
        weight = (self.confidence * tree.mass)[tied]
        left, _, right = np.linalg.svd(
            (weight[:, None] * self.towards[tied]).T @ tree.positions[tied]
        )
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        tree.positions[present] = tree.positions[present] @ (left @ sign @ right).T
