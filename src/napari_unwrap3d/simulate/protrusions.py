"""The shapes that grow from a body: each is a skeleton swept by balls.

Lengths are in µm. Points of a skeleton lie closer together than half a voxel of the
working grid, so that the swept solid is smooth on the grid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..charts import Floats
from .bodies import Body

OUTLINE_POINTS = 350


@dataclass(frozen=True, eq=False)
class Shape:
    """Balls along a skeleton.

    Attributes
    ----------
    kind : str
        "bleb", "lamellipodium", "filopodium", "arch", or "tunnel" for what is cut out.
    points : ndarray, (n, 3)
        Centres (z, y, x) of the balls in µm.
    radii : ndarray, (n,)
        In µm.
    rise : ndarray, (n,)
        Length in µm from the surface of the body along the shape; negative at the root.
    blend_um : float
        Width of the smooth transition into the body.
    """

    kind: str
    points: Floats
    radii: Floats
    rise: Floats
    blend_um: float

    def outline(self) -> tuple[Floats, Floats]:
        """Some hundred of the balls, enough to see what the shape comes close to."""
        step = max(len(self.points) // OUTLINE_POINTS, 1)
        return self.points[::step], self.radii[::step]

    @property
    def low(self) -> Floats:
        """Lowest (z, y, x) of the balls in µm."""
        low: Floats = (self.points - self.radii[:, None]).min(axis=0)
        return low

    @property
    def high(self) -> Floats:
        """Highest (z, y, x) of the balls in µm."""
        high: Floats = (self.points + self.radii[:, None]).max(axis=0)
        return high

    def moved(self, offset: Floats) -> Shape:
        """The same shape elsewhere."""
        return replace(self, points=self.points + offset)

    def clear_of_body(self, body: Body, gap_um: float) -> bool:
        """Whether the shape leaves the body and does not come back to it."""
        outside = self.rise > 0
        rise, radii = self.rise[outside], self.radii[outside]
        # The distance along the ray exceeds the distance to a lumpy surface by some 10 %.
        distance = body.level(self.points[outside]) / 1.15
        return bool((distance >= np.minimum(0.4 * rise, radii + gap_um)).all())


def bleb(
    body: Body,
    direction: Floats,
    radius_um: float,
    rise_um: float,
    lean: Floats,
    stretch_um: float,
    blend_um: float,
) -> Shape:
    """A round cap on a neck: balls along a short axis that ends `rise_um` above the body."""
    base = body.surface(direction)
    axis = body.normals(base) + lean
    axis /= np.linalg.norm(axis)
    count = int(np.ceil(stretch_um / 0.04)) + 1
    rise = np.linspace(rise_um - stretch_um, rise_um, count)
    points = base + rise[:, None] * axis
    return Shape("bleb", points, np.full(count, radius_um), rise, blend_um)


def filopodium(
    body: Body,
    direction: Floats,
    length_um: float,
    radii_um: tuple[float, float],
    lean: Floats,
    bend: Floats,
    blend_um: float,
    spacing_um: float,
) -> Shape:
    """A tapered tube that starts along the leaning normal and turns steadily.

    Parameters
    ----------
    radii_um : (float, float)
        At the base and at the tip.
    lean : ndarray, (3,)
        Added to the unit normal at the base.
    bend : ndarray, (3,)
        Rotation vector, in radians, of the axis from the base to the tip.
    """
    base = body.surface(direction)
    axis = body.normals(base) + lean
    axis /= np.linalg.norm(axis)
    root = radii_um[0]
    rise = np.arange(-root, length_um - radii_um[1], spacing_um)
    fraction = np.clip(rise / length_um, 0.0, 1.0)
    tangents = _rotated(axis, fraction[:, None] * bend)
    points = base - root * axis + np.cumsum(tangents, axis=0) * spacing_um
    radii = radii_um[0] + (radii_um[1] - radii_um[0]) * fraction
    return Shape("filopodium", points, radii, rise, blend_um)


def filopodium_to(
    body: Body,
    direction: Floats,
    target: Floats,
    radii_um: tuple[float, float],
    blend_um: float,
    spacing_um: float,
) -> Shape:
    """A tapered tube that leaves along the normal and ends at `target`."""
    base = body.surface(direction)
    normal = body.normals(base)
    root = radii_um[0]
    reach = float(np.linalg.norm(target - base))
    control = base + 0.55 * reach * normal
    points, rise = _bezier([base - root * normal, control, target], spacing_um)
    rise = rise - root
    fraction = np.clip(rise / rise[-1], 0.0, 1.0)
    radii = radii_um[0] + (radii_um[1] - radii_um[0]) * fraction
    return Shape("filopodium", points, radii, rise, blend_um)


def arch(
    body: Body,
    feet: tuple[Floats, Floats],
    height_um: float,
    radius_um: float,
    blend_um: float,
    spacing_um: float,
) -> Shape:
    """A loop that stands on the body with two feet (directions)."""
    bases = [body.surface(foot) for foot in feet]
    normals = [body.normals(base) for base in bases]
    controls = [
        bases[0] - radius_um * normals[0],
        bases[0] + 4 / 3 * height_um * normals[0],
        bases[1] + 4 / 3 * height_um * normals[1],
        bases[1] - radius_um * normals[1],
    ]
    points, length = _bezier(controls, spacing_um)
    rise = np.minimum(length, length[-1] - length) - radius_um
    return Shape("arch", points, np.full(len(points), radius_um), rise, blend_um)


def tunnel(
    body: Body,
    mouths: tuple[Floats, Floats],
    radius_um: float,
    sag: Floats,
    blend_um: float,
    spacing_um: float,
) -> Shape:
    """A hole through the body from one mouth (direction) to the other.

    `sag` (3,) in µm displaces the middle of the hole from the straight line.
    """
    bases = [body.surface(mouth) for mouth in mouths]
    chord = bases[1] - bases[0]
    overhang = 3 * radius_um * chord / np.linalg.norm(chord)
    middle = (bases[0] + bases[1]) / 2 + 2 * sag
    points, length = _bezier([bases[0] - overhang, middle, bases[1] + overhang], spacing_um)
    rise = -np.minimum(length, length[-1] - length)
    return Shape("tunnel", points, np.full(len(points), radius_um), rise, blend_um)


@dataclass(frozen=True, eq=False)
class Sheet:
    """How a lamellipodium grows.

    Attributes
    ----------
    direction, along : ndarray, (3,)
        Unit vectors: the middle of the footprint seen from the body's centre, and the
        way that the footprint runs there.
    length_um, height_um, radius_um : float
        Of the footprint, of the sheet at its highest, and half its thickness.
    curl : float
        Curvature of the footprint per radian along it.
    lean : (float, float)
        Angle to the normal in radians at the foot, and how much it grows up to the edge.
    ripple : (float, float, float)
        Amplitude (radians), waves per length and phase of the lean along the footprint.
    edge : (float, float)
        Relative amplitude and phase of the lobes of the upper edge.
    """

    direction: Floats
    along: Floats
    length_um: float
    height_um: float
    radius_um: float
    curl: float
    lean: tuple[float, float]
    ripple: tuple[float, float, float]
    edge: tuple[float, float]


def lamellipodium(
    body: Body, sheet: Sheet, blend_um: float, spacing_um: float
) -> tuple[Shape, tuple[int, int]]:
    """A thin curved sheet; also its number of points along and up (a raveled grid)."""
    base, normals, binormals = _footprint(body, sheet, spacing_um)
    columns = len(base)
    position = np.linspace(-1.0, 1.0, columns)
    amplitude, waves, phase = sheet.ripple
    ripple = amplitude * np.sin(np.pi * waves * position + phase)
    lobes = 1.0 + sheet.edge[0] * np.sin(2.5 * np.pi * position + sheet.edge[1])
    heights = sheet.height_um * (1.0 - position**2) ** 0.4 * lobes / (1.0 + sheet.edge[0])
    heights = np.maximum(heights - sheet.radius_um, 0.0)

    rows = int(np.ceil((sheet.height_um + sheet.radius_um) / spacing_um)) + 1
    fraction = np.linspace(0.0, 1.0, rows)[:, None]
    angle = sheet.lean[0] + ripple * fraction + sheet.lean[1] * fraction
    growth = (
        np.cos(angle)[..., None] * normals + np.sin(angle)[..., None] * binormals
    )  # (rows, columns, 3)
    step = (heights + sheet.radius_um) / (rows - 1)
    root = base - sheet.radius_um * normals
    points = root + np.cumsum(growth * step[:, None], axis=0)
    rise = fraction * (heights + sheet.radius_um) - sheet.radius_um
    shape = Shape(
        "lamellipodium",
        points.reshape(-1, 3),
        np.full(points.shape[0] * points.shape[1], sheet.radius_um),
        rise.ravel(),
        blend_um,
    )
    return shape, (rows, columns)


def _footprint(body: Body, sheet: Sheet, spacing_um: float) -> tuple[Floats, Floats, Floats]:
    """Points of the footprint, evenly spaced, with normals and the way that a sheet leans."""
    side = np.cross(sheet.direction, sheet.along)
    half_angle = sheet.length_um / float(body.radius(sheet.direction)) / 2
    angle = np.linspace(-half_angle, half_angle, 200)[:, None]
    offset = 0.5 * sheet.curl * (angle**2 - half_angle**2 / 3)
    directions = np.cos(angle) * sheet.direction + np.sin(angle) * sheet.along + offset * side
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    base, _ = _evenly(body.surface(directions), spacing_um)
    normals = body.normals(base)
    tangents = np.gradient(base, axis=0)
    binormals = np.cross(normals, tangents)
    return base, normals, binormals / np.linalg.norm(binormals, axis=1, keepdims=True)


def pinhole(
    sheet: Shape, grid: tuple[int, int], column: float, row: float, radius_um: float
) -> Shape:
    """A hole through a sheet, at fractions of its length and height."""
    rows, columns = grid
    r, c = round(row * (rows - 1)), round(column * (columns - 1))
    points = sheet.points.reshape(rows, columns, 3)
    across = np.cross(points[r + 1, c] - points[r - 1, c], points[r, c + 1] - points[r, c - 1])
    across /= np.linalg.norm(across)
    depth = 3.0 * float(sheet.radii[0])
    offsets = np.linspace(-depth, depth, 61)
    line = points[r, c] + offsets[:, None] * across
    return Shape("tunnel", line, np.full(61, radius_um), -np.ones(61), 0.5 * radius_um)


def _rotated(vector: Floats, rotations: Floats) -> Floats:
    """A vector (3,) turned by rotation vectors (n, 3), in radians."""
    from scipy.spatial.transform import Rotation

    turned: Floats = Rotation.from_rotvec(rotations).apply(vector)
    return turned


def _bezier(controls: list[Floats], spacing_um: float) -> tuple[Floats, Floats]:
    """A Bézier curve as evenly spaced points, and the length along it."""
    points = np.stack(controls)
    t = np.linspace(0.0, 1.0, 400)[:, None, None]
    levels = np.broadcast_to(points, (400, *points.shape))
    while levels.shape[1] > 1:  # de Casteljau
        levels = (1 - t) * levels[:, :-1] + t * levels[:, 1:]
    return _evenly(levels[:, 0], spacing_um)


def _evenly(curve: Floats, spacing_um: float) -> tuple[Floats, Floats]:
    """A curve resampled to even steps of at most `spacing_um`, and the length along it."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    count = int(np.ceil(length[-1] / spacing_um)) + 1
    even = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(even, length, axis) for axis in curve.T], axis=1), even
