"""Ways from the surface to its uv image, and how well the surface is rebuilt from each.

    .venv/bin/python benchmarks/core_routes.py

The paper's Extended Data Fig. 1h compares four: the input surface flowed to the sphere, mapped
conformally, mapped equiareally, and through the reference. The plane (Step 7), the topography
(Step 6) and the direct chart are beside them. Chamfer and sliced Wasserstein distance are taken
between the pixels and the vertices of the input, as in the paper, and the latter also between
points drawn by area: pixels crowd at the poles, which the first counts as a difference. The bar is
the paper's Chamfer distance on its own cell; for the ways that the paper does not give, that of its
way through the reference.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from common import measures, regions, results
from common.cases import FULL, simulated
from common.children import options_of, run_child
from common.grids import mesh_of_image
from common.requested import log_area
from common.results import Bar, Entries
from core_speed import WARM_UP_ROWS, parameters, tiny_cell

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.errors import NotCertifiedError
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.geometry.locate import SphericalLocator, interpolate
from napari_unwrap3d.geometry.wasserstein import sampled_sliced_wasserstein, sliced_wasserstein
from napari_unwrap3d.parameters import ReferenceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.axis import unwrapping_rotation
from napari_unwrap3d.unwrapping.flow import curvature_flow

LIMIT_S = 3600.0
KIND, SEED = "blebs", 0
CURVATURE = "mean_curvature_per_um"
# Chamfer and sliced Wasserstein distance in µm, and the difference of area in µm² and in % of
# the paper's cell, which has 708.87 µm².
PAPERS_AREA = 708.87
PAPERS = {
    "sphere": (0.069, 0.222, 43.85),
    "conformal": (0.071, 0.037, -2.83),
    "reference": (0.065, 0.031, -3.32),
    "equiareal": (0.059, 0.024, 0.77),
}


@dataclass
class Route:
    """One image of positions, or a mesh of it, and the map of the surface's faces behind it."""

    name: str
    cpu_s: float
    positions: Any = None
    mesh: Any = None
    directions: Any = None
    note: str = ""


class Clock:
    """CPU seconds of this process since it was made or last read."""

    def __init__(self) -> None:
        self._start = time.process_time()

    def read(self) -> float:
        seconds = time.process_time() - self._start
        self._start = time.process_time()
        return seconds


def routes(pipeline: unwrap3d.Pipeline) -> Iterator[Route]:
    """Every way, the paper's four first; the surface is of genus 0, so it needs no sealing."""
    surface = pipeline.run(parameters(FULL), until="sealed").sealed
    clock = Clock()
    flowed = flowed_sphere(surface.vertices, surface.faces)
    positions = image_of(pipeline.value("surface"), flowed)
    yield Route("sphere", clock.read(), positions, directions=flowed)
    for name, blend in (("conformal", 0.0), ("equiareal", 1.0)):
        yield sealed_route(name, blend, pipeline)
    clock.read()
    atlas = pipeline.run(parameters(FULL))
    through = clock.read()
    positions = outermost(atlas)
    image = atlas.topography.surface
    yield Route(
        "reference",
        through + clock.read(),
        positions,
        directions=regions.directions_of(image[:, 1:], FULL),
    )
    mesh = atlas.topography.meshed_vertices, atlas.topography.meshed_faces
    yield Route("topography", through, mesh=mesh)
    clock.read()
    chart = atlas.direct
    place = chart.face.ravel(), chart.weights.reshape(-1, 3)
    found = interpolate(atlas.sealed.vertices, atlas.sealed.faces, *place)
    seconds = through + clock.read()
    yield Route("direct", seconds, found.reshape(FULL, -1, 3), directions=chart.vertices)
    yield from plane_route(atlas, through)


def sealed_route(name: str, blend: float, pipeline: unwrap3d.Pipeline) -> Route:
    """The sealed surface's own mesh as the reference, at this blend of angles and areas."""
    settings = parameters(FULL).model_dump()
    settings["reference"] |= {"skip": True, "keep_mesh": True}
    settings["sphere"]["blend"] = blend
    chosen = unwrap3d.Parameters.from_dict(settings)
    own = unwrap3d.Pipeline(pipeline.source, dict(pipeline.kept))
    clock = Clock()
    atlas = own.run(chosen, until="uv")
    return Route(name, clock.read(), atlas.uv.positions, directions=atlas.sphere.vertices)


def plane_route(atlas: unwrap3d.Atlas, through: float) -> Iterator[Route]:
    """The flattened topographic surface, or why there is none."""
    clock = Clock()
    try:
        positions = atlas.plane.positions
    except (NotCertifiedError, unwrap3d.Unwrap3DError) as error:
        yield Route("plane", through + clock.read(), note=str(error))
        return
    yield Route("plane", through + clock.read(), positions)


def flowed_sphere(vertices: Any, faces: Any) -> Any:
    """The paper's flow (cMCF) run to its limit of iterations, and put onto the unit sphere."""
    limit = ReferenceParameters().iterations
    chosen = ReferenceParameters(stop="fixed", fixed_iteration=limit)
    flowed = curvature_flow(vertices, faces, chosen, silent()).vertices
    mass = vertex_mass(flowed, faces)
    centred = flowed - mass @ flowed / mass.sum()
    return centred / np.linalg.norm(centred, axis=1, keepdims=True)


def image_of(surface: unwrap3d.Surface, directions: Any) -> Any:
    """Positions (N, 2N, 3) of the surface in the uv image of its map to the sphere.

    The axis is the paper's, weighed by the surface's curvature.
    """
    mass = vertex_mass(directions, surface.faces)
    weight = surface.fields[CURVATURE] * np.sqrt(mass / mass.sum())
    turned = directions @ unwrapping_rotation(directions, weight).T
    pixels = regions.pixel_directions(FULL).reshape(-1, 3)
    place = SphericalLocator(turned, surface.faces).locate(pixels)
    return interpolate(surface.vertices, surface.faces, *place).reshape(FULL, -1, 3)


def outermost(atlas: unwrap3d.Atlas) -> Any:
    """Positions (N, 2N, 3) of the surface over every pixel of the reference's image."""
    grid = np.stack(np.meshgrid(np.arange(FULL), np.arange(2 * FULL), indexing="ij"), axis=-1)
    points, valid = atlas.map(grid.reshape(-1, 2), "uv", "surface")
    points[~valid] = np.nan
    return points.reshape(FULL, -1, 3)


def measured(route: Route, surface: unwrap3d.Surface, voxel_um: float) -> dict[str, Any]:
    """The paper's three numbers, CPU seconds, and how the map behind the image distorts."""
    if route.note:
        return {"cpu_s": route.cpu_s, "note": route.note}
    vertices, faces = route.mesh or mesh_of_image(route.positions)
    area = float(measures.trimesh_of(vertices, faces).area)
    given = float(measures.trimesh_of(surface.vertices, surface.faces).area)
    chamfer = measures.chamfer(vertices, surface.vertices)
    by_area = sampled_sliced_wasserstein((vertices, faces), (surface.vertices, surface.faces))
    return {
        "chamfer_um": chamfer,
        "chamfer_voxels": chamfer / voxel_um,
        "sliced_wasserstein_um": sliced_wasserstein(vertices, surface.vertices),
        "sliced_wasserstein_area_um": by_area.distance,
        "sliced_wasserstein_noise_um": by_area.noise_floor,
        "area_difference_um2": area - given,
        "area_difference_percent": 100.0 * (area / given - 1.0),
        "area_um2": area,
        "cpu_s": route.cpu_s,
        **distortion(route.directions, surface),
    }


def distortion(directions: Any, surface: unwrap3d.Surface) -> dict[str, Any]:
    """Flipped faces of a map to the sphere; its angles and areas where there are none."""
    if directions is None:
        return {}
    vertices, faces = surface.vertices, surface.faces
    flips = measures.flips(directions, faces)
    if flips:
        return {"flips": flips, "faces": len(faces)}
    return {
        "flips": 0,
        "faces": len(faces),
        "mean_q": measures.conformal_error(vertices, directions, faces),
        "log_lambda": log_area(vertices, directions, faces),
    }


def run_all() -> dict[str, Any]:
    """Every route on the simulated cell."""
    unwrap3d.unwrap(tiny_cell(), parameters(WARM_UP_ROWS))
    mask = simulated(KIND, SEED).truth.mask
    pipeline = unwrap3d.Pipeline(mask)
    surface = pipeline.run(until="surface").surface
    found = {}
    for route in routes(pipeline):
        found[route.name] = measured(route, surface, mask.voxel_size[0])
        print(route.name, found[route.name], flush=True)
    return found


def entries_of(found: Any) -> Entries:
    if isinstance(found, str):
        return {f"core/routes/{name}": bar_of(name).entry(None, note=found) for name in PAPERS}
    entries = {}
    for name, numbers in found.items():
        kept = {key: rounded(item) for key, item in numbers.items()}
        if name in PAPERS:
            kept["paper"] = papers(name)
        chamfer = numbers.get("chamfer_um")
        entries[f"core/routes/{name}"] = bar_of(name).entry(chamfer, **kept)
    return entries


def bar_of(name: str) -> Bar:
    return Bar(PAPERS.get(name, PAPERS["reference"])[0], "µm (Chamfer)")


def papers(name: str) -> dict[str, float]:
    """The figures of Extended Data Fig. 1h."""
    chamfer, wasserstein, area = PAPERS[name]
    return {
        "chamfer_um": chamfer,
        "sliced_wasserstein_um": wasserstein,
        "area_difference_um2": area,
        "area_difference_percent": round(100.0 * area / PAPERS_AREA, 2),
    }


def rounded(item: Any) -> Any:
    return item if isinstance(item, str) else results.significant(item, 4)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, run_all)
    entries = entries_of(run_child(__file__, limit_s=LIMIT_S))
    results.show(entries)
    results.merge(entries)


if __name__ == "__main__":
    main()
