"""Cells with pairs of blebs that touch above their necks, and single blebs beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from napari_unwrap3d.charts import Mask
from napari_unwrap3d.simulate.bodies import draw_body, random_directions
from napari_unwrap3d.simulate.protrusions import Shape, bleb
from napari_unwrap3d.simulate.scenes import Scene, clearance
from napari_unwrap3d.simulate.solids import build

VOXEL_UM = 0.104
REACH_UM = 3.0
TRIES = 1500


@dataclass(frozen=True, eq=False)
class TouchingCell:
    """A cell whose blebs 2 p + 1 and 2 p + 2 touch, for every pair p; the others stand alone.

    Attributes
    ----------
    mask : Mask
    labels : ndarray, (z, y, x) int32
        Of every bleb, 0 = body or outside.
    pairs, singles : int
        How many pairs, and how many blebs after them.
    overlap : ndarray, (pairs,)
        How deep the two balls lie in each other, as a part of the smaller's diameter.
    """

    mask: Mask
    labels: npt.NDArray[np.int32]
    pairs: int
    singles: int
    overlap: npt.NDArray[np.float64]

    def united(self, labels: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
        """Labels of blebs with those of a pair made one: p + 1 for pair p, then the others."""
        names = np.arange(2 * self.pairs + self.singles + 1)
        paired = (names + 1) // 2
        return np.where(names <= 2 * self.pairs, paired, names - self.pairs)[labels].astype(
            np.int32
        )


def touching_cell(seed: int, *, size: int = 200, pairs: int = 8, singles: int = 8) -> TouchingCell:
    """A random body with bleb pairs, as many as there is room for, at all overlaps.

    The two balls of a pair overlap by more than 2 voxels, and their necks, where the balls
    enter the body, are more than 2 voxels apart.
    """
    rng = np.random.default_rng([seed, 5])
    centre = np.full(3, (size - 1) / 2 * VOXEL_UM)
    scale = size / 200
    body = draw_body(rng, centre, size / 2 * VOXEL_UM - REACH_UM * scale)
    scene = Scene(body, np.zeros(3), size * VOXEL_UM, scale, VOXEL_UM)
    overlap = []
    for _ in range(TRIES):
        pair = _pair(scene, rng)
        if len(overlap) < pairs and pair is not None and all(map(scene.admits, pair)):
            scene.protrusions += pair
            a, b = pair
            overlap.append(-clearance(a, b) / (2.0 * min(a.radii[0], b.radii[0])))
    count = 0
    for _ in range(TRIES):
        shape = _ball(scene, rng, scene.direction(rng))
        if count < singles and scene.admits(shape):
            scene.protrusions.append(shape)
            count += 1
    solids = build(body, scene.protrusions, [], size, VOXEL_UM)
    mask = Mask(solids.mask, (VOXEL_UM,) * 3)
    return TouchingCell(mask, solids.labels, len(overlap), count, np.array(overlap))


def _ball(scene: Scene, rng: np.random.Generator, direction: npt.NDArray[np.float64]) -> Shape:
    radius = scene.scale * (0.7 + rng.beta(1.2, 2.2))
    return bleb(
        scene.body,
        direction,
        radius,
        rise_um=radius * rng.uniform(0.5, 0.85),
        lean=np.zeros(3),
        stretch_um=0.0,
        blend_um=radius * rng.uniform(0.25, 0.45),
    )


def _pair(scene: Scene, rng: np.random.Generator) -> list[Shape] | None:
    """Two blebs side by side, or None where they do not touch, or do so at the neck."""
    middle = scene.direction(rng)
    tangent = np.cross(middle, random_directions(rng, 1)[0])
    tangent /= np.linalg.norm(tangent)
    apart = rng.uniform(0.8, 3.0) * scene.scale / float(scene.body.radius(middle))
    directions = (np.cos(0.5 * apart) * middle + s * np.sin(0.5 * apart) * tangent for s in (-1, 1))
    a, b = (_ball(scene, rng, direction) for direction in directions)
    necks = [float(np.sqrt(max(s.radii[0] ** 2 - s.rise[-1] ** 2, 0.0))) for s in (a, b)]
    feet = [_foot(scene, shape) for shape in (a, b)]
    least = 2.0 * scene.voxel_um
    touch = clearance(a, b) < -least
    free = float(np.linalg.norm(feet[0] - feet[1])) - sum(necks) > least
    return [a, b] if touch and free else None


def _foot(scene: Scene, shape: Shape) -> npt.NDArray[np.float64]:
    """The point of the body below a ball, seen from the body's centre."""
    offset = shape.points[0] - scene.body.centre
    return scene.body.surface(offset / np.linalg.norm(offset))
