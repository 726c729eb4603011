"""Runs a batch from its plan to its summary."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..parameters import Parameters
from ..pipeline import ProgressLike
from ..progress import Progress
from ..provenance import environment
from .cluster import check_memory, existing, local, memory_bytes
from .driver import Driver
from .inputs import Reading
from .jobs import Exports
from .locks import held
from .planning import Input, Labels, Plan, plan_batch
from .result import BatchResult, Row
from .tasks import task_of

if TYPE_CHECKING:
    from distributed import Client

FORMAT = "napari-unwrap3d batch"
LOCK = ".batch.lock"


def run_batch(
    inputs: Iterable[Input],
    parameters: Parameters | None = None,
    output: str | Path = "batch-output",
    *,
    reading: Reading | None = None,
    timelapse: bool = False,
    movies: bool = True,
    labels: Labels = None,
    track: bool = False,
    measure: bool = False,
    exports: Exports | None = None,
    workers: int | None = None,
    threads: int | None = None,
    memory_gb: float | None = None,
    scheduler: str | None = None,
    retries: int = 2,
    progress: ProgressLike = None,
) -> BatchResult:
    """Unwrap many cells and movies.

    Parameters
    ----------
    inputs : iterable of path, Stack, Mask, Surface or Timelapse
        Files, folders and patterns such as ``"*.tif"``: stacks, label images, masks or meshes.
        A stack over time is a movie, every other file a cell. What is in memory is written to
        the output first, as workers are other processes.
    parameters : Parameters, optional
    output : path
        A folder for each cell (as `run` writes it) and each movie, ``log``, ``summary.csv`` and
        ``summary.json``. What is there and holds is not made again.
    reading : Reading, optional
        How files are read.
    timelapse : bool
        The inputs are the timepoints of one movie.
    movies : bool
        False: of a stack over time only ``stack.timepoint`` is unwrapped.
    labels : "all" or sequence of int, optional
        The stacks are label images: one atlas, or one movie, for each label.
    track : bool
        Movies: also link what ``measurement.tracks`` names, protrusions or regions by flow, as
        ``napari-unwrap3d track`` does. Protrusions of every timepoint are found before; without
        tracks they are where ``protrusions.compute`` is set.
    measure : bool
        Movies: also track, and measure the tracks, as ``napari-unwrap3d measure`` does, into
        ``measurements`` in the output.
    exports : Exports, optional
        What is written of single cells, and of measurements.
    workers, threads : int, optional
        Processes on this machine, and threads in each; by default what its cores and its memory
        allow.
    memory_gb : float, optional
        Of each worker.
    scheduler : str, optional
        Address of a dask scheduler, e.g. ``tcp://10.0.0.1:8786``, whose workers do the work
        instead. They see the input and the output under the same paths.
    retries : int
        How often an item is tried again whose worker has died; of a cluster, its own setting.
    progress : Progress, or callable(stage, fraction, message), optional
        Cancelling it ends the workers; what was made stays.

    Returns
    -------
    BatchResult
        What failed is in it with the reason; the other items are not affected.

    Raises
    ------
    InputError
        A file does not exist, there is nothing to do, not even one worker fits into the memory,
        or another batch is at work in the output.
    Cancelled
        The user asked to stop; the summary tells what is left.
    """
    report = progress if isinstance(progress, Progress) else Progress(progress)
    plan = plan_batch(
        inputs,
        parameters,
        output,
        reading=reading,
        timelapse=timelapse,
        movies=movies,
        labels=labels,
        track=track,
        measure=measure,
        exports=exports,
        workers=workers,
        threads=threads,
        memory_gb=memory_gb,
        scheduler=scheduler,
        retries=retries,
        progress=report.named("plan"),
    )
    return run_plan(plan, report)


def run_plan(
    plan: Plan,
    progress: ProgressLike = None,
    watch: Callable[[list[Row]], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> BatchResult:
    """Do what was planned; see :func:`run_batch`.

    Parameters
    ----------
    plan : Plan
    progress : Progress, or callable(stage, fraction, message), optional
    watch : callable(rows), optional
        Called with the rows of all items whenever one has ended.
    tell : callable, optional
        Given the workers and their memory in words, before the work begins.
    """
    report = progress if isinstance(progress, Progress) else Progress(progress)
    with _alone(plan.output):
        if not plan.jobs:
            return _finished(BatchResult(plan.output, plan.failed, _about(plan, "no workers")))
        _tidy(plan)
        tasks = [task_of(job, plan.output) for job in plan.jobs]
        with _workers(plan) as (client, limit, words):
            if tell is not None:
                tell(words)
            driver = Driver(
                tasks,
                plan.output,
                client,
                plan.retries,
                report.named("batch"),
                limit,
                plan.failed,
                watch,
            )
            try:
                driver.run()
            finally:
                result = BatchResult(plan.output, tuple(driver.rows), _about(plan, words))
                result.write()
    return result


@contextmanager
def _workers(plan: Plan) -> Iterator[tuple[Client, float, str]]:
    """The client, what a worker may take (0 if that is not known), and both in words."""
    largest = max(plan.estimates)
    if plan.crew is not None:
        with local(plan.crew, plan.retries) as client:
            yield client, plan.crew.memory_bytes, str(plan.crew)
        return
    assert plan.scheduler is not None
    with existing(plan.scheduler, plan.output) as client:
        words = check_memory(client, largest)
        yield client, memory_bytes(client), words


@contextmanager
def _alone(output: Path) -> Iterator[None]:
    """Keep other batches out of the folder."""
    lock = held(output / LOCK)
    if lock is None:
        raise InputError(
            "Another batch is at work in this folder.",
            output=str(output),
            hint="Wait for it, or choose another output.",
        )
    with lock:
        yield


def _tidy(plan: Plan) -> None:
    """Remove what pieces of work that were killed have left half-written."""
    for job in plan.jobs:
        for folder in filter(None, (job.folder, job.measured_folder)):
            for left in Path(folder).glob("**/.*.partial"):
                shutil.rmtree(left, ignore_errors=True)


def _about(plan: Plan, workers: str) -> dict[str, object]:
    parameters = plan.jobs[0].parameters.to_toml() if plan.jobs else ""
    return {
        "format": FORMAT,
        "versions": environment(),
        "workers": workers,
        "parameters": parameters,
    }


def _finished(result: BatchResult) -> BatchResult:
    result.write()
    return result
