"""Tracks as TrackMate's XML, which Fiji opens (Plugins › Tracking › Load a TrackMate file).

The elements and attributes are those of TrackMate 6 and later (Tinevez et al. 2017,
doi:10.1016/j.ymeth.2016.09.016): spots with features, tracks as edges between spots, and the
settings of a manual detector and tracker. TrackMate's track is everything that is linked, and it
has none for a single spot: our numbers of tracks are a feature of the spots. Text and what is in
no row have no place in TrackMate; they are in the log, from which :func:`read_trackmate` takes
them.
"""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Tracks
from ..charts.tracks import SPACE, TIMEPOINT, TRACK
from ..errors import FileFormatError, InputError
from .atomic import replacing
from .track_graph import KINDS, graph_of, tracks_of_graph
from .track_record import (
    NOTHING_SAID,
    TIMES_S,
    Said,
    as_name,
    cast,
    imported,
    length_um,
    record_of,
    restored,
)
from .trackmate_features import (
    EDGE_FEATURES,
    SPOT_FEATURES,
    TRACK_FEATURES,
    edge_features,
    track_features,
)

if TYPE_CHECKING:
    from ..motion.movie import Movie

SUFFIXES = (".xml",)
# Of the format, not of the program: what this version wrote is opened by all later ones.
VERSION = "6.0.3"
PREFIX = "UNWRAP3D_"
KIND = f"{PREFIX}KIND"
RECORD = "napari-unwrap3d record: "
RADIUS_UM = 0.5
# Dimensions that TrackMate has, by the end of a column's name.
DIMENSIONS = {"_um_per_s": "VELOCITY", "_per_um": "NONE", "_um2": "AREA", "_um": "LENGTH"}


def write_trackmate(
    path: str | Path, tracks: Tracks, movie: Movie | None = None, name: str = ""
) -> Path:
    """Write tracks as TrackMate's XML.

    Parameters
    ----------
    path : path
        ``*.xml``.
    tracks : Tracks
    movie : Movie, optional
        That they are of; from it come the size of the image and its name.
    name : str
        Of the tracks.

    Raises
    ------
    InputError
        A row has no place in space, without which TrackMate cannot have a spot.
    """
    path = Path(path)
    lost = int((~np.isfinite(tracks.position_um)).any(axis=1).sum())
    if lost:
        raise InputError(
            "TrackMate's spots have a place in space, and some rows have none.",
            rows=lost,
            hint="Lay the tracks on the surface of their movie first.",
        )
    root = ET.Element("TrackMate", version=VERSION)
    codes = _codes(tracks)
    columns = _features(tracks)
    record = record_of(tracks, movie, name) | {"features": columns, "texts": codes}
    # One line, which is left alone when the file is indented.
    log = json.dumps(record, allow_nan=False)
    ET.SubElement(root, "Log").text = f"Written by napari-unwrap3d.\n{RECORD}{log}\n"
    _add_model(root, tracks, columns, codes)
    _add_settings(root, tracks, movie)
    ET.SubElement(ET.SubElement(root, "GUIState", state="ConfigureViews"), "View").set(
        "key", "HYPERSTACKDISPLAYER"
    )
    ET.indent(root)
    with replacing(path) as partial:
        ET.ElementTree(root).write(partial, encoding="UTF-8", xml_declaration=True)
    return path


def read_trackmate(path: str | Path, said: Said = NOTHING_SAID) -> Tracks:
    """Read tracks from TrackMate's XML: the spots of its filtered tracks.

    Parameters
    ----------
    path : path
    said : Said, optional

    Raises
    ------
    FileFormatError
        The file is damaged, or not TrackMate's.
    InputError
        The file does not tell in what its places are, and it was not said.
    """
    path = Path(path)
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise FileFormatError(f"{path.name!r} is no XML file ({error}).") from error
    model = root.find("Model")
    if root.tag != "TrackMate" or model is None:
        raise FileFormatError(
            f"{path.name!r} is not TrackMate's.",
            hint="Save it in TrackMate; its export of tracks only is another format.",
        )
    record = _record(root)
    if record is not None:
        return _ours(path, model, record)
    return _foreign(path, root, model, said)


# Writing -------------------------------------------------------------------------


def _features(tracks: Tracks) -> dict[str, str]:
    """Names of features of spots to names of columns; places and times have TrackMate's own."""
    names: dict[str, str] = {}
    for column in tracks.columns:
        if column in (*SPACE, TIMEPOINT):
            continue
        feature = PREFIX + as_name(column).upper()
        while feature in names:
            feature += "_"
        names[feature] = column
    return names


def _codes(tracks: Tracks) -> dict[str, list[str]]:
    """The different texts of every column of texts, sorted."""
    return {
        name: sorted({str(value) for value in column.tolist()})
        for name, column in tracks.columns.items()
        if column.dtype.kind in "OSU"
    }


def _add_model(
    root: ET.Element, tracks: Tracks, columns: Mapping[str, str], codes: Mapping[str, list[str]]
) -> None:
    model = ET.SubElement(root, "Model", spatialunits="micron", timeunits="sec")
    own = [_declared(tracks, feature, column) for feature, column in columns.items()]
    declared = ET.SubElement(model, "FeatureDeclarations")
    kind = (KIND, f"Kind ({', '.join(KINDS)})", "Kind", "NONE", "true")
    for tag, features in (
        ("SpotFeatures", [*SPOT_FEATURES, *own]),
        ("EdgeFeatures", [*EDGE_FEATURES, kind]),
        ("TrackFeatures", TRACK_FEATURES),
    ):
        group = ET.SubElement(declared, tag)
        names = ("feature", "name", "shortname", "dimension", "isint")
        for feature in features:
            ET.SubElement(group, "Feature", dict(zip(names, feature, strict=True)))
    _add_spots(model, tracks, columns, codes)
    _add_tracks(model, tracks)


def _declared(tracks: Tracks, feature: str, column: str) -> tuple[str, str, str, str, str]:
    values = tracks.columns[column]
    dimension = next((d for end, d in DIMENSIONS.items() if column.endswith(end)), "NONE")
    whole = values.dtype.kind in "iubOSU"
    return feature, column, column, dimension, str(whole).lower()


def _add_spots(
    model: ET.Element, tracks: Tracks, columns: Mapping[str, str], codes: Mapping[str, list[str]]
) -> None:
    spots = ET.SubElement(model, "AllSpots", nspots=str(len(tracks)))
    attributes = {
        "QUALITY": ["1.0"] * len(tracks),
        "POSITION_T": _texts(tracks.times_s),
        "FRAME": _texts(tracks.timepoint),
        "RADIUS": _texts(_radius(tracks)),
        "VISIBILITY": ["1"] * len(tracks),
        **{
            f"POSITION_{axis}": _texts(tracks.columns[name].astype(np.float64))
            for axis, name in zip("ZYX", SPACE, strict=True)
        },
    }
    for feature, column in columns.items():
        values = tracks.columns[column]
        if column in codes:
            index = {text: code for code, text in enumerate(codes[column])}
            values = np.array([index[str(value)] for value in values.tolist()], np.int64)
        attributes[feature] = _texts(values)
    names = list(attributes)
    rows = list(zip(*attributes.values(), strict=True))
    for timepoint in np.unique(tracks.timepoint).tolist():
        frame = ET.SubElement(spots, "SpotsInFrame", frame=str(timepoint))
        for row in np.flatnonzero(tracks.timepoint == timepoint).tolist():
            there = dict(zip(names, rows[row], strict=True))
            ET.SubElement(frame, "Spot", {"ID": str(row), "name": f"ID{row}", **there})


def _texts(values: npt.NDArray[Any]) -> list[str]:
    """Numbers as Java reads them, and as TrackMate writes them: also NaN."""
    if values.dtype.kind in "iub":
        return [str(int(value)) for value in values.tolist()]
    return [_text(value) for value in values.astype(np.float64).tolist()]


def _text(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return repr(value)


def _radius(tracks: Tracks) -> Floats:
    """How large spots are drawn: circles of the same area, where that is known."""
    nothing = np.full(len(tracks), np.nan)
    area = tracks.columns.get("area_um2", nothing).astype(np.float64)
    radius = np.sqrt(np.maximum(area, 0.0) / np.pi)
    own: Floats = tracks.columns.get("radius_um", radius).astype(np.float64)
    return np.where(own > 0, own, RADIUS_UM)


def _add_tracks(model: ET.Element, tracks: Tracks) -> None:
    graph = graph_of(tracks)
    lineage = graph.lineages(len(tracks))
    step = edge_features(tracks, graph)
    order = np.argsort(lineage[graph.edges[:, 0]], kind="stable")
    edges = ET.SubElement(model, "AllTracks")
    chosen = np.unique(lineage[graph.edges[:, 0]])
    ends = np.searchsorted(lineage[graph.edges[order, 0]], chosen, "right")
    begins = np.append(0, ends)[:-1]
    texts = {name: _texts(values) for name, values in step.items()} | {KIND: _texts(graph.kind)}
    for index, (number, begin, end) in enumerate(zip(chosen.tolist(), begins, ends, strict=True)):
        mine = order[begin:end]
        rows = np.flatnonzero(lineage == number)
        features = track_features(tracks, graph.edges[mine], rows, step["DISPLACEMENT"][mine])
        told = {"TRACK_ID": index, **features, "TRACK_INDEX": index}
        attributes = {key: str(_plain(value)) for key, value in told.items()}
        track = ET.SubElement(edges, "Track", {"name": f"Track_{index}", **attributes})
        for edge in mine.tolist():
            ET.SubElement(track, "Edge", {name: text[edge] for name, text in texts.items()})
    filtered = ET.SubElement(model, "FilteredTracks")
    for index in range(len(chosen)):
        ET.SubElement(filtered, "TrackID", TRACK_ID=str(index))


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _add_settings(root: ET.Element, tracks: Tracks, movie: Movie | None) -> None:
    settings = ET.SubElement(root, "Settings")
    shape, voxel, title = _image(tracks, movie)
    sizes = dict(zip(("nslices", "height", "width"), map(str, shape), strict=True))
    edges = dict(zip(("voxeldepth", "pixelheight", "pixelwidth"), map(repr, voxel), strict=True))
    ET.SubElement(
        settings,
        "ImageData",
        {"filename": title, "folder": "", **sizes, "nframes": str(tracks.timepoints), **edges}
        | {"timeinterval": repr(float(tracks.time_step_s))},
    )
    last = zip("xyzt", (*shape[::-1], tracks.timepoints), strict=True)
    box = {f"{axis}{end}": str(n) for axis, size in last for end, n in _ends(size)}
    ET.SubElement(settings, "BasicSettings", box)
    ET.SubElement(settings, "DetectorSettings", DETECTOR_NAME="MANUAL_DETECTOR", RADIUS="0.5")
    ET.SubElement(settings, "InitialSpotFilter", feature="QUALITY", value="0.0", isabove="true")
    ET.SubElement(settings, "SpotFilterCollection")
    ET.SubElement(settings, "TrackerSettings", TRACKER_NAME="MANUAL_TRACKER")
    ET.SubElement(settings, "TrackFilterCollection")
    analyzers = ET.SubElement(settings, "AnalyzerCollection")
    for tag in ("SpotAnalyzers", "EdgeAnalyzers", "TrackAnalyzers"):
        ET.SubElement(analyzers, tag)


def _ends(size: int) -> Iterator[tuple[str, int]]:
    yield "start", 0
    yield "end", max(size - 1, 0)


def _image(tracks: Tracks, movie: Movie | None) -> tuple[tuple[int, ...], tuple[float, ...], str]:
    """Shape (z, y, x), size of a voxel and name of the image that the tracks are of.

    Without the movie, one of voxels of 1 µm that holds them.
    """
    if movie is not None:
        mask = movie.common.mask
        voxel = np.asarray(mask.voxel_size, np.float64)
        # The image begins where places are 0, also where the mask is a part of it.
        whole = np.rint(np.asarray(mask.origin) / voxel).astype(int) + mask.data.shape
        return tuple(np.maximum(whole, 1).tolist()), tuple(voxel.tolist()), movie.name
    reach = tracks.position_um.max(axis=0, initial=0.0)
    shape = tuple(math.ceil(size) + 1 for size in np.maximum(reach, 0.0).tolist())
    return shape, (1.0, 1.0, 1.0), "tracks"


# Reading -------------------------------------------------------------------------


def _record(root: ET.Element) -> dict[str, Any] | None:
    """What we wrote into the log, None where another program made the file."""
    for line in (root.findtext("Log") or "").splitlines():
        if line.startswith(RECORD):
            try:
                found: dict[str, Any] = json.loads(line.removeprefix(RECORD))
            except ValueError as error:
                raise FileFormatError(f"The record in the log is damaged ({error}).") from error
            return found
    return None


def _ours(path: Path, model: ET.Element, record: Mapping[str, Any]) -> Tracks:
    """Tracks that we wrote. Where TrackMate has changed links since, those of the file hold."""
    spots = [spot.attrib for spot in model.iter("Spot")]
    identity = _column(spots, "ID", int)
    columns: dict[str, npt.NDArray[Any]] = {
        name: _column(spots, f"POSITION_{axis}", float)
        for axis, name in zip("ZYX", SPACE, strict=True)
    }
    columns[TIMEPOINT] = _column(spots, "FRAME", int)
    for feature, name in record["features"].items():
        kind = record["columns"][name]
        codes = record["texts"].get(name)
        whole = codes is not None or np.dtype(kind).kind in "iub"
        values = _column(spots, feature, int if whole else float)
        columns[name] = (
            cast(values, kind)
            if codes is None
            else np.array([codes[code] for code in values.tolist()], np.dtype(kind))
        )
    links = _links(model)
    if (
        np.array_equal(np.sort(identity), np.arange(len(spots)))
        and columns[TRACK].min(initial=1) > 0
    ):
        tracks = restored(record, columns)
        if {tuple(edge) for edge in graph_of(tracks).edges.tolist()} == set(links):
            return tracks
    index = {spot: row for row, spot in enumerate(identity.tolist())}
    edges = _edges(path, links, index)
    columns[TRACK], splits, merges = tracks_of_graph(columns[TIMEPOINT], edges)
    source = {"file": path.name, "changed": "links, after napari-unwrap3d wrote them"}
    step, count = float(record["time_step_s"]), int(record["timepoints"])
    return replace(imported(columns, step, count, source, splits, merges), rows=int(record["rows"]))


def _links(model: ET.Element) -> list[tuple[int, int]]:
    """The spots at the two ends of every edge of the filtered tracks."""
    kept = {each.get("TRACK_ID") for each in model.iterfind("FilteredTracks/TrackID")}
    return [
        (int(edge.attrib["SPOT_SOURCE_ID"]), int(edge.attrib["SPOT_TARGET_ID"]))
        for track in model.iterfind("AllTracks/Track")
        if track.get("TRACK_ID") in kept
        for edge in track.iterfind("Edge")
    ]


def _edges(path: Path, links: list[tuple[int, int]], index: Mapping[int, int]) -> Ints:
    """Links between spots as pairs (m, 2) of rows."""
    missing = {spot for link in links for spot in link} - set(index)
    if missing:
        raise FileFormatError(
            f"{path.name!r} has tracks of spots that it does not have.", missing=len(missing)
        )
    pairs = [[index[one], index[other]] for one, other in links]
    return np.array(pairs, np.int64).reshape(-1, 2)


def _column(spots: list[dict[str, str]], name: str, kind: type) -> npt.NDArray[Any]:
    """A feature of all spots; NaN where one does not have it."""
    if kind is int:
        found = [spot.get(name, "0") for spot in spots]
        return np.array(
            [int(float(text)) if "." in text else int(text) for text in found], np.int64
        )
    return np.array([float(spot.get(name, "nan")) for spot in spots], np.float64)


def _foreign(path: Path, root: ET.Element, model: ET.Element, said: Said) -> Tracks:
    links = _links(model)
    tracked = {spot for link in links for spot in link}
    everything = [spot.attrib for spot in model.iter("Spot")]
    spots = [spot for spot in everything if int(spot["ID"]) in tracked]
    if not spots:
        raise FileFormatError(f"{path.name!r} has no tracks.", spots=len(everything))
    frames = _column(spots, "FRAME", int)
    edges = _edges(path, links, {int(spot["ID"]): row for row, spot in enumerate(spots)})
    track, splits, merges = tracks_of_graph(frames, edges)
    columns = {TRACK: track, TIMEPOINT: frames}
    for axis, name, size in zip("ZYX", SPACE, said.sizes, strict=True):
        um = length_um(model.get("spatialunits"), size, axis)
        columns[name] = _column(spots, f"POSITION_{axis}", float) * um
    columns["spot_id"] = _column(spots, "ID", int)
    for feature, whole in _declared_features(model):
        columns[feature] = _column(spots, feature, int if whole else float)
    image = root.find("Settings/ImageData")
    source = {
        "file": path.name,
        "format": f"TrackMate {root.get('version')}",
        "image": {} if image is None else dict(image.attrib),
        "units": {key: model.get(key) for key in ("spatialunits", "timeunits")},
        "spots_in_no_track": len(everything) - len(spots),
    }
    timepoints = said.timepoints
    if timepoints is None and image is not None:
        timepoints = max(int(image.get("nframes", 0)), int(frames.max()) + 1)
    step = said.time_step or _interval(image, model.get("timeunits"))
    return imported(columns, step, timepoints, source, splits, merges)


def _declared_features(model: ET.Element) -> Iterator[tuple[str, bool]]:
    """Features of spots that are columns of their own, and whether they are whole numbers."""
    own = {"FRAME", "POSITION_T", "POSITION_Z", "POSITION_Y", "POSITION_X", "VISIBILITY"}
    for feature in model.iterfind("FeatureDeclarations/SpotFeatures/Feature"):
        name = feature.attrib["feature"]
        if name not in own:
            yield name, feature.get("isint") == "true"


def _interval(image: ET.Element | None, unit: str | None) -> float | None:
    """Seconds between two frames, None where they are not told in a unit of time."""
    seconds = TIMES_S.get((unit or "").strip().lower())
    interval = None if image is None else image.get("timeinterval")
    return None if seconds is None or interval is None else float(interval) * seconds
