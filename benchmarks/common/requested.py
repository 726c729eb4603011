"""The charts that are computed on request, direct and plane, measured from their arrays."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

import napari_unwrap3d as unwrap3d

from . import measures, regions, results
from .results import Bar, Entries, Entry

PATCHES = 200
SEED = 20230412
ROUND_TRIP_PIXELS = 0.05
# Bars by what a case shows; what is none of these is held to that of filopodia.
AREA = {"blebs": 0.12, "lamellipodia": 0.2}
OTHER_AREA = 0.5
LABELS = {"blebs": 0.999, "lamellipodia": 0.999}
OTHER_LABELS = 0.995
CERTIFIED = Bar(1.0, "certified", at_least=True)
CORTEX = Bar(0.15, "rad (95th percentile)")
DIRECT_TIME = Bar(25.0, "CPU s")
# The setting of direct.registration that gives way to equal areas.
EQUIAREAL_REGISTRATION = 0.1
PLANE = Bar(1.0, "certified", at_least=True)
NAMES = (
    "direct",
    "direct-time",
    "direct-area",
    "direct-cortex",
    "direct-labels",
    "direct-equiareal",
    "direct-area-equiareal",
    "plane",
    "plane-round-trip",
)
PLANE_ROUND_TRIP = Bar(0.999, "of vertices", at_least=True)


def measure_direct(atlas: unwrap3d.Atlas, kind: str) -> Entries:
    """Certificate, areas, place of the cortex and labels of the direct chart."""
    start = time.process_time()
    chart = atlas.direct
    seconds = time.process_time() - start
    labels = Bar(LABELS.get(kind, OTHER_LABELS), "mean IoU", at_least=True)
    overlaps = label_round_trip(atlas)
    return {
        "direct": certified(atlas),
        "direct-time": DIRECT_TIME.entry(seconds, vertices=len(atlas.sealed.vertices)),
        "direct-area": area_kept(atlas, kind),
        "direct-cortex": CORTEX.entry(cortex_displacement(atlas), of=float(chart.cortex.mean())),
        "direct-labels": labels.entry(overlaps.mean(), smallest=float(overlaps.min())),
    }


def measure_direct_equiareal(atlas: unwrap3d.Atlas, kind: str) -> Entries:
    """Certificate and areas of the direct chart where areas go before the cortex's place."""
    equiareal = with_registration(atlas, EQUIAREAL_REGISTRATION)
    start = time.process_time()
    _ = equiareal.direct
    seconds = results.significant(time.process_time() - start)
    displaced = results.significant(cortex_displacement(equiareal))
    area = area_kept(equiareal, kind, cortex_rad=displaced, cpu_s=seconds)
    return {"direct-equiareal": certified(equiareal), "direct-area-equiareal": area}


def with_registration(atlas: unwrap3d.Atlas, registration: float) -> unwrap3d.Atlas:
    """The same atlas, its direct chart still to be computed with this ``direct.registration``."""
    direct = atlas.parameters.direct.model_copy(update={"registration": registration})
    parameters = atlas.parameters.model_copy(update={"direct": direct})
    charts = {name: chart for name, chart in atlas.on_request.items() if name != "direct"}
    return atlas.replaced(parameters=parameters, on_request=charts)


def certified(atlas: unwrap3d.Atlas) -> Entry:
    """Whether the direct chart is a homeomorphism of the sphere, from its arrays alone."""
    directions, faces = atlas.direct.vertices, atlas.sealed.faces
    flips = measures.flips(directions, faces)
    degree = solid_angle(directions, faces) / (4.0 * np.pi)
    norms = np.linalg.norm(directions, axis=1)
    holds = flips == 0 and abs(degree - 1.0) < 1e-6 and np.abs(norms - 1.0).max() < 1e-9
    return CERTIFIED.entry(holds, flips=flips, degree=degree)


def area_kept(atlas: unwrap3d.Atlas, kind: str, **more: Any) -> Entry:
    """Area distortion of the direct chart against the bar of its kind of cell."""
    bar = Bar(AREA.get(kind, OTHER_AREA), "mean |log λ| by area")
    chart, sealed = atlas.direct, atlas.sealed
    registration = atlas.parameters.direct.registration
    error = log_area(sealed.vertices, chart.vertices, sealed.faces)
    return bar.entry(error, registration=registration, **more)


def measure_plane(atlas: unwrap3d.Atlas, kind: str) -> Entries:
    """Certified and one to one, or refused with the reason (never for blebs)."""
    start = time.process_time()
    try:
        plane = atlas.plane
    except unwrap3d.Unwrap3DError as error:
        entry = PLANE.entry(0.0, note=f"refused: {error}")
        entry["holds"] = kind != "blebs"
        return {"plane": entry}
    seconds = round(time.process_time() - start, 2)
    vertices = atlas.surface.vertices
    image, there = atlas.map(vertices, "surface", "plane")
    world, back = atlas.map(image, "plane", "surface")
    again, found = atlas.map(world, "surface", "plane")
    miss = np.abs(again - image)
    miss[:, 1] = np.minimum(miss[:, 1], 2 * plane.shape[0] - miss[:, 1])
    good = there & back & found & (miss.max(axis=1) <= ROUND_TRIP_PIXELS)
    # What was closed or cut has no image; the others must come back.
    return {
        "plane": PLANE.entry(1.0, cpu_s=seconds, of_sealed=plane.of_sealed),
        "plane-round-trip": PLANE_ROUND_TRIP.entry(
            good[there].mean(), without_image=int((~there).sum())
        ),
    }


MEASUREMENTS = (measure_direct, measure_direct_equiareal, measure_plane)


def solid_angle(directions: npt.NDArray[Any], faces: npt.NDArray[Any]) -> float:
    """Sum of the signed solid angles of spherical triangles (L'Huilier's theorem)."""
    a, b, c = (directions[faces[:, k]] for k in range(3))

    def arc(p: npt.NDArray[Any], q: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(p - q, axis=1), 0.0, 1.0))

    sides = arc(b, c), arc(c, a), arc(a, b)
    half = sum(sides) * 0.5
    product = np.tan(half / 2)
    for side in sides:
        product = product * np.tan(np.maximum(half - side, 0.0) / 2)
    excess = 4.0 * np.arctan(np.sqrt(np.maximum(product, 0.0)))
    sign = np.sign(np.einsum("ij,ij->i", a, np.cross(b - a, c - a)))
    return float((sign * excess).sum())


def log_area(source: npt.NDArray[Any], target: npt.NDArray[Any], faces: npt.NDArray[Any]) -> float:
    """Mean |log of the ratio of area shares|, weighted by the source's areas."""
    before = measures.trimesh_of(source, faces).area_faces
    after = measures.trimesh_of(target, faces).area_faces
    share = before / before.sum()
    return float(share @ np.abs(np.log(np.maximum(after / after.sum(), 1e-300) / share)))


def cortex_displacement(atlas: unwrap3d.Atlas) -> float:
    """95th percentile of the angle between both images of the singly covered cortex."""
    chart = atlas.direct
    points = atlas.sealed.vertices[chart.cortex]
    image, valid = atlas.map(points, "volume", "uv")
    turned = chart.vertices[chart.cortex][valid] @ chart.rotation.T
    cosine = np.einsum("ij,ij->i", turned, regions.directions_of(image[valid], atlas.uv.shape[0]))
    return float(np.percentile(np.arccos(np.clip(cosine, -1.0, 1.0)), 95))


def label_round_trip(atlas: unwrap3d.Atlas) -> npt.NDArray[np.float64]:
    """IoU by area of patches carried surface → direct → surface."""
    surface = atlas.surface
    labels = patches(surface.vertices, surface.faces, PATCHES, SEED)
    image = atlas.carry(labels, "surface", "direct", kind="label")
    back = atlas.carry(image, "direct", "surface", kind="label")
    areas = measures.trimesh_of(surface.vertices, surface.faces).area_faces
    mass = np.bincount(surface.faces.ravel(), np.repeat(areas / 3.0, 3), len(surface.vertices))
    both = np.bincount(labels[labels == back], mass[labels == back], PATCHES + 1)
    one = np.bincount(labels, mass, PATCHES + 1)
    other = np.bincount(back, mass, PATCHES + 1)
    overlap: npt.NDArray[np.float64] = (both / np.maximum(one + other - both, 1e-300))[1:]
    return overlap[one[1:] > 0]


def patches(
    vertices: npt.NDArray[Any], faces: npt.NDArray[Any], count: int, seed: int
) -> npt.NDArray[np.int32]:
    """Every vertex has the number, from 1, of the nearest of random ones along the edges."""
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    length = np.linalg.norm(vertices[a] - vertices[b], axis=1) + 1e-12
    edges = sparse.csr_array((length, (a, b)), shape=(len(vertices),) * 2)
    chosen = np.random.default_rng(seed).choice(len(vertices), count, replace=False)
    _, _, nearest = sparse.csgraph.dijkstra(
        edges, directed=False, indices=chosen, min_only=True, return_predecessors=True
    )
    number = np.zeros(len(vertices), np.int32)
    number[chosen] = np.arange(1, count + 1)
    return np.where(nearest >= 0, number[nearest], 1).astype(np.int32)
