"""Distances from a line of sight to segments, and which segment is seen nearest to it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def across(direction: Floats) -> Floats:
    """Two unit vectors (2, 3) at right angles to a direction (3,) and to each other."""
    along = direction / np.linalg.norm(direction)
    # The axis that is farthest from it makes the best start.
    other = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = np.cross(along, other)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])


def distance_to_segments(point: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distances (k,) of a point (n,) from segments, each from `starts` to `ends` (k, n)."""
    step = ends - starts
    length = np.einsum("kn,kn->k", step, step)
    along = np.einsum("kn,kn->k", point - starts, step)
    share = np.clip(along / np.where(length > 0, length, 1.0), 0.0, 1.0)
    distances: Floats = np.linalg.norm(starts + share[:, None] * step - point, axis=1)
    return distances
