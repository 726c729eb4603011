"""From what the user gives to what is to be done, before anything is computed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..charts import Mask, Stack, Surface
from ..errors import InputError, ParameterError, Unwrap3DError
from ..files.stacks import STACK_SUFFIXES
from ..motion.timelapse import Source, Timelapse
from ..parameters import Parameters
from ..progress import Progress
from .inputs import Looked, Reading, Recipe, expanded, keep_sources, kind_of, label_voxels
from .jobs import MADE, Exports, Job, unique_names, with_label
from .memory import Crew, crew, estimate
from .result import Row

Input = str | Path | Source | Timelapse
Labels = Literal["all"] | Sequence[int] | None
SOURCES, MEASUREMENTS = "sources", "measurements"


@dataclass(frozen=True)
class Plan:
    """What a batch will do.

    Attributes
    ----------
    output : Path
    jobs : tuple of Job
        A cell or a movie each.
    estimates : tuple of float
        Of every job, the bytes that a worker is estimated to take at most.
    failed : tuple of Row
        What cannot be opened, with the reason.
    crew : Crew or None
        The workers on this machine; None where a scheduler has its own.
    scheduler : str or None
    retries : int
        How often an item is tried again after its worker has died.
    """

    output: Path
    jobs: tuple[Job, ...]
    estimates: tuple[float, ...]
    failed: tuple[Row, ...]
    crew: Crew | None
    scheduler: str | None = None
    retries: int = 2

    @property
    def in_words(self) -> str:
        """What will be done."""
        movies = [job for job in self.jobs if job.timepoints is not None]
        counts = ((len(self.jobs) - len(movies), "cell"), (len(movies), "movie"))
        parts = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count]
        words = f"{' and '.join(parts) or 'Nothing'} to unwrap"
        further = [stage for stage in movies[0].further if stage != "alike"] if movies else []
        if not further:
            return words
        *first, last = further
        listed = f"{', '.join(first)} and {last}" if first else last
        return f"{words}, of movies also their {listed}"


@dataclass(frozen=True)
class _Wanted:
    """What is made of every cell and movie, and where."""

    output: Path
    exports: Exports
    track: bool
    measure: bool


@dataclass(frozen=True)
class _Planned:
    recipe: Recipe
    looked: Looked
    movie: bool


def plan_batch(
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
    progress: Progress | None = None,
) -> Plan:
    """Look at what is given, and say what will be done and with which workers.

    Parameters are those of :func:`~napari_unwrap3d.batch.run_batch`.

    Raises
    ------
    InputError
        A file does not exist, there is nothing to do, or not even one worker fits into the
        memory.
    """
    chosen = parameters or Parameters()
    report = progress or Progress()
    folder = Path(output).resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{str(folder)!r} is a file, not a folder.", hint="Choose another output.")
    wanted = _Wanted(folder, exports or Exports(), track or measure, measure)
    _check_tracked(chosen, wanted)
    recipes = _recipes(list(inputs), folder, reading or Reading(), timelapse, chosen)
    jobs: list[Job] = []
    estimates: list[float] = []
    failed: list[Row] = []
    for place, recipe in enumerate(recipes):
        part = report.part(place / len(recipes), (place + 1) / len(recipes))
        part(0.0, recipe.name)
        try:
            looked = Looked.at(recipe, chosen.stack.working_voxel_um)
            movie = looked.timepoints > 1 and (movies or recipe.sequence)
            planned = _Planned(recipe, looked, movie)
            found = _jobs(planned, chosen, labels, wanted, part)
        except (Unwrap3DError, OSError) as error:
            failed.append(Row(recipe.name, _file(recipe), stage="open", state="failed"))
            failed[-1].reason = str(error)
            continue
        jobs += [job for job, _ in found]
        estimates += [size for _, size in found]
    if wanted.track and jobs and all(job.timepoints is None for job in jobs):
        raise InputError(
            "There is no movie that could be tracked.",
            cells=len(jobs),
            hint="A movie is a stack over time, or files with --timelapse.",
        )
    hands = None
    if scheduler is None:
        pieces = sum(job.timepoints or 1 for job in jobs)
        hands = crew(max(estimates, default=1.0), pieces, workers, threads, memory_gb)
    return Plan(
        folder, tuple(jobs), tuple(estimates), tuple(failed), hands, scheduler, max(retries, 0)
    )


def _jobs(
    planned: _Planned,
    parameters: Parameters,
    labels: Labels,
    wanted: _Wanted,
    progress: Progress,
) -> list[tuple[Job, float]]:
    """The jobs of one input, one for each label, and what they take."""
    recipe, looked = planned.recipe, planned.looked
    if planned.movie:
        recipe.lapse(parameters.stack)  # whether the time between timepoints is known, …
    voxels: dict[int | None, int | None] = {parameters.stack.label: None}
    if labels is not None:
        found = label_voxels(
            recipe, parameters.stack, planned.movie, progress, first_only=labels != "all"
        )
        which = list(found) if labels == "all" else list(dict.fromkeys(labels))
        voxels = {int(label): found.get(int(label)) for label in which}
    jobs = []
    for label, count in voxels.items():
        own = with_label(parameters, label)
        name = recipe.name if labels is None else f"{recipe.name}_label{label}"
        job = Job(
            name=name,
            label=label,
            timepoints=looked.timepoints if planned.movie else None,
            recipe=recipe,
            parameters=own,
            folder=str(wanted.output / name),
            exports=wanted.exports,
            track=wanted.track,
            measure=wanted.measure,
            measured_folder=str(wanted.output / MEASUREMENTS / name),
        )
        jobs.append((job, estimate(looked, own, count, "protrusions" in job.further)))
    return jobs


def _check_tracked(parameters: Parameters, wanted: _Wanted) -> None:
    """Raise unless there is something to follow."""
    name = parameters.measurement.tracks
    if wanted.track and not wanted.measure and name not in MADE:
        raise ParameterError(
            f"Nothing is followed to make tracks named {name!r}.",
            hint=f"Set measurement.tracks to {' or '.join(MADE)}, or measure them.",
        )


# Recipes -----------------------------------------------------------------------------


def _recipes(
    inputs: list[Input], output: Path, reading: Reading, timelapse: bool, parameters: Parameters
) -> list[Recipe]:
    """How the sources are opened; those in memory are written to the output first."""
    if not inputs:
        raise InputError("There is nothing to do.", hint="Give files, folders or patterns.")
    in_memory = [each for each in inputs if isinstance(each, Stack | Mask | Surface | Timelapse)]
    if in_memory and len(in_memory) < len(inputs):
        raise InputError(
            "Files and sources in memory are not mixed in one batch.",
            files=len(inputs) - len(in_memory),
            in_memory=len(in_memory),
        )
    if in_memory:
        return _written(in_memory, output, reading, timelapse)
    paths = expanded(each for each in inputs if isinstance(each, str | Path))
    kinds = [kind_of(path, reading.mask) for path in paths]
    if not timelapse:
        names = unique_names([_stem(path) for path in paths])
        return [
            Recipe(kind=kind, paths=(str(path),), name=name, reading=reading)
            for kind, path, name in zip(kinds, paths, names, strict=True)
        ]
    if len(set(kinds)) > 1 or len(paths) < 2:
        raise InputError(
            "The files of one movie are two or more, and of one kind.",
            files=len(paths),
            kinds=sorted(set(kinds)),
            hint="Leave --timelapse out where every file is a movie or a cell of its own.",
        )
    every = tuple(str(path) for path in paths)
    name = re.sub(r"[\W_]*(?:t|tp|time|frame)?[\W_]*\d+$", "", _stem(paths[0]), flags=re.I)
    name = name or paths[0].parent.name or "movie"
    return [Recipe(kind=kinds[0], paths=every, sequence=True, name=name, reading=reading)]


def _written(
    sources: Sequence[Any], output: Path, reading: Reading, timelapse: bool
) -> list[Recipe]:
    """Records of what is in memory; workers are other processes, or on other machines."""
    whole: list[Any] = [Timelapse.of(sources, reading.time_step)] if timelapse else list(sources)
    names = unique_names([_safe(getattr(s, "name", "") or "cell") for s in whole])
    recipes = []
    for source, name in zip(whole, names, strict=True):
        lapse = source
        if isinstance(source, Stack) and source.timepoints > 1:
            lapse = Timelapse.of(source, reading.time_step)
        many = isinstance(lapse, Timelapse)
        step = lapse.time_step_s if many else None
        recipes.append(
            Recipe(
                kind="record",
                paths=keep_sources(lapse, output / SOURCES / name),
                sequence=many,
                name=name,
                reading=Reading(time_step=step),
            )
        )
    return recipes


def _file(recipe: Recipe) -> str:
    return recipe.name if recipe.kind == "record" else recipe.paths[0]


def _stem(path: Path) -> str:
    """The name without the endings of stacks and meshes: ``cell`` of ``cell.ome.tif``."""
    name = path.name
    endings = (".ome", *STACK_SUFFIXES)
    stem = Path(name).stem
    while Path(stem).suffix.lower() in endings:
        stem = Path(stem).stem
    return _safe(stem)


def _safe(name: str) -> str:
    """A name that every file system takes, and that is none of the batch's own."""
    safe = re.sub(r"[^\w.+ -]+", "_", name).strip(" .") or "cell"
    return f"{safe}-cell" if safe.lower() in ("jobs", "log", SOURCES, MEASUREMENTS) else safe
