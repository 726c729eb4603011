"""The command ``napari-unwrap3d batch``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ..errors import Cancelled, ParameterError
from ..options import add_charts, add_output, add_parameters, add_reading, chosen_parameters

if TYPE_CHECKING:
    from rich.console import Console

    from .planning import Labels, Plan
    from .result import BatchResult

INTERRUPTED = 130
MOST_FAILURES_SHOWN = 20


def add_batch(commands: Any) -> None:
    """Add the command to the command line."""
    batch = commands.add_parser(
        "batch",
        help="unwrap many cells and movies on many workers",
        description="Unwrap cells and movies: files, label images and timepoints, on the cores of "
        "this machine or on a dask cluster. The same command again goes on where it was stopped. "
        "Exit code 3: some items failed, see summary.csv in the output.",
    )
    batch.set_defaults(command=batch_command)
    batch.add_argument(
        "inputs",
        nargs="+",
        metavar="INPUT",
        help="stacks, masks or meshes: files, folders, or patterns in quotes; a stack over time "
        "is a movie",
    )
    batch.add_argument(
        "--timelapse",
        action="store_true",
        help="the files, in this order, are the timepoints of one movie",
    )
    batch.add_argument("--time-step", type=float, metavar="S", help="seconds between timepoints")
    batch.add_argument(
        "--labels",
        nargs="+",
        metavar="LABEL",
        help="label images: one atlas, or one movie, for each of these labels, or for `all`",
    )
    batch.add_argument("--mask", action="store_true", help="stacks are masks: not 0 is cell")
    add_reading(batch)
    add_parameters(batch)
    batch.add_argument("--channel", type=int, help="channel that shows the cell (from 0)")
    batch.add_argument(
        "--timepoint", type=int, help="of a stack over time, only this timepoint (from 0)"
    )
    batch.add_argument(
        "--signal",
        nargs="+",
        default=(),
        metavar="CHANNEL",
        help="channels sampled below the surface of single cells; of movies: --set movie.signals",
    )
    add_charts(batch, movies=" (of movies, at every timepoint)")
    batch.add_argument(
        "--track",
        action="store_true",
        help="movies: also follow what measurement.tracks names, as `track` does: the protrusions "
        "of every timepoint, which are found before, or regions by flow",
    )
    batch.add_argument(
        "--measure",
        action="store_true",
        help="movies: also measure the tracks (implies --track), as `measure` does, into "
        "OUTPUT/measurements",
    )
    _add_workers(batch)
    add_output(batch, None)


def _add_workers(batch: argparse.ArgumentParser) -> None:
    workers = batch.add_argument_group("workers")
    workers.add_argument(
        "--workers", type=_count, metavar="N", help="processes (default: cores that memory allows)"
    )
    workers.add_argument("--threads", type=_count, metavar="N", help="threads of each process")
    workers.add_argument(
        "--memory", type=_size, metavar="GB", help="of each process (default: a part of the free)"
    )
    workers.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="use the workers of this dask scheduler (SLURM, Kubernetes, …), e.g. "
        "tcp://10.0.0.1:8786; they must see the same files",
    )
    workers.add_argument(
        "--retries",
        type=int,
        default=2,
        metavar="N",
        help="tries of an item after its process died (default: 2)",
    )


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("it must be 1 or more")
    return number


def _size(text: str) -> float:
    size = float(text)
    if not 0 < size < float("inf"):
        raise argparse.ArgumentTypeError("it must be more than 0")
    return size


def batch_command(arguments: argparse.Namespace, console: Console) -> int:
    """``batch``: plan, say so, run, and sum up."""
    from rich.console import Console

    from ..cli import interruptible
    from ..console import StepProgress
    from ..progress import Progress
    from .running import run_plan

    errors = Console(stderr=True)
    with (
        StepProgress(console, estimate=True) as bars,
        interruptible(Progress(bars, "plan")) as progress,
    ):
        plan = _planned(arguments, progress)
        console.print(plan.in_words, highlight=False)
        try:
            result = run_plan(
                plan, progress, tell=lambda words: console.print(words, highlight=False)
            )
        except Cancelled:
            errors.print(
                "Stopped. What was made stays; the same command again goes on from there.",
                highlight=False,
            )
            return INTERRUPTED
    _print_result(result, console, errors)
    return result.exit_code


def _planned(arguments: argparse.Namespace, progress: Any) -> Plan:
    from .inputs import Reading
    from .jobs import Exports
    from .planning import plan_batch

    reading = Reading(
        voxel_size=arguments.voxel_size,
        axes=arguments.axes,
        dataset=arguments.dataset,
        time_step=arguments.time_step,
        scale=arguments.scale,
        mask=arguments.mask,
    )
    exports = Exports(
        formats=tuple(arguments.format),
        pictures=not arguments.no_pictures,
        signals=tuple(arguments.signal),
    )
    exports.chosen_formats()
    return plan_batch(
        arguments.inputs,
        chosen_parameters(arguments),
        arguments.output,
        reading=reading,
        timelapse=arguments.timelapse,
        movies=arguments.timepoint is None,
        labels=_labels(arguments.labels),
        track=arguments.track,
        measure=arguments.measure,
        exports=exports,
        workers=arguments.workers,
        threads=arguments.threads,
        memory_gb=arguments.memory,
        scheduler=arguments.scheduler,
        retries=arguments.retries,
        progress=progress,
    )


def _labels(words: list[str] | None) -> Labels:
    """``all``, or numbers, also separated by commas."""
    if words is None:
        return None
    numbers = [word for part in words for word in part.split(",") if word]
    if numbers == ["all"]:
        return "all"
    if not numbers or not all(word.isdigit() and int(word) > 0 for word in numbers):
        raise ParameterError(
            f"{' '.join(words)!r} are no labels.", hint="Write --labels all, or --labels 1 2 7."
        )
    return [int(word) for word in numbers]


def _print_result(result: BatchResult, console: Console, errors: Console) -> None:
    from .result import in_words, place

    for row in result.failed[:MOST_FAILURES_SHOWN]:
        text = f"Failed: {place(row)}, {row.stage}: {row.reason}"
        errors.print(text, highlight=False, markup=False)
    more = len(result.failed) - MOST_FAILURES_SHOWN
    if more > 0:
        errors.print(f"… and {more} more.", highlight=False)
    console.print(f"Items: {in_words(result.counts)}", highlight=False)
    console.print(f"Written to {result.output}, see summary.csv", markup=False, highlight=False)
