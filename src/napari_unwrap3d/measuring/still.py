"""Places of the surface that do not move, as tracks: what changes there, changes in time.

Where regions are carried by a flow, what they carry along changes little. How two fields change
together at one place of the cell is seen only by staying there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..charts import Floats, Ints, Tracks
from ..geometry.padding import pad_sphere
from ..geometry.spread import spread_directions
from ..progress import Progress, silent
from ..tracking.places import height_at, on_surface
from ..unwrapping.uv import direction_to_uv, uv_to_direction

if TYPE_CHECKING:
    from ..motion.movie import Movie

#: The name under which these tracks are measured.
STILL = "places"
# Places of one of so many parts of the sphere are taken to change together.
GROUPS = 16


def still_tracks(movie: Movie, count: int, progress: Progress | None = None) -> Tracks:
    """Places that are spread evenly over the common sphere and stay where they are.

    Parameters
    ----------
    movie : Movie
    count : int
        How many.
    progress : Progress, optional

    Returns
    -------
    Tracks
        One per place, at every timepoint that was made, on what lies outermost there.
    """
    report = progress or silent()
    rows = movie.common.uv.shape[0]
    places = direction_to_uv(spread_directions(count), rows)
    made = [t for t in range(len(movie)) if not movie.is_lost(t)]
    points = np.empty((len(made), count, 3))
    for number, timepoint in enumerate(made):
        report(number / len(made), f"places at timepoint {timepoint}")
        points[number] = on_surface(movie, height_at(movie, timepoint), places)
    z, y, x = points.reshape(-1, 3).T
    columns = {
        "track_id": np.tile(np.arange(1, count + 1), len(made)),
        "timepoint": np.repeat(np.array(made, np.int64), count),
        "z_um": z,
        "y_um": y,
        "x_um": x,
        "v_px": np.tile(places[:, 0], len(made)),
        "u_px": np.tile(places[:, 1], len(made)),
    }
    return Tracks.of(
        columns,
        time_step_s=movie.time_step_s,
        timepoints=len(movie),
        rows=rows,
        method="places",
        numbers={"places": count},
    )


def groups_of(tracks: Tracks) -> Ints:
    """The part of the sphere (m,) that each track is in, on average."""
    direction = uv_to_direction(tracks.place_px, tracks.rows)
    place = np.searchsorted(tracks.ids, tracks.track_id)
    mean = np.stack([np.bincount(place, axis) for axis in direction.T], axis=1)
    parts: Ints = (mean @ spread_directions(GROUPS).T).argmax(axis=1).astype(np.int64)
    return parts


def pixel_lengths(positions: Floats) -> tuple[Floats, Floats]:
    """How long a step to the next row and to the next column is, (N, 2N) in µm.

    Parameters
    ----------
    positions : ndarray, (N, 2N, 3)
        In µm, of every pixel.
    """
    padded = pad_sphere(positions, 1)
    down = np.linalg.norm(padded[2:, 1:-1] - padded[:-2, 1:-1], axis=-1) / 2
    along = np.linalg.norm(padded[1:-1, 2:] - padded[1:-1, :-2], axis=-1) / 2
    return down, along
