"""Small movies that several test modules share: balls with bumps that come and go."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from napari_unwrap3d import Mask, Movie, Parameters, unwrap_movie

VOXEL_UM = 0.25
SIZE = 48
RADIUS_UM = 4.0
TIME_STEP_S = 2.0
CENTRE_UM = np.full(3, (SIZE - 1) / 2 * VOXEL_UM)
# Where bumps may stand: on the axes of the cube.
DIRECTIONS = np.array([(0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, -1), (1, 0, 0)], float)


def quick(**groups: dict[str, object]) -> Parameters:
    """Parameters for small cells; more groups on top. A reference of few vertices is enough for
    a ball with bumps, and takes a tenth of the time.
    """
    values = {
        "uv": {"rows": 64},
        "registration": {"method": "none"},
        "reference": {"vertices": 4000},
    } | groups
    return Parameters.from_dict(values)


def bumpy_ball(bumps: list[tuple[int, float]], radius_um: float = RADIUS_UM) -> Mask:
    """A ball with bumps: (which direction, height in µm over the ball)."""
    axis = np.arange(SIZE) * VOXEL_UM
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1) - CENTRE_UM
    inside = np.linalg.norm(points, axis=-1) < radius_um
    for which, height in bumps:
        bump_radius = 0.9
        middle = DIRECTIONS[which] * (radius_um + height - bump_radius)
        inside |= np.linalg.norm(points - middle, axis=-1) < bump_radius
    return Mask(inside, (VOXEL_UM,) * 3)


def blebbing(timepoints: int = 4) -> list[Mask]:
    """A ball on which one bump after the other rises and goes."""
    return [bumpy_ball([(t % 4, 1.0), ((t + 1) % 4, 0.5)]) for t in range(timepoints)]


@cache
def blebbing_movie(folder: Path) -> Movie:
    """The movie of :func:`blebbing` with all its frames; made once for a folder."""
    return unwrap_movie(blebbing(), quick(), time_step=TIME_STEP_S, folder=folder).compute()
