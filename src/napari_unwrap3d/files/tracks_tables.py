"""Tracks as tables, CSV and Parquet: a row per object and timepoint, units in the names.

``parent_track_id`` and ``into_track_id`` repeat in every row which track it comes out of and
which it goes into (0: none). What is in no row is beside a CSV in a JSON of its name, and in the
metadata of a Parquet file.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Ints, Tracks
from ..charts.tracks import PLACE, SPACE, TIMEPOINT, TRACK
from ..errors import FileFormatError, InputError
from .atomic import replacing
from .tables import check_parquet
from .track_record import (
    LENGTHS_UM,
    NOTHING_SAID,
    Said,
    from_one,
    imported,
    length_um,
    record_of,
    restored,
    smallest_step,
    whole_timepoints,
)

if TYPE_CHECKING:
    from ..motion.movie import Movie

SUFFIXES = (".csv", ".parquet")
RECORD = "napari-unwrap3d tracks"
PARENT, INTO, TIME = "parent_track_id", "into_track_id", "time_s"
# Names that other programs give to what we need, in lower case.
ALIASES = {
    TRACK: ("track_id", "track", "trackid", "track id", "tracklet_id", "particle", "id"),
    TIMEPOINT: ("timepoint", "frame", "t", "time_point", "timepoints"),
    SPACE[0]: ("z_um", "z", "position_z", "pos_z", "axis-1"),
    SPACE[1]: ("y_um", "y", "position_y", "pos_y", "axis-2"),
    SPACE[2]: ("x_um", "x", "position_x", "pos_x", "axis-3"),
    PLACE[0]: ("v_px", "v"),
    PLACE[1]: ("u_px", "u"),
    TIME: ("time_s", "position_t"),
    PARENT: (PARENT, "parent", "parent_id", "parent_track"),
    INTO: (INTO, "into", "merged_into"),
}
Columns = dict[str, npt.NDArray[Any]]


def write_track_table(
    path: str | Path, tracks: Tracks, movie: Movie | None = None, name: str = ""
) -> Path:
    """Write tracks as CSV (with its JSON) or Parquet; see :func:`..tracks.write_tracks`."""
    path = Path(path)
    columns = _columns(tracks)
    record = record_of(tracks, movie, name)
    if path.suffix.lower() == ".parquet":
        return _write_parquet(path, columns, record)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(_cells(column) for column in columns.values()), strict=True))
    with replacing(path) as partial:
        partial.write_text(text.getvalue(), encoding="utf-8")
        beside = partial.with_suffix(".json")
        beside.write_text(json.dumps(record, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return path


def read_track_table(path: str | Path, said: Said = NOTHING_SAID) -> Tracks:
    """Read tracks from CSV or Parquet; see :func:`..tracks.read_tracks`.

    Columns of other programs are known by their usual names (TrackMate's table of spots, napari's
    CSV, trackpy, …); their places need a unit in the name, or a voxel size.
    """
    path = Path(path)
    parquet = path.suffix.lower() == ".parquet"
    columns, record = _read_parquet(path) if parquet else _read_csv(path)
    if record is not None:
        return restored(record, columns)
    return _foreign(path, columns, said)


# Writing -------------------------------------------------------------------------


def _columns(tracks: Tracks) -> Columns:
    """The columns as they are written, with those that are found from others."""
    first = (TRACK, TIMEPOINT)
    found = {name: tracks.columns[name] for name in first}
    added = {
        TIME: tracks.times_s,
        PARENT: _partner(tracks.track_id, tracks.splits[:, ::-1]),
        INTO: _partner(tracks.track_id, tracks.merges),
    }
    added = {name: column for name, column in added.items() if name not in tracks.columns}
    places = {name: tracks.columns[name] for name in (*SPACE, *PLACE) if name in tracks.columns}
    return found | added | places | dict(tracks.columns)


def _partner(track: Ints, pairs: Ints) -> Ints:
    """In every row the second of the first pair that a track is the first of, or 0."""
    found = dict(pairs[::-1].tolist())
    return np.array([found.get(each, 0) for each in track.tolist()], np.int64)


def _cells(column: npt.NDArray[Any]) -> Iterable[Any]:
    values: list[Any] = column.tolist()
    # Python's shortest text of a number that gives the same number again.
    return [repr(value) if isinstance(value, float) else value for value in values]


def _write_parquet(path: Path, columns: Columns, record: Mapping[str, Any]) -> Path:
    check_parquet()
    import pyarrow
    import pyarrow.parquet

    arrays = {
        name: pyarrow.array([str(value) for value in column.tolist()], pyarrow.string())
        if column.dtype.kind in "OSU"
        else pyarrow.array(np.ascontiguousarray(column))
        for name, column in columns.items()
    }
    told = {RECORD: json.dumps(record, allow_nan=False)}
    table = pyarrow.table(arrays).replace_schema_metadata(told)
    with replacing(path) as partial:
        pyarrow.parquet.write_table(table, str(partial))
    return path


# Reading -------------------------------------------------------------------------


def _read_csv(path: Path) -> tuple[Columns, dict[str, Any] | None]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(f"{path.name!r} cannot be read as a table ({error}).") from error
    record = _beside(path)
    if len(rows) < (1 if record else 2):
        raise FileFormatError(f"{path.name!r} has no rows.")
    names, cells = rows[0], rows[1:]
    ragged = sum(len(row) != len(names) for row in cells)
    if ragged:
        raise FileFormatError(f"{path.name!r} has rows of other lengths.", rows=ragged)
    by_column = list(zip(*cells, strict=True)) or [()] * len(names)
    columns = {
        name: np.array(values, np.str_) for name, values in zip(names, by_column, strict=True)
    }
    return columns, record


def _beside(path: Path) -> dict[str, Any] | None:
    """The record beside a CSV, None where there is none of ours."""
    beside = path.with_suffix(".json")
    if not beside.is_file():
        return None
    try:
        record = json.loads(beside.read_text(encoding="utf-8"))
    except ValueError as error:
        raise FileFormatError(f"{beside.name!r} is damaged ({error}).") from error
    ours = isinstance(record, dict) and record.get("format") == RECORD
    return record if ours else None


def _read_parquet(path: Path) -> tuple[Columns, dict[str, Any] | None]:
    check_parquet()
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(str(path))
    except (OSError, pyarrow.ArrowInvalid) as error:
        raise FileFormatError(f"{path.name!r} is no Parquet file ({error}).") from error
    told = (table.schema.metadata or {}).get(RECORD.encode())
    columns = {name: table[name].to_numpy() for name in table.column_names}
    columns = {
        name: column.astype(np.str_) if column.dtype.kind == "O" else column
        for name, column in columns.items()
    }
    return columns, None if told is None else json.loads(told)


def _foreign(path: Path, found: Columns, said: Said) -> Tracks:
    """Tracks of a table that has no record of ours."""
    found, unit = _without_headers(found)
    names = _known(found)
    if TRACK not in names:
        raise FileFormatError(
            f"{path.name!r} has no column that says which track a row is of.",
            columns=list(found),
            hint="Name it track_id.",
        )
    numbers = {ours: _numbers(found[theirs], theirs) for ours, theirs in names.items()}
    tracked = np.isfinite(numbers[TRACK])
    numbers = {name: column[tracked] for name, column in numbers.items()}
    frames, step = _frames(path, numbers, said.time_step)
    track, raised = from_one(whole_timepoints(numbers[TRACK]))
    columns: Columns = {TRACK: track, TIMEPOINT: frames}
    columns |= _position(names, numbers, said.sizes, unit, len(track))
    columns |= {name: numbers[name] for name in PLACE if name in numbers}
    used = set(names.values())
    for name, column in found.items():
        if name and name not in used and name not in columns:
            columns[name] = _typed(column[tracked])
    source = {"file": path.name, "columns": names, "track_numbers_raised_by": raised}
    links = {
        name: _links(track, numbers.get(name), raised, child)
        for name, child in ((PARENT, True), (INTO, False))
    }
    return imported(columns, step, said.timepoints, source, links[PARENT], links[INTO])


def _without_headers(found: Columns) -> tuple[Columns, str | None]:
    """TrackMate's table of spots has three more rows of headers, the last with units."""
    upper = {name.upper(): name for name in found}
    if not {"TRACK_ID", "FRAME", "POSITION_X"} <= set(upper):
        return found, None
    frames = found[upper["FRAME"]].astype(np.str_)
    headers = 0
    while headers < min(3, len(frames)) and not _is_number(str(frames[headers])):
        headers += 1
    if headers == 0:
        return found, None
    unit = str(found[upper["POSITION_X"]][headers - 1]).strip("() ")
    return {name: column[headers:] for name, column in found.items()}, unit or None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _known(found: Columns) -> dict[str, str]:
    """Which of a table's columns are those that we know: our names to its names."""
    lower: dict[str, str] = {}
    for name in found:
        lower.setdefault(name.strip().lower(), name)
    names = {
        ours: next((lower[alias] for alias in aliases if alias in lower), None)
        for ours, aliases in ALIASES.items()
    }
    return {ours: theirs for ours, theirs in names.items() if theirs is not None}


def _numbers(column: npt.NDArray[Any], name: str) -> npt.NDArray[np.float64]:
    if column.dtype.kind != "U":
        return column.astype(np.float64)
    empty = np.isin(np.char.lower(column), ("", "nan", "na", "none", "null"))
    try:
        numbers: npt.NDArray[np.float64] = np.where(empty, "nan", column).astype(np.float64)
    except ValueError as error:
        raise FileFormatError(f"The column {name!r} is not of numbers ({error}).") from error
    return numbers


def _typed(column: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Whole numbers, numbers, or text: what all cells of a column are."""
    if column.dtype.kind != "U":
        return column
    for kind in (np.int64, np.float64):
        try:
            return np.where(column == "", "nan", column).astype(kind)
        except ValueError:
            continue
    return column


def _frames(
    path: Path, numbers: Mapping[str, npt.NDArray[np.float64]], time_step: float | None
) -> tuple[Ints, float | None]:
    """Timepoints, and the time step if it is known."""
    times = numbers.get(TIME)
    if TIMEPOINT in numbers:
        frames = whole_timepoints(numbers[TIMEPOINT])
        if time_step is None and times is not None:
            step = _ratio(frames, times)
            return frames, step
        return frames, time_step
    if times is None:
        raise FileFormatError(
            f"{path.name!r} has no column that says when a row is.", hint="Name it timepoint."
        )
    step = time_step or smallest_step(times)
    return whole_timepoints(times, step or 1.0), step


def _ratio(frames: Ints, times: npt.NDArray[np.float64]) -> float | None:
    """Seconds per timepoint, where rows at two timepoints tell."""
    known = np.isfinite(times)
    if not known.any() or np.ptp(frames[known]) == 0:
        return None
    first, last = np.argmin(frames[known]), np.argmax(frames[known])
    return float(np.ptp(times[known][[first, last]]) / np.ptp(frames[known]))


def _position(
    names: Mapping[str, str],
    numbers: Mapping[str, npt.NDArray[np.float64]],
    sizes: tuple[float | None, ...],
    unit: str | None,
    rows: int,
) -> Columns:
    """z, y, x in µm: not known where there is only (v, u), and z = 0 of a flat image."""
    if not all(name in names for name in SPACE[1:]):
        if not all(name in names for name in PLACE):
            raise InputError(
                "The table has no places.", hint="Name them z_um, y_um, x_um, or v_px, u_px."
            )
        return {name: np.full(rows, np.nan) for name in SPACE}
    found: Columns = {SPACE[0]: np.zeros(rows)}
    for name, size in zip(SPACE, sizes, strict=True):
        if name in names:
            told = "um" if names[name].strip().lower() == name else unit
            known = told if (told or "").lower() in LENGTHS_UM else None
            found[name] = numbers[name] * length_um(known, size, names[name])
    return found


def _links(track: Ints, partner: npt.NDArray[np.float64] | None, raised: int, child: bool) -> Ints:
    """Pairs of tracks from a column that names another track in every row."""
    if partner is None:
        return np.zeros((0, 2), np.int64)
    known = np.isfinite(partner)
    other = np.where(known, partner, -1).astype(np.int64) + raised
    pairs = np.column_stack([other, track] if child else [track, other])
    there = known & np.isin(other, track) & (other != track)
    unique: Ints = np.unique(pairs[there], axis=0)
    return unique
