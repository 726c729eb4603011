"""A mesh with one border on the unit disk: harmonic, then equiareal, and never flipped.

Points of the disk are (v, u), so that a face that is wound outward in (z, y, x) has a
positive determinant there and an image of the disk is seen from outside, not mirrored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from ..errors import FlippedFacesError, NotADiskError
from .holes import boundary_loops
from .laplacian import (
    Factor,
    cotangent_laplacian,
    cotangents_from_lengths,
    laplacian_from_weights,
)
from .mesh import connected_components, euler_characteristic, face_areas

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Positive weights are a cotangent within these limits, halved.
LEAST_WEIGHT = 0.05
# Weights are taken down where a map shrinks, this many times at the most; a face counts at
# least this part of the disk.
REWEIGHTINGS = 40
SMALLEST_SHARE = 1e-24
# No more when one of them gains less than this part.
SMALLEST_GAIN = 0.005
# Edges of the border count at least this part of their mean.
SHORTEST = 1e-3


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
    resolve, the weights of edges that shrink are taken down until it does not, as by
    :func:`spread_disk`. Paper, "Direct 2D unwrapping of
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
    points = _tutte(cotangent_laplacian(vertices, faces), loop, circle)
    if flipped(points, faces) == 0:
        return points
    weights = _positive_weights(vertices, faces)
    for _ in range(REWEIGHTINGS):
        points = _tutte(laplacian_from_weights(weights, faces, len(vertices)), loop, circle)
        left = flipped(points, faces)
        if left == 0:
            return points
        weights /= shrinking(vertices, points, faces)[:, None]
    raise FlippedFacesError(
        "The surface is too long to be laid on a disk.",
        flipped=left,
        hint="Remesh it with triangles of equal size, or cut it in two.",
    )


def spread_disk(vertices: Floats, faces: Ints, points: Floats) -> Floats:
    """A map to the disk that shrinks far less where `points` shrinks, and never flips.

    The weights of a Tutte embedding are divided by what it shrinks, again and again
    (Yoshizawa, Belyaev and Seidel 2004, doi:10.1109/SMI.2004.1314516): a tube that a harmonic
    map shrinks e-fold with every radius of its length needs no more than some tens of times.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    points : ndarray, (n, 2)
        A map to the disk without flips, whose border is kept.

    Returns
    -------
    ndarray, (n, 2)
        The best of those tried, by the mean |log λ| of the areas; `points` if it is the best.
    """
    loop = border(faces)
    weights = _positive_weights(vertices, faces)
    best, least = points, log_shrinking(vertices, points, faces)
    current, before = points, np.inf
    for _ in range(REWEIGHTINGS):
        weights /= shrinking(vertices, current, faces)[:, None]
        weights /= weights.mean()
        laplacian = laplacian_from_weights(weights, faces, len(vertices))
        current = _tutte(laplacian, loop, points[loop])
        error = log_shrinking(vertices, current, faces)
        if error < least and flipped(current, faces) == 0:
            best, least = current, error
        if error > (1.0 - SMALLEST_GAIN) * before:
            break
        before = error
    return best


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


def shrinking(vertices: Floats, points: Floats, faces: Ints) -> Floats:
    """How many times smaller a map to the plane makes each face (m,), as a length.

    Against the mean: the shares of the areas are compared.
    """
    before, after = face_areas(vertices, faces), np.abs(disk_determinants(points, faces))
    after = np.maximum(after / after.sum(), SMALLEST_SHARE)
    ratio: Floats = np.sqrt(before / before.sum() / after)
    return ratio


def log_shrinking(vertices: Floats, points: Floats, faces: Ints) -> float:
    """Mean |log λ| over the faces of a map to the plane, λ the ratio of shares of the area."""
    return float(2.0 * np.abs(np.log(shrinking(vertices, points, faces))).mean())
