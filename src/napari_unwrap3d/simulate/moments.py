"""A simulated cell at one time, and what a cell has to know to make a movie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..geometry.rigid import Rigid
from .courses import SignalLaw
from .recording import Texture
from .solids import Field, Solid

Row = dict[str, float | int | bool]


@dataclass(frozen=True, eq=False)
class Moment:
    """A cell at one time on the working grid.

    Attributes
    ----------
    field : ndarray, (z, y, x) float32
        Signed distance in µm to the surface, negative inside.
    mask, body : ndarray, (z, y, x) bool
    labels : ndarray, (z, y, x) int32
        Identities in the mask outside the body, else 0.
    signal : ndarray, (z, y, x) float32
        Near the surface: what the second dye is multiplied by.
    curvature : ndarray, (z, y, x) float32
        Near the surface: the curvature of protrusions in 1/µm, which the signal follows.
    """

    field: Field
    mask: Solid
    body: Solid
    labels: npt.NDArray[np.int32]
    signal: Field
    curvature: Field


class LivingCell(Protocol):
    """Everything that happens to a cell, in its own world; a pose puts it into another."""

    @property
    def size(self) -> int:
        """Of the working grid."""
        ...

    @property
    def voxel_um(self) -> float:
        """Of the working grid."""
        ...

    @property
    def law(self) -> SignalLaw:
        """Which the signal follows."""
        ...

    def moment(self, time_s: float, pose: Rigid) -> Moment:
        """The cell at a time, where a pose puts it."""
        ...

    def dyes(self, moment: Moment, pose: Rigid, texture: Texture) -> tuple[Field, Field]:
        """Concentrations on the working grid."""
        ...

    def body_points(self, count: int) -> Floats:
        """Points (n, 3) on the body."""
        ...

    def state(self, time_s: float) -> list[Row]:
        """What is known of every protrusion at a time."""
        ...

    def lives(self) -> list[Row]:
        """What is known of every protrusion over its life."""
        ...

    def cycles(self) -> list[Row]:
        """What is known of every cycle of extension and retraction."""
        ...


def place(point: Floats) -> Row:
    """A point (z, y, x) in µm as columns of a table."""
    return {"z_um": float(point[0]), "y_um": float(point[1]), "x_um": float(point[2])}
