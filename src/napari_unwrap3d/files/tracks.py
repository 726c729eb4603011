"""Tracks from and to files: GEFF, CSV, Parquet and TrackMate's XML, by the suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..charts import Tracks
from ..errors import FileFormatError, InputError
from . import tracks_geff, tracks_tables, tracks_trackmate
from .track_record import Said

if TYPE_CHECKING:
    from ..motion.movie import Movie

Function = TypeVar("Function", bound=Callable[..., object])

WRITERS: dict[str, Callable[..., Path]] = {
    **dict.fromkeys(tracks_geff.SUFFIXES, tracks_geff.write_geff),
    **dict.fromkeys(tracks_tables.SUFFIXES, tracks_tables.write_track_table),
    **dict.fromkeys(tracks_trackmate.SUFFIXES, tracks_trackmate.write_trackmate),
}
READERS: dict[str, Callable[..., Tracks]] = {
    **dict.fromkeys(tracks_geff.SUFFIXES, tracks_geff.read_geff),
    ".zarr": tracks_geff.read_geff,
    **dict.fromkeys(tracks_tables.SUFFIXES, tracks_tables.read_track_table),
    **dict.fromkeys(tracks_trackmate.SUFFIXES, tracks_trackmate.read_trackmate),
}
# Formats of tracks, as they are shown: what a file dialog offers.
FORMATS = {
    "GEFF": ".geff",
    "CSV": ".csv",
    "Parquet": ".parquet",
    "TrackMate": ".xml",
}


def check_format(path: str | Path) -> None:
    """Raise :class:`FileFormatError` where tracks cannot be written to such a file."""
    _chosen(WRITERS, path)


def write_tracks(
    path: str | Path, tracks: Tracks, movie: Movie | None = None, *, name: str = ""
) -> Path:
    """Write tracks: ``*.geff``, ``*.csv``, ``*.parquet`` or ``*.xml`` (TrackMate).

    With every format goes where the tracks come from: versions, parameters, and the numbers of
    how they were made. The file takes the place of an earlier one when it is complete.

    Parameters
    ----------
    path : path
        A CSV comes with a JSON of its name, which holds what is in no row.
    tracks : Tracks
    movie : Movie, optional
        That they are of: its name, its parameters and the size of its image are written.
    name : str
        Of the tracks in the movie.

    Returns
    -------
    Path

    Raises
    ------
    FileFormatError
        The suffix is of no format of tracks.
    InputError
        A row has no place in space (TrackMate), or Parquet needs pyarrow.
    """
    return _chosen(WRITERS, path)(path, tracks, movie, name)


def read_tracks(
    path: str | Path,
    *,
    voxel_size: tuple[float, float, float] | None = None,
    time_step: float | None = None,
    timepoints: int | None = None,
) -> Tracks:
    """Read tracks from GEFF, CSV, Parquet or TrackMate's XML, ours and those of other programs.

    What :func:`write_tracks` wrote comes back as it was. Tracks that were made elsewhere are
    paths of the graph that they are in; :func:`~napari_unwrap3d.tracking.laying.lay` lays them
    on the surface of a movie.

    Parameters
    ----------
    path : path
    voxel_size : tuple of float, optional
        µm per unit along z, y, x, where the file has places in pixels or does not tell.
    time_step : float, optional
        Seconds between two timepoints, where the file does not tell.
    timepoints : int, optional
        Of the movie; unless given, those of the file's image, or up to the last row.

    Raises
    ------
    FileFormatError
        The file is damaged, or of no format of tracks.
    InputError
        There is no such file, or it does not tell the size of a pixel or the time step.
    """
    path = Path(path)
    reader = _chosen(READERS, path)
    if not path.exists():
        raise InputError(f"There is no {str(path)!r}.")
    return reader(path, Said(voxel_size, time_step, timepoints))


def _chosen(known: Mapping[str, Function], path: str | Path) -> Function:
    found = known.get(Path(path).suffix.lower())
    if found is None:
        raise FileFormatError(
            f"{Path(path).name!r} is of no format of tracks.", hint=f"Known: {', '.join(known)}."
        )
    return found
