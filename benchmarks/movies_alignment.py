"""How far matter drifts in (u, v) where every timepoint has its own atlas (common = "each").

    .venv/bin/python benchmarks/movies_alignment.py

A simulated cell is turned, stretched and bent by a known one-to-one map, a little more at every
timepoint, so that it is known where each of its points goes. The drift of a point is the angle
between its place on the sphere at a timepoint and at the first, in pixels of the 512×256 image:
with the spheres as they come, turned onto the first one as well as can be told, and aligned.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from common import results
from common.cases import SEEDS, simulated_name
from common.children import options_of, run_child
from common.results import Bar, Entries

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import Reference, Sphere, Surface
from napari_unwrap3d.geometry.fit import rotation_of
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.geometry.locate import SurfaceLocator, interpolate
from napari_unwrap3d.geometry.mesh import unit
from napari_unwrap3d.geometry.spherical_alignment import angles, best_rotation

LIMIT_S = 3600.0
KINDS = ("blebs", "lamellipodia")
SIZE, TIMEPOINTS, ROWS = 96, 4, 256
STRETCH, BEND, TURN = 0.3, 0.4, 0.3
AXIS = np.array([0.5, 0.6, 0.62])
WORKING_VOXELS = 80
# Half of the matter within a few pixels, and less than half of what turning alone leaves.
MEDIAN = Bar(3.0, "pixels (512×256), median")
MOST = Bar(0.6, "of the drift with rotation only, 95th percentile")
FLIPS = Bar(0, "flipped faces")


def deformed(points: Any, amount: float) -> Any:
    """Where points (n, 3) of a body of radius 1 around 0 go."""
    along = 1.0 + STRETCH * amount
    z, y, x = (points * [along**-0.5, along**-0.5, along]).T
    if amount:
        curvature = BEND * amount
        radius, angle = 1.0 / curvature - y, curvature * x
        y, x = 1.0 / curvature - radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([z, y, x], axis=1) @ rotation_of(TURN * amount * AXIS).T


def run_cell(kind: str, seed: str) -> dict[str, Any]:
    """Drift of the surface's points at the last timepoint by the three ways."""
    cell = unwrap3d.simulate.cell(kind, int(seed), size=SIZE)
    mesh = unwrap3d.Pipeline(cell.truth.mask).run(until="surface").surface
    centre = mesh.vertices.mean(axis=0)
    radius = float(np.linalg.norm(mesh.vertices - centre, axis=1).mean())
    body = (mesh.vertices - centre) / radius
    sources = [
        Surface(centre + radius * deformed(body, t / (TIMEPOINTS - 1)), mesh.faces)
        for t in range(TIMEPOINTS)
    ]
    edge = float(np.ptp(mesh.vertices, axis=0).max()) / WORKING_VOXELS
    chosen = unwrap3d.Parameters.from_dict(
        {
            "uv": {"rows": ROWS},
            "registration": {"method": "none"},
            "movie": {"common": "each", "signals": ""},
            "stack": {"working_voxel_um": edge},
        }
    )
    movie = unwrap3d.unwrap_movie(sources, chosen, time_step=1.0)
    last = TIMEPOINTS - 1
    first, atlas = movie.atlas(0), movie.atlas(last)
    # The same pipeline without an alignment, and its sphere turned by the best rotation that
    # the truth allows: no rotation can do better.
    own = unwrap3d.Pipeline(sources[last]).run(atlas.parameters, until="sphere")
    start = places(first.reference, first.sphere, sources[0])
    there = places(own.reference, own.sphere, sources[last])
    after = places(atlas.reference, atlas.sphere, sources[last])
    mass = vertex_mass(sources[0].vertices, sources[0].faces)
    turned = there @ best_rotation(there, start, mass).T
    return {
        "none": drift(start, there, mass),
        "rotation": drift(start, turned, mass),
        "full": drift(start, after, mass),
        "flipped_faces": atlas.quality["alignment"]["flipped_faces"],
        "mean_abs_log_lambda": atlas.quality["alignment"]["mean_abs_log_lambda_aligned"],
    }


def places(reference: Reference, sphere: Sphere, cell: Surface) -> Any:
    """Unit vectors (n, 3) of the reference's points next to a surface's."""
    locator = SurfaceLocator(reference.vertices, reference.faces)
    face, weights, _ = locator.closest(cell.vertices)
    return unit(interpolate(sphere.vertices, sphere.faces, face, weights))


def drift(one: Any, other: Any, mass: Any) -> list[float]:
    """Median and 95th percentile of the drift in pixels, by area."""
    pixels = angles(one, other) * ROWS / np.pi
    order = np.argsort(pixels)
    share = np.cumsum(mass[order]) / mass.sum()
    return [float(pixels[order][np.searchsorted(share, part)]) for part in (0.5, 0.95)]


def entries_of(kind: str, seed: int, found: dict[str, Any]) -> Entries:
    """One cell against the bars."""
    name = simulated_name(kind, seed)
    (none, none_95), (turned, turned_95), (full, full_95) = (
        found[way] for way in ("none", "rotation", "full")
    )
    more = {
        "none": f"{none:.1f} / {none_95:.1f}",
        "rotation": f"{turned:.2f} / {turned_95:.2f}",
        "p95": f"{full_95:.2f}",
        "mean_abs_log_lambda": f"{found['mean_abs_log_lambda']:.3f}",
    }
    return {
        f"movies/alignment-median/{name}": MEDIAN.entry(full, **more),
        f"movies/alignment-gain/{name}": MOST.entry(full_95 / turned_95),
        f"movies/alignment-flips/{name}": FLIPS.entry(found["flipped_faces"]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    options = options_of(parser, run_cell, 2)
    for seed in options.seeds:
        for kind in options.kinds:
            found = run_child(__file__, kind, str(seed), limit_s=LIMIT_S)
            if isinstance(found, str):
                print(f"  {kind} {seed}: {found}", flush=True)
                continue
            entries = entries_of(kind, seed, found)
            results.show(entries)
            if seed in SEEDS:
                results.merge(entries)


if __name__ == "__main__":
    main()
