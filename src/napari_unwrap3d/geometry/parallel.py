"""Blocks of work on several threads, with progress and cancellation.

The compiled kernels run without the interpreter's lock, so that threads are enough. Blocks
must be independent and their number must not depend on that of the threads: then the result
does not either.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import TypeVar

from ..errors import ParameterError
from ..progress import Progress, silent

Block = TypeVar("Block")
Result = TypeVar("Result")

THREADS_VARIABLE = "NAPARI_UNWRAP3D_THREADS"
POLL_SECONDS = 0.05


def workers(threads: int | None = None) -> int:
    """Number of threads to use.

    Parameters
    ----------
    threads : int, optional
        By default that in the environment variable ``NAPARI_UNWRAP3D_THREADS``, or, where it
        is not set, the number of cores that this process may run on.

    Raises
    ------
    ParameterError
        The number, or the variable, is not a positive whole number.
    """
    wanted = os.environ.get(THREADS_VARIABLE, "") if threads is None else str(threads)
    if not wanted:
        return _cores()
    if not wanted.strip().isdigit() or int(wanted) < 1:
        raise ParameterError(
            f"The number of threads must be 1 or more, not {wanted!r}.",
            hint=f"Set {THREADS_VARIABLE} to a whole number, or leave it unset.",
        )
    return int(wanted)


def _cores() -> int:
    """Cores that this process may run on, which a cluster or a container may limit."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def ranges(size: int, length: int) -> list[slice]:
    """Slices of `length`, the last one shorter, that together are 0 … `size`."""
    return [slice(start, min(start + length, size)) for start in range(0, size, length)]


def run_blocks(
    function: Callable[[Block], Result],
    blocks: Sequence[Block],
    progress: Progress | None = None,
    message: str = "",
    *,
    threads: int | None = None,
) -> list[Result]:
    """The results of `function` for every block, in the order of the blocks.

    On the first error, or when the user cancels, no further block is started and the error is
    raised at once. Blocks that run then finish in the background: they should take a tenth of
    a second, and write to nothing that the caller still reads after an error.

    Parameters
    ----------
    function : callable
        Of one block; should release the interpreter's lock for most of its time.
    blocks : sequence
    progress : Progress, optional
        Told the fraction of the blocks that are done.
    message : str
        Told to the progress.
    threads : int, optional
        See :func:`workers`.
    """
    report = progress if progress is not None else silent()
    count = min(workers(threads), len(blocks))
    if count <= 1:
        results = []
        for number, block in enumerate(blocks):
            report(number / len(blocks), message)
            results.append(function(block))
        return results
    report(0.0, message)
    pool = ThreadPoolExecutor(count, thread_name_prefix="unwrap3d-block")
    try:
        futures = [pool.submit(function, block) for block in blocks]
        _wait_for(futures, report, message)
        return [future.result() for future in futures]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _wait_for(futures: Sequence[Future[Result]], report: Progress, message: str) -> None:
    """Wait until all are done, or raise the first error or cancellation."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
        for future in done:
            future.result()
        if pending:
            report.check()
            if done:
                report(1.0 - len(pending) / len(futures), message)
