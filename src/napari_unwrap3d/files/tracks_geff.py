"""Tracks as GEFF, the Graph Exchange File Format (https://liveimagetracking.org/geff).

A node per row and an edge per link, split and merge. The axes t, z, y and x carry units, and t
the time step; every other column is a property of the nodes with its unit. A track that goes on
after another came out of it is one track here and several tracklets there: both are written.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Tracks
from ..charts.tracks import PLACE, SPACE, TIMEPOINT, TRACK
from ..errors import FileFormatError, InputError
from .atomic import replacing
from .track_graph import graph_of, tracks_of_graph
from .track_record import (
    NOTHING_SAID,
    TIMES_S,
    Said,
    as_name,
    imported,
    length_um,
    record_of,
    restored,
    smallest_step,
    unit_of,
    whole_timepoints,
)

if TYPE_CHECKING:
    from ..motion.movie import Movie

SUFFIXES = (".geff",)
EXTRA = "napari-unwrap3d"
AXES = dict(zip(("t", "z", "y", "x"), (TIMEPOINT, *SPACE), strict=True))
TRACKLET, LINEAGE, KIND = "tracklet_id", "lineage_id", "kind"
TEXTS = {
    TRACK: "Number of the track, which goes on where another comes out of it.",
    TRACKLET: "Number of the path without a branch or a merge.",
    LINEAGE: "Number of everything that is linked.",
    "v_px": "Row on the unwrapped surface, north pole first.",
    "u_px": "Column on the unwrapped surface, periodic.",
    KIND: "0: within a track, 1: a track comes out of another, 2: a track goes into another.",
}


def write_geff(
    path: str | Path, tracks: Tracks, movie: Movie | None = None, name: str = ""
) -> Path:
    """Write tracks as GEFF (a Zarr folder, format 2); it appears when it is complete.

    Nothing is lost: numbers of tracks, splits, merges, columns with their types, and where they
    come from are in the metadata under ``extra["napari-unwrap3d"]``.

    Parameters
    ----------
    path : path
        ``*.geff``.
    tracks : Tracks
    movie : Movie, optional
        That they are of.
    name : str
        Of the tracks.

    Raises
    ------
    InputError
        There is something else in the place.
    """
    from geff.core_io import write_arrays

    path = Path(path)
    if path.exists() and not _is_geff(path):
        raise InputError(f"{path.name!r} is there and no GEFF.", hint="Choose another name.")
    graph = graph_of(tracks)
    names = _identifiers(tracks)
    nodes = len(tracks)
    values = {identifier: tracks.columns[column] for identifier, column in names.items()}
    values |= {TRACKLET: graph.tracklets(nodes), LINEAGE: graph.lineages(nodes)}
    record = record_of(tracks, movie, name) | {"identifiers": names}
    with replacing(path) as partial:
        write_arrays(
            partial,
            np.arange(nodes, dtype=np.uint64),
            {key: _property(column) for key, column in values.items()},
            graph.edges.astype(np.uint64),
            {KIND: _property(graph.kind)},
            _metadata(tracks, names, values, record),
            zarr_format=2,
        )
        _with_finite_limits(partial, values)
    return path


def read_geff(path: str | Path, said: Said = NOTHING_SAID) -> Tracks:
    """Read tracks from a GEFF, also from one that was made elsewhere.

    Parameters
    ----------
    path : path
    said : Said, optional

    Raises
    ------
    FileFormatError
        The file is damaged or no GEFF, or an edge joins two nodes of one timepoint.
    InputError
        The file does not tell in what its axes are, and it was not said.
    """
    from geff.core_io import read_to_memory

    path = Path(path)
    if not _is_geff(path):
        raise FileFormatError(f"{path.name!r} is no GEFF.")
    try:
        with warnings.catch_warnings():
            # Units that it does not know are looked at below.
            warnings.filterwarnings("ignore", message=".*not in valid OME-Zarr units")
            found = read_to_memory(path)
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise FileFormatError(f"{path.name!r} is damaged or no GEFF ({error}).") from error
    record = found["metadata"].extra.get(EXTRA)
    properties = {key: _values(prop) for key, prop in found["node_props"].items()}
    if record is not None:
        names = record["identifiers"]
        return restored(record, {names[key]: properties[key] for key in names})
    return _foreign(path, found, properties, said)


# Writing -------------------------------------------------------------------------


def _identifiers(tracks: Tracks) -> dict[str, str]:
    """Names of properties, which are names of folders, to names of columns."""
    axes = {column: axis for axis, column in AXES.items()}
    taken = {*AXES, TRACKLET, LINEAGE}
    names: dict[str, str] = {}
    for column in tracks.columns:
        identifier = axes.get(column)
        if identifier is None:
            identifier = as_name(column) or "column"
            while identifier in taken:
                identifier += "_"
        taken.add(identifier)
        names[identifier] = column
    return names


def _property(values: npt.NDArray[Any]) -> Any:
    column = values
    if column.dtype.kind in "OS":
        column = np.array([str(value) for value in column.tolist()], dtype=np.str_)
    if column.dtype.kind == "U" and column.dtype.itemsize == 0:
        column = column.astype("U1")
    return {"values": column, "missing": None}


def _metadata(
    tracks: Tracks,
    names: dict[str, str],
    values: dict[str, npt.NDArray[Any]],
    record: dict[str, Any],
) -> Any:
    from geff_spec import Axis, DisplayHint, GeffMetadata

    time = Axis(
        name="t",
        type="time",
        unit="frame",
        scale=float(tracks.time_step_s),
        scaled_unit="second",
    )
    space = [Axis(name=axis, type="space", unit="micrometer") for axis in ("z", "y", "x")]
    return GeffMetadata(
        axes=[time, *space],
        directed=True,
        node_props_metadata={
            key: _described(key, names.get(key, key), column) for key, column in values.items()
        },
        edge_props_metadata={KIND: _described(KIND, KIND, np.zeros(0, np.int64))},
        track_node_props={"tracklet": TRACKLET, "lineage": LINEAGE},
        display_hints=DisplayHint(
            display_horizontal="x", display_vertical="y", display_depth="z", display_time="t"
        ),
        extra={EXTRA: record},
    )


def _described(identifier: str, column: str, values: npt.NDArray[Any]) -> Any:
    from geff_spec import PropMetadata

    text = values.dtype.kind in "OSU"
    return PropMetadata(
        identifier=identifier,
        dtype="str" if text else values.dtype.name,
        unit="frame" if column == TIMEPOINT else unit_of(column),
        name=column,
        description=TEXTS.get(column),
    )


def _with_finite_limits(path: Path, values: dict[str, npt.NDArray[Any]]) -> None:
    """Limits of axes over what is known: places that are not known are NaN, no limit is."""
    from geff_spec import GeffMetadata

    if all(np.isfinite(values[axis]).all() for axis in AXES):
        return
    metadata = GeffMetadata.read(path)
    for axis in metadata.axes or ():
        known = values[axis.name][np.isfinite(values[axis.name])]
        axis.min = float(known.min()) if len(known) else None
        axis.max = float(known.max()) if len(known) else None
    metadata.write(path)


# Reading -------------------------------------------------------------------------


def _is_geff(path: Path) -> bool:
    return path.is_dir() and any((path / name).is_file() for name in (".zgroup", "zarr.json"))


def _values(found: Any) -> npt.NDArray[Any]:
    """Values of a property; what is missing is NaN, or an empty text."""
    values, missing = np.asarray(found["values"]), found.get("missing")
    if missing is None or not np.any(missing):
        return values
    if values.dtype.kind in "iufb":
        values = values.astype(np.float64)
        values[np.asarray(missing)] = np.nan
    elif values.dtype.kind in "UTO":
        values = np.where(missing, "", values)
    return values


def _foreign(path: Path, found: Any, properties: dict[str, npt.NDArray[Any]], said: Said) -> Tracks:
    """Tracks that were not written by us: paths of the graph."""
    metadata = found["metadata"]
    axes = list(metadata.axes or ())
    time = [axis for axis in axes if axis.type == "time"]
    space = [axis for axis in axes if axis.type == "space"]
    if len(time) != 1 or len(space) not in (2, 3):
        raise FileFormatError(
            f"{path.name!r} has no axes of time and space.", axes=[axis.name for axis in axes]
        )
    frames, step = _frames(time[0], properties[time[0].name], said.time_step)
    position = _position(space, properties, said.sizes)
    index = {int(node): row for row, node in enumerate(found["node_ids"].tolist())}
    edges = np.array(
        [[index[int(node)] for node in edge] for edge in found["edge_ids"].tolist()], np.int64
    ).reshape(-1, 2)
    track, splits, merges = tracks_of_graph(frames, edges)
    columns: dict[str, npt.NDArray[Any]] = {TRACK: track, TIMEPOINT: frames} | position
    left_out = []
    for name, values in properties.items():
        if name in {axis.name for axis in axes}:
            continue
        if values.ndim != 1 or values.dtype.kind not in "iufbUT":
            left_out.append(name)
            continue
        columns[_as_column(name, columns)] = (
            values.astype(np.str_) if values.dtype.kind in "UT" else values
        )
    source = {
        "file": path.name,
        "format": f"GEFF {metadata.geff_version}",
        "left_out": left_out,
        "axes": [axis.model_dump(mode="json") for axis in axes],
    }
    return imported(columns, step, said.timepoints, source, splits, merges)


def _as_column(name: str, taken: dict[str, Any]) -> str:
    """A property under its own name, or ours of the unwrapped surface; never twice."""
    column = {"v": PLACE[0], "u": PLACE[1]}.get(name, name)
    while column in taken:
        column = f"{column}_of_file"
    return column


def _frames(
    axis: Any, values: npt.NDArray[Any], time_step: float | None
) -> tuple[npt.NDArray[np.int64], float | None]:
    """Timepoints and the time step in s of an axis of time."""
    unit = (axis.unit or "frame").lower()
    if unit in TIMES_S:
        seconds = values.astype(np.float64) * TIMES_S[unit]
        step = time_step or smallest_step(seconds)
        return whole_timepoints(seconds, step or 1.0), step
    scaled = (axis.scaled_unit or "").lower()
    if time_step is None and axis.scale and scaled in TIMES_S:
        time_step = float(axis.scale) * TIMES_S[scaled]
    return whole_timepoints(values), time_step


def _position(
    space: list[Any],
    properties: dict[str, npt.NDArray[Any]],
    sizes: tuple[float | None, ...],
) -> dict[str, npt.NDArray[Any]]:
    """z, y, x in µm; a flat image lies at z = 0."""
    named = {axis.name.lower()[-1:]: axis for axis in space}
    ordered = [named[k] for k in "zyx" if k in named]
    ordered = ordered if len(ordered) == len(space) else space
    found: dict[str, npt.NDArray[Any]] = {}
    for column, size, axis in zip(
        SPACE[-len(ordered) :], sizes[-len(ordered) :], ordered, strict=True
    ):
        scale, offset, unit = 1.0, 0.0, axis.unit
        if axis.scaled_unit and axis.scale:
            scale, offset, unit = float(axis.scale), float(axis.offset or 0.0), axis.scaled_unit
        um = length_um(unit, size, axis.name)
        found[column] = (properties[axis.name].astype(np.float64) * scale + offset) * um
    rows = len(next(iter(found.values())))
    return {SPACE[0]: np.zeros(rows)} | found
