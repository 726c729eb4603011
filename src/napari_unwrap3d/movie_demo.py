"""``napari-unwrap3d demo --movie``: a short simulated movie, unwrapped into one common space."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import ParameterError
from .options import chosen_parameters
from .parameters import Parameters
from .progress import Progress

if TYPE_CHECKING:
    from rich.console import Console

    from .charts import Stack
    from .motion.movie import Movie

# Small enough to be done in a minute or two.
SIZE, TIMEPOINTS, ROWS = 96, 8, 128
MOVIE, PICTURES, EXPORT = "movie.unwrap3d", "pictures", "movie"


def demo_stack(kind: str, seed: int, size: int = SIZE, timepoints: int = TIMEPOINTS) -> Stack:
    """The timelapse of a simulated cell that drifts: ``tczyx``, made when it is read.

    Raises
    ------
    ParameterError
        There is no such kind of movie.
    """
    from .simulate.movies import MOVIES, movie

    if kind not in MOVIES:
        raise ParameterError(
            f"There is no movie of kind {kind!r}.", hint=f"Kinds: {', '.join(MOVIES)}."
        )
    return movie(kind, seed=seed, size=size, timepoints=timepoints).stack


def demo_parameters(chosen: Parameters) -> Parameters:
    """With a small uv image, unless its size was chosen."""
    if "rows" in chosen.uv.model_fields_set:
        return chosen
    return chosen.model_copy(update={"uv": chosen.uv.model_copy(update={"rows": ROWS})})


def movie_demo(arguments: argparse.Namespace, console: Console) -> int:
    """Simulate, unwrap, and write or show."""
    from .cli import DEMO_OUTPUT, missing_for_window
    from .files.export import check_folder, remove_entries

    if arguments.output == DEMO_OUTPUT:
        arguments.overwrite = True  # the folder is the demo's own
    check_folder(arguments.output, arguments.overwrite)
    parameters = demo_parameters(chosen_parameters(arguments))
    size = arguments.size or SIZE
    stack = demo_stack(arguments.kind, arguments.seed, size, arguments.timepoints)
    arguments.output.mkdir(parents=True, exist_ok=True)
    remove_entries(arguments.output, (MOVIE, PICTURES, EXPORT))
    if arguments.window:
        missing = missing_for_window()
        if not missing:
            from .viewer.movies.demo import open_movie_demo

            path = arguments.output / MOVIE
            console.print(f"The movie will be saved as {path}", markup=False, highlight=False)
            open_movie_demo(stack, path, parameters)
            return 0
        console.print(f"{missing} The movie is written as files instead.", highlight=False)
    _unwrap_and_write(stack, parameters, arguments, console)
    return 0


def _unwrap_and_write(
    stack: Stack, parameters: Parameters, arguments: argparse.Namespace, console: Console
) -> None:
    from .cli import interruptible
    from .console import StepProgress
    from .files.movie_files import export_movie
    from .motion.movie import unwrap_movie

    output: Path = arguments.output
    with StepProgress(console) as bars, interruptible(Progress(bars)) as progress:
        movie = unwrap_movie(stack, parameters, progress).compute(progress)
        export_movie(movie, output / EXPORT, progress=progress.named("export"))
        if not arguments.no_pictures:
            _draw(movie, output / PICTURES, progress.named("pictures"))
        movie.save(output / MOVIE, progress.named("saving"))
    console.print(str(movie.record["recommendation"]["reason"]), markup=False, highlight=False)
    if proposal := movie.proposal():
        console.print(proposal, markup=False, highlight=False)
    console.print(f"Written to {output}", markup=False, highlight=False)


def _draw(movie: Movie, folder: Path, progress: Progress) -> None:
    """A picture of every view at every timepoint, as PNG."""
    from .files.movie_export import FrameWriter
    from .files.movie_pictures import movie_pictures

    pictures = movie_pictures(movie, progress=progress.part(0.0, 0.3))
    with FrameWriter(folder) as writer:
        for image in pictures.pictures(progress.part(0.3, 1.0)):
            writer.add(image)
