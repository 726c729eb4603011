"""Directions that are spread evenly over the sphere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def spread_directions(count: int) -> npt.NDArray[np.float64]:
    """Unit vectors (count, 3) of a spherical Fibonacci lattice: each stands for the same area."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - z**2)
    return np.stack([z, ring * np.sin(azimuth), ring * np.cos(azimuth)], axis=1)
