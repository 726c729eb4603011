"""The folder of a movie while it is made, and the one file that it is saved in.

Every piece of work is one file that appears when it is complete, with the key of what it was
made from: what is there need not be made again, and nothing half-written is taken for done.

Layout::

    movie.json                  format, schema version, parameters (TOML text), times, source
    registration/00012.json     where timepoint 12 lies in the common world
    masks/00012.zip             its mask there
    common.json                 which common space, why, and its key
    common.unwrap3d             the atlas of the common space, with its annotations
    frames/00012.zip            the frame
    annotations/                what was drawn on single timepoints, see :mod:`.movie_annotations`
    frames/00012.unwrap3d       its own atlas, where every timepoint has one
    guides/00012.zip            there, the mesh that tells which place of its surface is which
    protrusions/00012.zip       the protrusions of the timepoint
    protrusions/alike.json      what those of all timepoints have in common: kind, threshold
    tracks/NAME.zip             tracks: "protrusions", "flow", or as they were named
    failures/00012.json         why the timepoint could not be made and is left out
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..charts import Frame, FrameProtrusions, Mask, Surface, Tracks
from ..errors import FileFormatError, InputError
from ..imaging.register import Registered
from ..progress import Progress, silent
from .atomic import replacing, write_json
from .project import MOVIE, SUFFIX, read_record, record_key, record_numbers, write_record

FORMAT = "napari-unwrap3d movie"
SCHEMA_VERSION = 1
COMMON = f"common{SUFFIX}"
COMMON_RECORD = "common.json"
TRACKS = "tracks"
ALIKE = "alike.json"
TRACKS_NAME = re.compile(r"[^\W\d_][\w .-]{0,63}")


@dataclass(frozen=True)
class MovieFolder:
    """Where the pieces of one movie are."""

    path: Path

    # The manifest ------------------------------------------------------------------

    def begin(self, manifest: Mapping[str, Any]) -> None:
        """Write what the movie is of; what was made before stays, and its keys tell what of it
        still holds.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        write_json(
            self.path / MOVIE,
            {"format": FORMAT, "schema_version": SCHEMA_VERSION, **manifest},
        )

    def manifest(self) -> dict[str, Any]:
        """What the movie is of.

        Raises
        ------
        FileFormatError
            The folder is no movie, or of another version.
        """
        found = read_json(self.path / MOVIE)
        if found is None or found.get("format") != FORMAT:
            raise FileFormatError(
                f"{self.path.name!r} is no movie of napari-unwrap3d.",
                hint=f"A movie is a folder with {MOVIE}, made by unwrap_movie or `batch`.",
            )
        if found.get("schema_version") != SCHEMA_VERSION:
            raise FileFormatError(
                f"{self.path.name!r} is of another version.",
                file_schema=found.get("schema_version"),
                known_schema=SCHEMA_VERSION,
                hint="Update napari-unwrap3d, or make the movie anew.",
            )
        return found

    # The pieces --------------------------------------------------------------------

    def registered(self, timepoint: int, key: str | None = None) -> Registered | None:
        """Where a timepoint lies, if that was found, for this key if one is given."""
        found = read_json(self._piece("registration", timepoint, ".json"))
        if found is None or key not in (None, found.get("key")):
            return None
        return Registered.from_plain(found)

    def keep_registered(self, timepoint: int, key: str, registered: Registered) -> None:
        write_json(
            self._piece("registration", timepoint, ".json"), {"key": key, **registered.to_plain()}
        )

    def has_mask(self, timepoint: int, key: str) -> bool:
        return record_key(self._piece("masks", timepoint, ".zip")) == key

    def mask(self, timepoint: int) -> tuple[Mask, dict[str, Any]]:
        """The mask of a timepoint and the report of how it was found."""
        charts, numbers = read_record(self._piece("masks", timepoint, ".zip"))
        return charts["mask"], numbers

    def keep_mask(self, timepoint: int, key: str, mask: Mask, numbers: Mapping[str, Any]) -> None:
        write_record(self._piece("masks", timepoint, ".zip"), {"mask": mask}, key, numbers)

    def common(self) -> dict[str, Any] | None:
        """The record of the common space, if one was made: ``key``, ``method``, ``reason`` …"""
        found = read_json(self.path / COMMON_RECORD)
        return found if (self.path / COMMON).is_file() else None

    def drop_common(self) -> None:
        """Forget the record: while the atlas is replaced, it is of no key."""
        (self.path / COMMON_RECORD).unlink(missing_ok=True)

    def keep_common(self, record: Mapping[str, Any]) -> None:
        """Keep the record; the atlas must be there."""
        write_json(self.path / COMMON_RECORD, record)

    @property
    def common_path(self) -> Path:
        """The atlas of the common space."""
        return self.path / COMMON

    def has_frame(self, timepoint: int, key: str) -> bool:
        return self.frame_key(timepoint) == key

    def frame_key(self, timepoint: int) -> str | None:
        """What the frame of a timepoint was made from; None without one."""
        return record_key(self._piece("frames", timepoint, ".zip"))

    def frame_numbers(self, timepoint: int) -> dict[str, Any]:
        """What was measured of the frame of a timepoint; empty without one."""
        return record_numbers(self._piece("frames", timepoint, ".zip"))

    def frame(self, timepoint: int) -> Frame:
        """The frame of a timepoint."""
        charts, _ = read_record(self._piece("frames", timepoint, ".zip"))
        frame: Frame = charts["frame"]
        return frame

    def keep_frame(self, frame: Frame, key: str) -> None:
        path = self._piece("frames", frame.timepoint, ".zip")
        write_record(path, {"frame": frame}, key, frame.numbers)

    def numbers(self, stage: str, timepoint: int) -> dict[str, Any]:
        """What was measured in a stage of a timepoint; empty where nothing was."""
        kinds = {"segment": "masks", "frame": "frames", "protrusions": "protrusions"}
        kind = kinds.get(stage)
        return record_numbers(self._piece(kind, timepoint, ".zip")) if kind else {}

    def failure(self, timepoint: int) -> dict[str, Any] | None:
        """Why a timepoint could not be made: ``stage`` and ``reason``; None if it could."""
        return read_json(self._piece("failures", timepoint, ".json"))

    def keep_failure(self, timepoint: int, stage: str, reason: str) -> None:
        """Note that a timepoint could not be made: it is left out of the movie, and so is a frame
        of it that was made from something else.
        """
        self._piece("frames", timepoint, ".zip").unlink(missing_ok=True)
        write_json(self._piece("failures", timepoint, ".json"), {"stage": stage, "reason": reason})

    def drop_failure(self, timepoint: int) -> None:
        self._piece("failures", timepoint, ".json").unlink(missing_ok=True)

    def atlas_path(self, timepoint: int) -> Path:
        """The own atlas of a timepoint (common space "each")."""
        return self._piece("frames", timepoint, SUFFIX)

    def guide(self, timepoint: int, key: str) -> Surface | None:
        """The mesh that tells which place of a timepoint is which, if it is of this key."""
        path = self._piece("guides", timepoint, ".zip")
        if record_key(path) != key:
            return None
        guide: Surface = read_record(path)[0]["guide"]
        return guide

    def keep_guide(self, timepoint: int, key: str, guide: Surface) -> None:
        write_record(self._piece("guides", timepoint, ".zip"), {"guide": guide}, key, {})

    # Protrusions and tracks --------------------------------------------------------

    def protrusions(self, timepoint: int, key: str | None = None) -> FrameProtrusions | None:
        """The protrusions of a timepoint, if they are there, for this key if one is given."""
        path = self._piece("protrusions", timepoint, ".zip")
        found = record_key(path)
        if found is None or key not in (None, found):
            return None
        protrusions: FrameProtrusions = read_record(path)[0]["protrusions"]
        return protrusions

    def has_protrusions(self, timepoint: int, key: str) -> bool:
        return self.protrusions_key(timepoint) == key

    def protrusions_key(self, timepoint: int) -> str | None:
        """What the protrusions of a timepoint were made from; None without any."""
        return record_key(self._piece("protrusions", timepoint, ".zip"))

    def keep_protrusions(self, found: FrameProtrusions, key: str) -> None:
        path = self._piece("protrusions", found.timepoint, ".zip")
        write_record(path, {"protrusions": found}, key, found.numbers)

    def alike(self, key: str) -> dict[str, Any] | None:
        """What the protrusions of all timepoints have in common, if it is of this key."""
        found = read_json(self.path / "protrusions" / ALIKE)
        return found["told"] if found is not None and found.get("key") == key else None

    def keep_alike(self, key: str, told: Mapping[str, Any]) -> None:
        (self.path / "protrusions").mkdir(exist_ok=True)
        write_json(self.path / "protrusions" / ALIKE, {"key": key, "told": dict(told)})

    def track_names(self) -> list[str]:
        """The names under which tracks were kept."""
        return sorted(path.stem for path in (self.path / TRACKS).glob("*.zip"))

    def tracks(self, name: str) -> Tracks | None:
        """Tracks by their name, None without any."""
        path = self._tracks(name)
        if record_key(path) is None:
            return None
        tracks: Tracks = read_record(path)[0]["tracks"]
        return tracks

    def tracks_key(self, name: str) -> str | None:
        """What tracks were made from; None without any."""
        return record_key(self._tracks(name))

    def keep_tracks(self, name: str, tracks: Tracks, key: str) -> None:
        write_record(self._tracks(name), {"tracks": tracks}, key, tracks.numbers)

    def drop_tracks(self, name: str) -> None:
        self._tracks(name).unlink(missing_ok=True)

    def _tracks(self, name: str) -> Path:
        if not TRACKS_NAME.fullmatch(name):
            raise InputError(
                f"Tracks cannot be named {name!r}.",
                hint="Use letters, digits, spaces, dots, - and _, and begin with a letter.",
            )
        return self.path / TRACKS / f"{name}.zip"

    def _piece(self, kind: str, timepoint: int, suffix: str) -> Path:
        return self.path / kind / f"{timepoint:05d}{suffix}"

    # One file ----------------------------------------------------------------------

    def pack(self, target: Path, progress: Progress | None = None) -> Path:
        """Everything in one ``*.unwrap3d`` file, which :func:`unpack` opens."""
        report = progress if progress is not None else silent()
        target = target if target.suffix == SUFFIX else target.with_name(target.name + SUFFIX)
        self.manifest()
        with replacing(target) as partial, zipfile.ZipFile(partial, "w") as archive:
            entries = [entry for entry in sorted(self.path.rglob("*")) if entry.is_file()]
            for index, entry in enumerate(entries):
                name = entry.relative_to(self.path)
                report(index / len(entries), f"writing {name.as_posix()}")
                if not any(part.startswith(".") for part in name.parts):
                    archive.write(entry, name.as_posix())
        report(1.0, "saved")
        return target


def is_movie(path: str | Path) -> bool:
    """Whether a folder or a file is a movie."""
    path = Path(path)
    if path.is_dir():
        return (path / MOVIE).is_file()
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return MOVIE in archive.namelist()


def read_movie_summary(path: str | Path) -> dict[str, Any]:
    """What a movie is of, without opening it.

    Parameters
    ----------
    path : path
        Its folder, or the one file it was saved in.

    Returns
    -------
    dict
        The manifest, and ``common`` (the record of the common space, or None) and ``frames``
        (how many were made).
    """
    path = Path(path)
    if path.is_dir():
        folder = MovieFolder(path)
        frames = len(list((path / "frames").glob("*.zip")))
        return {**folder.manifest(), "common": folder.common(), "frames": frames}
    with tempfile.TemporaryDirectory() as name, zipfile.ZipFile(path) as archive:
        names = set(archive.namelist())
        for entry in {MOVIE, COMMON_RECORD} & names:
            archive.extract(entry, name)
        manifest = MovieFolder(Path(name)).manifest()
        common = read_json(Path(name) / COMMON_RECORD)
    frames = sum(each.startswith("frames/") and each.endswith(".zip") for each in names)
    return {**manifest, "common": common, "frames": frames}


def unpack(source: Path, folder: Path) -> MovieFolder:
    """The folder of a movie that was saved in one file.

    Raises
    ------
    InputError
        The file is no movie.
    FileFormatError
        It is damaged, or names a place outside of the folder.
    """
    if not is_movie(source):
        raise InputError(f"{source.name!r} is no movie.", hint="load() opens single cells.")
    try:
        with zipfile.ZipFile(source) as archive:
            root = folder.resolve()
            for item in archive.infolist():
                target = (folder / item.filename).resolve()
                if not target.is_relative_to(root) or item.is_dir():
                    raise FileFormatError(
                        f"{source.name!r} names a place that it must not.", entry=item.filename
                    )
                target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(item) as stream, target.open("wb") as file:
                    shutil.copyfileobj(stream, file, 1 << 20)
    except zipfile.BadZipFile as error:
        raise FileFormatError(f"{source.name!r} is damaged ({error}).") from error
    return MovieFolder(folder)


def read_json(path: Path) -> dict[str, Any] | None:
    """What a file holds; None where there is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{path.name!r} cannot be read ({error}).") from error
    return found if isinstance(found, dict) else None
