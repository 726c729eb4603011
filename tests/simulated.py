"""Small simulated movies that several test modules share."""

from __future__ import annotations

from functools import cache
from typing import Any

from napari_unwrap3d.simulate import SimulatedMovie, movie

SIZE = 80
VOXEL = 0.2
GRID = {"size": SIZE, "working_voxel_um": VOXEL, "voxel_size": (0.4, VOXEL, VOXEL)}


@cache
def sample(kind: str, **options: Any) -> SimulatedMovie:
    """A small movie in which the cell drifts and turns."""
    moving = {"timepoints": 24, "drift_um": 0.45, "rotation_deg": 3.0}
    return movie(kind, 11, **(GRID | moving | options))
