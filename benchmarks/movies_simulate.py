"""How quickly simulated movies are made, and in how much memory.

    .venv/bin/python benchmarks/movies_simulate.py
    .venv/bin/python benchmarks/movies_simulate.py --only blebs

Every frame is made with its truth. Memory is the peak of a process that does nothing else.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time

from common import results
from common.results import Bar, Entries

from napari_unwrap3d import simulate

SEED = 0
FEW, MANY = 20, 200
SECONDS = Bar(1.5, "CPU s per frame")
GROWTH = Bar(1.3, "peak of 200 frames / peak of 20")
MEGABYTE = 1024.0


def measure(kind: str) -> Entries:
    """The entries of one kind of movie."""
    few, _, _ = measured(kind, FEW)
    many, drawing, seconds = measured(kind, MANY)
    peaks = {"few_mb": results.significant(few, 4), "many_mb": results.significant(many, 4)}
    return {
        f"movies/simulate-seconds/{kind}": SECONDS.entry(
            seconds / MANY, drawing_cpu_s=results.significant(drawing, 3)
        ),
        f"movies/simulate-memory/{kind}": GROWTH.entry(many / few, **peaks),
    }


def measured(kind: str, timepoints: int) -> tuple[float, float, float]:
    """Peak memory in MB, CPU seconds of drawing and of all frames, in a process of its own."""
    command = [sys.executable, __file__, "--child", kind, str(timepoints)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    peak, drawing, seconds = map(float, done.stdout.split())
    return peak, drawing, seconds


def child(kind: str, timepoints: int) -> None:
    """Make a movie of 128³ working voxels, and say what it took."""
    warm = simulate.movie(kind, SEED + 10, size=72, timepoints=2)
    warm.frame(0)  # compiled loops are loaded
    start = time.process_time()
    movie = simulate.movie(kind, SEED, timepoints=timepoints, rotation_deg=3.0, drift_um=0.75)
    drawn = time.process_time()
    for _ in movie.frames():
        pass
    done = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEGABYTE
    print(peak, drawn - start, done - drawn)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=simulate.MOVIES, default=simulate.MOVIES)
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        child(arguments.child[0], int(arguments.child[1]))
        return
    for kind in arguments.only:
        entries = measure(kind)
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
