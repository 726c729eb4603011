"""Every chart of every case against its bars: one child process per case.

    .venv/bin/python benchmarks/core_charts.py [--only CASE ...] [--missing] [--list]

The numbers are computed here from the charts' arrays and through ``atlas.map`` and
``atlas.carry``; nothing is taken from ``atlas.quality``.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np
from common import measures, regions, requested, results
from common.cases import FULL, Case, all_cases
from common.children import options_of, run_child
from common.results import Bar, Entries, Entry

import napari_unwrap3d as unwrap3d

LIMIT_S = 1200.0
LOG = results.HERE / "cases.json"  # the last run of every case with its timings; not committed
POINTS = 100_000
SEED = 20230412
ON_SURFACE_VOXELS = 0.01
LOCATED = 1e-9

BARS = {
    "charts": Bar(1.0, "reached", at_least=True),
    "reference": Bar(0.0, "defects"),
    "conformal-flips": Bar(0.0, "faces"),
    "conformal": Bar(1.01, "mean Q"),
    "equiareal-flips": Bar(0.0, "faces"),
    "equiareal": Bar(0.005, "mean |log λ|"),
    "uv-located": Bar(1.0, "of pixels", at_least=True),
    "uv-round-trip": Bar(1e-9, "voxels"),
    "topography-folded": Bar(0.0, "cells"),
    "topography": Bar(0.999, "of vertices", at_least=True),
    "chamfer": Bar(0.6, "voxels"),
    "area": Bar(4.0, "%"),
    "volume": Bar(1.0, "%"),
    "labels": Bar(0.99, "smallest IoU", at_least=True),
}


# The measurements, one function per chart ------------------------------------------------


def measure_reference(atlas: unwrap3d.Atlas) -> Entries:
    """χ = 2, one component, watertight, positive volume."""
    found = measures.topology(atlas.reference.vertices, atlas.reference.faces)
    defects = [
        found["euler_characteristic"] != 2,
        found["components"] != 1,
        not found["watertight"],
        found["volume"] <= 0,
    ]
    del found["volume"]
    return {"reference": BARS["reference"].entry(sum(defects), **found)}


def measure_sphere(atlas: unwrap3d.Atlas) -> Entries:
    """Flips and distortion of the conformal and of the equiareal state."""
    source, faces = atlas.reference.vertices, atlas.sphere.faces
    conformal, equiareal = atlas.sphere.conformal, atlas.sphere.vertices
    q = measures.conformal_error(source, conformal, faces)
    error = measures.log_area_distortion(source, equiareal, faces)
    return {
        "conformal-flips": BARS["conformal-flips"].entry(measures.flips(conformal, faces)),
        "conformal": BARS["conformal"].entry(q),
        "equiareal-flips": BARS["equiareal-flips"].entry(measures.flips(equiareal, faces)),
        "equiareal": BARS["equiareal"].entry(error),
    }


def measure_uv(atlas: unwrap3d.Atlas) -> Entries:
    """Pixels whose place on the sphere and on the reference is right, and the round trip."""
    rows = atlas.uv.shape[0]
    corners = atlas.sphere.faces[atlas.uv.face]
    turned = atlas.sphere.vertices @ atlas.uv.rotation.T
    on_sphere = np.einsum("vuk,vukx->vux", atlas.uv.weights, turned[corners])
    on_sphere /= np.linalg.norm(on_sphere, axis=2, keepdims=True)
    position = np.einsum("vuk,vukx->vux", atlas.uv.weights, atlas.reference.vertices[corners])
    located = (atlas.uv.face >= 0) & (atlas.uv.weights > -LOCATED).all(axis=2)
    located &= np.abs(on_sphere - regions.pixel_directions(rows)).max(axis=2) < LOCATED
    located &= np.abs(position - atlas.uv.positions).max(axis=2) < LOCATED * atlas.voxel_um

    rng = np.random.default_rng(SEED)
    reference = atlas.reference
    points = measures.random_points(reference.vertices, reference.faces, POINTS, rng)
    image, there = atlas.map(points, "reference", "uv")
    back, again = atlas.map(image, "uv", "reference")
    miss = np.linalg.norm(back - points, axis=1) / atlas.voxel_um
    miss[~(there & again)] = np.inf
    return {
        "uv-located": BARS["uv-located"].entry(located.mean()),
        "uv-round-trip": BARS["uv-round-trip"].entry(
            miss.max(), missed=int((~(miss <= BARS["uv-round-trip"].limit)).sum())
        ),
    }


def measure_topography(atlas: unwrap3d.Atlas) -> Entries:
    """Folded cells, and how many vertices come back to their place."""
    chart = atlas.topography
    folded, cells = measures.folded_cells(chart.nodes, chart.first_layer, chart.last_layer)
    vertices = atlas.surface.vertices
    image, there = atlas.map(vertices, "surface", "topography")
    back, again = atlas.map(image, "topography", "surface")
    miss = np.linalg.norm(back - vertices, axis=1) / atlas.voxel_um
    exact = there & again & (miss <= ON_SURFACE_VOXELS)
    return {
        "topography-folded": BARS["topography-folded"].entry(folded, of=int(cells)),
        "topography": BARS["topography"].entry(
            exact.mean(), missed=int((~exact).sum()), without_image=int((~there).sum())
        ),
    }


def measure_topographic_surface(atlas: unwrap3d.Atlas) -> Entries:
    """S_topo, meshed the paper's way and brought back to space, against S.

    The bar of the Chamfer distance is for 1024 × 512 pixels. On half that grid S_topo's edges
    are halved, so that it is sampled as densely; it is not made more exact by that.
    """
    chart, surface = atlas.topography, atlas.surface
    mesh = measures.trimesh_of(chart.meshed_vertices, chart.meshed_faces)
    given = measures.trimesh_of(surface.vertices, surface.faces)
    points = chart.meshed_vertices
    if atlas.uv.shape[0] < FULL:
        points = measures.subdivided(points, chart.meshed_faces)
    others = measures.sampled(surface.vertices, surface.faces, atlas.voxel_um)
    distance = measures.chamfer(points, others) / atlas.voxel_um
    area = 100.0 * (mesh.area / given.area - 1.0)
    volume = 100.0 * (mesh.volume / given.volume - 1.0)
    return {
        "chamfer": BARS["chamfer"].entry(distance),
        "area": BARS["area"].entry(abs(area), signed=results.significant(area)),
        "volume": BARS["volume"].entry(abs(volume), signed=results.significant(volume)),
    }


def measure_labels(atlas: unwrap3d.Atlas) -> Entries:
    """Regions carried uv → reference → uv, one by one."""
    overlaps = []
    for region in regions.random_regions(atlas.uv.shape[0], SEED):
        carried = atlas.carry(region.astype(np.int32), "uv", "reference", kind="label")
        returned = atlas.carry(carried, "reference", "uv", kind="label")
        overlaps.append(regions.intersection_over_union(region, returned == 1))
    mean = results.significant(float(np.mean(overlaps)))
    return {"labels": BARS["labels"].entry(min(overlaps), mean=mean)}


MEASUREMENTS = (
    measure_reference,
    measure_sphere,
    measure_uv,
    measure_topography,
    measure_topographic_surface,
    measure_labels,
)


# One case --------------------------------------------------------------------------------


def run_named(name: str, rows: str) -> dict[str, Any]:
    """The case of a name on a grid of so many rows."""
    return run_case(Case(**(vars(all_cases()[name]) | {"rows": int(rows)})))


def run_case(case: Case) -> dict[str, Any]:
    """Unwrap one case and measure every chart: entries and a log of timings."""
    times: dict[str, float] = {}
    source = _timed(times, "load", case.load)
    try:
        atlas = _timed(times, "unwrap", unwrap3d.unwrap, source, case.all_parameters())
    except unwrap3d.Unwrap3DError as error:
        stopped = f"stopped with {type(error).__name__}: {error}"
        return {"entries": {"charts": not_reached(case, stopped, case.may_stop)}, "cpu_s": times}
    entries: Entries = {}
    for measure in MEASUREMENTS:
        entries |= _timed(times, measure.__name__, measure, atlas)
    kind = case.name.removesuffix("-stack").rsplit("-", 1)[0]
    for measure_chart in requested.MEASUREMENTS:
        entries |= _timed(times, measure_chart.__name__, measure_chart, atlas, kind)
    silent = silent_defects(atlas, source)
    entries["charts"] = BARS["charts"].entry(0.0 if silent else 1.0, note=silent)
    for entry in entries.values():
        entry["grid"] = case.grid
    return {
        "entries": entries,
        "cpu_s": times,
        "steps_s": {name: step["seconds"] for name, step in atlas.provenance["steps"].items()},
        "repairs": list(atlas.provenance["repairs"]),
        "quality": dict(atlas.quality),
    }


def _timed(times: dict[str, float], name: str, function: Any, *arguments: Any) -> Any:
    start = time.process_time()
    result = function(*arguments)
    times[name] = round(time.process_time() - start, 2)
    return result


def not_reached(case: Case, why: str, allowed: bool = False) -> Entry:
    """The entry of a case without an atlas; `allowed` where a clear error will do."""
    entry = BARS["charts"].entry(0.0, note=why, grid=case.grid)
    entry["holds"] = allowed
    return entry


def silent_defects(atlas: unwrap3d.Atlas, source: Any) -> str:
    """What was wrong with the input or its surface and is not reported; empty if nothing."""
    found = measures.topology(atlas.surface.vertices, atlas.surface.faces)
    handles = found["components"] - found["euler_characteristic"] / 2
    silent = []
    if handles > 0 and not atlas.sealed.sealed:
        silent.append(f"{handles:g} handles of the surface closed without a word")
    if isinstance(source, unwrap3d.Surface):
        given = measures.trimesh_of(source.vertices, source.faces)
        if not given.is_watertight and not atlas.provenance["repairs"]:
            silent.append("an open mesh repaired without a word")
    return "; ".join(silent)


# All cases -------------------------------------------------------------------------------


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", metavar="CASE", help="these cases only")
    parser.add_argument("--missing", action="store_true", help="cases without a result only")
    parser.add_argument("--rows", type=int, help="another grid; the results are shown, not kept")
    parser.add_argument("--list", action="store_true", help="show the names of the cases")
    options = options_of(parser, run_named, 2)
    cases = all_cases()
    chosen = [cases[name] for name in options.only or cases]
    if options.missing:
        done = results.read()
        chosen = [case for case in chosen if f"core/charts/{case.name}" not in done]
    if options.list:
        print("\n".join(f"{case.name:26s} {case.grid}" for case in chosen))
        return
    for number, case in enumerate(chosen, 1):
        print(f"[{number}/{len(chosen)}] {case.name}", flush=True)
        run_and_keep(case, options.rows)
    if not options.rows:
        results.summarise(keep_fraction(cases))


def run_and_keep(case: Case, rows: int | None) -> None:
    """Run a case in a child and write what it measured, with its log."""
    if case.absent:
        print(f"  left out: {case.file} is not there")
        return
    start = time.perf_counter()
    found = run_child(__file__, case.name, str(rows or case.rows), limit_s=LIMIT_S)
    if isinstance(found, str):
        found = {"entries": {"charts": not_reached(case, found)}}
    found["wall_s"] = round(time.perf_counter() - start, 1)
    entries = {f"core/{bar}/{case.name}": entry for bar, entry in found["entries"].items()}
    results.show(entries)
    print(f"  {found['wall_s']} s; steps {found.get('steps_s')}; CPU {found.get('cpu_s')}")
    log = json.loads(LOG.read_text("utf-8")) if LOG.exists() else {}
    log[case.name if not rows else f"{case.name}@{rows}"] = found
    LOG.write_text(json.dumps(log, indent=1), "utf-8")
    if not rows:
        # Other benchmarks have entries of this case, too; those are theirs.
        measured = (*BARS, *requested.NAMES)
        results.merge(entries, drop=[f"core/{bar}/{case.name}" for bar in measured])


def keep_fraction(cases: dict[str, Case]) -> Entries:
    """The fraction of cases that reach every chart, out of all that were run."""
    entries = results.read()
    reached = {
        name: entry for name in cases if (entry := entries.get(f"core/charts/{name}")) is not None
    }
    expected = {name: e for name, e in reached.items() if e["value"] or not cases[name].may_stop}
    failed = [f"{name} {e.get('note', '')}" for name, e in reached.items() if not e["value"]]
    fraction = sum(e["value"] for e in expected.values()) / max(len(expected), 1)
    entry = BARS["charts"].entry(fraction, cases=len(expected), note="; ".join(failed))
    entry["unit"] = "of cases"
    return results.merge({"core/reached/all": entry})


if __name__ == "__main__":
    main()
