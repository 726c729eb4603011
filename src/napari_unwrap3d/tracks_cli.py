"""The commands ``track``, ``measure`` and ``analyse``: what moves on an unwrapped movie."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .analyses import MOVIE_FOLDER, Analysis, Wanted, measured, over, run_analysis, tracked
from .errors import InputError
from .options import add_parameters, set_values
from .parameters import Parameters
from .progress import Progress
from .tracking.relations import EDITED

if TYPE_CHECKING:
    from rich.console import Console

    from .charts import Tracks
    from .measuring.measurements import Measurements
    from .motion.movie import Movie

KINDS = ("protrusions", "flow")
KEY_NUMBERS = ("tracks", "events", "events_per_track", "mean_lifetime_s", "correlation", "lag_s")
SUFFIXES = (".geff", ".csv", ".parquet", ".xml")


# Arguments -----------------------------------------------------------------------


def add_tracks(commands: Any) -> None:
    """Add the commands to the parser's commands."""
    _add_track(commands)
    _add_measure(commands)
    _add_analyse(commands)


def _add_track(commands: Any) -> None:
    track = commands.add_parser(
        "track",
        help="follow protrusions or regions of an unwrapped movie, or lay tracks on it",
        description="Follow the protrusions of a movie, or regions by optical flow, and keep the "
        "tracks in the movie; or lay tracks that were made elsewhere on its surface.",
    )
    track.set_defaults(command=track_command)
    track.add_argument("input", type=Path, metavar="MOVIE", help="folder or *.unwrap3d of a movie")
    track.add_argument(
        "--of", choices=KINDS, default=KINDS[0], help="what is followed (default: protrusions)"
    )
    track.add_argument(
        "--import",
        dest="imported",
        type=Path,
        metavar="FILE",
        help="instead, lay the tracks in a file (GEFF, CSV, Parquet, TrackMate XML) on the surface",
    )
    track.add_argument(
        "--name", help="under which the tracks are kept (default: what is followed; imported)"
    )
    track.add_argument(
        "-o",
        "--output",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="also write them: *.geff, *.csv, *.parquet or *.xml (TrackMate); several can be given",
    )
    track.add_argument(
        "--overwrite", action="store_true", help="also replace tracks that a person has edited"
    )
    _add_importing(track)
    add_parameters(track)
    track.add_argument("--quiet", action="store_true", help="print errors only")


def _add_importing(track: argparse.ArgumentParser) -> None:
    group = track.add_argument_group("tracks from a file")
    group.add_argument(
        "--voxel-size",
        type=float,
        nargs=3,
        metavar=("Z", "Y", "X"),
        help="µm per unit, where the file is in pixels",
    )
    group.add_argument(
        "--onto",
        choices=("surface", "common"),
        default="surface",
        help="the surface of every timepoint, or the common one (default: surface)",
    )
    group.add_argument(
        "--farthest", type=float, metavar="UM", help="points farther from it are not laid on it"
    )
    group.add_argument(
        "--world",
        choices=("common", "stack"),
        default="common",
        help="where the file's places are: where the movie was registered, or where the stack was "
        "recorded (default: common)",
    )
    group.add_argument(
        "--snap", action="store_true", help="move the points to the surface in space, too"
    )


def _add_measure(commands: Any) -> None:
    measure = commands.add_parser(
        "measure",
        help="series, events, correlations and speeds of tracks, with a report",
        description="Measure the tracks of a movie, and write tracks, tables, numbers and a report "
        "into a folder. Tracks of protrusions and of regions are made first if they are not there.",
    )
    measure.set_defaults(command=measure_command)
    measure.add_argument(
        "input", type=Path, metavar="MOVIE", help="folder or *.unwrap3d of a movie"
    )
    measure.add_argument(
        "--tracks",
        nargs="+",
        metavar="NAME",
        help="which tracks: protrusions, flow, or names (default: measurement.tracks)",
    )
    measure.add_argument("--title", default="", help="of the report")
    add_parameters(measure)
    _add_writing(measure)


def _add_analyse(commands: Any) -> None:
    analyse = commands.add_parser(
        "analyse",
        help="a whole analysis from one TOML file: unwrap, track, measure, report",
        description="Unwrap the movie that a TOML file names, track, measure, and write a report. "
        "An analysis that was stopped goes on where it was.",
    )
    analyse.set_defaults(command=analyse_command)
    analyse.add_argument("input", type=Path, metavar="FILE", help="TOML file of the analysis")
    analyse.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FOLDER", help="where to write"
    )
    analyse.add_argument("--overwrite", action="store_true", help="replace earlier results")
    analyse.add_argument("--quiet", action="store_true", help="print errors only")


def _add_writing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FOLDER", help="where to write"
    )
    parser.add_argument(
        "--formats",
        nargs="+",
        choices=SUFFIXES,
        default=[".geff", ".csv", ".xml"],
        help="of the tracks (default: .geff .csv .xml)",
    )
    parser.add_argument(
        "--tables", choices=("csv", "parquet"), default="csv", help="of the tables (default: csv)"
    )
    parser.add_argument("--no-report", action="store_true", help="write tables and tracks only")
    parser.add_argument("--overwrite", action="store_true", help="replace earlier results")
    parser.add_argument("--quiet", action="store_true", help="print errors only")


# Commands ------------------------------------------------------------------------


def track_command(arguments: argparse.Namespace, console: Console) -> int:
    """``track``: follow, or import, and keep and write the tracks."""
    from .files.tracks import check_format, write_tracks

    for path in arguments.output:
        check_format(path)
    with _opened(arguments, console) as (movie, progress):
        parameters = _parameters(movie, arguments)
        name = arguments.name or ("imported" if arguments.imported else arguments.of)
        for replaced in {name} if arguments.imported else {name, arguments.of}:
            _check_unedited(movie, replaced, arguments.overwrite)
        if arguments.imported is not None:
            tracks = _imported(movie, arguments, progress.named("laying"))
        else:
            tracks = tracked(movie, arguments.of, parameters, progress)
        if arguments.imported is not None or name != arguments.of:
            movie.keep_tracks(name, tracks)
        for path in arguments.output:
            write_tracks(path, tracks, movie, name=name)
    console.print(
        f"{len(tracks.ids)} tracks, {len(tracks)} rows, kept as {name!r}", highlight=False
    )
    for path in arguments.output:
        console.print(f"Written to {path}", markup=False, highlight=False)
    return 0


def measure_command(arguments: argparse.Namespace, console: Console) -> int:
    """``measure``: measure tracks and write what was found."""
    from .files.measured import check_output, write_measured

    check_output(arguments.output, arguments.overwrite)
    with _opened(arguments, console) as (movie, progress):
        parameters = _parameters(movie, arguments)
        names = arguments.tracks or [parameters.measurement.tracks]
        wanted = [Wanted(over(parameters, {"measurement": {"tracks": name}})) for name in names]
        found = measured(movie, wanted, progress)
        write_measured(
            movie,
            found,
            arguments.output,
            title=arguments.title or movie.name,
            track_suffixes=arguments.formats,
            table_suffix=f".{arguments.tables}",
            report=not arguments.no_report,
            progress=progress.named("report"),
        )
    _print_numbers(console, found)
    console.print(f"Written to {arguments.output}", markup=False, highlight=False)
    return 0


def analyse_command(arguments: argparse.Namespace, console: Console) -> int:
    """``analyse``: everything that a TOML file says."""
    from .cli import interruptible
    from .console import StepProgress

    if not arguments.input.is_file():
        raise InputError(f"There is no {str(arguments.input)!r}.")
    analysis = Analysis.from_toml(arguments.input)
    with StepProgress(console) as bars, interruptible(Progress(bars)) as progress:
        found = run_analysis(analysis, arguments.output, progress, overwrite=arguments.overwrite)
    _, wanted = analysis.chosen()
    _print_numbers(console, found, [one.name for one in wanted])
    console.print(f"Written to {arguments.output}", markup=False, highlight=False)
    if analysis.source.movie is None:
        movie = arguments.output / MOVIE_FOLDER
        console.print(f"The unwrapped movie is in {movie}", markup=False, highlight=False)
    return 0


# Inside --------------------------------------------------------------------------


@contextmanager
def _opened(arguments: argparse.Namespace, console: Console) -> Iterator[tuple[Movie, Progress]]:
    """The movie, which is saved again where it came from one file, and the progress."""
    from .cli import interruptible
    from .console import StepProgress
    from .motion.movie import load_movie

    path: Path = arguments.input
    if not path.exists():
        raise InputError(f"There is no {str(path)!r}.")
    movie = load_movie(path)
    with StepProgress(console) as bars, interruptible(Progress(bars)) as progress:
        yield movie, progress
        if path.is_file():
            movie.save(path, progress.named("saving"))


def _parameters(movie: Movie, arguments: argparse.Namespace) -> Parameters:
    """Those of the movie, and over them what the command says."""
    return over(movie.parameters, set_values(arguments))


def _check_unedited(movie: Movie, name: str, overwrite: bool) -> None:
    """Raise :class:`InputError` where the work of a person would be replaced."""
    if not overwrite and name in movie.track_names and movie.tracks(name).method == EDITED:
        raise InputError(
            f"The tracks {name!r} of the movie were edited.",
            edits=len(movie.tracks(name).numbers.get("edits", ())),
            hint="Keep others under another --name, or pass --overwrite to replace them.",
        )


def _imported(movie: Movie, arguments: argparse.Namespace, progress: Progress) -> Tracks:
    from .files.tracks import read_tracks
    from .tracking.laying import lay_tracks
    from .tracking.recorded import in_common_world

    size = arguments.voxel_size
    found = read_tracks(
        arguments.imported,
        voxel_size=None if size is None else (size[0], size[1], size[2]),
        time_step=movie.time_step_s,
        timepoints=len(movie),
    )
    return lay_tracks(
        movie,
        in_common_world(movie, found) if arguments.world == "stack" else found,
        onto=arguments.onto,
        farthest_um=arguments.farthest,
        snap=arguments.snap,
        progress=progress,
    )


def _print_numbers(
    console: Console, found: Sequence[Measurements], names: Sequence[str] = ()
) -> None:
    from .console import print_pairs
    from .files.measured import entry_names
    from .quality import in_words

    for name, one in zip(entry_names(found, names), found, strict=True):
        pairs = {in_words(key): one.numbers.get(key) for key in KEY_NUMBERS}
        print_pairs(console, name, pairs)
