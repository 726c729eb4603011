"""Blebs over time: they expand quickly, bulge, and are slowly retracted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from .bodies import Body
from .courses import Course, Lifetimes, draw_cycles
from .protrusions import Shape

EXPANSION_S = 5.0
LONGEST_CYCLE_S = 38.0
LEAST_FOOT_VOXELS = 3.5
FLATTEST = 1.6  # largest radius of a young bleb's cap, over that of the grown one
BUD = 0.35  # up to this height, in parts of the foot's radius, a bud's curvature appears


@dataclass(frozen=True, eq=False)
class BlebFormer:
    """A spherical cap on a foot: it bulges until it is round and overhangs.

    Attributes
    ----------
    base, axis : ndarray, (3,)
        Foot on the body, and the unit vector along which it grows.
    foot_um : float
        Radius of the foot.
    height_um : float
        Of the grown bleb.
    blend_um : float
        Width of the transition into the body of the grown bleb.
    """

    base: Floats
    axis: Floats
    foot_um: float
    height_um: float
    blend_um: float

    @property
    def bud(self) -> float:
        """The size at which its foot is as wide as that of the grown one."""
        return BUD * self.foot_um / self.height_um

    def shape(self, size: float) -> Shape:
        """A ball whose top is `size` times the height above the foot."""
        height = size * self.height_um
        radius = float(self._radius(size))
        centre = self.base + (height - radius) * self.axis
        blend = self.blend_um * (0.15 + 0.85 * size)
        rise = np.array([height - radius])
        return Shape("bleb", centre[None], np.array([radius]), rise, blend)

    def curvature(self, size: npt.ArrayLike) -> Floats:
        """Of the cap, in 1/µm; it appears with the bud."""
        sizes = np.asarray(size, float)
        part = np.clip(sizes / self.bud, 0.0, 1.0)
        curvature: Floats = part * part * (3 - 2 * part) / self._radius(sizes)
        return curvature

    def _radius(self, size: npt.ArrayLike) -> Floats:
        """Of the cap in µm, from its height and its foot."""
        height = np.maximum(np.asarray(size, float) * self.height_um, 1e-6)
        cap = (self.foot_um**2 + height**2) / (2 * height)
        grown = (self.foot_um**2 + self.height_um**2) / (2 * self.height_um)
        return np.asarray(np.minimum(cap, FLATTEST * grown))


@dataclass(frozen=True, eq=False)
class Blebs:
    """Draws blebs on a body.

    Attributes
    ----------
    body : Body
    lifetimes : Lifetimes
    scale : float
        Field of view over that of :data:`.scenes.FIELD_OF_VIEW_UM`.
    voxel_um : float
        Of the working grid.
    """

    body: Body
    lifetimes: Lifetimes
    scale: float
    voxel_um: float

    def draw(
        self, rng: np.random.Generator, direction: Floats, birth_s: float
    ) -> tuple[BlebFormer, Course]:
        """One bleb in a direction, and its life."""
        foot = self.scale * (0.65 + 0.8 * float(rng.beta(1.4, 2.2)))
        foot = max(foot, LEAST_FOOT_VOXELS * self.voxel_um)
        base = self.body.surface(direction)
        axis = self.body.normals(base) + rng.normal(0, 0.12, 3)
        former = BlebFormer(
            base=base,
            axis=axis / np.linalg.norm(axis),
            foot_um=foot,
            height_um=foot * rng.uniform(1.0, 1.7),
            blend_um=foot * rng.uniform(0.3, 0.5),
        )
        lifetime = self.lifetimes.draw(rng)
        return former, draw_cycles(rng, birth_s, lifetime, EXPANSION_S, LONGEST_CYCLE_S)
