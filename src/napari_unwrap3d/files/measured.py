"""What was tracked and measured in a movie, as files in one folder."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..measuring.report import write_report
from ..progress import Progress, silent
from ..provenance import environment
from .atomic import write_json, write_text
from .export import files_below, replacing_folder
from .tables import write_table
from .track_pictures import draw_tracks
from .tracks import write_tracks

if TYPE_CHECKING:
    from ..measuring.measurements import Measurements
    from ..motion.movie import Movie

TRACKS, INDEX, PROVENANCE = "tracks", "index.html", "provenance.json"
# What an analysis that was stopped leaves behind, and goes on with.
KEPT = ("movie",)
TABLES = "tables"
PICTURE = "Mean curvature on the unwrapped surface, with the tracks of {}."


def check_output(folder: Path, overwrite: bool) -> None:
    """Raise :class:`InputError` where results would be written over something else."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{str(folder)!r} is a file, not a folder.", hint="Choose another output.")
    if not folder.is_dir():
        return
    there = sorted(entry.name for entry in folder.iterdir() if entry.name not in KEPT)
    if there and not overwrite:
        raise InputError(
            f"The folder {str(folder)!r} is not empty.",
            first=there[0],
            hint="Choose another folder, or pass --overwrite to replace earlier results in it.",
        )


def write_measured(
    movie: Movie,
    found: Sequence[Measurements],
    folder: str | Path,
    *,
    names: Sequence[str] = (),
    title: str = "",
    track_suffixes: Sequence[str] = (".geff", ".csv", ".xml"),
    table_suffix: str = ".csv",
    report: bool = True,
    texts: Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write tracks, tables, numbers and reports of what was measured.

    Parameters
    ----------
    movie : Movie
    found : sequence of Measurements
    folder : path
        Gets ``tracks/NAME.*``, for everything measured ``NAME/`` with its report and tables, an
        ``index.html`` that leads to the reports, and ``provenance.json``. It is changed only when
        everything has been written; what else is in it stays.
    names : sequence of str
        Of everything measured; those of the tracks where there are none, or empty ones.
    title : str
        Of the reports.
    track_suffixes : sequence of str
        As of :func:`.tracks.write_tracks`.
    table_suffix : str
        ``.csv`` or ``.parquet``.
    report : bool
        Whether figures are drawn, too.
    texts : mapping of str to str, optional
        Further files by their names, such as what was asked for.
    progress : Progress, optional

    Returns
    -------
    list of Path
    """
    told = progress or silent()
    named = dict(zip(entry_names(found, names), found, strict=True))
    further = texts or {}
    written_before = (TRACKS, INDEX, PROVENANCE, *named, *further)
    with replacing_folder(folder, written_before) as partial:
        for index, (name, one) in enumerate(named.items()):
            told(index / len(named), f"writing {name}")
            for suffix in track_suffixes:
                own = one.parameters.measurement.tracks
                write_tracks(partial / TRACKS / f"{name}{suffix}", one.tracks, movie, name=own)
            if report:
                heading = f"{title or movie.name}: {name}"
                pictures = {PICTURE.format(name): draw_tracks(movie, one.tracks)}
                write_report(one, partial / name, title=heading, pictures=pictures)
            _write_tables(one, partial / name / TABLES, table_suffix)
        for name, text in further.items():
            write_text(partial / name, text)
        write_json(partial / PROVENANCE, provenance_of(movie, named))
        if report:
            write_text(partial / INDEX, _index(title or movie.name, named))
        written = files_below(partial)
    told(1.0, "written")
    return [Path(folder) / path for path in written]


def _write_tables(one: Measurements, folder: Path, suffix: str) -> None:
    for table, rows in one.tables.items():
        path = folder / f"{table}{suffix}"
        if len(rows.columns) and not path.exists():
            write_table(path, rows)


def _index(title: str, named: Mapping[str, Measurements]) -> str:
    """A page that leads to the reports."""
    items = "".join(
        f'<li><a href="{html.escape(name)}/report.html">{html.escape(name)}</a>: '
        f"{len(one.tracks.ids)} tracks</li>"
        for name, one in named.items()
    )
    heading = html.escape(title)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{heading}</title></head><body>\n<h1>{heading}</h1>\n<ul>{items}</ul>\n"
        "</body></html>\n"
    )


def entry_names(found: Sequence[Measurements], names: Sequence[str] = ()) -> list[str]:
    """Names of what was measured: given ones, or those of its tracks, each once."""
    given = [*names, *[""] * (len(found) - len(names))]
    chosen: list[str] = []
    for one, name in zip(found, given, strict=True):
        own = re.sub(r"[^\w .-]", "_", name or one.parameters.measurement.tracks) or "tracks"
        free, number = own, 1
        while free in chosen:
            number += 1
            free = f"{own} {number}"
        chosen.append(free)
    return chosen


def provenance_of(movie: Movie, found: dict[str, Measurements]) -> dict[str, Any]:
    """Where results come from: versions, the movie, and every group of parameters that counts."""
    groups = ("tracking", "boxes", "flow", "measurement")
    return {
        "versions": environment(),
        "movie": movie.name,
        "common_space": movie.record,
        "measured": {
            name: {
                "tracks_key": movie.folder.tracks_key(one.parameters.measurement.tracks),
                "tracks": dict(one.tracks.numbers),
                "parameters": {
                    group: getattr(one.parameters, group).model_dump() for group in groups
                },
            }
            for name, one in found.items()
        },
    }
