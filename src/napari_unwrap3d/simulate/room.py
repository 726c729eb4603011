"""Where something may grow on a cell that moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..charts import Floats
from ..geometry.spread import spread_directions
from .bodies import Body, StandingBody, random_directions
from .protrusions import Shape
from .scenes import clearance

SAMPLES = 4000
STEEPEST = 0.2  # of the ground's normals, so much may point down


@dataclass(frozen=True, eq=False)
class Ground:
    """The surface of a body that is free of the plane on which it stands.

    Attributes
    ----------
    body : Body
    area_um2 : float
    largest : float
        Area per solid angle, in µm².
    """

    body: Body
    area_um2: float
    largest: float

    @classmethod
    def of(cls, body: Body) -> Ground:
        """Measure the free surface of a body."""
        weights = _weights(body, spread_directions(SAMPLES))
        return cls(body, float(4 * np.pi * weights.mean()), 1.1 * float(weights.max()))

    def draw(self, rng: np.random.Generator) -> Floats:
        """The direction (3,) of a point from the centre, evenly likely per area."""
        while True:
            directions = random_directions(rng, 8)
            chosen = rng.uniform(0.0, self.largest, 8) < _weights(self.body, directions)
            if chosen.any():
                direction: Floats = directions[np.argmax(chosen)]
                return direction


def _weights(body: Body, directions: Floats) -> Floats:
    """Free area per solid angle along unit vectors (n, 3), in µm²."""
    normals = body.normals(body.surface(directions))
    slant = np.einsum("ij,ij->i", normals, directions)
    weights: Floats = body.radius(directions) ** 2 / np.maximum(slant, 0.2)
    if isinstance(body, StandingBody):
        weights = np.where(normals @ body.up > -STEEPEST, weights, 0.0)
    return weights


@dataclass(frozen=True, eq=False)
class Room:
    """Where protrusions may be: within the field of view, clear of each other.

    Attributes
    ----------
    low_um, high_um : float
        Between these they lie along every axis, however the cell drifts.
    gap_um : float
        Free space between two of them beside the width of their blends.
    """

    low_um: float
    high_um: float
    gap_um: float

    def admits(self, shape: Shape, others: Sequence[Shape]) -> bool:
        """Whether there is room for a shape beside others."""
        if (shape.low < self.low_um).any() or (shape.high > self.high_um).any():
            return False
        return all(
            clearance(shape, other) > self.gap_um + 0.5 * max(shape.blend_um, other.blend_um)
            for other in others
        )
