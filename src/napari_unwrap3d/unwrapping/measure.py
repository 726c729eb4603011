"""The numbers that say how good each chart is; they become ``atlas.quality``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import UV, Direct, Plane, Reference, SealedSurface, Sphere, Surface, Topography
from ..errors import NotCertifiedError
from ..geometry.compare import area_difference, chamfer_distance, volume_difference
from ..geometry.distortion import (
    area_distortion,
    conformal_error,
    flipped_faces,
    mean_conformal_error,
    mean_log_area_distortion,
)
from ..geometry.flat import FlatSphere
from ..geometry.locate import SurfaceLocator, interpolate
from ..geometry.mesh import (
    euler_characteristic,
    face_areas,
    is_watertight,
    mesh_report,
    signed_volume,
)
from ..geometry.parallel import run_blocks
from ..geometry.spherical_embedding import certificate
from .plane import flat_sphere
from .topography import topography_to_world

ROUND_TRIP_VOXELS = 0.01
ROUND_TRIP_PIXELS = 0.05

Numbers = dict[str, Any]


def measure_sealed(surface: Surface, sealed: SealedSurface) -> Numbers:
    """What was closed, and the topology and quality of the sealed surface."""
    same = sealed.faces is surface.faces
    report = surface.report if same else mesh_report(sealed.vertices, sealed.faces)
    parts: dict[str, int] = {}
    for part in sealed.sealed:
        parts[part["kind"]] = parts.get(part["kind"], 0) + 1
    return {
        "sealed_parts": len(sealed.sealed),
        **{f"sealed_{kind}_count": count for kind, count in parts.items()},
        "sealed_volume_um3": float(sum(part["volume_um3"] for part in sealed.sealed)),
        **report,
    }


def measure_reference(chart: Reference) -> Numbers:
    """Topology and mesh quality, where the flow stopped and why."""
    return {
        **mesh_report(chart.vertices, chart.faces),
        "iteration": chart.iteration,
        "stopped_by": chart.stopped_by,
        "total_curvature": float(chart.total_curvature[-1]),
    }


def measure_sphere(reference: Reference, chart: Sphere) -> Numbers:
    """Flips, conformal error Q and |log λ| of both states, and what chose the second."""
    faces = chart.faces
    advected = {
        "iteration": chart.iteration,
        "iterations_with_flips": int((chart.flip_history > 0).sum()),
    }
    return {
        "conformal_flipped_faces": flipped_faces(chart.conformal, faces),
        "conformal_mean_q": mean_conformal_error(reference.vertices, chart.conformal, faces),
        "flipped_faces": flipped_faces(chart.vertices, faces),
        "mean_q": mean_conformal_error(reference.vertices, chart.vertices, faces),
        "mean_abs_log_lambda": mean_log_area_distortion(reference.vertices, chart.vertices, faces),
        "method": chart.method,
        "target": chart.target,
        "criterion": chart.criterion,
        "criterion_value": chart.criterion_value,
        "blend": chart.blend,
        "flow_iterations": max(len(chart.error_history) - 1, 0),
        **(advected if chart.method == "advection" else {}),
    }


def measure_uv(reference: Reference, chart: UV) -> Numbers:
    """Pixels located, and the mean distortion of the image."""
    area = chart.fields["area_um2"]
    log_lambda = np.log(np.maximum(chart.fields["area_distortion"], 1e-300))
    return {
        "unlocated_pixels": int((chart.face < 0).sum()),
        "mean_q": float((area * chart.fields["conformal_error"]).sum() / area.sum()),
        "mean_abs_log_lambda": float(np.abs(log_lambda).mean()),
        "area_um2": float(area.sum()),
        "reference_area_error": float(
            area.sum() / face_areas(reference.vertices, reference.faces).sum() - 1.0
        ),
    }


def measure_direct(sealed: SealedSurface, chart: Direct) -> Numbers:
    """The certificate of the embedding, its distortion, and how far the cortex is from its place.

    The means are weighted by area; displacements are of the cortex, in radians.
    """
    proof = certificate(chart.vertices, chart.faces)
    area = face_areas(sealed.vertices, sealed.faces)
    log_lambda = np.abs(np.log(area_distortion(sealed.vertices, chart.vertices, chart.faces)))
    cosine = np.einsum("ij,ij->i", chart.vertices, chart.registered)[chart.cortex]
    displaced = np.arccos(np.clip(cosine, -1.0, 1.0)) if len(cosine) else np.array([np.nan])
    return {
        "certified": proof.holds,
        "flipped_faces": proof.flipped_faces,
        "degree": proof.degree,
        "smallest_determinant": proof.smallest_determinant,
        "mean_q": mean_conformal_error(sealed.vertices, chart.vertices, chart.faces),
        "mean_abs_log_lambda": float(area @ log_lambda / area.sum()),
        "cortex_fraction": float(chart.cortex.mean()),
        "cortex_displacement_median_rad": float(np.median(displaced)),
        "cortex_displacement_p95_rad": float(np.percentile(displaced, 95)),
        "vertices_without_pixel_fraction": float(
            (chart.spokesman != np.arange(len(chart.spokesman))).mean()
        ),
    }


def measure_topography(surface: Surface, chart: Topography, voxel_um: float) -> Numbers:
    """Folded cells, unmapped vertices, round trip, and S_topo against S."""
    mapped = np.asarray(np.isfinite(chart.surface).all(axis=1))
    back, _ = topography_to_world(chart, chart.surface[mapped])
    miss = np.linalg.norm(back - surface.vertices[mapped], axis=1) / voxel_um
    exact = int((miss <= ROUND_TRIP_VOXELS).sum())
    cells = int((chart.last_layer - chart.first_layer).clip(min=0).sum())
    return {
        "folded_cells": chart.folded_cells,
        "folded_fraction": chart.folded_cells / max(cells, 1),
        "unmapped_fraction": 1.0 - float(mapped.mean()),
        "round_trip_fraction": exact / len(mapped),
        "round_trip_max_voxels": float(miss.max(initial=0.0)),
        "outward_um": float(chart.d_um[-1]),
        "inward_um": float(-chart.d_um[0]),
        **_measure_meshed(surface, chart, voxel_um),
    }


def _measure_meshed(surface: Surface, chart: Topography, voxel_um: float) -> Numbers:
    """S_topo against S, its topology and volume; none waits for the others."""
    vertices, faces = chart.meshed_vertices, chart.meshed_faces
    meshes = vertices, faces, surface.vertices, surface.faces
    measures: dict[str, Callable[[], Any]] = {
        "chamfer_voxels": lambda: chamfer_distance(vertices, surface.vertices) / voxel_um,
        "area_difference": lambda: area_difference(*meshes),
        "volume_difference": lambda: volume_difference(*meshes),
        "meshed_euler_characteristic": lambda: euler_characteristic(faces),
        "meshed_watertight": lambda: is_watertight(faces),
        "meshed_volume_um3": lambda: signed_volume(vertices, faces),
    }
    numbers = run_blocks(lambda measure: measure(), list(measures.values()))
    return dict(zip(measures, numbers, strict=True))


def measure_plane(
    surface: Surface, sealed: SealedSurface, chart: Plane, voxel_um: float
) -> Numbers:
    """The certificate, how the plane stretches, and the way there and back.

    Of the faces that hold the poles there is no one stretch; they are left out.
    """
    flat = flat_sphere(chart, sealed.faces)
    rows = chart.shape[0]
    faces, target = flat.corners()
    source = sealed.vertices[sealed.faces[faces]].reshape(-1, 3)
    flattened = np.column_stack([np.zeros(len(source)), target.reshape(-1, 2)])
    triangles = np.arange(len(source)).reshape(-1, 3)
    area = flat.areas()[0]
    miss, mapped = _plane_round_trip(surface, sealed, flat, voxel_um)
    return {
        "certified": True,
        "flipped_faces": len(flat.flipped()),
        "covered_once_fraction": float((flat.pixels().covering == 1).mean()),
        "covered_area": float(area.sum() / (2.0 * rows**2)),
        "smallest_face_pixels2": float(area.min()),
        "mean_q": mean_conformal_error(source, flattened, triangles),
        "median_q": float(np.median(conformal_error(source, flattened, triangles))),
        "mean_abs_log_lambda": mean_log_area_distortion(source, flattened, triangles),
        "round_trip_fraction": float((miss <= ROUND_TRIP_PIXELS).sum() / max(mapped, 1)),
        "round_trip_max_pixels": float(miss.max(initial=0.0)),
        "unmapped_fraction": 1.0 - mapped / len(surface.vertices),
        "of_sealed_surface": chart.of_sealed,
        "laplacian": chart.laplacian,
        "iterations": chart.iterations,
    }


def _plane_round_trip(
    surface: Surface, sealed: SealedSurface, flat: FlatSphere, voxel_um: float
) -> tuple[npt.NDArray[np.float64], int]:
    """Pixels between a vertex's image and that of its way back, and how many have one."""
    locator = SurfaceLocator(sealed.vertices, sealed.faces)
    face, weights, distance = locator.closest(surface.vertices)
    near = distance <= voxel_um
    image = flat.at(face[near], weights[near])
    back = interpolate(sealed.vertices, sealed.faces, *flat.locate(image))
    again = flat.at(*locator.closest(back)[:2])
    miss = np.abs(again - image)
    miss[:, 1] = np.minimum(miss[:, 1], 2.0 * flat.rows - miss[:, 1])
    return np.hypot(miss[:, 0], miss[:, 1]), int(near.sum())


def measure_refusal(error: NotCertifiedError) -> Numbers:
    """Why and where a chart was refused."""
    return {
        "certified": False,
        "reason": str(error).removesuffix(error.hint).strip(),
        "hint": error.hint,
        **error.measured,
        "places": [dict(place) for place in error.places],
    }
