"""How time and memory grow with the size of the cell and of the image, one core.

    .venv/bin/python benchmarks/core_growth.py                 # everything, with the plot
    .venv/bin/python benchmarks/core_growth.py --sizes 100 200 --rows 256 512

Bleb cells of 100³, 200³ and 300³ voxels, images of 512×256, 1024×512 and 2048×1024 pixels.
There are no bars: the entries hold when the run ends within the limit of time. The plot,
docs/growth.png, shows all entries there are.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.children import options_of, run_child
from common.results import Bar, Entries
from core_speed import run_once

import napari_unwrap3d as unwrap3d

LIMIT_S = 1800.0
SIZES = (100, 200, 300)
ROWS = (256, 512, 1024)
BAR = Bar(LIMIT_S, "CPU s")
PLOT = results.HERE.parent / "docs" / "growth.png"


def name(size: int, rows: int) -> str:
    return f"core/growth/blebs-{size}-{2 * rows}x{rows}"


def measure(mask_file: str, size: int, rows: int, core: int) -> Entries:
    """The entry of one cell on one grid."""
    found = run_child(__file__, mask_file, str(rows), limit_s=LIMIT_S, core=core)
    if isinstance(found, str):
        return {name(size, rows): BAR.entry(None, note=found)}
    more = {"peak_gb": results.significant(found["peak_gb"], 3), "steps_cpu_s": found["steps_s"]}
    return {name(size, rows): BAR.entry(found["cpu_s"], **more)}


def plot(entries: Entries, file: Path) -> None:
    """CPU seconds and peak memory against the size of the cell, a line for every image."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(7.0, 2.8), layout="constrained")
    for panel, key, label in zip(
        axes, ("value", "peak_gb"), ("CPU time (s)", "peak memory (GB)"), strict=True
    ):
        for rows in ROWS:
            measured = _series(entries, rows, key)
            if measured:
                panel.plot(*zip(*measured, strict=True), "o-", label=f"{2 * rows}×{rows}")
        panel.set(xlabel="voxels along an edge", ylabel=label, xticks=SIZES)
        panel.set_ylim(bottom=0)
        panel.spines[["top", "right"]].set_visible(False)
    axes[0].legend(title="image", frameon=False, fontsize="small")
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=110)
    pyplot.close(figure)


def _series(entries: Entries, rows: int, key: str) -> list[tuple[int, float]]:
    found: list[tuple[int, Any]] = [
        (size, entries.get(name(size, rows), {}).get(key)) for size in SIZES
    ]
    return [(size, float(value)) for size, value in found if value is not None]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="*", type=int, choices=SIZES, default=SIZES)
    parser.add_argument("--rows", nargs="*", type=int, choices=ROWS, default=ROWS)
    options = options_of(parser, lambda file, rows: run_once(file, int(rows)), 2)
    core = max(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "mask.npz")
        for size in options.sizes:
            mask = unwrap3d.simulate.cell("blebs", 0, size=size).truth.mask
            np.savez(file, mask=mask.data, voxel_size=mask.voxel_size)
            for rows in options.rows:
                entries = measure(file, size, rows, core)
                results.show(entries)
                plot(results.merge(entries), PLOT)


if __name__ == "__main__":
    main()
