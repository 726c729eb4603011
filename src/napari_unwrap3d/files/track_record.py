"""What files say of tracks beside their rows: times, links, columns, and where they come from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Ints, Tracks
from ..charts.tracks import NEEDED, TIMEPOINT, TRACK
from ..errors import FileFormatError, InputError
from ..provenance import environment
from .atomic import from_plain, plain

if TYPE_CHECKING:
    from ..motion.movie import Movie

FORMAT = "napari-unwrap3d tracks"
SCHEMA_VERSION = 1
PROVENANCE = "provenance"
IMPORTED = "imported"
# What lengths and times may be in, in µm and in s.
LENGTHS_UM = {
    **dict.fromkeys(("micrometer", "micrometre", "micron", "microns", "um", "µm", "μm"), 1.0),
    **dict.fromkeys(("nanometer", "nanometre", "nm"), 1e-3),
    **dict.fromkeys(("angstrom", "å"), 1e-4),
    **dict.fromkeys(("millimeter", "millimetre", "mm"), 1e3),
    **dict.fromkeys(("centimeter", "cm"), 1e4),
    **dict.fromkeys(("meter", "metre", "m"), 1e6),
}
TIMES_S = {
    **dict.fromkeys(("second", "seconds", "sec", "s"), 1.0),
    **dict.fromkeys(("millisecond", "msec", "ms"), 1e-3),
    **dict.fromkeys(("minute", "minutes", "min"), 60.0),
    **dict.fromkeys(("hour", "hours", "h"), 3600.0),
}
# Units at the end of a column's name, the longest first.
UNITS = {
    "_um_per_min": "micrometer/minute",
    "_um_per_s": "micrometer/second",
    "_um2_per_s": "micrometer^2/second",
    "_per_um2": "1/micrometer^2",
    "_per_um": "1/micrometer",
    "_um3": "micrometer^3",
    "_um2": "micrometer^2",
    "_um": "micrometer",
    "_px": "pixel",
    "_deg": "degree",
    "_s": "second",
}


def unit_of(column: str) -> str | None:
    """The unit that a column's name ends with, None if it names none."""
    return next((unit for end, unit in UNITS.items() if column.endswith(end)), None)


def record_of(tracks: Tracks, movie: Movie | None = None, name: str = "") -> dict[str, Any]:
    """Everything about tracks that is in no row, JSON-able.

    Parameters
    ----------
    tracks : Tracks
    movie : Movie, optional
        That they are of: its name and parameters are told.
    name : str
        Of the tracks.
    """
    told: dict[str, Any] = dict(tracks.numbers.get(PROVENANCE, {}))
    told["versions"] = environment()
    if name:
        told["tracks"] = name
    if movie is not None:
        told["movie"] = movie.name
        told["parameters"] = movie.parameters.to_toml()
        if name in movie.track_names:
            told["key"] = movie.folder.tracks_key(name)
    record = {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "time_step_s": float(tracks.time_step_s),
        "timepoints": int(tracks.timepoints),
        "rows": int(tracks.rows),
        "method": tracks.method,
        "splits": tracks.splits.tolist(),
        "merges": tracks.merges.tolist(),
        "columns": {name: column.dtype.str for name, column in tracks.columns.items()},
        "numbers": {key: value for key, value in tracks.numbers.items() if key != PROVENANCE},
        PROVENANCE: told,
    }
    plain_record: dict[str, Any] = plain(record)
    return plain_record


def restored(record: Mapping[str, Any], columns: Mapping[str, npt.ArrayLike]) -> Tracks:
    """Tracks that were written with a record; columns that it does not name are left out.

    Raises
    ------
    FileFormatError
        The record is of a newer version, or does not fit the rows.
    """
    if record.get("format") != FORMAT or record.get("schema_version", 0) > SCHEMA_VERSION:
        raise FileFormatError(
            "The tracks were written by another version.",
            file_schema=record.get("schema_version"),
            known_schema=SCHEMA_VERSION,
            hint="Update napari-unwrap3d.",
        )
    missing = [name for name in record["columns"] if name not in columns]
    if missing:
        raise FileFormatError("The file lacks columns that it should have.", missing=missing)
    typed = {name: _typed(name, columns[name], kind) for name, kind in record["columns"].items()}
    there = np.unique(typed[TRACK])
    splits, merges = (_pairs(record[name]) for name in ("splits", "merges"))
    told = from_plain(dict(record[PROVENANCE]))
    kept = [np.isin(pairs, there).all(axis=1) for pairs in (splits, merges)]
    lost = sum(int((~each).sum()) for each in kept)
    if lost:
        # Rows were taken out of the table since it was written.
        told = {**told, "links_of_missing_tracks": lost}
    return Tracks.of(
        typed,
        time_step_s=float(record["time_step_s"]),
        timepoints=int(record["timepoints"]),
        rows=int(record["rows"]),
        splits=splits[kept[0]],
        merges=merges[kept[1]],
        method=str(record["method"]),
        numbers={**from_plain(dict(record["numbers"])), PROVENANCE: told},
    )


def _typed(name: str, values: npt.ArrayLike, kind: str) -> npt.NDArray[Any]:
    try:
        return cast(values, kind)
    except (ValueError, OverflowError) as error:
        raise FileFormatError(f"The column {name!r} is not as it was written ({error}).") from error


def cast(values: npt.ArrayLike, kind: str) -> npt.NDArray[Any]:
    """Values as the type that they had before they were written.

    Raises
    ------
    ValueError
        A text is no such value.
    """
    found = np.asarray(values)
    texts = found.dtype.kind in "OUS"
    wanted = np.dtype(kind)
    if wanted.kind in "OUS":
        return np.array([str(value) for value in found.tolist()], wanted)
    if not texts:
        return found.astype(wanted)
    cells = [str(value).strip() for value in found.tolist()]
    if wanted.kind == "b":
        return np.array([cell.lower() in ("true", "1") for cell in cells], bool)
    if wanted.kind in "iu":
        return np.array([_whole(cell) for cell in cells], wanted)
    # Spreadsheets leave what is no number empty.
    return np.array([float(cell or "nan") for cell in cells], wanted)


def _whole(cell: str) -> int:
    """A whole number, also where a spreadsheet wrote it as 3.0."""
    return int(cell) if cell.lstrip("+-").isdigit() else int(float(cell))


def _pairs(pairs: Any) -> Ints:
    return np.array(pairs, np.int64).reshape(-1, 2)


# Tracks made elsewhere -----------------------------------------------------------


@dataclass(frozen=True)
class Said:
    """What a person says of tracks that were made elsewhere, where their file does not tell.

    Attributes
    ----------
    voxel_size : (float, float, float) or None
        µm per unit along z, y, x where places are in pixels.
    time_step : float or None
        Seconds between two timepoints.
    timepoints : int or None
        Of the movie; otherwise those of the file's image, or up to the last row.
    """

    voxel_size: tuple[float, float, float] | None = None
    time_step: float | None = None
    timepoints: int | None = None

    @property
    def sizes(self) -> tuple[float | None, ...]:
        """µm per unit along z, y and x, each None where nobody said it."""
        return (None, None, None) if self.voxel_size is None else self.voxel_size


NOTHING_SAID = Said()


def imported(
    columns: Mapping[str, npt.ArrayLike],
    time_step_s: float | None,
    timepoints: int | None,
    source: Mapping[str, Any],
    splits: Ints | None = None,
    merges: Ints | None = None,
) -> Tracks:
    """Tracks of rows that were made elsewhere.

    Parameters
    ----------
    columns : mapping of str to array-like, (n,)
        Under our names.
    time_step_s : float or None
    timepoints : int or None
        As many as there are unless given.
    source : mapping
        Where they come from.
    splits, merges : ndarray, (k, 2), optional

    Raises
    ------
    InputError
        The time between two timepoints is not known, or there is no place in a row.
    FileFormatError
        A track is at two places at a time.
    """
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        raise InputError("The tracks lack what every row must have.", missing=missing)
    if time_step_s is None:
        raise InputError(
            "The time between two timepoints is not known.", hint="Give time_step, in s."
        )
    time = np.asarray(columns[TIMEPOINT])
    count = int(time.max(initial=-1)) + 1
    if timepoints is not None and timepoints < count:
        raise InputError("There are later rows than timepoints.", last=count - 1, given=timepoints)
    none = np.zeros((0, 2), np.int64)
    try:
        return Tracks.of(
            columns,
            time_step_s=float(time_step_s),
            timepoints=count if timepoints is None else timepoints,
            splits=none if splits is None else splits,
            merges=none if merges is None else merges,
            method=IMPORTED,
            numbers={PROVENANCE: {IMPORTED: dict(source)}},
        )
    except InputError as error:
        raise FileFormatError(f"These are no tracks: {error.what}", **error.measured) from error


def length_um(unit: str | None, voxel_um: float | None, where: str) -> float:
    """µm per unit of a length; what is in pixels has the size of the voxel.

    Raises
    ------
    InputError
        The unit says nothing, and no voxel size was given.
    """
    known = LENGTHS_UM.get((unit or "").strip().lower())
    if known is not None:
        return known
    if voxel_um is None:
        told = f"in {unit!r}" if unit else "of no known unit"
        raise InputError(
            f"Places along {where} are {told}.", hint="Give voxel_size: µm per unit (z, y, x)."
        )
    return float(voxel_um)


def whole_timepoints(times: npt.ArrayLike, time_step: float = 1.0) -> Ints:
    """Timepoints of times in units of `time_step`.

    Raises
    ------
    FileFormatError
        They are no whole multiples of the step.
    """
    found = np.asarray(times, np.float64) / time_step
    rounded = np.rint(found)
    if not np.isfinite(found).all() or (np.abs(found - rounded) > 0.01).any():
        worst = float(np.nanmax(np.abs(found - rounded), initial=0.0))
        raise FileFormatError(
            "Times are no whole number of time steps.",
            time_step=time_step,
            farthest=worst,
            hint="Give the time step in s that the movie was recorded with.",
        )
    return rounded.astype(np.int64)


def smallest_step(times: npt.ArrayLike) -> float | None:
    """The smallest time between two different times, None if there are not two.

    Times that differ by rounding only are one.
    """
    known = np.unique(np.asarray(times, np.float64))
    steps = np.diff(known[np.isfinite(known)])
    steps = steps[steps > 1e-6 * np.ptp(known)] if len(steps) else steps
    if len(steps) == 0:
        return None
    whole = float(np.ptp(known))
    return whole / round(whole / float(steps.min()))


def from_one(track: npt.ArrayLike) -> tuple[Ints, int]:
    """Numbers of tracks from 1, and by how much they were raised."""
    found = np.asarray(track).astype(np.int64)
    raised = max(0, 1 - int(found.min(initial=1)))
    return found + raised, raised


def as_name(text: str) -> str:
    """Letters, digits and _ of a text: a name that files can use."""
    return re.sub(r"\W", "_", text, flags=re.ASCII)
