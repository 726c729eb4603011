"""Step 2: the conformal map of a genus-0 mesh to the unit sphere.

One face is cut out and the rest is mapped harmonically into a triangle of the plane,
which inverse stereographic projection takes to the sphere (Choi, Lam and Lui 2015,
doi:10.1137/130950008). A harmonic map stays one when it is stretched, so the triangle is
given the shape that makes the map most conformal. Around the removed face the map is poor;
solving again in the stereographic projection from the opposite pole, with the far part held
fixed, corrects it, and alternating between the poles converges to the harmonic, hence
conformal, map.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from ..charts import Floats, Ints
from ..errors import FlippedFacesError
from ..geometry.distortion import flipped_faces, mean_conformal_error
from ..geometry.laplacian import (
    Factor,
    ReusedFactor,
    cotangent_laplacian,
    laplacian_from_weights,
    pinned,
    vertex_mass,
)
from ..geometry.spherical_embedding import EmbeddingWeights, embed_on_sphere
from ..progress import Progress

logger = logging.getLogger(__name__)

Complex = npt.NDArray[np.complex128]

# Vertices farther from the pole's antipode than this are held fixed while the others are
# solved for; above 1 (the equator) so that the two solves overlap.
FIXED_RADIUS = 2.5
ALTERNATIONS = 6
# Stop at this mean Q, or when both poles have had their turn and another gains nothing.
GOOD_ENOUGH = 1.002
SMALLEST_GAIN = 1e-3
# Weight of angles against areas in the embedding that is fallen back on.
CONFORMAL_SHAPE = 10.0


def conformal_sphere(
    vertices: Floats, faces: Ints, progress: Progress, solver: ReusedFactor | None = None
) -> Floats:
    """Map a closed genus-0 mesh conformally onto the unit sphere (paper, Step 2).

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Positive signed volume.
    progress : Progress
    solver : ReusedFactor, optional
        Left with the factor of the mesh's Laplacian, which a conformal map hardly changes.

    Returns
    -------
    ndarray, (n, 3)
        Unit vectors with the area-weighted mean at the centre; no face is flipped.

    Raises
    ------
    NotGenusZeroError, FlippedFacesError
        The mesh is no sphere, or so degenerate that not even the hierarchical embedding,
        which every other mesh has, is found.
    """
    weights = vertex_mass(vertices, faces)
    solver = ReusedFactor() if solver is None else solver
    for name, laplacian in _laplacians(vertices, faces):
        plane = progress.run(_punctured_map, vertices, faces, laplacian, solver)
        start = _inverse_stereographic(plane)
        directions = _alternate(vertices, faces, laplacian, start, progress)
        flips = flipped_faces(directions, faces)
        if flips == 0:
            return mobius_centered(directions, weights, faces)
        logger.info("the spherical map with %s weights has %d flipped faces", name, flips)
    # Never flipped on any sphere, but less conformal; the alternation improves what it can.
    logger.info("falling back on the hierarchical embedding")
    kept = EmbeddingWeights(shape=CONFORMAL_SHAPE, tie=0.0)
    start = embed_on_sphere(vertices, faces, progress.part(0.2, 0.9), weights=kept)
    laplacian = cotangent_laplacian(vertices, faces)
    directions = _alternate(vertices, faces, laplacian, start, progress.part(0.9, 1.0))
    flips = flipped_faces(directions, faces)
    if flips:
        raise FlippedFacesError(
            "The reference could not be mapped to the sphere one to one.",
            flips=flips,
            faces=len(faces),
            hint="Smooth the reference more (a lower limit of total |K|, or extra iterations); "
            "where it was skipped, do not skip it.",
        )
    return mobius_centered(directions, weights, faces)


def _laplacians(vertices: Floats, faces: Ints) -> Any:
    """Cotangent weights first; then the same clamped positive; then uniform (Tutte)."""
    cotangent = cotangent_laplacian(vertices, faces)
    yield "cotangent", cotangent
    off = sparse.coo_array(cotangent)
    keep = off.row != off.col
    data = np.clip(off.data[keep], 0.02, 50.0)
    positive = sparse.coo_array((data, (off.row[keep], off.col[keep])), shape=off.shape).tocsr()
    positive = (positive + positive.T) * 0.5
    degree = np.asarray(positive.sum(axis=1)).ravel()
    yield "clamped", sparse.csr_array(positive - sparse.diags_array(degree))
    uniform = np.full(faces.shape, 0.5)
    yield "uniform", laplacian_from_weights(uniform, faces, len(vertices))


def _alternate(
    vertices: Floats, faces: Ints, laplacian: Any, start: Floats, progress: Progress
) -> Floats:
    """Harmonic corrections of a spherical map from alternating poles.

    Keeps the best map without flips; stops when the conformal error stops falling.
    """
    best = start
    best_flips = flipped_faces(best, faces)
    best_error = mean_conformal_error(vertices, best, faces)
    current, pole = best, -1
    for alternation in range(ALTERNATIONS):
        progress((alternation + 1) / (ALTERNATIONS + 1), "conformal map")
        current = progress.run(_solve_hemisphere, current, laplacian, pole)
        flips = flipped_faces(current, faces)
        error = mean_conformal_error(vertices, current, faces)
        gain = best_error - error
        if np.isfinite(error) and (flips, error) < (best_flips, best_error):
            best, best_flips, best_error = current, flips, error
        settled = alternation > 0 and gain < SMALLEST_GAIN
        if best_flips == 0 and (settled or best_error < GOOD_ENOUGH):
            break
        if not np.isfinite(current).all():
            break
        pole = -pole
    return best


def _punctured_map(vertices: Floats, faces: Ints, laplacian: Any, solver: ReusedFactor) -> Complex:
    """Harmonic map of the mesh without its most regular face into a triangle."""
    corners = faces[_most_regular_face(vertices, faces)]
    # Two functions that are harmonic but at the corners, and the sum of both and a constant
    # that has the wanted values there.
    loads = np.zeros((len(vertices), 2))
    loads[corners] = [[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]
    functions = solver.solve(pinned(laplacian), loads)
    target = np.exp(2j * np.pi * np.arange(3) / 3)
    differences = functions[corners[:2]] - functions[corners[2]]
    values: Complex = functions @ (np.linalg.inv(differences) @ (target[:2] - target[2]))
    values = _most_conformal(values, vertices, faces)
    values = values - _median(values)
    radius = np.median(np.abs(values))
    scaled: Complex = values / max(radius, 1e-300)
    return scaled


def _most_conformal(plane: Complex, vertices: Floats, faces: Ints) -> Complex:
    """The map f to the plane, stretched to f + k f̄, of least Beltrami coefficient.

    Seen from the hole the other faces are turned over. A face's coefficient then vanishes for
    ``k = −f_z / conj(f_z̄)``; the median over the faces is taken, as those next to the hole
    are distorted anyway.
    """
    corner = vertices[faces]
    edge, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    length = np.maximum(np.linalg.norm(edge, axis=1), 1e-300)
    along = np.einsum("ij,ij->i", edge, other) / length
    across = np.maximum(np.linalg.norm(np.cross(edge, other), axis=1) / length, 1e-300)
    f = plane[faces]
    f_x = (f[:, 1] - f[:, 0]) / length
    f_y = (f[:, 2] - f[:, 0] - along * f_x) / across
    below = np.conj(f_x + 1j * f_y)
    stretch = _median(-(f_x - 1j * f_y) / np.where(below == 0.0, 1.0, below))
    # From 1 on the stretched map would be turned inside out.
    return plane + stretch * np.conj(plane) if abs(stretch) < 1.0 else plane


def _most_regular_face(vertices: Floats, faces: Ints) -> int:
    edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2)
    spread = edges / edges.sum(axis=1, keepdims=True) - 1.0 / 3.0
    return int(np.argmin(np.abs(spread).sum(axis=1)))


def _median(values: Complex) -> complex:
    return complex(np.median(values.real), np.median(values.imag))


def _solve_dirichlet(laplacian: Any, values: Complex, free: npt.NDArray[np.bool_]) -> Complex:
    """Harmonic values on the free vertices, the others given."""
    inner = np.flatnonzero(free)
    fixed = np.flatnonzero(~free)
    rows = laplacian[inner]
    right = rows[:, fixed] @ values[fixed]
    solution = Factor(-rows[:, inner]).solve(np.stack([right.real, right.imag], axis=1))
    result = values.copy()
    result[inner] = solution[:, 0] + 1j * solution[:, 1]
    return result


def _solve_hemisphere(directions: Floats, laplacian: Any, pole: int) -> Floats:
    """Solve again in the projection from `pole` (±1), the part around it held fixed."""
    plane = _stereographic(directions, pole)
    free = np.abs(plane) < FIXED_RADIUS
    return _inverse_stereographic(_solve_dirichlet(laplacian, plane, free), pole)


def _stereographic(directions: Floats, pole: int = 1) -> Complex:
    """Plane of the projection from (pole, 0, 0); orientation kept for either pole."""
    z, y, x = directions.T
    # x + iy seen from the north pole's side is mirrored from the south pole's side.
    plane: Complex = (y + 1j * pole * x) / np.maximum(1.0 - pole * z, 1e-300)
    return plane


def _inverse_stereographic(plane: Complex, pole: int = 1) -> Floats:
    squared = np.abs(plane) ** 2
    z = pole * (squared - 1.0) / (squared + 1.0)
    y = 2.0 * plane.real / (squared + 1.0)
    x = 2.0 * pole * plane.imag / (squared + 1.0)
    directions = np.stack([z, y, x], axis=1)
    unit: Floats = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return unit


def mobius_centered(directions: Floats, weights: Floats, faces: Ints) -> Floats:
    """Move the weighted mean of the directions to the centre by Möbius maps, keeping angles.

    Gauss–Newton on the inversion's centre (Baden, Crane and Kazhdan 2018,
    doi:10.1111/cgf.13503); a step that would flip a face is halved.
    """
    share = weights / weights.sum()
    current = directions
    for _ in range(100):
        mean = share @ current
        if np.linalg.norm(mean) < 1e-10:
            break
        jacobian = np.eye(3) - np.einsum("i,ij,ik->jk", share, current, current)
        step = -0.5 * np.linalg.solve(jacobian, mean)
        length = np.linalg.norm(step)
        if length > 0.9:
            step *= 0.9 / length
        for _ in range(20):
            moved = _invert(current, step)
            closer = np.linalg.norm(share @ moved) < np.linalg.norm(mean)
            if closer and flipped_faces(moved, faces) == 0:
                break
            step = 0.5 * step
        else:
            break
        current = moved
    return current


def _invert(directions: Floats, centre: Floats) -> Floats:
    """Möbius map of the sphere that moves the origin of the ball to `centre`."""
    shifted = directions + centre
    factor = (1.0 - centre @ centre) / np.einsum("ij,ij->i", shifted, shifted)
    moved = factor[:, None] * shifted + centre
    unit: Floats = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    return unit
