"""What was tracked and measured in a movie, as files in one folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..progress import Progress, silent
from ..provenance import environment
from .atomic import write_json, write_text
from .export import files_below, replacing_folder
from .tables import write_table
from .tracks import write_tracks

if TYPE_CHECKING:
    from ..measuring.measurements import Measurements
    from ..motion.movie import Movie

TRACKS, TABLES, REPORT = "tracks", "tables", "report.html"
NUMBERS, PARAMETERS, PROVENANCE = "numbers.json", "parameters.toml", "provenance.json"
ENTRIES = (TRACKS, TABLES, REPORT, NUMBERS, PARAMETERS, PROVENANCE)
# What an analysis that was stopped leaves behind, and goes on with.
KEPT = ("movie",)


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
    title: str = "",
    track_suffixes: Sequence[str] = (".geff", ".csv", ".xml"),
    table_suffix: str = ".csv",
    report: bool = True,
    progress: Progress | None = None,
) -> list[Path]:
    """Write tracks, tables, numbers and the report of what was measured.

    Parameters
    ----------
    movie : Movie
    found : sequence of Measurements
    folder : path
        ``tracks/NAME.*``, ``tables/NAME/*``, ``numbers.json``, ``parameters.toml``,
        ``provenance.json`` and ``report.html``. Changed only when everything has been written;
        what else is in it stays.
    title : str
        Of the report.
    track_suffixes : sequence of str
        As of :func:`.tracks.write_tracks`.
    table_suffix : str
        ``.csv`` or ``.parquet``.
    report : bool
        Whether the figures are drawn into ``report.html``.
    progress : Progress, optional

    Returns
    -------
    list of Path
    """
    told = progress or silent()
    named = dict(zip(entry_names(found), found, strict=True))
    with replacing_folder(folder, ENTRIES) as partial:
        for index, (name, one) in enumerate(named.items()):
            told(0.5 * index / len(named), f"writing {name}")
            for suffix in track_suffixes:
                own = one.parameters.measurement.tracks
                write_tracks(partial / TRACKS / f"{name}{suffix}", one.tracks, movie, name=own)
            for table, rows in one.tables.items():
                if len(rows.columns):
                    write_table(partial / TABLES / name / f"{table}{table_suffix}", rows)
        write_json(partial / NUMBERS, {name: one.numbers for name, one in named.items()})
        write_text(partial / PARAMETERS, movie.parameters.to_toml())
        write_json(partial / PROVENANCE, provenance_of(movie, named))
        if report and named:
            from ..measuring.report import write_report

            write_report(
                partial / REPORT, list(named.values()), title=title, progress=told.part(0.5, 1.0)
            )
        written = files_below(partial)
    told(1.0, "written")
    return [Path(folder) / path for path in written]


def entry_names(found: Sequence[Measurements]) -> list[str]:
    """Names of what was measured: those of its tracks, with a number where one comes again."""
    names: list[str] = []
    for one in found:
        own = re.sub(r"[^\w .-]", "_", one.parameters.measurement.tracks) or "tracks"
        name, number = own, 1
        while name in names:
            number += 1
            name = f"{own} {number}"
        names.append(name)
    return names


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
