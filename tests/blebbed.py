"""A small ball with round blebs on it: two that touch, and one alone."""

from __future__ import annotations

import functools

import numpy as np

from napari_unwrap3d.charts import Mask, Surface
from napari_unwrap3d.pipeline import Pipeline

VOXEL_UM = 0.1
CENTRE = np.array([30.0, 36.0, 36.0])
BODY = 17.0
# Centres and radii in voxels. The first two balls overlap above their necks.
BLEBS = (
    (np.array([20.5, 0.0, 8.6]), 9.5),
    (np.array([20.5, 0.0, -8.6]), 9.5),
    (np.array([-12.0, -16.0, 0.0]), 8.0),
)
SHAPE = (72, 72, 72)


@functools.cache
def blebbed_mask() -> Mask:
    place = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1) - CENTRE
    inside = np.linalg.norm(place, axis=-1) < BODY
    for centre, radius in BLEBS:
        inside |= np.linalg.norm(place - centre, axis=-1) < radius
    return Mask(inside, (VOXEL_UM,) * 3)


@functools.cache
def blebbed_surface() -> Surface:
    return Pipeline(blebbed_mask()).run(until="surface").surface


def bleb_labels(points: np.ndarray) -> np.ndarray:
    """Bleb 1, 2 or 3 at points (..., 3) in voxels, 0 on the body."""
    levels = [np.linalg.norm(points - CENTRE, axis=-1) - BODY]
    levels += [np.linalg.norm(points - CENTRE - c, axis=-1) - r for c, r in BLEBS]
    return np.argmin(levels, axis=0).astype(np.int32)
