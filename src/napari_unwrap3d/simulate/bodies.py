"""The cell without its protrusions: a lumpy ellipsoid, never the same twice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..geometry.rigid import Rigid
from ..geometry.spread import spread_directions

LARGEST_ASPECT = 1.6
# Waves, lowest and highest wave number on the unit sphere, and between which values the
# relative root mean square is drawn.
LOBES = (8, 1.5, 3.5, (0.05, 0.10))
LUMPS = (30, 4.0, 9.0, (0.008, 0.022))


@dataclass(frozen=True, eq=False)
class Body:
    """A star-shaped solid: an ellipsoid whose radius is modulated by smooth waves.

    Attributes
    ----------
    centre : ndarray, (3,)
        (z, y, x) in µm.
    semi_axes : ndarray, (3,)
        Of the ellipsoid, in µm.
    rotation : ndarray, (3, 3)
        Rows are the directions (z, y, x) of the semi-axes.
    waves : ndarray, (m, 3), phases : ndarray, (m,), amplitudes : ndarray, (m,)
        The radius is multiplied by ``1 + Σ amplitude cos(wave · direction + phase)``.
    """

    centre: Floats
    semi_axes: Floats
    rotation: Floats
    waves: Floats
    phases: Floats
    amplitudes: Floats

    def radius(self, directions: Floats) -> Floats:
        """Distance (...) in µm from the centre to the surface along unit vectors (..., 3)."""
        local = directions @ self.rotation.T / self.semi_axes
        ellipsoid = 1.0 / np.sqrt(np.einsum("...i,...i->...", local, local))
        waves = np.cos(directions @ self.waves.T + self.phases)
        radius: Floats = ellipsoid * (1.0 + waves @ self.amplitudes)
        return radius

    def level(self, points: Floats) -> Floats:
        """Distance (...) in µm above the surface, measured along the ray from the centre."""
        offset = points - self.centre
        distance = np.sqrt(np.einsum("...i,...i->...", offset, offset))
        directions = offset / np.maximum(distance, 1e-9)[..., None]
        level: Floats = distance - self.radius(directions)
        return level

    def surface(self, directions: Floats) -> Floats:
        """The points (..., 3) in µm of the surface along unit vectors (..., 3)."""
        points: Floats = self.centre + directions * self.radius(directions)[..., None]
        return points

    def normals(self, points: Floats) -> Floats:
        """Outward unit normals (..., 3) of the level sets through points (..., 3)."""
        step = 1e-4 * float(self.semi_axes.min())
        gradient = np.stack(
            [self.level(points + e) - self.level(points - e) for e in step * np.eye(3)], axis=-1
        )
        normals: Floats = gradient / np.linalg.norm(gradient, axis=-1, keepdims=True)
        return normals

    def samples(self, count: int) -> Floats:
        """Points (count, 3) in µm spread over the surface (a Fibonacci lattice)."""
        return self.surface(spread_directions(count))

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest (z, y, x) in µm of the surface."""
        samples = self.samples(5000)
        return samples.min(axis=0), samples.max(axis=0)

    def moved(self, pose: Rigid) -> Self:
        """The same body elsewhere, and turned."""
        return replace(
            self,
            centre=pose.apply(self.centre),
            rotation=self.rotation @ pose.rotation.T,
            waves=self.waves @ pose.rotation.T,
        )

    def scaled(self, factor: float) -> Self:
        """The same shape, `factor` times as large."""
        return replace(self, semi_axes=self.semi_axes * factor)


@dataclass(frozen=True, eq=False)
class StandingBody(Body):
    """A body that stands on a plane: it is cut off there, with a rounded edge.

    Attributes
    ----------
    up : ndarray, (3,)
        The plane's unit normal, into the body.
    floor_um : float
        Distance of the centre from the plane.
    edge_um : float
        How wide the rounded edge is.
    """

    up: Floats
    floor_um: float
    edge_um: float

    @classmethod
    def of(cls, body: Body, up: Floats, height: float) -> StandingBody:
        """Cut a body `height` (a part of its smallest semi-axis) below its centre."""
        smallest = float(body.semi_axes.min())
        parts = {name: getattr(body, name) for name in Body.__dataclass_fields__}
        return cls(**parts, up=up, floor_um=height * smallest, edge_um=0.25 * smallest)

    def radius(self, directions: Floats) -> Floats:
        """Distance (...) in µm from the centre to the surface along unit vectors (..., 3)."""
        free = super().radius(directions)
        to_floor = self.floor_um / np.maximum(-directions @ self.up, 1e-3)
        overlap = np.maximum(self.edge_um - np.abs(free - to_floor), 0.0)
        radius: Floats = np.minimum(free, to_floor) - overlap**2 / (4 * self.edge_um)
        return radius

    def level(self, points: Floats) -> Floats:
        """Distance (...) in µm above the surface, along the ray; cut off deep inside."""
        # Around the centre rays turn quickly, and so would their lengths to the floor.
        level: Floats = np.maximum(super().level(points), -0.6 * self.floor_um)
        return level

    def moved(self, pose: Rigid) -> Self:
        """The same body elsewhere, and turned."""
        moved = super().moved(pose)
        return replace(moved, up=pose.rotation @ self.up)

    def scaled(self, factor: float) -> Self:
        """The same shape, `factor` times as large."""
        scaled = super().scaled(factor)
        return replace(
            scaled,
            floor_um=self.floor_um * factor,
            edge_um=self.edge_um * factor,
        )


def draw_body(rng: np.random.Generator, centre: npt.ArrayLike, half_extent_um: float) -> Body:
    """A random body that just fits into a cube.

    Parameters
    ----------
    rng : numpy.random.Generator
    centre : array-like, (3,)
        (z, y, x) in µm.
    half_extent_um : float
        Half the edge of the cube around `centre`.
    """
    longest = rng.uniform(1.15, LARGEST_ASPECT)
    middle = rng.uniform(1.0, longest)
    families = [_waves(rng, *family) for family in (LOBES, LUMPS)]
    body = Body(
        centre=np.asarray(centre, dtype=float),
        semi_axes=np.array([1.0, middle, longest]),
        rotation=random_rotation(rng),
        waves=np.concatenate([waves for waves, _ in families]),
        phases=rng.uniform(0, 2 * np.pi, sum(len(waves) for waves, _ in families)),
        amplitudes=np.concatenate([amplitudes for _, amplitudes in families]),
    )
    extent = float(np.abs(body.samples(4000) - body.centre).max())
    return body.scaled(half_extent_um / extent)


def _waves(
    rng: np.random.Generator, count: int, low: float, high: float, rms: tuple[float, float]
) -> tuple[Floats, Floats]:
    numbers = rng.uniform(low, high, count)
    amplitudes = rng.uniform(0.5, 1.5, count) / numbers
    amplitudes *= rng.uniform(*rms) / np.sqrt(0.5 * (amplitudes**2).sum())
    return numbers[:, None] * random_directions(rng, count), amplitudes


def random_directions(rng: np.random.Generator, count: int) -> Floats:
    """Unit vectors (count, 3), uniform on the sphere."""
    vectors = rng.normal(size=(count, 3))
    directions: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return directions


def random_rotation(rng: np.random.Generator) -> Floats:
    """A proper rotation (3, 3), uniform."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    rotation: Floats = q * np.linalg.det(q)
    return rotation
