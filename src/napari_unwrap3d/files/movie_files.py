"""What a movie gives as files: uv stacks, tables, and kymographs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import tifffile

from ..errors import FileFormatError
from ..motion.kymograph import Kymograph
from ..motion.uv_stacks import check_field, field_names, made_frames
from ..progress import Progress, silent
from .atomic import replacing
from .drawing import Colours, colour_bar, new_figure, save_figure
from .export import check_folder, files_below, replacing_folder
from .movie_panels import draw_kymograph
from .movie_pictures import field_colours
from .tables import TABLE_SUFFIXES, write_table
from .tiff import write_image

if TYPE_CHECKING:
    from ..motion.movie import Movie

UV_FOLDER, KYMOGRAPHS = "uv", "kymographs"
FRAMES_TABLE = "frames.csv"
REGISTRATION_TABLE = "registration.csv"
ENTRIES = (UV_FOLDER, KYMOGRAPHS, FRAMES_TABLE, REGISTRATION_TABLE)
TIFF_SUFFIXES = (".tif", ".tiff")
BIG = 1 << 31


def export_movie(
    movie: Movie,
    folder: str | Path,
    *,
    fields: Sequence[str] | None = None,
    kymographs: Mapping[str, Kymograph] | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write the uv stacks, the tables and kymographs of a movie.

    Parameters
    ----------
    movie : Movie
    folder : path
        New, empty, or with `overwrite` the folder of an earlier export. It changes only when
        everything has been written.
    fields : sequence of str, optional
        Those whose uv stacks are written; all, by default.
    kymographs : mapping of str to Kymograph, optional
        Written as CSV, TIFF and PNG under these names.
    overwrite : bool
    progress : Progress, optional

    Returns
    -------
    list of Path

    Raises
    ------
    ParameterError
        The movie has no such field.
    InputError
        The folder is not empty and `overwrite` is False.
    """
    report = progress or silent()
    chosen = field_names(movie) if fields is None else tuple(fields)
    for name in chosen:
        check_field(movie, name)
    check_folder(folder, overwrite)
    with replacing_folder(folder, ENTRIES) as partial:
        for i, name in enumerate(chosen):
            part = report.part(i / len(chosen), (i + 1) / len(chosen))
            write_uv_stack(movie, name, partial / UV_FOLDER / f"{name}.ome.tif", part)
        write_table(partial / FRAMES_TABLE, movie.check_table())
        write_table(partial / REGISTRATION_TABLE, movie.registration_table())
        for title, found in (kymographs or {}).items():
            for suffix in (".csv", ".ome.tif", ".png"):
                write_kymograph(found, partial / KYMOGRAPHS / f"{title}{suffix}")
        written = files_below(partial)
    return [Path(folder) / path for path in written]


def write_uv_stack(
    movie: Movie, name: str, path: str | Path, progress: Progress | None = None
) -> Path:
    """Write the uv images of a field at all timepoints as one OME-TIFF (t, v, u), float32.

    One frame at a time is in memory. Timepoints whose frame is missing are NaN.

    Raises
    ------
    ParameterError
        The movie has no such field.
    """
    check_field(movie, name)
    path = Path(path)
    shape = (len(movie), *movie.common.uv.shape)

    def images() -> Iterator[npt.NDArray[np.float32]]:
        for _, frame in made_frames(movie, progress):
            image = np.full(shape[1:], np.nan) if frame is None else frame.uv[name]
            yield np.ascontiguousarray(image, dtype=np.float32)

    metadata: dict[str, Any] = {
        "axes": "TYX",
        "TimeIncrement": movie.time_step_s,
        "TimeIncrementUnit": "s",
        "Channel": {"Name": [name]},
    }
    with replacing(path) as partial:
        tifffile.imwrite(
            partial,
            images(),
            shape=shape,
            dtype=np.float32,
            ome=True,
            bigtiff=4 * int(np.prod(shape)) > BIG,
            photometric="minisblack",
            compression="zlib",
            compressionargs={"level": 1},
            metadata=metadata,
        )
    return path


def write_kymograph(found: Kymograph, path: str | Path, colours: Colours | None = None) -> Path:
    """Write a kymograph.

    Parameters
    ----------
    found : Kymograph
    path : path
        ``.csv`` or ``.parquet``: a row per timepoint and position, with the units in the names
        of the columns; ``.tif``: an image (time, position) with the step in µm and in s;
        ``.png``: a picture with both axes.
    colours : Colours, optional
        Of the picture.

    Raises
    ------
    FileFormatError
        The suffix is none of these.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in TABLE_SUFFIXES:
        return write_table(path, found.table())
    if suffix in TIFF_SUFFIXES:
        times = found.times_s
        return write_image(
            path,
            found.values.astype(np.float32),
            "yx",
            sizes={"x": found.line.step_um},
            time_step=float(times[1] - times[0]) if len(times) > 1 else None,
        )
    if suffix == ".png":
        return save_figure(kymograph_figure(found, colours), path)
    raise FileFormatError(
        f"{path.name!r} is no file of a kymograph.",
        hint=f"Known: {', '.join((*TABLE_SUFFIXES, *TIFF_SUFFIXES, '.png'))}.",
    )


def kymograph_figure(found: Kymograph, colours: Colours | None = None) -> Any:
    """A kymograph as a figure with µm and s on its axes."""
    colours = colours or field_colours(found.field, found.values)
    figure = new_figure(8.0, 5.6, found.name)
    axes = figure.subplots()
    draw_kymograph(axes, found, colours)
    colour_bar(figure, colours, axes)
    return figure
