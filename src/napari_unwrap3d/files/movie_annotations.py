"""What was drawn on single timepoints of a movie, in its folder.

Layout::

    annotations/timed.json     the annotations' names and colours, and the common space's key
    annotations/00012.zip      the labels of timepoint 12, as in a project, see :mod:`.annotated`

Annotations that are the same at every timepoint are in the project of the common space.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..annotations.annotation import checked_colours, checked_name
from ..annotations.state import Drawn, DrawnInTime, State
from ..atlas import Atlas
from ..errors import FileFormatError, ParameterError
from ..progress import silent
from ..provenance import content_hash
from .annotated import GROUP, read_annotations, write_annotations
from .atomic import replacing, write_json
from .autosave import save_annotations
from .movie import MovieFolder, read_json
from .project import FORMAT, SCHEMA_VERSION, opened, record_key

logger = logging.getLogger(__name__)

FOLDER, LIST = "annotations", "timed.json"
CHARTS = ("surface", "uv", "topography", "direct", "plane")


def keep_annotations(folder: MovieFolder, state: State) -> None:
    """Keep everything that was drawn on a movie in its folder.

    Parameters
    ----------
    folder : MovieFolder
    state : State
        Of the annotations of its common space.
    """
    save_annotations(folder.common_path, state)
    keep_timed(folder, state.timed)


def keep_timed(folder: MovieFolder, timed: tuple[DrawnInTime, ...]) -> None:
    """Keep what was drawn on single timepoints; only what changed is written."""
    place = folder.path / FOLDER
    if not timed and not place.is_dir():
        return
    place.mkdir(exist_ok=True)
    by_time: dict[int, list[Drawn]] = {}
    for part in timed:
        for timepoint, drawn in part.drawn.items():
            by_time.setdefault(timepoint, []).append(drawn)
    for timepoint, parts in by_time.items():
        _write(_path(place, timepoint), tuple(parts))
    described = [
        {"name": p.name, "colours": [[label, *c] for label, c in p.colours.items()]} for p in timed
    ]
    about = {"common": _common_key(folder), "annotations": described, "timepoints": sorted(by_time)}
    write_json(place / LIST, about)
    for path in place.glob("*.zip"):
        if path not in {_path(place, timepoint) for timepoint in by_time}:
            path.unlink()


def read_timed(folder: MovieFolder, atlas: Atlas) -> tuple[DrawnInTime, ...]:
    """What was drawn on single timepoints; nothing where the common space is another now.

    Raises
    ------
    FileFormatError
        A file is damaged, or does not belong to the common space.
    """
    place = folder.path / FOLDER
    about = read_json(place / LIST)
    if about is None:
        return ()
    if about.get("common") != _common_key(folder):
        logger.warning("What was drawn on single timepoints is of another common space.")
        return ()
    try:
        colours = {
            checked_name(part["name"]): checked_colours({n: tuple(c) for n, *c in part["colours"]})
            for part in about["annotations"]
        }
        timepoints = [int(timepoint) for timepoint in about["timepoints"]]
    except (KeyError, TypeError, ValueError, ParameterError) as error:
        raise FileFormatError(f"{LIST!r} of the movie is damaged ({error!r}).") from error
    charts = {name: getattr(atlas, name) for name in CHARTS if atlas.has(name)}
    drawn: dict[str, dict[int, Drawn]] = {name: {} for name in colours}
    for timepoint in timepoints:
        for part in _read(_path(place, timepoint), charts):
            if part.name in drawn:
                drawn[part.name][timepoint] = part
    return tuple(DrawnInTime(name, drawn[name], colours[name]) for name in colours)


def restore_timed(folder: MovieFolder, atlas: Atlas) -> None:
    """Give the annotations of a common space what was drawn on single timepoints."""
    timed = read_timed(folder, atlas)
    if timed:
        atlas.annotations.restore(replace(atlas.annotations.state(), timed=timed))


def _common_key(folder: MovieFolder) -> str:
    return str((folder.common() or {}).get("key", ""))


def _path(place: Path, timepoint: int) -> Path:
    return place / f"{timepoint:05d}.zip"


def _write(path: Path, parts: tuple[Drawn, ...]) -> None:
    import zarr
    from zarr.storage import ZipStore

    key = _key(parts)
    if record_key(path) == key:
        return
    attributes = {"format": FORMAT, "schema_version": SCHEMA_VERSION, "key": key, "numbers": {}}
    with replacing(path) as partial, ZipStore(partial, mode="w") as store:
        root = zarr.create_group(store, attributes=attributes)
        write_annotations(root, State(parts), silent())


def _read(path: Path, charts: Mapping[str, Any]) -> tuple[Drawn, ...]:
    with opened(path) as root:
        return read_annotations(root[GROUP], charts, silent()).drawn


def drawn_key(state: State) -> str:
    """Of everything that was drawn: what is measured in it depends on it."""
    timed = [
        (part.name, timepoint, _key((drawn,)))
        for part in state.timed
        for timepoint, drawn in sorted(part.drawn.items())
    ]
    return content_hash(_key(state.drawn), timed)


def _key(parts: tuple[Drawn, ...]) -> str:
    """Of what a file holds, so that it is not written again."""
    held = ((p.name, p.labels, p.image, [s.plain() for s in p.shapes]) for p in parts)
    return content_hash(*(each for part in held for each in part))
