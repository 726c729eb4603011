"""A lumpy ellipsoid with bumps, anywhere in space: what the tests of registration look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from napari_unwrap3d.charts import Mask, Volume
from napari_unwrap3d.geometry.rigid import Rigid

VOXEL = (0.3, 0.15, 0.15)
SHAPE = (42, 84, 84)
CENTRE = np.array([6.2, 6.3, 6.3])
AXES = np.array([3.2, 4.4, 3.7])
BUMPS = np.array([(1, 1, 0), (-1, 0, 1), (0, -1, -1), (1, -1, 1), (0, 1, -1)]) / np.sqrt(2)


def moved(degrees: Sequence[float], shift_um: Sequence[float]) -> Rigid:
    """A rotation vector (z, y, x) about the middle, and a shift."""
    turn = Rotation.from_rotvec(np.radians(degrees)).as_matrix()
    return Rigid.about(CENTRE, turn, np.asarray(shift_um))


def height(points: np.ndarray, bumps: Sequence[int]) -> np.ndarray:
    """How far (n,) in µm points (n, 3) of the cell's own world are outside, roughly."""
    offset = points - CENTRE
    # A lobe on one side: nothing is symmetric, so that every rotation shows.
    lobe = 1 + 0.12 * np.tanh(offset[:, 2] / 2) * np.tanh(offset[:, 0] / 2)
    found = (np.linalg.norm(offset / AXES, axis=1) / lobe - 1) * AXES.min()
    for which in bumps:
        middle = CENTRE + BUMPS[which] * AXES * 1.1
        found = np.minimum(found, np.linalg.norm(points - middle, axis=1) - 1.0)
    return found


def recorded(
    pose: Rigid,
    bumps: Sequence[int] = (),
    *,
    brightness: float = 100.0,
    noise: float = 0.0,
    seed: int = 0,
    shape: tuple[int, int, int] = SHAPE,
    voxel: tuple[float, float, float] = VOXEL,
) -> Volume:
    """The cell as a microscope sees it after a motion from its own world."""
    volume = Volume(np.zeros(shape, np.float32), voxel)
    points = pose.inverse().apply(volume.to_world(np.indices(shape).reshape(3, -1).T))
    inside = 0.5 - 0.5 * np.tanh(height(points, bumps) / 0.25)
    texture = 1 + 0.15 * np.cos(2.1 * points).prod(axis=1)
    image = 20 + brightness * (inside * texture).reshape(shape)
    image += noise * np.random.default_rng(seed).normal(size=shape)
    return Volume(image.astype(np.float32), voxel)


def solid(pose: Rigid, bumps: Sequence[int] = ()) -> Mask:
    """The cell as a mask."""
    volume = Volume(np.zeros(SHAPE), VOXEL)
    points = pose.inverse().apply(volume.to_world(np.indices(SHAPE).reshape(3, -1).T))
    return Mask((height(points, bumps) < 0).reshape(SHAPE), VOXEL)


def body_points() -> np.ndarray:
    """Points (n, 3) all over the cell, in its own world."""
    directions = np.random.default_rng(0).normal(size=(300, 3))
    return CENTRE + directions / np.linalg.norm(directions, axis=1, keepdims=True) * AXES
