"""Equal areas on the sphere: the Poisson flow against the paper's advection, in one process.

    .venv/bin/python benchmarks/core_advection.py

Both start from the same conformal map of the same reference and stop by their own rules. The
advection only knows its best map when the iterations after it were no better, and is charged for
them; the ratio without them is in the entry, too.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from common import measures, results
from common.cases import simulated
from common.children import options_of, run_child
from common.results import Bar, Entries
from core_speed import WARM_UP_ROWS, parameters, tiny_cell

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.parameters import SphereParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.advection import advected_sphere
from napari_unwrap3d.unwrapping.conformal import conformal_sphere
from napari_unwrap3d.unwrapping.criteria import Criterion, wanted_shares
from napari_unwrap3d.unwrapping.equiareal import equiareal_sphere

LIMIT_S = 3600.0
KINDS = ("blebs", "lamellipodia", "filopodia")
SEED = 0
BAR = Bar(5.0, "× less CPU", at_least=True)
DEFAULTS = SphereParameters()


def run_kind(kind: str) -> dict[str, Any]:
    """CPU seconds, |log λ| and flips of both methods on the reference of one cell."""
    unwrap3d.unwrap(tiny_cell(), parameters(WARM_UP_ROWS))
    mask = simulated(kind, SEED).truth.mask
    reference = unwrap3d.Pipeline(mask).run(until="reference").reference
    vertices, faces = reference.vertices, reference.faces
    start = time.process_time()
    conformal = conformal_sphere(vertices, faces, silent())
    seconds = time.process_time() - start
    return {
        "vertices": len(vertices),
        "conformal_cpu_s": seconds,
        "conformal_log_lambda": measures.log_area_distortion(vertices, conformal, faces),
        "poisson": by_poisson(vertices, conformal, faces),
        "advection": by_advection(vertices, conformal, faces),
    }


def by_poisson(vertices: Any, conformal: Any, faces: Any) -> dict[str, Any]:
    """Step 3 as the package does it by default."""
    start = time.process_time()
    directions, history = equiareal_sphere(
        vertices,
        conformal,
        faces,
        silent(),
        iterations=DEFAULTS.iterations,
        tolerance=DEFAULTS.tolerance,
    )
    return {
        "cpu_s": time.process_time() - start,
        "iterations": len(history) - 1,
        **distortion(vertices, directions, faces),
    }


def by_advection(vertices: Any, conformal: Any, faces: Any) -> dict[str, Any]:
    """Step 3 as the paper does it, with its ε and δ."""
    wanted = wanted_shares(vertices, faces, "reference")
    criterion = Criterion("equiareal", None, vertices, faces, wanted)
    start = time.process_time()
    found = advected_sphere(
        conformal,
        faces,
        wanted,
        criterion,
        silent(),
        iterations=DEFAULTS.iterations,
        tolerance=DEFAULTS.tolerance,
        step=DEFAULTS.step,
        delta=DEFAULTS.delta,
    )
    seconds = time.process_time() - start
    done = len(found.errors) - 1
    return {
        "cpu_s": seconds,
        "cpu_s_to_best": seconds * found.iteration / max(done, 1),
        "iterations": done,
        "best_iteration": found.iteration,
        "iterations_with_flips": int((np.asarray(found.flips) > 0).sum()),
        **distortion(vertices, found.directions, faces),
    }


def distortion(vertices: Any, directions: Any, faces: Any) -> dict[str, Any]:
    return {
        "log_lambda": measures.log_area_distortion(vertices, directions, faces),
        "flips": measures.flips(directions, faces),
    }


def entry(kind: str, found: Any) -> Entries:
    """How many times less CPU; holds only where the areas are no worse and nothing flips."""
    name = f"core/advection/{kind}"
    if isinstance(found, str):
        return {name: BAR.entry(None, note=found)}
    ours, papers = found["poisson"], found["advection"]
    ratio = papers["cpu_s"] / ours["cpu_s"]
    to_best = results.significant(papers["cpu_s_to_best"] / ours["cpu_s"], 4)
    made = BAR.entry(ratio, ratio_to_best=to_best, **rounded(found))
    made["holds"] &= ours["log_lambda"] <= papers["log_lambda"] and ours["flips"] == 0
    return {name: made}


def rounded(values: dict[str, Any]) -> dict[str, Any]:
    """The same, nested, with four significant digits."""
    return {
        name: rounded(item) if isinstance(item, dict) else results.significant(item, 4)
        for name, item in values.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, run_kind, 1)
    for kind in KINDS:
        entries = entry(kind, run_child(__file__, kind, limit_s=LIMIT_S))
        results.show(entries)
        results.merge(entries)


if __name__ == "__main__":
    main()
