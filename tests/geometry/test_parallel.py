"""Blocks on threads: order, errors, cancellation, progress, and the same bits on any number."""

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask
from napari_unwrap3d.errors import Cancelled, ParameterError
from napari_unwrap3d.geometry.compare import chamfer_distance
from napari_unwrap3d.geometry.curvature import mean_curvature
from napari_unwrap3d.geometry.curvilinear import evaluate, invert, trim_folded
from napari_unwrap3d.geometry.distance import signed_distance
from napari_unwrap3d.geometry.parallel import THREADS_VARIABLE, ranges, run_blocks, workers
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.progress import Progress
from shapes import QUICK, ball, grid


def test_as_many_threads_as_cores_unless_told_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(THREADS_VARIABLE, raising=False)
    if hasattr(os, "sched_getaffinity"):
        assert workers() == len(os.sched_getaffinity(0))
    monkeypatch.setenv(THREADS_VARIABLE, "3")
    assert workers() == 3
    assert workers(5) == 5


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be chosen")
def test_only_the_cores_that_may_be_used_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(THREADS_VARIABLE, raising=False)
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        assert workers() == 1
    finally:
        os.sched_setaffinity(0, allowed)


@pytest.mark.parametrize("wrong", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_is_none_is_refused(
    wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(THREADS_VARIABLE, wrong)
    with pytest.raises(ParameterError, match=THREADS_VARIABLE):
        workers()


def test_ranges_cover_everything_once() -> None:
    assert ranges(0, 4) == []
    assert [(r.start, r.stop) for r in ranges(10, 4)] == [(0, 4), (4, 8), (8, 10)]


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_results_come_in_the_order_of_the_blocks(threads: int) -> None:
    def slow_at_first(block: int) -> int:
        time.sleep(0.002 * (5 - block))
        return block**2

    assert run_blocks(slow_at_first, range(5), threads=threads) == [0, 1, 4, 9, 16]
    assert run_blocks(slow_at_first, [], threads=threads) == []


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_in_a_block_reaches_the_caller_and_no_other_starts(threads: int) -> None:
    started = []

    def failing(block: int) -> None:
        started.append(block)
        time.sleep(0.01)
        if block == 2:
            raise ZeroDivisionError("block 2")

    with pytest.raises(ZeroDivisionError, match="block 2"):
        run_blocks(failing, range(500), threads=threads)
    assert len(started) < 100


@pytest.mark.parametrize("threads", [1, 2])
def test_a_cancellation_ends_the_wait_after_a_few_blocks(threads: int) -> None:
    progress = Progress()
    seen = []

    def block(number: int) -> None:
        seen.append(number)
        time.sleep(0.05)
        if number == 5:
            progress.cancel()

    with pytest.raises(Cancelled):
        run_blocks(block, range(1000), progress, threads=threads)
    begun = len(seen)
    assert begun < 40
    time.sleep(0.2)
    assert len(seen) <= begun + threads, "no block is begun after it"


@pytest.mark.parametrize("threads", [1, 2])
def test_progress_grows_with_the_blocks(threads: int) -> None:
    seen: list[float] = []
    progress = Progress(lambda step, fraction, message: seen.append(fraction))
    run_blocks(lambda block: time.sleep(0.002), range(20), progress, "working", threads=threads)
    assert seen[0] == 0.0
    assert seen == sorted(seen)
    assert 0.5 < seen[-1] <= 1.0


# The same bits ------------------------------------------------------------------------

RNG = np.random.default_rng(3)
SOLID = RNG.random((40, 41, 43)) > 0.98
POINTS = RNG.uniform(0, 39, (40_000, 3))
NODES = RNG.random((9, 40, 64, 3)).astype(np.float32)
PLACES = RNG.uniform(0, 8, (40_000, 3))


def trimmed() -> Any:
    first = np.zeros(NODES.shape[1:3], np.int64)
    last = np.full(first.shape, 8)
    lost = trim_folded(NODES, first, last, 4, first + 3, first + 5)
    return first, last, lost


KERNELS: dict[str, Callable[[], Any]] = {
    "distance": lambda: signed_distance(SOLID),
    "curvature": lambda: mean_curvature(signed_distance(SOLID), POINTS),
    "evaluate": lambda: evaluate(NODES, PLACES),
    "invert": lambda: invert(NODES, evaluate(NODES, PLACES), PLACES + 0.2, 5, 1e-6),
    "trim": trimmed,
    "chamfer": lambda: chamfer_distance(POINTS, PLACES),
}


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_give_the_same_bits_on_one_thread_and_on_many(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv(THREADS_VARIABLE, threads)
        found = KERNELS[name]()
        results.append(found if isinstance(found, tuple) else (found,))
    for others in results[1:]:
        for one, other in zip(results[0], others, strict=True):
            np.testing.assert_array_equal(one, other)


def test_the_whole_pipeline_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    mask = Mask(ball(9.0, 30) | (grid(30)[..., 0] > 22) & ball(12.0, 30), (0.1, 0.1, 0.1))
    atlases = []
    for threads in ("1", "4"):
        monkeypatch.setenv(THREADS_VARIABLE, threads)
        atlases.append(Pipeline(mask).run(QUICK))
    one, other = atlases
    assert one.quality == other.quality
    for name in ("nodes", "mask", "surface", "first_layer", "meshed_vertices", "meshed_faces"):
        np.testing.assert_array_equal(
            getattr(one.topography, name), getattr(other.topography, name)
        )
    np.testing.assert_array_equal(one.sphere.vertices, other.sphere.vertices)
