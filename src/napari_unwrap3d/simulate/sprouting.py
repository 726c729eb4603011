"""Filopodia over time: they extend at one rate, stay, and retract at another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from .bodies import Body
from .courses import Course, straight_course
from .protrusions import Shape, filopodium

RATE_SPREAD = 0.2
STAY_S = (4.0, 12.0)  # at least, and the mean of what is more
LEAST_LENGTH_VOXELS = 8


@dataclass(frozen=True, eq=False)
class FilopodiumFormer:
    """A tube that is pushed out along its own line.

    Attributes
    ----------
    grown : Shape
        At its longest.
    base : ndarray, (3,)
        Its foot on the body.
    height_um : float
        Its largest length along the tube.
    radii_um : (float, float)
        At the foot and at the tip.
    """

    grown: Shape
    base: Floats
    height_um: float
    radii_um: tuple[float, float]

    @property
    def bud(self) -> float:
        """The size at which its foot is as wide as that of the grown one."""
        return self.radii_um[0] / self.height_um

    def shape(self, size: float) -> Shape:
        """The tube up to `size` times its length; it tapers to its tip."""
        length = size * self.height_um
        root, tip = self.radii_um
        rise = self.grown.rise
        end = np.clip(length - tip, rise[0], rise[-1])
        kept = rise < end
        last = [float(np.interp(end, rise, axis)) for axis in self.grown.points.T]
        points = np.concatenate([self.grown.points[kept], [last]])
        along = np.append(rise[kept], end)
        radii = root + (tip - root) * np.clip(along / max(length, 1e-9), 0.0, 1.0)
        # A tip that has not come out yet is as thin as it has to be to stay below.
        radii = np.minimum(radii, np.maximum(length - along, 0.5 * tip))
        return Shape("filopodium", points, radii, along, self.grown.blend_um * min(4 * size, 1.0))

    def curvature(self, size: npt.ArrayLike) -> Floats:
        """Mean curvature of the tube in 1/µm; it appears with the tip."""
        out = np.clip(np.asarray(size, float) / self.bud, 0.0, 1.0)
        curvature: Floats = out / (self.radii_um[0] + self.radii_um[1])
        return curvature


@dataclass(frozen=True, eq=False)
class Filopodia:
    """Draws filopodia on a body.

    Attributes
    ----------
    body : Body
    extension_um_per_min, retraction_um_per_min : float
        Mean rates; every filopodium has its own within 20 %.
    scale : float
        Field of view over that of :data:`.scenes.FIELD_OF_VIEW_UM`.
    voxel_um : float
        Of the working grid.
    """

    body: Body
    extension_um_per_min: float
    retraction_um_per_min: float
    scale: float
    voxel_um: float

    def draw(
        self, rng: np.random.Generator, direction: Floats, birth_s: float
    ) -> tuple[FilopodiumFormer, Course] | None:
        """One filopodium in a direction, and its life; None where it comes back to the body."""
        root = max(self.scale * rng.uniform(0.32, 0.45), 2.7 * self.voxel_um)
        tip = min(max(self.scale * rng.uniform(0.26, 0.32), 2.4 * self.voxel_um), root)
        length = max(self.scale * rng.uniform(2.0, 4.5), LEAST_LENGTH_VOXELS * self.voxel_um)
        lean, bend = rng.normal(0, 0.25, 3), rng.normal(0, 0.35, 3)
        blend = root * rng.uniform(0.7, 1.2)
        rates = rng.uniform(1 - RATE_SPREAD, 1 + RATE_SPREAD, 2)
        stay = STAY_S[0] + float(rng.exponential(STAY_S[1]))
        spacing = 0.4 * self.voxel_um
        radii = (root, tip)
        grown = filopodium(self.body, direction, length, radii, lean, bend, blend, spacing)
        if not grown.clear_of_body(self.body, 3.5 * self.voxel_um + blend):
            return None
        extension = float(rates[0]) * self.extension_um_per_min / 60.0
        retraction = float(rates[1]) * self.retraction_um_per_min / 60.0
        course = straight_course(birth_s, length / extension, stay, length / retraction)
        return FilopodiumFormer(grown, self.body.surface(direction), length, radii), course

    @property
    def longest_s(self) -> float:
        """Hardly any filopodium lives longer."""
        slowest = 60.0 * (1 / self.extension_um_per_min + 1 / self.retraction_um_per_min)
        return float(5.0 * slowest / (1 - RATE_SPREAD) + STAY_S[0] + 4 * STAY_S[1])
