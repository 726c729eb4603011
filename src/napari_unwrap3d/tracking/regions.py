"""Regions of the surface that are carried by the optical flow of a field.

Paper, Methods, "Optical flow ROI tracking": the image is divided into regions, and each is moved
by the median flow within it; where regions thin out new ones begin (dense tracking of motion
sensing superpixels, Zhou et al. 2019, doi:10.7554/eLife.40162). Here regions are of one size on
the sphere, and so of about one area on the surface, at the poles as everywhere.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import KDTree

from ..charts import Floats, Ints, Tracks
from ..charts.tracks import BOX, PLACE, SPACE, TIMEPOINT, TRACK
from ..parameters import FlowParameters, Parameters
from ..pipeline import ProgressLike
from ..progress import Progress
from ..provenance import content_hash
from ..unwrapping.uv import direction_to_uv, uv_to_direction
from .flows import FieldImages, FlowsOfMovie
from .optical_flow import tangents_at
from .places import height_at, on_surface
from .velocities import SECONDS, annotated_plane, divergence, with_lateral, with_velocities

if TYPE_CHECKING:
    from ..motion.movie import Movie

VERSION = 1
NAME = "flow"
# The median over a region, and its cover, are taken over so many places along each side.
SIDE_SAMPLES = 7


def track_flow(
    movie: Movie, parameters: Parameters | None = None, progress: ProgressLike = None
) -> Tracks:
    """Follow regions of the surface by the optical flow of a field.

    The tracks are kept in the movie's folder under the name "flow"; asked for again with the
    same parameters, they are read from there.

    Parameters
    ----------
    movie : Movie
    parameters : Parameters, optional
        Those of the movie unless given; their group ``flow``.
    progress : Progress, or callable(stage, fraction, message), optional

    Returns
    -------
    Tracks
        Method "flow": with the boxes of the regions and ``side_px`` (their height; to the poles
        they are wider than high, as pixels are), with ``velocity_z_um_per_min``,
        ``velocity_y_um_per_min``, ``velocity_x_um_per_min`` and ``speed_um_per_min`` along the
        surface (:func:`.velocities.with_velocities`), ``direction_deg`` on the uv image (0 along
        u, 90 towards the north), ``divergence_per_min``, how fast the surface spreads there, and,
        where a plane is annotated, ``lateral_speed_um_per_min``.

    Raises
    ------
    InputError
        The movie has no such field or annotation.
    """
    report = progress if isinstance(progress, Progress) else Progress(progress)
    report = report.named("flow")
    chosen = (parameters or movie.parameters).flow
    plane = annotated_plane(movie, chosen.plane) if chosen.plane else None
    times = [t for t in range(len(movie)) if not movie.is_lost(t)]
    key = _key(movie, chosen, times, () if plane is None else (*plane.point, *plane.normal))
    if key is not None and movie.folder.tracks_key(NAME) == key:
        return movie.tracks(NAME)
    moved = _moved(movie, chosen, times, report.part(0.0, 0.7))
    tracks = _tracks(movie, moved, chosen, report.part(0.7, 0.8))
    tracks = with_velocities(movie, tracks, report.part(0.8, 1.0))
    if plane is not None:
        tracks = with_lateral(tracks, plane)
    key = _key(movie, chosen, times, () if plane is None else (*plane.point, *plane.normal))
    movie.keep_tracks(NAME, tracks, key or "")
    report(1.0, "done")
    return tracks


def _key(
    movie: Movie, parameters: FlowParameters, times: list[int], plane: tuple[float, ...]
) -> str | None:
    """What tracks are made from; None where a timepoint is not made yet."""
    frames = [movie.folder.frame_key(t) for t in times if movie.has_frame(t)]
    if len(frames) < len(times):
        return None
    return content_hash(VERSION, NAME, parameters.model_dump_json(), times, frames, repr(plane))


# Regions ---------------------------------------------------------------------------


@dataclass(eq=False)
class Regions:
    """Squares on the unit sphere, whose sides run along u and v.

    Attributes
    ----------
    centres : ndarray, (k, 3)
        Unit vectors.
    ids : ndarray, (k,)
        In the order in which they began.
    side : float
        Angle.
    """

    centres: Floats
    ids: Ints
    side: float

    @classmethod
    def even(cls, count: int) -> Regions:
        """About as many regions of one size, in bands around the axis, over all the sphere."""
        side = np.sqrt(4 * np.pi / count)
        bands = max(round(np.pi / side), 2)
        edges = np.arange(bands + 1) * np.pi / bands
        found = []
        for low, high in itertools.pairwise(edges.tolist()):
            share = 2 * np.pi * (np.cos(low) - np.cos(high))
            places = max(round(share / side**2), 1)
            azimuth = (np.arange(places) + 0.5) * 2 * np.pi / places - np.pi
            middle, ring = (low + high) / 2, np.ones(places)
            sine, cosine = np.sin(middle), np.cos(middle)
            axes = [cosine * ring, sine * np.sin(azimuth), sine * np.cos(azimuth)]
            found.append(np.stack(axes, axis=1))
        centres = np.concatenate(found)
        return cls(centres, np.arange(1, len(centres) + 1), float(side))

    def samples(self, rows: int) -> Floats:
        """Directions (k, s, 3) spread evenly over every region."""
        axis = (np.arange(SIDE_SAMPLES) + 0.5) / SIDE_SAMPLES - 0.5
        offsets = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        south, east = self.tangents(rows)
        steps = offsets[:, :1] * south[:, None] + offsets[:, 1:] * east[:, None]
        return _unit(self.centres[:, None] + self.side * steps)

    def tangents(self, rows: int) -> tuple[Floats, Floats]:
        """Unit vectors (k, 3) along v and u at the centres."""
        return tangents_at(direction_to_uv(self.centres, rows), rows, (len(self.centres),))

    def within(self, image: Floats) -> Floats:
        """Values (k, s, ...) of an image (N, 2N, ...) at the samples of every region."""
        rows = image.shape[0]
        samples = self.samples(rows)
        at = np.rint(direction_to_uv(samples.reshape(-1, 3), rows)).astype(np.int64)
        found: Floats = image[np.clip(at[:, 0], 0, rows - 1), at[:, 1] % (2 * rows)]
        return found.reshape(*samples.shape[:2], *image.shape[2:])

    def carried(self, flow: Floats) -> Regions:
        """Every region moved by the median of a flow (N, 2N, 3) within it."""
        rows = flow.shape[0]
        within = self.within(flow)
        moved = self.centres.copy()
        for axis in self.tangents(rows):
            along = np.median(np.einsum("ksi,ki->ks", within, axis), axis=1)
            moved += along[:, None] * axis
        return Regions(_unit(moved), self.ids, self.side)

    def thinned(self, least: float) -> Regions:
        """Without those that are nearer to an older one than so many sides."""
        if least <= 0:
            return self
        pairs = KDTree(self.centres).query_pairs(least * self.side, output_type="ndarray")
        gone = np.zeros(len(self.ids), bool)
        # From the oldest on: who is gone crowds nobody.
        for first, second in sorted(np.sort(pairs, axis=1).tolist()):
            if not gone[first]:
                gone[second] = True
        return Regions(self.centres[~gone], self.ids[~gone], self.side)

    def filled(self, places: Regions, rows: int, least: float, next_id: int) -> Regions:
        """With a new one at every place of which less than a part is covered."""
        # A disk as large as a region: the cover does not depend on how squares are turned.
        reach = 2 * np.sin(self.side / np.sqrt(np.pi) / 2)
        samples = places.samples(rows)
        apart, _ = KDTree(self.centres).query(samples.reshape(-1, 3))
        covered = (apart.reshape(samples.shape[:2]) <= reach).mean(axis=1)
        new = places.centres[covered < least]
        ids = np.arange(next_id, next_id + len(new))
        return Regions(
            np.concatenate([self.centres, new]), np.concatenate([self.ids, ids]), self.side
        )


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


@dataclass(frozen=True, eq=False)
class Moved:
    """Where regions were: a row per region and timepoint, in the order of time.

    Attributes
    ----------
    ids, timepoint : ndarray, (n,)
    centres : ndarray, (n, 3)
    divergence : ndarray, (n,)
        Of the flow to that timepoint, per minute; NaN at the first one.
    side : float
    numbers : dict
    """

    ids: Ints
    timepoint: Ints
    centres: Floats
    divergence: Floats
    side: float
    numbers: dict[str, Any]


def _moved(movie: Movie, parameters: FlowParameters, times: list[int], progress: Progress) -> Moved:
    images = FieldImages(movie, parameters.field, times, parameters.smoothing_s)
    flows = FlowsOfMovie(
        images,
        times,
        parameters.method,
        parameters.window_um,
        parameters.clipped_percent,
        progress.part(0.0, 0.1),
    )
    places = now = Regions.even(parameters.regions)
    begun = len(now.ids)
    area = np.asarray(movie.common.uv.fields["area_um2"])
    ids, timepoint, centres, spread = [], [], [], []
    before = None
    for number, time in enumerate(times):
        progress(0.1 + 0.9 * number / len(times), f"timepoint {time}")
        flow = flows.to(time)
        minutes = np.nan if before is None else (time - before) * movie.time_step_s / SECONDS
        if number:
            now = now.carried(flow).thinned(parameters.least_distance)
            now = now.filled(places, flows.rows, parameters.coverage, begun + 1)
            begun = max(begun, int(now.ids.max()))
        ids.append(now.ids)
        timepoint.append(np.full(len(now.ids), time))
        centres.append(now.centres)
        spread.append(np.nanmean(now.within(divergence(flow, area)), axis=1) / minutes)
        before = time
    numbers = {
        "field": parameters.field,
        "first_regions": len(places.ids),
        "later_regions": begun - len(places.ids),
        "ended_in_others": begun - len(now.ids),
        "side_um": now.side * _radius_um(movie),
    }
    return Moved(
        np.concatenate(ids),
        np.concatenate(timepoint),
        np.concatenate(centres),
        np.concatenate(spread),
        now.side,
        numbers,
    )


def _radius_um(movie: Movie) -> float:
    """Of the sphere that is as large as the common reference surface."""
    area = float(np.asarray(movie.common.uv.fields["area_um2"]).sum())
    return float(np.sqrt(area / (4 * np.pi)))


# Tracks ----------------------------------------------------------------------------


def _tracks(movie: Movie, moved: Moved, parameters: FlowParameters, progress: Progress) -> Tracks:
    rows = movie.common.uv.shape[0]
    moved = _lasting(moved, parameters.least_lifetime_s, movie.time_step_s)
    places = direction_to_uv(moved.centres, rows)
    points = np.full((len(places), 3), np.nan)
    times = np.unique(moved.timepoint)
    for number, time in enumerate(times.tolist()):
        progress(number / len(times), f"timepoint {time}")
        here = moved.timepoint == time
        points[here] = on_surface(movie, height_at(movie, time), places[here])
    side = moved.side * rows / np.pi
    height = np.full(len(places), side)
    width = np.minimum(side / np.sin((places[:, 0] + 0.5) * np.pi / rows), 2.0 * rows)
    half, middle = np.column_stack([height, width]) / 2, places + 0.5
    columns = {
        TRACK: moved.ids,
        TIMEPOINT: moved.timepoint,
        **dict(zip(SPACE, points.T, strict=True)),
        **dict(zip(PLACE, places.T, strict=True)),
        **dict(zip(BOX, np.column_stack([middle - half, middle + half]).T, strict=True)),
        "side_px": height,
        "divergence_per_min": moved.divergence,
    }
    tracks = Tracks.of(
        columns,
        time_step_s=movie.time_step_s,
        timepoints=len(movie),
        rows=rows,
        method="flow",
        numbers=moved.numbers,
    )
    return tracks.with_columns(direction_deg=_directions_deg(tracks))


def _lasting(moved: Moved, least_s: float, time_step_s: float) -> Moved:
    """Only regions that last long enough, numbered anew."""
    first = np.full(int(moved.ids.max()) + 1, np.iinfo(np.int64).max)
    last = np.full(len(first), -1)
    np.minimum.at(first, moved.ids, moved.timepoint)
    np.maximum.at(last, moved.ids, moved.timepoint)
    long = (last - first + 1) * time_step_s >= least_s
    kept = long[moved.ids]
    number = np.cumsum(long & (last >= 0))
    return Moved(
        number[moved.ids[kept]],
        moved.timepoint[kept],
        moved.centres[kept],
        moved.divergence[kept],
        moved.side,
        moved.numbers,
    )


def _directions_deg(tracks: Tracks) -> Floats:
    """The direction on the uv image in which each row moves on; of the last, came."""
    directions = uv_to_direction(tracks.place_px, tracks.rows)
    ahead = np.full((len(tracks), 3), np.nan)
    follows = np.flatnonzero(tracks.track_id[1:] == tracks.track_id[:-1])
    ahead[follows] = directions[follows + 1] - directions[follows]
    last = np.isnan(ahead[:, 0])
    last[0] = False
    came = np.flatnonzero(last & np.isin(np.arange(len(tracks)), follows + 1))
    ahead[came] = directions[came] - directions[came - 1]
    south, east = tangents_at(tracks.place_px, tracks.rows, (len(tracks),))
    along = [np.einsum("ni,ni->n", ahead, axis) for axis in (east, south)]
    found: Floats = np.degrees(np.arctan2(-along[1], along[0]))
    return found
