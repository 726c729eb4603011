"""Step 4: the (u, v) image of the sphere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..charts import UV, Floats, Reference, Sphere
from ..geometry.locate import SphericalLocator, interpolate
from ..geometry.padding import pad_sphere
from ..parameters import UVParameters
from ..progress import Progress
from .axis import axis_rotation

ROWS_PER_REPORT = 32


def uv(reference: Reference, sphere: Sphere, parameters: UVParameters, progress: Progress) -> UV:
    """Unwrap the sphere into an N × 2N image by exact pull-back (paper, Step 4).

    Every pixel's direction is located in the spherical triangle that holds it; its
    position is the same barycentric combination of the reference's vertices.
    """
    rotation = axis_rotation(reference, sphere, parameters)
    return uv_image(reference, sphere, rotation, parameters.rows, progress)


def uv_image(
    reference: Reference, sphere: Sphere, rotation: Floats, rows: int, progress: Progress
) -> UV:
    """The image of N rows of a sphere that is turned by a rotation (3, 3); see :func:`uv`."""
    locator = SphericalLocator(sphere.vertices @ rotation.T, sphere.faces)
    face = np.empty((rows, 2 * rows), np.int64)
    weights = np.empty((rows, 2 * rows, 3))
    for first in range(0, rows, ROWS_PER_REPORT):
        progress(first / rows, "locating pixels")
        block = slice(first, min(first + ROWS_PER_REPORT, rows))
        pixels = pixel_grid(rows)[block].reshape(-1, 2)
        found, place = locator.locate(uv_to_direction(pixels, rows))
        face[block] = found.reshape(-1, 2 * rows)
        weights[block] = place.reshape(-1, 2 * rows, 3)
    flat_face, flat_weights = face.ravel(), weights.reshape(-1, 3)
    positions = interpolate(reference.vertices, reference.faces, flat_face, flat_weights)
    positions = positions.reshape(rows, 2 * rows, 3)
    fields = dict(pixel_distortion(positions))
    curvature = reference.fields["mean_curvature_per_um"]
    fields["mean_curvature_per_um"] = interpolate(
        curvature, reference.faces, flat_face, flat_weights
    ).reshape(rows, 2 * rows)
    return UV(rotation=rotation, face=face, weights=weights, positions=positions, fields=fields)


def pixel_grid(rows: int) -> Floats:
    """(v, u) of every pixel, (N, 2N, 2)."""
    v, u = np.meshgrid(np.arange(float(rows)), np.arange(2.0 * rows), indexing="ij")
    return np.stack([v, u], axis=-1)


def uv_to_direction(points: Floats, rows: int) -> Floats:
    """Unit vectors (n, 3) (z, y, x), in the turned frame, of (v, u) in pixels (n, 2)."""
    inclination = (points[:, 0] + 0.5) * np.pi / rows
    azimuth = (points[:, 1] + 0.5) * np.pi / rows - np.pi
    sine = np.sin(inclination)
    return np.stack([np.cos(inclination), sine * np.sin(azimuth), sine * np.cos(azimuth)], axis=1)


def direction_to_uv(directions: Floats, rows: int) -> Floats:
    """(v, u) in pixels (n, 2) of unit vectors (n, 3) (z, y, x) in the turned frame."""
    z, y, x = directions.T
    inclination = np.arctan2(np.hypot(y, x), z)
    azimuth = np.arctan2(y, x)
    v = inclination * rows / np.pi - 0.5
    u = (azimuth + np.pi) * rows / np.pi - 0.5
    return np.stack([v, u], axis=1)


def pixel_distortion(positions: Floats) -> dict[str, npt.NDArray[np.float64]]:
    """Conformal error, area distortion and area (µm²) of every pixel.

    Paper, "Quantification of geometric deformation error for UV images": the singular
    values of the Jacobian of (u, v) ↦ (x, y, z) by central differences, continued over the
    seam and the poles; λ is a pixel's share of the image over its share of the surface.
    """
    padded = pad_sphere(positions, 1)
    dv = 0.5 * (padded[2:, 1:-1] - padded[:-2, 1:-1])
    du = 0.5 * (padded[1:-1, 2:] - padded[1:-1, :-2])
    area = np.linalg.norm(np.cross(du, dv), axis=2)
    half_trace = 0.5 * (np.einsum("ijk,ijk->ij", du, du) + np.einsum("ijk,ijk->ij", dv, dv))
    root = np.sqrt(np.maximum(half_trace**2 - area**2, 0.0))
    larger_squared = half_trace + root
    tiny = np.finfo(float).tiny
    return {
        "conformal_error": larger_squared / np.maximum(area, tiny),
        "area_distortion": (area.sum() / area.size) / np.maximum(area, tiny),
        "area_um2": area,
    }
