"""How long the pipeline goes on after it was asked to stop, at 20 random moments of a run.

    .venv/bin/python benchmarks/core_cancel.py

The moments are spread evenly at random over the run's time. To come to a moment quickly, the
steps before it are taken from the first run, and the step it falls into starts afresh.
"""

from __future__ import annotations

import argparse
import threading
import time
from typing import Any

import numpy as np
from common import results
from common.cases import FULL, simulated
from common.children import options_of, run_child
from common.results import Bar, Entries
from core_speed import parameters

import napari_unwrap3d as unwrap3d

LIMIT_S = 1200.0
MOMENTS = 20
SEED = 7
BAR = Bar(0.5, "s")
NAME = "core/cancel/blebs-0"


def run_all() -> dict[str, Any]:
    """Latencies in seconds, and the step of each moment."""
    mask = simulated("blebs", 0).truth.mask
    first = unwrap3d.Pipeline(mask)
    first.run(parameters(FULL))
    durations = {name: kept.seconds for name, kept in first.kept.items()}
    moments = np.sort(np.random.default_rng(SEED).uniform(0, sum(durations.values()), MOMENTS))
    latencies, steps = [], []
    for moment in moments:
        step, offset = _place(durations, float(moment))
        before = list(durations)[: list(durations).index(step)]
        pipeline = unwrap3d.Pipeline(mask, kept={name: first.kept[name] for name in before})
        latencies.append(latency(pipeline, step, offset))
        steps.append(step)
    return {"latencies": latencies, "steps": steps}


def latency(pipeline: unwrap3d.Pipeline, step: str, offset: float) -> float:
    """Seconds from the cancellation, `offset` seconds into `step`, to the end of the run."""
    started = threading.Event()

    def report(name: str, fraction: float, message: str) -> None:
        if name == step:
            started.set()

    progress = unwrap3d.Progress(report)
    ended: list[float] = []
    errors: list[Exception] = []

    def run() -> None:
        try:
            pipeline.run(parameters(FULL), progress)
        except unwrap3d.Cancelled:
            pass
        except unwrap3d.Unwrap3DError as error:
            errors.append(error)
        ended.append(time.perf_counter())

    thread = threading.Thread(target=run)
    thread.start()
    started.wait()
    time.sleep(offset)
    asked = time.perf_counter()
    progress.cancel()
    thread.join()
    _wait_for_compiled_code()
    if errors:
        raise errors[0]
    return max(ended[0] - asked, 0.0)


def _place(durations: dict[str, float], moment: float) -> tuple[str, float]:
    """The step that a moment of the run falls into, and how far into it."""
    for name, seconds in durations.items():
        if moment <= seconds:
            return name, moment
        moment -= seconds
    return name, seconds


def _wait_for_compiled_code() -> None:
    """Wait for what an earlier cancellation left running in the background."""
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and thread.name.startswith("unwrap3d"):
            thread.join()


def entry(found: Any) -> Entries:
    """The slowest of all moments."""
    if isinstance(found, str):
        return {NAME: BAR.entry(None, note=found)}
    slowest = int(np.argmax(found["latencies"]))
    return {
        NAME: BAR.entry(
            found["latencies"][slowest],
            median=results.significant(float(np.median(found["latencies"])), 3),
            slowest_step=found["steps"][slowest],
            moments=MOMENTS,
        )
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, run_all)
    found = run_child(__file__, limit_s=LIMIT_S)
    entries = entry(found)
    results.show(entries)
    results.merge(entries)


if __name__ == "__main__":
    main()
