"""The flow of a movie as fields on the common surface: speed, direction, divergence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..charts import Floats, Surface
from ..geometry.padding import sample_uv_linear
from ..parameters import Parameters
from ..progress import Progress, silent
from ..unwrapping.uv import direction_to_uv
from .flows import FieldImages, FlowsOfMovie
from .optical_flow import directions_of_pixels
from .velocities import SECONDS, SPEED, VELOCITY, direction_deg, divergence

if TYPE_CHECKING:
    from ..motion.movie import Movie

DIRECTION, DIVERGENCE = "direction_deg", "divergence_per_min"


def flow_fields(
    movie: Movie, parameters: Parameters | None = None, progress: Progress | None = None
) -> dict[str, Floats]:
    """The mean flow of a field over the movie, as images on the common reference surface.

    Parameters
    ----------
    movie : Movie
    parameters : Parameters, optional
        Those of the movie unless given; their group ``flow``.
    progress : Progress, optional

    Returns
    -------
    dict of str to ndarray, (N, 2N)
        ``velocity_z_um_per_min``, ``velocity_y_um_per_min``, ``velocity_x_um_per_min`` and
        ``speed_um_per_min`` along the common reference surface, ``direction_deg`` on the uv
        image (0 along u, 90 towards the north), and ``divergence_per_min``: positive where the
        surface spreads, negative where it gathers. Carry them to other charts as any field of
        ``movie.common``: ``movie.common.carry(values, "uv", "surface")``.
    """
    progress = progress or silent()
    chosen = (parameters or movie.parameters).flow
    times = [t for t in range(len(movie)) if not movie.is_lost(t)]
    images = FieldImages(movie, chosen.field, times, chosen.smoothing_s)
    flows = FlowsOfMovie(
        images,
        times,
        chosen.method,
        chosen.window_um,
        chosen.clipped_percent,
        progress.part(0.0, 0.1),
    )
    total = np.zeros((flows.rows, 2 * flows.rows, 3))
    for number, time in enumerate(times):
        progress(0.1 + 0.9 * number / len(times), f"timepoint {time}")
        total += flows.to(time)
    minutes = max(times[-1] - times[0], 1) * movie.time_step_s / SECONDS
    return _fields_of(movie, total, max(len(times) - 1, 1), minutes)


def flow_surface(
    movie: Movie, parameters: Parameters | None = None, progress: Progress | None = None
) -> Surface:
    """The common surface with the mean flow over the movie, as fields of its vertices.

    Parameters
    ----------
    movie, parameters, progress
        As of :func:`flow_fields`.

    Returns
    -------
    Surface
        With ``speed_um_per_min``, ``direction_deg`` and ``divergence_per_min``.
    """
    progress = progress or silent()
    found = flow_fields(movie, parameters, progress.part(0.0, 0.9))
    angle = np.radians(found[DIRECTION])
    images = (found[SPEED], found[DIVERGENCE], np.sin(angle), np.cos(angle))
    speed, spread, sine, cosine = (
        np.asarray(movie.common.carry(image, "uv", "surface")) for image in images
    )
    # Angles are carried by their sine and cosine, as they go on at ±180°.
    fields = {SPEED: speed, DIRECTION: np.degrees(np.arctan2(sine, cosine)), DIVERGENCE: spread}
    surface: Surface = movie.common.surface.with_fields(**fields)
    return surface


def _fields_of(movie: Movie, total: Floats, steps: int, minutes: float) -> dict[str, Floats]:
    """Of the sum of the flow (N, 2N, 3) over some steps, which took so many minutes."""
    step = total / steps
    start = directions_of_pixels(len(step))
    end = start + step
    places = direction_to_uv(
        end.reshape(-1, 3) / np.linalg.norm(end, axis=2).reshape(-1, 1), len(step)
    )
    positions = np.asarray(movie.common.uv.positions)
    moved = sample_uv_linear(positions, places).reshape(positions.shape) - positions
    velocity = moved * steps / minutes
    area = np.asarray(movie.common.uv.fields["area_um2"])
    return {
        **{name: velocity[..., axis] for axis, name in enumerate(VELOCITY)},
        SPEED: np.linalg.norm(velocity, axis=2),
        DIRECTION: direction_deg(step),
        DIVERGENCE: divergence(total, area) / minutes,
    }
