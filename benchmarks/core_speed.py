"""CPU seconds and peak memory from a bleb cell's mask to its topographic surface, one core.

    .venv/bin/python benchmarks/core_speed.py

Then how much sooner it is done on two cores: wall time on one over that on two, each the
best of two turns that take place by turns. Other work on the machine disturbs this number.

The child is held to one core and one thread, its kernels are compiled on a tiny cell first,
and the mask comes from a file, so that the peak is the pipeline's own.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.cases import FULL, HALF, simulated
from common.children import options_of, run_child
from common.results import Bar, Entries

import napari_unwrap3d as unwrap3d

LIMIT_S = 1200.0
CPU_BARS = {FULL: Bar(25.0, "CPU s"), HALF: Bar(12.0, "CPU s")}
MEMORY_BAR = Bar(2.0, "GB")
TWO_CORES_BAR = Bar(1.25, "× faster", at_least=True)
TWO_CORES = f"core/two-cores/blebs-{2 * FULL}x{FULL}"
TURNS = 2
WARM_UP_ROWS = 32


def tiny_cell() -> unwrap3d.Mask:
    """A ball of radius 14 voxels with a bleb on it: every kernel runs in a second."""
    z, y, x = np.indices((48, 48, 48)) - 24.0
    ball = z**2 + y**2 + x**2 < 14.0**2
    bleb = (z - 13.0) ** 2 + y**2 + x**2 < 6.0**2
    return unwrap3d.Mask(ball | bleb, (0.1, 0.1, 0.1))


def parameters(rows: int) -> unwrap3d.Parameters:
    """The defaults on a grid of `rows` rows."""
    return unwrap3d.Parameters.from_dict({"uv": {"rows": rows}})


class StepClock:
    """A progress callback that notes the CPU time of the process at every call."""

    def __init__(self) -> None:
        self._first: dict[str, float] = {}
        self._last: dict[str, float] = {}

    def __call__(self, step: str, fraction: float, message: str) -> None:
        self._last[step] = time.process_time()
        self._first.setdefault(step, self._last[step])

    def steps_s(self) -> dict[str, float]:
        """CPU seconds from the first to the last report of every step."""
        return {name: round(self._last[name] - self._first[name], 2) for name in self._first}


def run_once(mask_file: str, rows: int) -> dict[str, Any]:
    """CPU seconds, wall seconds and peak memory (GB) of one run in this process."""
    with np.load(mask_file) as saved:
        mask = unwrap3d.Mask(saved["mask"], tuple(saved["voxel_size"]))
    unwrap3d.unwrap(tiny_cell(), parameters(WARM_UP_ROWS))
    clock = StepClock()
    wall, cpu = time.perf_counter(), time.process_time()
    unwrap3d.unwrap(mask, parameters(rows), clock)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    # Linux counts ru_maxrss in KiB, macOS in bytes.
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return {"cpu_s": cpu, "wall_s": wall, "peak_gb": peak / 1e9, "steps_s": clock.steps_s()}


def measure(mask_file: str, rows: int, core: int) -> Entries:
    """The entries of one grid."""
    grid = f"{2 * rows}x{rows}"
    found = run_child(__file__, mask_file, str(rows), limit_s=LIMIT_S, core=core)
    if isinstance(found, str):
        entries = {f"core/time/blebs-{grid}": CPU_BARS[rows].entry(None, note=found)}
        if rows == FULL:
            entries[f"core/memory/blebs-{grid}"] = MEMORY_BAR.entry(None, note=found)
        return entries
    more = {"wall_s": results.significant(found["wall_s"], 3), "steps_cpu_s": found["steps_s"]}
    entries = {f"core/time/blebs-{grid}": CPU_BARS[rows].entry(found["cpu_s"], **more)}
    if rows == FULL:
        entries[f"core/memory/blebs-{grid}"] = MEMORY_BAR.entry(found["peak_gb"])
    return entries


def two_cores(mask_file: str, cores: list[int]) -> Entries:
    """Wall time on one core over that on two."""
    if len(cores) < 2:
        return {TWO_CORES: TWO_CORES_BAR.entry(None, note="there is only one core")}
    best: dict[int, float] = {}
    for _ in range(TURNS):
        for count in (1, 2):
            found = run_child(__file__, mask_file, str(FULL), limit_s=LIMIT_S, core=cores[-count:])
            if isinstance(found, str):
                return {TWO_CORES: TWO_CORES_BAR.entry(None, note=found)}
            best[count] = min(found["wall_s"], best.get(count, LIMIT_S))
    walls = {f"wall_{count}_s": results.significant(wall, 3) for count, wall in best.items()}
    return {TWO_CORES: TWO_CORES_BAR.entry(best[1] / best[2], **walls)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, lambda file, rows: run_once(file, int(rows)), 2)
    cores = sorted(os.sched_getaffinity(0))
    mask = simulated("blebs", 0).truth.mask
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "mask.npz")
        np.savez(file, mask=mask.data, voxel_size=mask.voxel_size)
        for rows in (FULL, HALF):
            entries = measure(file, rows, cores[-1])
            results.show(entries)
            results.merge(entries)
        entries = two_cores(file, cores)
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
