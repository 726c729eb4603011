"""What is drawn on one chart, read back from another: patches on the direct chart, uv columns.

    .venv/bin/python benchmarks/views_labels.py [--only CASE ...]

Connected patches of the surface, half of them where another sheet lies over them, are drawn
one after the other, seen in the direct chart, and drawn anew from that image alone. Regions of
uv, most of them over the seam and the poles, are drawn, and what they mark is held against the
place of every vertex. Everything goes through ``atlas.annotations``, as drawing in the window.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import numpy.typing as npt
from common import regions, results
from common.cases import all_cases
from common.children import options_of, run_child
from common.results import Bar, Entries
from scipy import sparse

import napari_unwrap3d as unwrap3d

LIMIT_S = 1500.0
SEED = 20230412
PATCHES = 200
# Of a patch, in vertices: from a few to a lamellipodium.
SMALLEST, LARGEST = 60, 6000
# How far beside a patch its labels may come back: corners of the faces around its border.
RINGS = 2
CASES = {"blebs-0": 0.999, "lamellipodia-0": 0.999, "filopodia-0": 0.995}
SHEETS, COLUMNS = Bar(0.0, "vertices of other sheets"), Bar(0.0, "vertices and pixels")

Mask = npt.NDArray[np.bool_]


def neighbours(atlas: unwrap3d.Atlas) -> sparse.csr_array:
    """Which vertices of the surface share an edge."""
    faces, size = atlas.surface.faces, len(atlas.surface.vertices)
    a, b = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    graph = sparse.coo_array((np.ones(len(a), bool), (a, b)), shape=(size, size)).tocsr()
    return sparse.csr_array(graph + graph.T)


def grown(inside: Mask, graph: sparse.csr_array) -> Mask:
    """A patch and the vertices next to it."""
    larger: Mask = inside | (graph @ inside)
    return larger


def patch(start: int, count: int, graph: sparse.csr_array) -> Mask:
    """A connected patch around a vertex, of about so many vertices."""
    inside = np.zeros(graph.shape[0], bool)
    inside[start] = True
    while np.count_nonzero(inside) < count:
        larger = grown(inside, graph)
        if (larger == inside).all():
            break
        inside = larger
    return inside


def places(atlas: unwrap3d.Atlas) -> npt.NDArray[np.int64]:
    """The pixel (v, u) of uv that every vertex lies in, (n, 2); −1 where it has none."""
    rows = atlas.uv.shape[0]
    place = atlas.topography.surface[:, 1:]
    known = np.isfinite(place).all(axis=1)
    pixel = np.full(place.shape, -1, np.int64)
    v, u = np.floor(place[known] + 0.5).astype(np.int64).T
    over = (v < 0) | (v >= rows)
    v = np.where(v < 0, -1 - v, np.where(v >= rows, 2 * rows - 1 - v, v))
    pixel[known] = np.stack([v, (u + rows * over) % (2 * rows)], axis=1)
    return pixel


def buried(atlas: unwrap3d.Atlas, pixel: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Vertices that lie well below the highest one of their pixel."""
    d, known = atlas.topography.surface[:, 0], pixel[:, 0] >= 0
    highest = np.full(atlas.uv.shape, -np.inf)
    np.maximum.at(highest, tuple(pixel[known].T), d[known])
    below = np.zeros(len(d), bool)
    below[known] = d[known] < highest[tuple(pixel[known].T)] - 3.0 * atlas.voxel_um
    return np.flatnonzero(below)


def read_from_direct(annotations: Any) -> Mask:
    """What is seen in the direct chart, drawn there on an empty annotation."""
    image = annotations.image("drawn", "direct")
    annotations.add("read")
    annotations.draw("read", "direct", np.nonzero(image), 1)
    read: Mask = annotations.labels("read") == 1
    annotations.remove("read")
    return read


def measure_patches(atlas: unwrap3d.Atlas, hidden: npt.NDArray[np.int64]) -> dict[str, Any]:
    """IoU of every patch, and vertices that came back on another sheet."""
    annotations, graph = atlas.annotations, neighbours(atlas)
    rng, size = np.random.default_rng(SEED), graph.shape[0]
    overlaps, mixed, counts = [], 0, []
    for number in range(PATCHES):
        start = rng.choice(hidden) if number % 2 and len(hidden) else rng.integers(size)
        count = int(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        truth = patch(int(start), count, graph)
        annotations.draw_vertices("drawn", np.flatnonzero(truth), 1)
        read = read_from_direct(annotations)
        annotations.draw_vertices("drawn", np.flatnonzero(truth), 0)
        overlaps.append(regions.intersection_over_union(truth, read))
        near = truth
        for _ in range(RINGS):
            near = grown(near, graph)
        mixed += int(np.count_nonzero(read & ~near))
        counts.append(int(np.count_nonzero(truth)))
    return {
        "iou": float(np.min(overlaps)),
        "mean_iou": float(np.mean(overlaps)),
        "exact": int(np.count_nonzero(np.array(overlaps) == 1.0)),
        "mixed": mixed,
        "patches": PATCHES,
        "buried": len(hidden),
        "vertices": f"{min(counts)}–{max(counts)} of {size}",
    }


def measure_columns(atlas: unwrap3d.Atlas, pixel: npt.NDArray[np.int64]) -> dict[str, Any]:
    """Vertices that were missed or marked beside, and pixels that are not as drawn."""
    annotations, rows, wrong, drawn = atlas.annotations, atlas.uv.shape[0], 0, 0
    for seed in range(PATCHES // regions.REGIONS):
        for region in regions.random_regions(rows, SEED + seed):
            annotations.draw("drawn", "uv", np.nonzero(region), 1)
            # Without an image a vertex has pixel −1, which would be the last one.
            expected = (pixel[:, 0] >= 0) & region[tuple(pixel.T)]
            wrong += int(np.count_nonzero((annotations.labels("drawn") == 1) != expected))
            wrong += int(np.count_nonzero((annotations.image("drawn", "uv") == 1) != region))
            drawn += int(np.count_nonzero(expected))
            annotations.undo()
    return {"wrong": wrong, "regions": PATCHES, "vertices_marked": drawn}


def run_case(name: str) -> dict[str, Any]:
    """All numbers of a case, in this process."""
    case = all_cases()[name]
    atlas = unwrap3d.unwrap(case.load(), case.all_parameters())
    atlas.annotations.add("drawn")
    pixel = places(atlas)
    columns = measure_columns(atlas, pixel)
    return {
        "patches": measure_patches(atlas, buried(atlas, pixel)),
        "columns": columns,
        "grid": case.grid,
    }


def entries_of(name: str, found: Any) -> Entries:
    labels = Bar(CASES[name], "mean IoU", at_least=True)
    names = [f"views/{part}/{name}" for part in ("labels-direct", "sheets", "columns")]
    if isinstance(found, str):
        bars = (labels, SHEETS, COLUMNS)
        return {key: bar.entry(None, note=found) for key, bar in zip(names, bars, strict=True)}
    patches, columns, grid = found["patches"], found["columns"], found["grid"]
    more = {key: patches[key] for key in ("exact", "patches", "vertices")}
    more["smallest"] = results.significant(patches["iou"])
    return dict(
        zip(
            names,
            (
                labels.entry(patches["mean_iou"], grid=grid, **more),
                SHEETS.entry(patches["mixed"], grid=grid, buried=patches["buried"]),
                COLUMNS.entry(columns.pop("wrong"), grid=grid, **columns),
            ),
            strict=True,
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--dry", action="store_true", help="do not write the results")
    options = options_of(parser, run_case, 1)
    for name in options.only:
        entries = entries_of(name, run_child(__file__, name, limit_s=LIMIT_S))
        results.show(entries)
        if not options.dry:
            results.merge(entries)


if __name__ == "__main__":
    main()
