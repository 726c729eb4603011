"""Velocities on the surface and along a plane, and what a field of them does.

Paper, Results, "Ruffles are driven by …": optical flow gives the speed along the surface; its
component along the flat bottom of the cell is found by projection on the plane that is fitted to
the annotated bottom.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Tracks
from ..errors import AxesError, InputError
from ..geometry.laplacian import vertex_mass
from ..geometry.padding import pad_sphere
from ..progress import Progress, silent
from ..unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction
from .optical_flow import tangents_at
from .places import height_at, on_surface

if TYPE_CHECKING:
    from ..motion.movie import Movie

VELOCITY = ("velocity_z_um_per_min", "velocity_y_um_per_min", "velocity_x_um_per_min")
SPEED, LATERAL = "speed_um_per_min", "lateral_speed_um_per_min"
SECONDS = 60.0
# A step along the surface is the chain of so many pieces.
PIECES = 3


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in the common world.

    Attributes
    ----------
    point, normal : ndarray, (3,)
        (z, y, x) in µm; a unit vector, out of the cell.
    distance_um : float
        Root of the mean squared distance of what it was fitted to.
    """

    point: Floats
    normal: Floats
    distance_um: float

    def along(self, vectors: Floats) -> Floats:
        """The components (n, 3) of vectors (n, 3) that lie in the plane."""
        projected: Floats = vectors - np.outer(vectors @ self.normal, self.normal)
        return projected


def fit_plane(points: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Plane:
    """The plane with the least squared distances to points.

    Parameters
    ----------
    points : array-like, (n, 3)
    weights : array-like, (n,), optional

    Raises
    ------
    InputError
        The points do not span a plane.
    """
    places = np.asarray(points, np.float64)
    weight = np.ones(len(places)) if weights is None else np.asarray(weights, np.float64)
    if places.ndim != 2 or places.shape[1:] != (3,) or weight.shape != places.shape[:1]:
        raise AxesError(
            "A plane is fitted to points (n, 3) with a weight each.",
            points=places.shape,
            weights=weight.shape,
        )
    if len(places) < 3 or not weight.sum() > 0:
        raise InputError("A plane needs at least three points.", points=len(places))
    share = weight / weight.sum()
    middle = share @ places
    apart = places - middle
    spread, axes = np.linalg.eigh((apart * share[:, None]).T @ apart)
    if spread[1] <= 1e-12 * max(spread[2], np.finfo(float).tiny):
        raise InputError("The points lie on a line: no plane can be fitted to them.")
    return Plane(middle, axes[:, 0], float(np.sqrt(max(spread[0], 0.0))))


def annotated_plane(movie: Movie, annotation: str, label: int | None = None) -> Plane:
    """The plane of an annotated part of the common surface, such as the bottom of a cell.

    Parameters
    ----------
    movie : Movie
    annotation : str
        By its name in ``movie.common.annotations``.
    label : int, optional
        Any unless given.

    Raises
    ------
    InputError
        There is no such annotation, or too little of the surface is marked.
    """
    drawn = movie.common.annotations
    if annotation not in drawn.names:
        raise InputError(
            f"The movie has no annotation {annotation!r}.",
            hint=f"Annotations: {', '.join(drawn.names) or 'none'}.",
        )
    labels = np.asarray(drawn.labels(annotation))
    marked = labels > 0 if label is None else labels == label
    cell = movie.common.surface
    area = vertex_mass(cell.vertices, cell.faces)
    plane = fit_plane(cell.vertices[marked], area[marked])
    inside = (area @ cell.vertices) / area.sum() - plane.point
    outwards = plane.normal if inside @ plane.normal < 0 else -plane.normal
    return Plane(plane.point, outwards, plane.distance_um)


def with_lateral(tracks: Tracks, plane: Plane) -> Tracks:
    """Tracks with the part of their speed along a plane, ``lateral_speed_um_per_min``.

    Raises
    ------
    InputError
        The tracks have no velocities.
    """
    missing = [name for name in VELOCITY if name not in tracks.columns]
    if missing:
        raise InputError(
            "These tracks have no velocities.",
            missing=missing,
            hint="Those of track_flow have; with_velocities() gives them to others.",
        )
    velocity = np.column_stack([tracks.columns[name] for name in VELOCITY])
    speed = np.linalg.norm(plane.along(velocity), axis=1)
    numbers = {
        "plane_point_um": plane.point.tolist(),
        "plane_normal": plane.normal.tolist(),
        "plane_distance_um": plane.distance_um,
    }
    added = tracks.with_columns(**{LATERAL: speed})
    return replace(added, numbers={**tracks.numbers, **numbers})


# Steps along the surface -----------------------------------------------------------


def steps_between(
    movie: Movie, heights: tuple[Floats, Floats], starts: Floats, ends: Floats
) -> tuple[Floats, Floats]:
    """Steps (n, 3) in µm along the surface from a timepoint to the next, and their lengths (n,).

    A step is taken along the surface of either timepoint, and the mean of both counts: so the
    surface's own way in and out, which is no motion along it, is left out.

    Parameters
    ----------
    movie : Movie
    heights : two of ndarray, (N, 2N)
        d of the surface at the two timepoints.
    starts, ends : ndarray, (n, 3)
        Directions on the unit sphere (turned frame).
    """
    rows = heights[0].shape[0]
    part = np.linspace(0, 1, PIECES + 1)[:, None, None]
    ways = (1 - part) * starts + part * ends
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    places = direction_to_uv(ways.reshape(-1, 3), rows)
    points = np.mean([on_surface(movie, height, places) for height in heights], axis=0)
    pieces = np.diff(points.reshape(PIECES + 1, -1, 3), axis=0)
    return pieces.sum(axis=0), np.linalg.norm(pieces, axis=2).sum(axis=0)


def with_velocities(movie: Movie, tracks: Tracks, progress: Progress | None = None) -> Tracks:
    """Tracks with their velocity along the surface.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks
        With ``v_px`` and ``u_px``.
    progress : Progress, optional

    Returns
    -------
    Tracks
        With ``velocity_z_um_per_min``, ``velocity_y_um_per_min``, ``velocity_x_um_per_min`` and
        ``speed_um_per_min``, the length of the way along the surface over time: over the steps
        before and after each timepoint, or the one that there is; NaN of tracks of one timepoint.
    """
    progress = progress or silent()
    step, length = np.full((len(tracks), 3), np.nan), np.full(len(tracks), np.nan)
    directions = uv_to_direction(tracks.place_px, movie.common.uv.shape[0])
    follows = np.flatnonzero(tracks.track_id[1:] == tracks.track_id[:-1])
    first, second = tracks.timepoint[follows], tracks.timepoint[follows + 1]
    pairs = np.unique(np.column_stack([first, second]), axis=0)
    for number, (before, after) in enumerate(pairs.tolist()):
        progress(number / len(pairs), f"timepoint {before}")
        rows = follows[(first == before) & (second == after)]
        heights = height_at(movie, before), height_at(movie, after)
        found = steps_between(movie, heights, directions[rows], directions[rows + 1])
        minutes = (after - before) * movie.time_step_s / SECONDS
        step[rows], length[rows] = (each / minutes for each in found)
    velocity, speed = (_centred(values, follows) for values in (step, length))
    return tracks.with_columns(**dict(zip(VELOCITY, velocity.T, strict=True)), **{SPEED: speed})


def _centred(ahead: Floats, follows: Ints) -> Floats:
    """Of values of the step after each row, the mean of the steps before and after it."""
    behind = np.full_like(ahead, np.nan)
    behind[follows + 1] = ahead[follows]
    both = np.isfinite(ahead) & np.isfinite(behind)
    either = np.where(np.isfinite(ahead), ahead, behind)
    centred: Floats = np.where(both, (ahead + behind) / 2, either)
    return centred


# Fields ----------------------------------------------------------------------------


def divergence(displacement: Floats, area_um2: npt.ArrayLike) -> Floats:
    """How fast a flow on the surface spreads: the rate of change of an area that goes with it.

    With ρ the area of the surface over that of the sphere, div = ∇ · (ρ w) / ρ of the flow w on
    the sphere.

    Parameters
    ----------
    displacement : ndarray, (N, 2N, 3)
        Tangents of the unit sphere, such as those of :meth:`SphereFlow.between`.
    area_um2 : array-like, (N, 2N)
        Area of the surface over each pixel.

    Returns
    -------
    ndarray, (N, 2N)
        Per time of the displacement; NaN where the area is not known.
    """
    rows = displacement.shape[0]
    inclination = (np.arange(rows) + 0.5) * np.pi / rows
    sine = np.sin(inclination)[:, None]
    south, east = tangents_at(pixel_grid(rows).reshape(-1, 2), rows, (rows, 2 * rows))
    density = np.asarray(area_um2, np.float64) / sine
    carried = pad_sphere(density[..., None] * displacement, 1)
    along_v = (carried[2:, 1:-1] - carried[:-2, 1:-1]) / 2
    along_u = (carried[1:-1, 2:] - carried[1:-1, :-2]) / 2 / sine
    spread = np.einsum("ijk,ijk->ij", along_v, south) + np.einsum("ijk,ijk->ij", along_u, east)
    found: Floats = spread * rows / np.pi / np.where(density > 0, density, np.nan)
    return found


def direction_deg(displacement: Floats) -> Floats:
    """Direction (N, 2N) of a flow (N, 2N, 3) on the uv image: 0 along u, 90 towards the north."""
    rows = displacement.shape[0]
    south, east = tangents_at(pixel_grid(rows).reshape(-1, 2), rows, (rows, 2 * rows))
    along = [np.einsum("ijk,ijk->ij", displacement, axis) for axis in (east, south)]
    found: Floats = np.degrees(np.arctan2(-along[1], along[0]))
    return found
