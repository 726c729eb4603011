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
from scipy import stats

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
MODE_STEPS = 1000


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


# Velocities ------------------------------------------------------------------------


def normals_at(movie: Movie, height: Floats, places: Floats) -> Floats:
    """Unit normals (n, 3) of what lies outermost over places (n, 2) (v, u) in pixels.

    From the positions a pixel to either side; which side is out does not matter here.
    """
    rows = height.shape[0]
    south, east = tangents_at(places, rows, (len(places),))
    here = uv_to_direction(places, rows)
    around = [here + sign * np.pi / rows * axis for axis in (south, east) for sign in (1, -1)]
    unit = np.concatenate(around)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    points = on_surface(movie, height, direction_to_uv(unit, rows)).reshape(4, -1, 3)
    across = np.cross(points[0] - points[1], points[2] - points[3])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    normals: Floats = across / np.maximum(length, np.finfo(float).tiny)
    return normals


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
        With the velocity of their places on the surface in space, ``velocity_z_um_per_min``,
        ``velocity_y_um_per_min`` and ``velocity_x_um_per_min``: between the timepoints before
        and after, or the one that there is; NaN of tracks of one timepoint. And with
        ``speed_um_per_min``, the part of it along the surface: the surface's own way in and out
        is no motion on it.
    """
    progress = progress or silent()
    rows = np.arange(len(tracks))
    same = tracks.track_id[1:] == tracks.track_id[:-1]
    before, after = rows.copy(), rows.copy()
    before[1:][same] -= 1
    after[:-1][same] += 1
    minutes = (tracks.timepoint[after] - tracks.timepoint[before]) * movie.time_step_s / SECONDS
    step = tracks.position_um[after] - tracks.position_um[before]
    velocity = step / np.where(minutes > 0, minutes, np.nan)[:, None]
    along = np.full(len(tracks), np.nan)
    times = np.unique(tracks.timepoint)
    for number, time in enumerate(times.tolist()):
        progress(number / len(times), f"timepoint {time}")
        here = tracks.timepoint == time
        normals = normals_at(movie, _known_height(movie, time), tracks.place_px[here])
        outwards = np.einsum("ni,ni->n", velocity[here], normals)
        along[here] = np.linalg.norm(velocity[here] - outwards[:, None] * normals, axis=1)
    return tracks.with_columns(**dict(zip(VELOCITY, velocity.T, strict=True)), **{SPEED: along})


def _known_height(movie: Movie, timepoint: int) -> Floats:
    """The height at a timepoint, or, of one that was lost, at the nearest that there is."""
    made = [t for t in range(len(movie)) if not movie.is_lost(t)]
    return height_at(movie, min(made, key=lambda t: (abs(t - timepoint), t)))


# Populations -----------------------------------------------------------------------


def median_velocities(
    tracks: Tracks, rows: npt.ArrayLike | None = None, least_timepoints: int = 1
) -> tuple[Ints, Floats]:
    """The median velocity of every track, so that single wrong steps do not count.

    Parameters
    ----------
    tracks : Tracks
        With velocities.
    rows : array-like, (n,) bool, optional
        Those that count, such as where the track is on a ruffle; all unless given.
    least_timepoints : int
        Tracks with fewer such rows are left out.

    Returns
    -------
    ids : ndarray, (k,)
    velocity : ndarray, (k, 3)
        (z, y, x) in µm per minute, the median of each component.
    """
    velocity = np.column_stack([tracks.columns[name] for name in VELOCITY])
    counted = np.isfinite(velocity).all(axis=1)
    if rows is not None:
        counted &= np.asarray(rows, bool)
    ids, start, count = np.unique(tracks.track_id[counted], return_index=True, return_counts=True)
    kept = count >= least_timepoints
    parts = np.split(velocity[counted], start[1:]) if len(ids) else []
    medians = [np.median(part, axis=0) for part, keep in zip(parts, kept, strict=True) if keep]
    return ids[kept], np.array(medians, np.float64).reshape(-1, 3)


def most_frequent(values: npt.ArrayLike, bandwidth: float | None = None) -> float:
    """The mode of a distribution: where its Gaussian kernel density is largest.

    Of speeds it is that of what moves alike, whatever else moves faster here and there.

    Parameters
    ----------
    values : array-like
        Those that are not finite do not count.
    bandwidth : float, optional
        Standard deviation of the kernel, in the values' unit; by Scott's rule unless given.

    Raises
    ------
    InputError
        There are less than two different finite values.
    """
    known = np.asarray(values, np.float64)
    known = known[np.isfinite(known)]
    if len(np.unique(known)) < 2:
        raise InputError("A mode needs different values.", values=len(known))
    low, high = np.percentile(known, [0.5, 99.5])
    inner = known[(known >= low) & (known <= high)]
    grid = np.linspace(low, high, MODE_STEPS)
    factor = None if bandwidth is None else bandwidth / float(inner.std(ddof=1))
    return float(grid[int(np.argmax(stats.gaussian_kde(inner, factor)(grid)))])


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
    along_u = (carried[1:-1, 2:] - carried[1:-1, :-2]) / 2 / sine[..., None]
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
