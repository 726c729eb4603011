"""The command ``napari-unwrap3d movie``: a movie of an unwrapped timelapse, and its files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InputError, ParameterError
from .options import add_reading
from .progress import Progress

if TYPE_CHECKING:
    from rich.console import Console

    from .charts import Stack
    from .motion.kymograph import Kymograph
    from .motion.movie import Movie

VIEWS = ("all", "surface", "uv", "polar", "projection", "kymograph")


def add_movie(commands: Any) -> None:
    """Add the command to the parser's commands."""
    movie = commands.add_parser(
        "movie",
        help="pictures of an unwrapped movie as MP4 or PNG, its stacks and tables",
        description="Draw every timepoint of an unwrapped movie, into an MP4 or a folder of PNG "
        "frames; and write its uv stacks, tables and kymographs.",
    )
    movie.set_defaults(command=movie_command)
    movie.add_argument("input", type=Path, metavar="MOVIE", help="folder or *.unwrap3d of a movie")
    movie.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="movie.mp4, or a folder for PNG frames"
    )
    movie.add_argument(
        "--export",
        type=Path,
        metavar="FOLDER",
        help="write uv stacks (OME-TIFF), tables and the kymograph into this folder",
    )
    movie.add_argument(
        "--overwrite", action="store_true", help="replace an earlier export (--export)"
    )
    movie.add_argument("--quiet", action="store_true", help="print errors only")
    _add_looks(movie)
    _add_line(movie)
    _add_projection(movie)


def _add_looks(movie: argparse.ArgumentParser) -> None:
    looks = movie.add_argument_group("pictures")
    looks.add_argument("--view", choices=VIEWS, default="all", help="what is shown (default: all)")
    looks.add_argument(
        "--field",
        default="mean_curvature_per_um",
        help="what colours it (default: mean_curvature_per_um)",
    )
    looks.add_argument(
        "--limits",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="values at the ends of the colour bar (default: from all timepoints)",
    )
    looks.add_argument("--fps", type=float, default=10.0, help="frames per second (default: 10)")
    looks.add_argument(
        "--quality", type=float, default=8.0, help="of the MP4, 1 to 10 (default: 8)"
    )
    looks.add_argument(
        "--axis", choices=("z", "y", "x"), default="z", help="seen along it (default: z)"
    )
    looks.add_argument(
        "--pole", choices=("north", "south"), default="north", help="in the polar view's middle"
    )


def _add_line(movie: argparse.ArgumentParser) -> None:
    line = movie.add_argument_group("kymograph")
    line.add_argument(
        "--line",
        metavar="V,U:V,U",
        help="corners of a line in the uv image, in pixels, e.g. 64,10:80,120; beyond the image "
        "they continue over seam and poles (--line=-6,40:20,40)",
    )
    line.add_argument(
        "--width", type=float, default=0.0, metavar="UM", help="mean over this width in µm"
    )
    line.add_argument(
        "--great-circles",
        action="store_true",
        help="join the corners by the shortest ways on the sphere, not straight in the image",
    )


def _add_projection(movie: argparse.ArgumentParser) -> None:
    group = movie.add_argument_group("surface-limited projection")
    group.add_argument("--stack", type=Path, metavar="FILE", help="what the movie was made from")
    group.add_argument("--channel", default="0", help="its channel, number or name (default: 0)")
    group.add_argument(
        "--reach", type=float, default=1.0, metavar="UM", help="± µm of the surface (default: 1)"
    )
    group.add_argument(
        "--statistic", choices=("max", "mean"), default="max", help="along the rays (default: max)"
    )
    add_reading(group)


def movie_command(arguments: argparse.Namespace, console: Console) -> int:
    """``movie``: pictures, stacks and tables of a movie."""
    from .cli import interruptible
    from .console import StepProgress
    from .motion.movie import load_movie

    if arguments.output is None and arguments.export is None:
        raise InputError(
            "Nothing to write.", hint="Name a movie (-o movie.mp4) or a folder (--export FOLDER)."
        )
    if not arguments.input.exists():
        raise InputError(f"There is no {str(arguments.input)!r}.")
    movie = load_movie(arguments.input)
    with StepProgress(console) as bars, interruptible(Progress(bars)) as progress:
        found = _kymograph(movie, arguments, progress.named("kymograph"))
        if arguments.output is not None:
            _draw(movie, arguments, found, progress)
        if arguments.export is not None:
            from .files.movie_files import export_movie

            export_movie(
                movie,
                arguments.export,
                kymographs={} if found is None else {arguments.field: found},
                overwrite=arguments.overwrite,
                progress=progress.named("export"),
            )
    for path in (arguments.output, arguments.export):
        if path is not None:
            console.print(f"Written to {path}", markup=False, highlight=False)
    return 0


def _draw(
    movie: Movie, arguments: argparse.Namespace, found: Kymograph | None, progress: Progress
) -> None:
    from .files.movie_export import FrameWriter
    from .files.movie_pictures import common_scales, movie_pictures
    from .motion.projections import Projections

    with FrameWriter(arguments.output, arguments.fps, arguments.quality) as writer:
        looking = progress.named("scales")
        stack = _stack(arguments)
        projections = None
        if stack is not None:
            projections = Projections.of(
                movie,
                arguments.channel,
                arguments.reach,
                arguments.axis,
                statistic=arguments.statistic,
                stack=stack,
                progress=looking.part(0.0, 0.2),
            )
        limits = None if arguments.limits is None else tuple(arguments.limits)
        scales = common_scales(
            movie, arguments.field, arguments.axis, limits, looking.part(0.2, 0.6)
        )
        pictures = movie_pictures(
            movie,
            arguments.view,
            arguments.field,
            scales=scales,
            axis=arguments.axis,
            pole=arguments.pole,
            projections=projections,
            kymograph=found,
            progress=looking.part(0.6, 1.0),
        )
        looking(1.0, "done")
        drawing = progress.named("frames")
        for image in pictures.pictures(drawing):
            writer.add(image)
        drawing(1.0, f"{writer.frames} frames")


def _kymograph(movie: Movie, arguments: argparse.Namespace, progress: Progress) -> Kymograph | None:
    from .motion.kymograph import kymograph

    if arguments.line is None:
        return None
    return kymograph(
        movie,
        [_corner(text) for text in arguments.line.split(":")],
        arguments.field,
        arguments.width,
        between="great circle" if arguments.great_circles else "straight",
        progress=progress,
    )


def _corner(text: str) -> tuple[float, float]:
    try:
        v, u = (float(part) for part in text.split(","))
    except ValueError:
        raise ParameterError(
            f"{text!r} is no corner of a line.", hint="Write v,u in pixels: --line 64,10:80,120."
        ) from None
    return v, u


def _stack(arguments: argparse.Namespace) -> Stack | None:
    from .files.stacks import read_stack

    if arguments.stack is None:
        return None
    return read_stack(
        arguments.stack, arguments.voxel_size, axes=arguments.axes, dataset=arguments.dataset
    )
