"""What stands on a body for each kind of cell, and where there is room for it.

The lengths below are those of a cell in a field of view of 20.8 µm (200 voxels of
0.104 µm); they shrink with the field of view, but nothing becomes thinner than what
the working grid resolves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..charts import Floats
from .bodies import Body, draw_body, random_directions
from .protrusions import (
    Shape,
    Sheet,
    arch,
    bleb,
    filopodium,
    filopodium_to,
    lamellipodium,
    pinhole,
    tunnel,
)

KINDS = ("blebs", "lamellipodia", "filopodia", "touching_filopodia", "handles", "mix")

FIELD_OF_VIEW_UM = 20.8
MARGIN_VOXELS = 8
TRIES = 60

# How much of the half field of view the body leaves for protrusions, in µm. Protrusions on
# one side may take more, as the whole cell is centred in the end.
REACH_UM = {
    "blebs": 1.5,
    "lamellipodia": 2.6,
    "filopodia": 3.2,
    "touching_filopodia": 3.2,
    "handles": 2.4,
    "mix": 2.6,
}


class NoRoom(Exception):
    """Not even the fewest protrusions fitted; another draw may."""


@dataclass(eq=False)
class Scene:
    """A body and what stands on it, while it is being drawn.

    Attributes
    ----------
    body : Body
    front : ndarray, (3,)
        Where protrusions are more frequent; its length is by how much (0: nowhere).
    width_um : float
        Edge of the cube that the cell may fill.
    scale : float
        Field of view over that of :data:`FIELD_OF_VIEW_UM`.
    voxel_um : float
        Of the working grid.
    protrusions, holes : list of Shape
    handles_um : list of ndarray, (3,)
        Where each handle of the cell is.
    """

    body: Body
    front: Floats
    width_um: float
    scale: float
    voxel_um: float
    protrusions: list[Shape] = field(default_factory=list)
    holes: list[Shape] = field(default_factory=list)
    handles_um: list[Floats] = field(default_factory=list)

    @property
    def spacing_um(self) -> float:
        return 0.4 * self.voxel_um

    @property
    def gap_um(self) -> float:
        """Free space between two shapes, beside the width of their blends."""
        return 3.5 * self.voxel_um

    def length(self, rng: np.random.Generator, low: float, high: float) -> float:
        """A length between two lengths of the full-sized cell."""
        return self.scale * float(rng.uniform(low, high))

    def radius(
        self, rng: np.random.Generator, low: float, high: float, least_voxels: float
    ) -> float:
        """The same for a radius, never less than so many voxels."""
        return max(self.length(rng, low, high), least_voxels * self.voxel_um)

    def direction(self, rng: np.random.Generator) -> Floats:
        """A direction: points of the surface are evenly likely, but for a front of the cell."""
        candidates = random_directions(rng, 16)
        weights = self.body.radius(candidates) ** 2 * np.exp(candidates @ self.front)
        chosen: Floats = candidates[rng.choice(16, p=weights / weights.sum())]
        return chosen

    def bounds(self, more: Sequence[Shape] = ()) -> tuple[Floats, Floats]:
        """Lowest and highest (z, y, x) in µm of the cell, and of more shapes."""
        solids = [*self.protrusions, *more]
        low = np.min([self.body.bounds[0], *(shape.low for shape in solids)], axis=0)
        high = np.max([self.body.bounds[1], *(shape.high for shape in solids)], axis=0)
        return low, high

    def centred(self, centre: Floats) -> Scene:
        """The same scene, with the middle of its bounds at `centre`."""
        low, high = self.bounds()
        offset = centre - (low + high) / 2
        return replace(
            self,
            body=replace(self.body, centre=self.body.centre + offset),
            protrusions=[shape.moved(offset) for shape in self.protrusions],
            holes=[shape.moved(offset) for shape in self.holes],
            handles_um=[handle + offset for handle in self.handles_um],
        )

    def admits(self, shape: Shape, others: list[Shape] | None = None) -> bool:
        """Whether a shape fits into the field of view and is clear of all others."""
        if shape.kind != "tunnel":
            low, high = self.bounds([shape])
            if (high - low).max() > self.width_um:
                return False
        others = self.protrusions + self.holes if others is None else others
        return all(
            clearance(shape, other) > self.gap_um + 0.5 * max(shape.blend_um, other.blend_um)
            for other in others
        )


def clearance(a: Shape, b: Shape) -> float:
    """Free space in µm between two shapes; negative where they overlap."""
    (p, r), (q, s) = a.outline(), b.outline()
    squared = (p**2).sum(1)[:, None] + (q**2).sum(1) - 2 * p @ q.T
    return float((np.sqrt(np.maximum(squared, 0)) - r[:, None] - s).min())


def draw_scene(
    kind: str, rng: np.random.Generator, size: int, voxel_um: float, slack_um: float = 0.0
) -> Scene:
    """A random cell of one of :data:`KINDS` for a cubic grid.

    Parameters
    ----------
    slack_um : float
        Width to keep free at the border in addition to :data:`MARGIN_VOXELS`.

    Raises
    ------
    NoRoom
        This draw did not succeed.
    """
    scale = size * voxel_um / FIELD_OF_VIEW_UM
    width = (size - 1 - 2 * (MARGIN_VOXELS + 1)) * voxel_um - 2 * slack_um
    centre = np.full(3, (size - 1) / 2 * voxel_um) + rng.uniform(-0.5, 0.5, 3) * voxel_um
    # A small cell keeps more room in proportion, as its protrusions cannot be as thin.
    reach = max(REACH_UM[kind] * scale, 7 * voxel_um)
    body = draw_body(rng, centre, width / 2 - reach)
    front = rng.uniform(0.0, 0.8) * random_directions(rng, 1)[0]
    scene = Scene(body, front, width, scale, voxel_um)
    _POPULATE[kind](scene, rng)
    return scene.centred(centre)


# Kinds -------------------------------------------------------------------------


def _blebs(scene: Scene, rng: np.random.Generator) -> None:
    _add(scene, rng, _bleb, int(rng.integers(20, 36)), least=20)


def _lamellipodia(scene: Scene, rng: np.random.Generator) -> None:
    _add(scene, rng, _sheet, int(rng.integers(3, 7)), least=3)


def _filopodia(scene: Scene, rng: np.random.Generator) -> None:
    _add(scene, rng, _filopodium, int(rng.integers(15, 26)), least=15)


def _touching_filopodia(scene: Scene, rng: np.random.Generator) -> None:
    count = int(rng.integers(15, 26))
    for _ in range(int(rng.integers(3, 6))):
        _add_cluster(scene, rng, int(rng.choice([2, 2, 3])))
    if not scene.handles_um:
        raise NoRoom
    _add(scene, rng, _filopodium, count - len(scene.protrusions), least=6)


def _handles(scene: Scene, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(2, 4))):
        _add_tunnel(scene, rng)
    for _ in range(int(rng.integers(1, 3))):
        _add_pierced_sheet(scene, rng)
    for shape in _add(scene, rng, _arch, int(rng.integers(2, 5)), least=1):
        apex = shape.points[len(shape.points) // 2]
        foot = (shape.points[0] + shape.points[-1]) / 2
        scene.handles_um.append(0.5 * (apex + foot))
    _add(scene, rng, _bleb, int(rng.integers(3, 8)), least=0)


def _mix(scene: Scene, rng: np.random.Generator) -> None:
    _add(scene, rng, _sheet, int(rng.integers(1, 4)), least=1)
    _add(scene, rng, _filopodium, int(rng.integers(5, 10)), least=3)
    _add(scene, rng, _bleb, int(rng.integers(6, 14)), least=4)


_POPULATE: dict[str, Callable[[Scene, np.random.Generator], None]] = {
    "blebs": _blebs,
    "lamellipodia": _lamellipodia,
    "filopodia": _filopodia,
    "touching_filopodia": _touching_filopodia,
    "handles": _handles,
    "mix": _mix,
}


def _add(
    scene: Scene,
    rng: np.random.Generator,
    draw: Callable[[Scene, np.random.Generator], Shape | None],
    count: int,
    least: int,
) -> list[Shape]:
    """Add up to `count` shapes where there is room; fewer than `least` is a failure.

    On a small cell protrusions are thick in proportion, so that fewer are asked for.
    """
    added: list[Shape] = []
    for _ in range(count):
        for _ in range(TRIES):
            shape = draw(scene, rng)
            if shape is not None and scene.admits(shape):
                scene.protrusions.append(shape)
                added.append(shape)
                break
        else:
            break
    if len(added) < min(least, np.ceil(least * scene.scale)):
        raise NoRoom
    return added


# One protrusion ------------------------------------------------------------------


def _bleb(scene: Scene, rng: np.random.Generator) -> Shape:
    radius = max(scene.scale * (0.6 + rng.beta(1.2, 2.2)), 3.0 * scene.voxel_um)
    return bleb(
        scene.body,
        scene.direction(rng),
        radius,
        rise_um=radius * rng.uniform(0.15, 0.85),
        lean=rng.normal(0, 0.15, 3),
        stretch_um=radius * rng.uniform(0.0, 0.35),
        blend_um=radius * rng.uniform(0.25, 0.45),
    )


def _filopodium(scene: Scene, rng: np.random.Generator) -> Shape | None:
    base = scene.radius(rng, 0.3, 0.45, 2.7)
    tip = min(scene.radius(rng, 0.25, 0.3, 2.4), base)
    shape = filopodium(
        scene.body,
        scene.direction(rng),
        max(scene.length(rng, 2.0, 6.0), 8 * scene.voxel_um),
        (base, tip),
        lean=rng.normal(0, 0.3, 3),
        bend=rng.normal(0, 0.4, 3),
        blend_um=base * rng.uniform(0.8, 1.4),
        spacing_um=scene.spacing_um,
    )
    return shape if shape.clear_of_body(scene.body, scene.gap_um + shape.blend_um) else None


def _arch(scene: Scene, rng: np.random.Generator) -> Shape | None:
    radius = scene.radius(rng, 0.28, 0.42, 2.5)
    blend = 0.8 * radius
    open_um = 2 * radius + blend + 7 * scene.voxel_um
    middle = scene.direction(rng)
    feet = _pair(scene, rng, middle, max(scene.length(rng, 2.2, 4.2), open_um))
    height = max(scene.length(rng, 1.4, 2.6), open_um)
    shape = arch(scene.body, feet, height, radius, blend, scene.spacing_um)
    return shape if shape.clear_of_body(scene.body, scene.gap_um + blend) else None


def _sheet(scene: Scene, rng: np.random.Generator) -> Shape | None:
    grown = _grown_sheet(scene, rng, 2.0)
    return None if grown is None else grown[0]


def _grown_sheet(
    scene: Scene, rng: np.random.Generator, least_height: float
) -> tuple[Shape, tuple[int, int]] | None:
    direction = scene.direction(rng)
    radius = scene.radius(rng, 0.2, 0.3, 2.1)
    height = max(scene.length(rng, least_height, 5.0), 4 * radius)
    sheet = Sheet(
        direction,
        _tangent(rng, direction),
        length_um=max(scene.length(rng, 3.5, 8.0), 1.3 * height),
        height_um=height,
        radius_um=radius,
        curl=rng.uniform(-0.8, 0.8),
        lean=(rng.normal(0, 0.2), rng.normal(0, 0.6)),
        ripple=(rng.uniform(0.0, 0.35), rng.uniform(0.6, 2.0), rng.uniform(0, 2 * np.pi)),
        edge=(rng.uniform(0.0, 0.18), rng.uniform(0, 2 * np.pi)),
    )
    blend = radius * rng.uniform(1.2, 2.0)
    shape, grid = lamellipodium(scene.body, sheet, blend, 1.5 * scene.spacing_um)
    clear = shape.clear_of_body(scene.body, scene.gap_um + blend)
    return (shape, grid) if clear else None


# Handles -------------------------------------------------------------------------


def _add_cluster(scene: Scene, rng: np.random.Generator, count: int) -> None:
    """A filopodium, and neighbours whose tips grow into the upper part of it."""
    for _ in range(TRIES):
        cluster = _cluster(scene, rng, count)
        if cluster is not None:
            shapes, contacts = cluster
            scene.protrusions += shapes
            scene.handles_um += contacts
            return


def _cluster(
    scene: Scene, rng: np.random.Generator, count: int
) -> tuple[list[Shape], list[Floats]] | None:
    first = _filopodium(scene, rng)
    if first is None or not scene.admits(first):
        return None
    shapes, contacts = [first], []
    base = first.points[np.argmin(np.abs(first.rise))] - scene.body.centre
    for _ in range(count - 1):
        radii = (scene.radius(rng, 0.3, 0.42, 2.7), scene.radius(rng, 0.25, 0.3, 2.4))
        apart = max(scene.length(rng, 1.6, 3.2), 4 * radii[0] + 8 * scene.voxel_um)
        foot = base + apart * _tangent(rng, base / np.linalg.norm(base))
        target = first.points[int(rng.uniform(0.75, 1.0) * (len(first.points) - 1))]
        shape = filopodium_to(
            scene.body,
            foot / np.linalg.norm(foot),
            target,
            radii,
            radii[0],
            scene.spacing_um,
        )
        if not (
            shape.clear_of_body(scene.body, scene.gap_um + shape.blend_um)
            and scene.admits(shape)
            and all(_open_below(scene, shape, other) for other in shapes)
        ):
            return None
        shapes.append(shape)
        contacts.append(target)
    return shapes, contacts


def _open_below(scene: Scene, a: Shape, b: Shape) -> bool:
    """Whether the lower halves of two filopodia are clear of each other."""
    halves = []
    for shape in (a, b):
        low = shape.rise < 0.5 * shape.rise[-1]
        halves.append(
            Shape(shape.kind, shape.points[low], shape.radii[low], shape.rise[low], shape.blend_um)
        )
    return scene.admits(halves[0], [halves[1]])


def _add_tunnel(scene: Scene, rng: np.random.Generator) -> None:
    """A thin hole through the body, well below the surface between its mouths."""
    for _ in range(TRIES):
        radius = scene.radius(rng, 0.25, 0.42, 2.5)
        middle = scene.direction(rng)
        mean_radius = float(scene.body.radius(middle))
        least = np.arccos(max(1 - (3 * radius + 5 * scene.voxel_um) / mean_radius, -0.5))
        half_angle = rng.uniform(least, max(least + 0.1, 1.0))
        tangent = _tangent(rng, middle)
        mouths = [
            np.cos(half_angle) * middle + sign * np.sin(half_angle) * tangent for sign in (-1, 1)
        ]
        sag = 0.1 * mean_radius * rng.normal(size=3)
        shape = tunnel(scene.body, (mouths[0], mouths[1]), radius, sag, radius, scene.spacing_um)
        level = scene.body.level(shape.points)
        buried = shape.rise < -8 * radius
        if (
            buried.any()
            and (level[buried] < -radius - 4 * scene.voxel_um).all()
            and scene.admits(shape)
        ):
            scene.holes.append(shape)
            scene.handles_um.append(shape.points[len(shape.points) // 2])
            return


def _add_pierced_sheet(scene: Scene, rng: np.random.Generator) -> None:
    """A lamellipodium with one or two pinholes."""
    for _ in range(TRIES):
        grown = _grown_sheet(scene, rng, 3.0)
        if grown is None or not scene.admits(grown[0]):
            continue
        sheet, grid = grown
        pierced: list[Shape] = []
        for column in rng.permutation([0.35, 0.5, 0.65])[: int(rng.integers(1, 3))]:
            radius = scene.radius(rng, 0.25, 0.4, 2.4)
            hole = pinhole(sheet, grid, column + rng.uniform(-0.04, 0.04), 0.62, radius)
            if _rim(sheet, grid, hole) and scene.admits(hole, pierced):
                pierced.append(hole)
        if pierced:
            scene.protrusions.append(sheet)
            scene.holes += pierced
            scene.handles_um += [hole.points[len(hole.points) // 2] for hole in pierced]
            return


def _rim(sheet: Shape, grid: tuple[int, int], hole: Shape) -> bool:
    """Whether a pinhole keeps clear of the edges of the sheet and of the body."""
    points = sheet.points.reshape(*grid, 3)
    edges = np.concatenate([points[-1], points[:, 0], points[:, -1], points[grid[0] // 6]])
    centre = hole.points[len(hole.points) // 2]
    distance = float(np.linalg.norm(edges - centre, axis=1).min())
    return distance > float(hole.radii[0] + 2.5 * sheet.radii[0])


def _tangent(rng: np.random.Generator, direction: Floats) -> Floats:
    """A random unit vector perpendicular to a unit vector."""
    vector = np.cross(direction, random_directions(rng, 1)[0])
    tangent: Floats = vector / np.linalg.norm(vector)
    return tangent


def _pair(
    scene: Scene, rng: np.random.Generator, middle: Floats, apart_um: float
) -> tuple[Floats, Floats]:
    """Two directions whose points on the body are about `apart_um` apart."""
    half = np.arcsin(min(apart_um / 2 / float(scene.body.radius(middle)), 0.9))
    tangent = _tangent(rng, middle)
    first, second = (np.cos(half) * middle + sign * np.sin(half) * tangent for sign in (-1, 1))
    return first, second
