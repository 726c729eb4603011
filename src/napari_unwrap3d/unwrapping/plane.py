"""Step 7: the topographic surface flattened to the (u, v) plane, certified one to one."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ..charts import (
    UV,
    Floats,
    Ints,
    Plane,
    SealedSurface,
    Surface,
    Topography,
    TriangleMesh,
)
from ..errors import MapError, NotCertifiedError
from ..geometry.flat import FlatSphere, Pixels
from ..geometry.locate import interpolate
from ..geometry.poles import Cylinder, open_at_poles
from ..parameters import PlaneParameters
from ..progress import Progress
from .flatten import flow, limit, stiffness
from .surface import same_mesh
from .topography import locate_in_columns
from .uv import direction_to_uv, pixel_distortion, uv_to_direction

logger = logging.getLogger(__name__)

# How far the areas may be from N × 2N, relatively: rounding of their sum.
DEGREE_TOLERANCE = 1e-6
PLACES_LISTED = 10
USE_DIRECT = (
    "The direct chart (atlas.direct) has no such limit; or smooth the surface, or turn the "
    "unwrapping axis by another axis weight."
)


@dataclass(frozen=True)
class Attempt:
    """One flattening, how many faces are flipped in it, and how it was made."""

    flat: FlatSphere
    flips: int
    iterations: int
    weights: str


def plane(
    surface: Surface,
    sealed: SealedSurface,
    uv: UV,
    topography: Topography,
    voxel_um: float,
    parameters: PlaneParameters,
    progress: Progress,
) -> Plane:
    """Flatten the topographic surface by topographic cMCF (paper, Step 7) and certify it.

    Parameters
    ----------
    surface, sealed, uv, topography
        The charts. A surface with handles has no plane; its sealed surface is flattened.
    voxel_um : float
        Edge of the working voxel.

    Returns
    -------
    Plane

    Raises
    ------
    NotCertifiedError
        Faces are flipped, or pixels not covered exactly once, whatever the weights: says
        where.
    """
    rows = uv.shape[0]
    progress(0.0, "mapping the sealed surface")
    image = topographic_image(surface, sealed, topography, voxel_um, progress.part(0.0, 0.1))
    image[:, 0] /= pixel_um(uv)
    attempt = flattened(image, sealed.faces, rows, parameters, progress.part(0.1, 0.8))
    progress(0.8, "counting what covers every pixel")
    pixels = progress.run(certify, attempt.flat, sealed.vertices)
    progress(0.9, "measuring the plane")
    return plane_chart(sealed, attempt, pixels, of_sealed=not same_mesh(sealed, surface))


def plane_chart(mesh: TriangleMesh, attempt: Attempt, pixels: Pixels, *, of_sealed: bool) -> Plane:
    """The chart of a flattening of a mesh that was certified."""
    face, weights = pixels.face.ravel(), pixels.weights.reshape(-1, 3)
    positions = interpolate(mesh.vertices, mesh.faces, face, weights)
    positions = positions.reshape(*pixels.face.shape, 3)
    return Plane(
        vertices=attempt.flat.vertices,
        turns=attempt.flat.turns,
        pole_faces=attempt.flat.pole_faces,
        pole_weights=attempt.flat.pole_weights,
        face=pixels.face,
        weights=pixels.weights,
        positions=positions,
        of_sealed=of_sealed,
        laplacian=attempt.weights,
        iterations=attempt.iterations,
        fields=dict(pixel_distortion(positions)),
    )


def pixel_um(uv: UV) -> float:
    """Edge in µm of a pixel of average area on the reference: the unit of d in pixels."""
    return float(np.sqrt(uv.fields["area_um2"].mean()))


def topographic_image(
    surface: Surface,
    sealed: SealedSurface,
    topography: Topography,
    voxel_um: float,
    progress: Progress,
) -> Floats:
    """(d µm, v, u) of the sealed surface's vertices; those without get their neighbours'."""
    if same_mesh(sealed, surface):
        image = topography.surface.copy()
    else:
        image = locate_in_columns(topography, sealed.vertices, voxel_um, progress)
    return filled(image, sealed.faces, topography.shape[1])


def filled(image: Floats, faces: Ints, rows: int) -> Floats:
    """(d, v, u) (n, 3) without NaN: where one is missing, the mean of the neighbours'.

    What is missing lies outside of the mapped shell. It is only where the flow starts from.
    """
    missing = ~np.isfinite(image).all(axis=1)
    if not missing.any() or missing.all():
        return image
    values = np.column_stack([image[:, 0], uv_to_direction(image[:, 1:], rows)])
    values[missing] = 0.0
    known = (~missing).astype(float)
    joined = _neighbours(faces, len(image))
    while (known == 0).any():
        count = joined @ known
        if not (count[known == 0] > 0).any():
            break
        new = (known == 0) & (count > 0)
        values[new] = (joined[new] @ (values * known[:, None])) / count[new, None]
        known[new] = 1.0
    length = np.linalg.norm(values[missing, 1:], axis=1, keepdims=True)
    result = image.copy()
    result[missing, 0] = values[missing, 0]
    result[missing, 1:] = direction_to_uv(values[missing, 1:] / np.maximum(length, 1e-12), rows)
    return result


def flat_sphere(chart: Plane, faces: Ints) -> FlatSphere:
    """The flattened mesh of a plane, for location.

    Parameters
    ----------
    chart : Plane
    faces : ndarray, (m, 3)
        Of the sealed surface.
    """
    return FlatSphere(
        chart.vertices, faces, chart.turns, chart.pole_faces, chart.pole_weights, chart.shape[0]
    )


def flattened(
    image: Floats, faces: Ints, rows: int, parameters: PlaneParameters, progress: Progress
) -> Attempt:
    """The first flattening without a flipped face, or the one with the fewest.

    The robust Laplacian keeps angles best; positive weights leave no face flipped in the
    limit but for rounding, which the direct solution of the limit keeps smallest.

    Parameters
    ----------
    image : ndarray, (n, 3)
        (d, v, u) of the vertices in pixels.
    faces : ndarray, (m, 3)
        Of a closed mesh of genus 0.
    rows : int
        N.

    Raises
    ------
    NotCertifiedError
        The mesh does not go around the poles.
    """
    try:
        cylinder = open_at_poles(image, faces, rows)
    except MapError as error:
        raise NotCertifiedError(error.what, hint=USE_DIRECT) from None
    chosen = parameters.laplacian
    kinds = ["robust", "positive"] if chosen == "automatic" else [chosen]
    attempts: list[Attempt] = []
    for index, kind in enumerate(kinds):
        part = progress.part(index / len(kinds), (index + 1) / len(kinds))
        part(0.0, f"Laplacian with {kind} weights")
        operator = progress.run(stiffness, cylinder, rows, kind)
        points, iterations = flow(cylinder, operator, rows, parameters, part.part(0.0, 0.7))
        attempts.append(_attempt(cylinder, faces, rows, points, iterations, kind))
        if attempts[-1].flips:
            part(0.7, "limit of the flow")
            points = limit(cylinder, operator, part)
            attempts.append(_attempt(cylinder, faces, rows, points, iterations, kind))
        logger.info("%s weights: %d flipped faces", kind, attempts[-1].flips)
        if attempts[-1].flips == 0:
            break
    return min(attempts, key=lambda attempt: attempt.flips)


def _attempt(
    cylinder: Cylinder, faces: Ints, rows: int, points: Floats, iterations: int, kind: str
) -> Attempt:
    flat = FlatSphere(
        np.ascontiguousarray(points[:-6, 1:]),
        faces,
        cylinder.face_turns,
        cylinder.pole_faces,
        cylinder.pole_weights,
        rows,
    )
    return Attempt(flat, len(flat.flipped()), iterations, kind)


def certify(flat: FlatSphere, vertices: Floats) -> Pixels:
    """What covers every pixel centre, if the plane is one to one.

    No face is flipped, the signed areas sum to the image's (so that the map is of degree
    one), and every pixel centre is covered exactly once.

    Parameters
    ----------
    flat : FlatSphere
    vertices : ndarray, (n, 3)
        Of the sealed surface, in µm, to say where it is not.

    Raises
    ------
    NotCertifiedError
    """
    flipped = flat.flipped()
    if len(flipped):
        places = flipped_places(flat, flipped, vertices)
        raise NotCertifiedError(
            "The plane is not one to one: faces are flipped in it.",
            places=tuple(places[:PLACES_LISTED]),
            flipped_faces=len(flipped),
            clusters=len(places),
            largest_at_um=places[0]["position_um"],
            largest_at_vu=places[0]["position_vu"],
            hint=USE_DIRECT,
        )
    pixels = flat.pixels()
    covered = float(flat.areas()[0].sum()) / (2.0 * flat.rows**2)
    wrong = np.argwhere(pixels.covering != 1)
    if abs(covered - 1.0) > DEGREE_TOLERANCE or len(wrong):
        raise NotCertifiedError(
            "The plane does not cover every pixel exactly once.",
            pixels=len(wrong),
            first_at_vu=tuple(int(i) for i in wrong[0]) if len(wrong) else (),
            covered=covered,
            hint=USE_DIRECT,
        )
    return pixels


def flipped_places(flat: FlatSphere, flipped: Ints, vertices: Floats) -> list[dict[str, Any]]:
    """Where faces are flipped: clusters of them that share vertices, the largest first.

    Returns
    -------
    list of dict
        ``position_um`` (z, y, x), ``position_vu`` (v, u) in pixels, and ``faces``.
    """
    chosen = flat.faces[flipped]
    joined = _neighbours(chosen, len(vertices))
    _, group = csgraph.connected_components(joined, directed=False)
    _, index, count = np.unique(group[chosen[:, 0]], return_inverse=True, return_counts=True)
    places = []
    for cluster in np.argsort(-count, kind="stable"):
        members = flipped[index == cluster]
        middle = vertices[flat.faces[members]].mean(axis=(0, 1))
        third = np.full((1, 3), 1.0 / 3.0)
        pixel = flat.at(members[:1], third)[0]
        places.append(
            {
                "position_um": tuple(round(float(x), 3) for x in middle),
                "position_vu": tuple(round(float(x), 1) for x in pixel),
                "faces": int(count[cluster]),
            }
        )
    return places


def _neighbours(faces: Ints, size: int) -> sparse.csr_array:
    """1 where two vertices share an edge, (size, size)."""
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    pairs = np.concatenate([a, b]), np.concatenate([b, a])
    joined = sparse.coo_array((np.ones(2 * len(a)), pairs), shape=(size, size)).tocsr()
    joined.data[:] = 1.0
    return sparse.csr_array(joined)
