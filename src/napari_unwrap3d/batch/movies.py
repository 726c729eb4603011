"""What is made of an unwrapped movie: its protrusions, its tracks, and what is measured of them.

All of it is made from the movie's folder with the parameters in it, by what the commands
``track`` and ``measure`` call, so that it does not matter which of them has made it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..analyses import Wanted, measured, tracked
from ..charts import Tracks
from ..files.atomic import write_json
from ..files.export import remove_entries
from ..files.measured import PROVENANCE, entry_names, write_measured
from ..files.movie_annotations import drawn_key
from ..motion.movie import Movie
from ..progress import silent
from ..provenance import content_hash
from ..tracking.detections import has_protrusions, is_automatic, is_told, same_for_all
from ..tracking.objects import tracks_key
from ..tracking.relations import EDITED
from .cells import RECORD, record_of
from .jobs import PROTRUSIONS, Further, Job

VERSION = 1
Made = tuple[bool, dict[str, Any]]


def make(stage: Further, movie: Movie, timepoint: int, job: Job) -> Made:
    """Do one piece of work on a movie whose frames are there.

    Returns
    -------
    bool
        Whether something was done: False where it was there already.
    dict
        What was measured.

    Raises
    ------
    Unwrap3DError
        It could not be done.
    """
    if stage == "protrusions":
        return find_protrusions(movie, timepoint)
    makers: dict[str, Callable[[Movie, Job], Made]] = {
        "alike": find_alike,
        "tracks": make_tracks,
        "measurements": make_measurements,
    }
    return makers[stage](movie, job)


def find_alike(movie: Movie, job: Job) -> Made:
    """What the protrusions of all timepoints have in common."""
    if not is_automatic(movie.parameters) or is_told(movie, movie.parameters):
        return False, {}
    same_for_all(movie, movie.parameters)
    return True, {}


def find_protrusions(movie: Movie, timepoint: int) -> Made:
    """The protrusions of a timepoint."""
    alike = same_for_all(movie, movie.parameters)
    there = has_protrusions(movie, timepoint, alike)
    if not there:
        movie.protrusions(timepoint, alike)
    return not there, movie.folder.numbers("protrusions", timepoint)


def make_tracks(movie: Movie, job: Job) -> Made:
    """The tracks that are measured, unless a person has edited them."""
    name, parameters = movie.parameters.measurement.tracks, movie.parameters
    before = movie.folder.tracks(name)
    key = movie.folder.tracks_key(name)
    if before is not None and (before.method == EDITED or _hold(movie, name, key)):
        return False, _counted(before)
    tracks = tracked(movie, name, parameters, silent())
    # Regions look themselves whether they are there.
    return before is None or key != movie.folder.tracks_key(name), _counted(tracks)


def _hold(movie: Movie, name: str, key: str | None) -> bool:
    """Whether tracks of protrusions are of the movie as it is."""
    if name != PROTRUSIONS:
        return False
    return tracks_key(movie, same_for_all(movie, movie.parameters)) == key


def make_measurements(movie: Movie, job: Job) -> Made:
    """What is measured of the tracks, as tables and a report in a folder of their own."""
    folder = Path(job.measured_folder)
    record = record_of(folder)
    if record.get("key") == _measured_key(movie, job) and (folder / PROVENANCE).is_file():
        return False, dict(record["numbers"])
    found = measured(movie, [Wanted(movie.parameters)], silent())
    # Until the record is there anew, the files are not all of one run.
    (folder / RECORD).unlink(missing_ok=True)
    remove_entries(folder, record.get("names", ()))
    write_measured(
        movie,
        found,
        folder,
        table_suffix=job.exports.chosen_formats().tables[0],
        report=job.exports.pictures,
    )
    numbers = _counted(found[0].tracks)
    # Protrusions that were not there may have been found on the way.
    key, names = _measured_key(movie, job), entry_names(found)
    write_json(folder / RECORD, {"key": key, "numbers": numbers, "names": names})
    return True, numbers


def _measured_key(movie: Movie, job: Job) -> str:
    """What measurements depend on: frames, protrusions, tracks, annotations and parameters."""
    folder, name = movie.folder, movie.parameters.measurement.tracks
    frames = [folder.frame_key(timepoint) for timepoint in range(len(movie))]
    kept = folder.tracks(name)
    return content_hash(
        VERSION,
        frames,
        [folder.protrusions_key(timepoint) for timepoint in range(len(movie))],
        () if kept is None else _content(kept),
        movie.parameters.to_toml(),
        drawn_key(movie.common.annotations.state()),
        job.exports.model_dump_json(),
    )


def _content(tracks: Tracks) -> str:
    columns = [part for name, column in tracks.columns.items() for part in (name, _plain(column))]
    return content_hash(*columns, tracks.splits, tracks.merges, tracks.method)


def _plain(column: Any) -> Any:
    return column.tolist() if column.dtype.kind == "O" else column


def _counted(tracks: Tracks) -> dict[str, Any]:
    return {"tracks": len(tracks.ids)}
