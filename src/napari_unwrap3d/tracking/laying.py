"""Laying points on the surface of a movie's timepoints: from space to (v, u), and back."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Frame, Tracks
from ..charts.tracks import PLACE, SPACE
from ..errors import ParameterError
from ..geometry.locate import SurfaceLocator, interpolate
from ..geometry.padding import sample_uv_nearest
from ..motion.frames import HEIGHT
from ..progress import Progress, silent
from ..unwrapping.topography import topography_to_world
from ..unwrapping.uv import direction_to_uv, uv_to_direction

if TYPE_CHECKING:
    from ..motion.movie import Movie

DISTANCE = "off_surface_um"
Onto = Literal["surface", "common"]


def lay_tracks(
    movie: Movie,
    tracks: Tracks,
    *,
    onto: Onto = "surface",
    farthest_um: float | None = None,
    snap: bool = False,
    progress: Progress | None = None,
) -> Tracks:
    """Lay tracks that were made elsewhere on the unwrapped surface of a movie.

    Every point gets the (v, u) of the nearest place of its timepoint's surface (where that has
    left the shell, of the common reference), and ``off_surface_um``, how far it is from it. Points
    of which only the (v, u) are known get their place in space: where the surface lies outermost
    over them.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks
        In the common world of the movie: where it was registered, so must the tracks be.
    onto : {"surface", "common"}
        The surface of every timepoint, or the common reference surface (also where a timepoint
        of the movie could not be made).
    farthest_um : float, optional
        Points that are farther away have no (v, u); any unless given.
    snap : bool
        Whether the points move to the surface in space, too.
    progress : Progress, optional

    Raises
    ------
    ParameterError
        The movie has fewer timepoints than the tracks, or another time step.
    """
    report = progress or silent()
    _check(movie, tracks, onto)
    place, position = tracks.place_px, tracks.position_um
    distance = np.full(len(tracks), np.nan)
    given = np.isfinite(position).all(axis=1)
    place[given] = np.nan
    times = np.unique(tracks.timepoint)
    for done, timepoint in enumerate(times.tolist()):
        report(done / len(times), f"timepoint {timepoint}")
        here = tracks.timepoint == timepoint
        on = "common" if movie.is_lost(timepoint) else onto
        above = np.flatnonzero(here & ~given & np.isfinite(place).all(axis=1))
        if len(above):
            position[above] = _over(movie, timepoint, place[above], on)
            distance[above] = 0.0
        rows = np.flatnonzero(here & given)
        if len(rows) == 0:
            continue
        found, nearest, away = _nearest(movie, timepoint, position[rows], on)
        near = np.ones(len(rows), bool) if farthest_um is None else away <= farthest_um
        place[rows[near]] = found[near]
        distance[rows] = away
        if snap:
            position[rows[near]] = nearest[near]
    report(1.0, "laid on the surface")
    columns = dict(zip((*SPACE, *PLACE), np.column_stack([position, place]).T, strict=True))
    columns[DISTANCE] = distance
    numbers = {"laid_onto": onto, "farthest_um": farthest_um, "snapped": snap}
    numbers |= {
        "off_surface_um_mean": _mean(distance),
        "not_laid": int(np.isnan(place[:, 0]).sum()),
    }
    laid = replace(
        tracks,
        rows=movie.common.uv.shape[0],
        timepoints=len(movie),
        numbers={**tracks.numbers, "laying": numbers},
    )
    return laid.with_columns(**columns)


def place_of(movie: Movie, timepoint: int, points: npt.ArrayLike) -> tuple[Floats, Floats]:
    """(v, u) of the nearest places on the surface of a timepoint, and how far they are.

    Parameters
    ----------
    movie : Movie
    timepoint : int
    points : array-like, (n, 3)
        z, y, x in µm in the common world.

    Returns
    -------
    place : ndarray, (n, 2)
    distance_um : ndarray, (n,)
    """
    place, _, away = _nearest(movie, timepoint, np.asarray(points, np.float64), "surface")
    return place, away


def position_of(movie: Movie, timepoint: int, places: npt.ArrayLike) -> Floats:
    """Where the surface of a timepoint lies outermost over (v, u) (n, 2): (n, 3) in µm.

    Where none lies over a pixel, the place on the common reference.
    """
    return _over(movie, timepoint, np.asarray(places, np.float64), "surface")


def _check(movie: Movie, tracks: Tracks, onto: str) -> None:
    last = int(tracks.timepoint.max(initial=-1))
    if last >= len(movie):
        raise ParameterError(
            "The tracks go on after the end of the movie.", last=last, timepoints=len(movie)
        )
    if not np.isclose(tracks.time_step_s, movie.time_step_s, rtol=0.01):
        raise ParameterError(
            "The tracks and the movie have different time steps.",
            tracks_s=tracks.time_step_s,
            movie_s=movie.time_step_s,
            hint="Read them with the time step of the movie, if they are of it.",
        )
    if onto not in ("surface", "common"):
        raise ParameterError(f"Tracks cannot be laid onto {onto!r}.", hint="surface or common.")


def _over(movie: Movie, timepoint: int, vu: Floats, onto: Onto) -> Floats:
    """Places (n, 3) in µm over (v, u): on the surface, or on the common reference."""
    reference, _ = movie.common.map(vu, "uv", "reference")
    if onto == "common":
        return reference
    height = sample_uv_nearest(movie.frame(timepoint).uv[HEIGHT], vu).astype(np.float64)
    known = np.isfinite(height)
    dvu = np.column_stack([np.where(known, height, 0.0), vu])
    world, valid = topography_to_world(movie.common.topography, dvu)
    position: Floats = np.where((known & valid)[:, None], world, reference)
    return position


def _nearest(
    movie: Movie, timepoint: int, points: Floats, onto: Onto
) -> tuple[Floats, Floats, Floats]:
    """(v, u), the place in space, and the distance of the nearest places."""
    rows = movie.common.uv.shape[0]
    if onto == "common":
        return _on_reference(movie, points)
    frame = movie.frame(timepoint)
    place, nearest, away = _on_surface(frame, points, rows)
    lost = ~np.isfinite(place).all(axis=1)
    if lost.any():
        place[lost] = _on_reference(movie, nearest[lost])[0]
    return place, nearest, away


def _on_surface(frame: Frame, points: Floats, rows: int) -> tuple[Floats, Floats, Floats]:
    surface = frame.surface
    face, weights, away = SurfaceLocator(surface.vertices, surface.faces).closest(points)
    nearest = interpolate(surface.vertices, surface.faces, face, weights)
    # Directions, not (v, u): between them there is neither seam nor pole.
    corners = frame.topography[surface.faces[face], 1:]
    directions = uv_to_direction(corners.reshape(-1, 2), rows).reshape(-1, 3, 3)
    mean = np.einsum("ij,ijk->ik", weights, directions)
    return direction_to_uv(mean, rows), nearest, away


def _on_reference(movie: Movie, points: Floats) -> tuple[Floats, Floats, Floats]:
    reference = movie.common.reference
    face, weights, away = SurfaceLocator(reference.vertices, reference.faces).closest(points)
    nearest = interpolate(reference.vertices, reference.faces, face, weights)
    place, _ = movie.common.map(nearest, "reference", "uv")
    return place, nearest, away


def _mean(values: Floats) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None
