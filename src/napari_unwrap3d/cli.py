"""The command ``napari-unwrap3d``: run, batch, info, compare, demo, export, movie, track …

No logic of its own: it reads, calls the pipeline, and writes with ``files.export``.
Exit codes: 0 done, 1 an unexpected error, 2 a wrong input or parameter, 3 a part of a batch
failed, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import argparse
import importlib.util
import io
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .batch.command import add_batch
from .charts import Mask, Stack, Surface
from .errors import Cancelled, InputError, ParameterError, Unwrap3DError, VoxelSizeMissingError
from .movie_cli import add_movie
from .options import (
    add_charts,
    add_comparing,
    add_output,
    add_parameters,
    add_reading,
    chosen_parameters,
)
from .parameters import Parameters
from .progress import Progress
from .provenance import package_version
from .tracks_cli import add_tracks

if TYPE_CHECKING:
    from rich.console import Console

    from .atlas import Atlas

INTERRUPTED = 130
WRONG_INPUT = 2

DEMO_OUTPUT = Path("demo-output")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    from rich.console import Console

    from .console import print_error

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # terminals that do not know µ or ✔
    arguments = build_parser().parse_args(argv)
    quiet = getattr(arguments, "quiet", False) or getattr(arguments, "json", False)
    console = Console(quiet=quiet)
    errors = Console(stderr=True)
    try:
        code: int = arguments.command(arguments, console)
        return code
    except (Cancelled, KeyboardInterrupt):
        errors.print("Stopped. Nothing was written.", highlight=False)
        return INTERRUPTED
    except (Unwrap3DError, OSError) as error:
        print_error(errors, error)
        return WRONG_INPUT


# Arguments -------------------------------------------------------------------


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="napari-unwrap3d",
        description="Unwrap the surface of a cell: from a stack, a mask or a mesh to every chart.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_run(commands)
    add_batch(commands)
    _add_info(commands)
    _add_compare(commands)
    _add_demo(commands)
    _add_export(commands)
    add_movie(commands)
    add_tracks(commands)
    return parser


def _add_run(commands: Any) -> None:
    run = commands.add_parser(
        "run",
        help="unwrap a cell and write every chart",
        description="Unwrap the cell in a stack, a mask or a mesh, and write meshes, images, "
        "pictures, tables and the project into a folder.",
    )
    run.set_defaults(command=run_command)
    run.add_argument("input", type=Path, help="stack (TIFF, OME-TIFF, OME-Zarr, HDF5) or mesh")
    add_reading(run)
    add_parameters(run)
    run.add_argument("--channel", type=int, help="channel that shows the cell (from 0)")
    run.add_argument("--timepoint", type=int, help="timepoint (from 0)")
    run.add_argument("--label", type=int, help="the stack is a label image: the cell's label")
    run.add_argument("--mask", action="store_true", help="the stack is a mask: not 0 is cell")
    run.add_argument(
        "--signal",
        nargs="+",
        default=(),
        metavar="CHANNEL",
        help="channels (number or name) whose 95th percentile down to 1 µm below the surface is "
        "written as fields signal_CHANNEL of it",
    )
    add_charts(run)
    add_output(run, None)


def _add_info(commands: Any) -> None:
    info = commands.add_parser(
        "info",
        help="what a file holds, or every parameter",
        description="Say what is in a stack, a mesh or a project; or list every parameter.",
    )
    info.set_defaults(command=info_command)
    info.add_argument("input", type=Path, nargs="?", help="stack, mesh or project")
    info.add_argument("--parameters", action="store_true", help="list every parameter")
    add_reading(info)


def _add_compare(commands: Any) -> None:
    compare = commands.add_parser(
        "compare",
        help="how different two surfaces are",
        description="Measure how the first surface differs from the second: Chamfer, Hausdorff "
        "and sliced Wasserstein distance, area and volume. Nothing is repaired.",
    )
    compare.set_defaults(command=compare_command)
    for name, which in (("first", "compared"), ("second", "compared with")):
        compare.add_argument(
            name, type=Path, help=f"mesh or project whose surface is {which}", metavar=name.upper()
        )
    add_comparing(compare)


def _add_demo(commands: Any) -> None:
    demo = commands.add_parser(
        "demo",
        help="the whole job on a simulated light-sheet cell",
        description="Simulate a light-sheet stack of a cell, unwrap it, and write every chart.",
    )
    demo.set_defaults(command=demo_command)
    demo.add_argument("--kind", default="blebs", help="kind of protrusions (default: blebs)")
    demo.add_argument("--seed", type=int, default=0, help="which random cell (default: 0)")
    demo.add_argument(
        "--size", type=int, help="edge of the field of view in voxels (default: 200; of movies 96)"
    )
    demo.add_argument("--movie", action="store_true", help="a short movie of a cell instead")
    demo.add_argument(
        "--timepoints", type=int, default=8, help="of the movie (default: 8)", metavar="T"
    )
    demo.add_argument("--window", action="store_true", help="show the charts in napari")
    add_parameters(demo)
    add_charts(demo)
    add_output(demo, DEMO_OUTPUT)


def _add_export(commands: Any) -> None:
    export = commands.add_parser(
        "export",
        help="write the files of a saved project",
        description="Write meshes, images, pictures and tables of a saved project.",
    )
    export.set_defaults(command=export_command)
    export.add_argument("input", type=Path, help="project (*.unwrap3d)")
    add_output(export, None)


# Commands --------------------------------------------------------------------


def run_command(arguments: argparse.Namespace, console: Console) -> int:
    """``run``: unwrap and write."""
    from .files.export import check_folder
    from .sampling import check_signals

    check_folder(arguments.output, arguments.overwrite)
    parameters = chosen_parameters(arguments)
    source: Stack | Mask | Surface = read_input(arguments)
    signals: Stack | None = None
    if isinstance(source, Stack):
        _print_choice(source, parameters, console)
        signals = source
        source = as_mask(source, parameters) if arguments.mask else source
    check_signals(signals, arguments.signal)
    _unwrap_and_export(source, parameters, arguments, console, signals)
    return 0


def info_command(arguments: argparse.Namespace, console: Console) -> int:
    """``info``: what a file holds, or the parameters."""
    from .console import movie_pairs, print_pairs, print_parameters, print_quality, project_pairs
    from .files.movie import is_movie, read_movie_summary
    from .files.project import SUFFIX, read_summary
    from .quality import quality_rows

    if arguments.parameters:
        print_parameters(console)
        return 0
    if arguments.input is None:
        raise InputError("Nothing to look at.", hint="Name a file, or pass --parameters.")
    path: Path = arguments.input
    if path.exists() and is_movie(path):
        print_pairs(console, path.name, movie_pairs(read_movie_summary(path)))
        return 0
    if path.suffix != SUFFIX:
        print_pairs(console, path.name, described(arguments))
        return 0
    summary = read_summary(path)
    print_pairs(console, path.name, project_pairs(summary))
    print_quality(console, quality_rows(summary["quality"]))
    return 0


def compare_command(arguments: argparse.Namespace, console: Console) -> int:
    """``compare``: how different two surfaces are."""
    from .console import StepProgress, comparison_pairs, print_pairs
    from .geometry.compare import compare_meshes

    first, second = (
        read_surface(path, arguments.scale) for path in (arguments.first, arguments.second)
    )
    with StepProgress(console) as bars, interruptible(Progress(bars, "compare")) as progress:
        found = compare_meshes(
            first,
            second,
            projections=arguments.projections,
            samples=arguments.samples,
            seed=arguments.seed,
            progress=progress,
        )
    if arguments.json:
        print(json.dumps(found, indent=2))
        return 0
    title = f"{arguments.first.name} against {arguments.second.name}"
    print_pairs(console, title, comparison_pairs(found))
    for note in found["notes"]:
        console.print(note, markup=False, highlight=False)
    return 0


def demo_command(arguments: argparse.Namespace, console: Console) -> int:
    """``demo``: simulate, unwrap, and write or show."""
    from .files.export import PROJECT_NAME, check_folder, remove_entries
    from .simulate import KINDS, cell

    if arguments.movie:
        from .movie_demo import movie_demo

        return movie_demo(arguments, console)
    arguments.size = arguments.size or 200
    if arguments.kind not in KINDS:
        raise ParameterError(
            f"There is no kind {arguments.kind!r}.", hint=f"Kinds: {', '.join(KINDS)}."
        )
    if arguments.output == DEMO_OUTPUT:
        arguments.overwrite = True  # the folder is the demo's own
    check_folder(arguments.output, arguments.overwrite)
    parameters = chosen_parameters(arguments)
    if arguments.window:
        missing = missing_for_window()
        if not missing:
            from .viewer.demo import open_demo

            arguments.output.mkdir(parents=True, exist_ok=True)
            remove_entries(arguments.output)
            project = arguments.output / PROJECT_NAME
            console.print(f"The project will be saved as {project}", markup=False, highlight=False)
            open_demo(arguments.kind, project, parameters, size=arguments.size)
            return 0
        console.print(f"{missing} The charts are written as files instead.", highlight=False)
    source = cell(kind=arguments.kind, seed=arguments.seed, size=arguments.size).stack
    _unwrap_and_export(source, parameters, arguments, console)
    return 0


def export_command(arguments: argparse.Namespace, console: Console) -> int:
    """``export``: the files of a saved project."""
    from .console import StepProgress, print_quality
    from .files.export import check_folder, export_atlas
    from .files.formats import Formats
    from .files.project import load_project
    from .quality import quality_rows

    formats = Formats.named(arguments.format)
    check_folder(arguments.output, arguments.overwrite)
    with StepProgress(console) as bars, interruptible(Progress(bars)) as progress:
        atlas = load_project(arguments.input, progress.named("reading"))
        export_atlas(
            atlas,
            arguments.output,
            pictures=not arguments.no_pictures,
            formats=formats,
            overwrite=arguments.overwrite,
            progress=progress.named("files"),
        )
    print_quality(console, quality_rows(atlas.quality))
    _print_where(arguments.output, console)
    return 0


def _unwrap_and_export(
    source: Stack | Mask | Surface,
    parameters: Parameters,
    arguments: argparse.Namespace,
    console: Console,
    signals: Stack | None = None,
) -> Atlas:
    from .console import StepProgress, print_quality
    from .files.export import export_atlas
    from .files.formats import Formats
    from .pipeline import Pipeline
    from .quality import quality_rows
    from .sampling import with_signals

    formats = Formats.named(arguments.format)
    with StepProgress(console) as bars, interruptible(Progress(bars)) as progress:
        atlas = _named(Pipeline(source).run(parameters, progress), arguments)
        if signals is not None and arguments.signal:
            atlas = with_signals(atlas, signals, arguments.signal, progress.named("signal"))
        export_atlas(
            atlas,
            arguments.output,
            stack=source if isinstance(source, Stack) else None,
            pictures=not arguments.no_pictures,
            formats=formats,
            overwrite=arguments.overwrite,
            progress=progress.named("files"),
        )
    for repair in atlas.provenance.get("repairs", ()):
        console.print(f"Repaired: {repair}", markup=False, highlight=False)
    print_quality(console, quality_rows(atlas.quality))
    _print_where(arguments.output, console)
    return atlas


def _named(atlas: Atlas, arguments: argparse.Namespace) -> Atlas:
    """The atlas with the name of the file in its provenance; masks and meshes have none."""
    path = getattr(arguments, "input", None)
    if path is None or atlas.provenance["source"]["name"]:
        return atlas
    named = {**atlas.provenance["source"], "name": path.name}
    return atlas.replaced(provenance={**atlas.provenance, "source": named})


def _print_choice(stack: Stack, parameters: Parameters, console: Console) -> None:
    """Which volume of several is taken."""
    chosen = {
        "t": ("timepoint", parameters.stack.timepoint),
        "c": ("channel", parameters.stack.channel),
    }
    for axis, (name, index) in chosen.items():
        if axis in stack.axes:
            count = stack.shape[stack.axes.index(axis)]
            text = f"{name.capitalize()} {index} of 0–{count - 1} (--{name} takes another)"
            console.print(text, highlight=False)


def _print_where(folder: Path, console: Console) -> None:
    console.print(f"Written to {folder}", markup=False, highlight=False)


@contextmanager
def interruptible(progress: Progress) -> Iterator[Progress]:
    """Make Ctrl-C cancel `progress`; a second Ctrl-C stops at once."""
    if threading.current_thread() is not threading.main_thread():
        yield progress
        return

    def interrupt(number: int, frame: Any) -> None:
        if progress.cancelled.is_set():
            raise KeyboardInterrupt
        progress.cancel()

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield progress
    finally:
        signal.signal(signal.SIGINT, before)


# Input -----------------------------------------------------------------------


def read_input(arguments: argparse.Namespace) -> Stack | Surface:
    """Read a stack or a mesh, told apart by the suffix."""
    from .files.meshes import MESH_SUFFIXES, read_mesh
    from .files.project import SUFFIX

    path: Path = arguments.input
    if path.suffix == SUFFIX:
        raise InputError(
            f"{path.name!r} is a project: it has been unwrapped already.",
            hint="`napari-unwrap3d export` writes its files, `info` shows its quality.",
        )
    if path.suffix.lower() in MESH_SUFFIXES:
        for name in ("voxel_size", "axes", "dataset", "channel", "timepoint", "label"):
            if getattr(arguments, name) is not None:
                option = name.replace("_", "-")
                raise InputError(
                    f"--{option} is for stacks, and {path.name} is a mesh.",
                    hint="Leave it out. A mesh whose unit is not µm is scaled by --scale.",
                )
        return read_mesh(path, scale=arguments.scale or 1.0)
    if arguments.scale is not None:
        raise InputError(
            f"--scale is for meshes, and {path.name} is none.", hint="Give --voxel-size in µm."
        )
    return _read_stack(arguments)


def read_surface(path: Path, scale: float | None) -> Surface:
    """The mesh in a file as it is, or the surface of a project."""
    from .files.meshes import read_mesh
    from .files.project import SUFFIX, load_surface

    if path.suffix != SUFFIX:
        return read_mesh(path, scale=scale or 1.0, repaired=False)
    return load_surface(path)


def _read_stack(arguments: argparse.Namespace) -> Stack:
    from .files.stacks import read_stack

    return read_stack(
        arguments.input,
        arguments.voxel_size,
        axes=arguments.axes,
        dataset=arguments.dataset,
    )


def as_mask(stack: Stack, parameters: Parameters) -> Mask:
    """The chosen volume of a stack, taken as it is: not 0 is cell."""
    import numpy as np

    volume = stack.volume(parameters.stack.timepoint, parameters.stack.channel)
    return Mask(np.asarray(volume) != 0, stack.voxel_size)


def described(arguments: argparse.Namespace) -> dict[str, Any]:
    """What a mesh or a stack is; also one that `run` would refuse as it stands."""
    from .console import mesh_pairs, stack_pairs
    from .files.meshes import MESH_SUFFIXES, read_mesh

    if arguments.input.suffix.lower() in MESH_SUFFIXES:
        return mesh_pairs(read_mesh(arguments.input, scale=arguments.scale or 1.0, repaired=False))
    try:
        return stack_pairs(_read_stack(arguments))
    except VoxelSizeMissingError as error:
        arguments.voxel_size = (1.0, 1.0, 1.0)
        pairs = stack_pairs(_read_stack(arguments))
        pairs.pop("extent (z, y, x)")
        return {**pairs, "voxel size (z, y, x)": f"{error.what} {error.hint}"}


# The window ------------------------------------------------------------------


def missing_for_window() -> str:
    """Why no window can be opened, with the way out; empty when one can."""
    if importlib.util.find_spec("napari") is None or importlib.util.find_spec("qtpy") is None:
        return 'No window: napari is not installed (`pip install "napari-unwrap3d[all]"`).'
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in displays):
        return "No window: there is no display (DISPLAY is not set)."
    return ""
