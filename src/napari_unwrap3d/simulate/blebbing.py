"""A cell that blebs: where and when blebs are born, how they grow, and how long they live."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import count

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from .bodies import Body
from .courses import Lifetimes, SignalLaw, draw_cycles
from .growing import GrowingCell, Protrusion, protrusion
from .protrusions import Shape
from .room import Ground, Room

EXPANSION_S = 5.0
LONGEST_CYCLE_S = 38.0
REST_S = (2.0, 6.0)  # at least, and the mean of what is more, before the next bleb at a place
LEAST_BASE_VOXELS = 3.5
FLATTEST = 1.6  # largest radius of a young bleb's cap, over that of the grown one


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

    def shape(self, size: float) -> Shape:
        """A ball whose top is `size` times the height above the foot."""
        height = size * self.height_um
        radius = float(self.radius(size))
        centre = self.base + (height - radius) * self.axis
        blend = self.blend_um * (0.15 + 0.85 * size)
        rise = np.array([height - radius])
        return Shape("bleb", centre[None], np.array([radius]), rise, blend)

    def radius(self, size: npt.ArrayLike) -> Floats:
        """Of the cap in µm, from its height and its foot."""
        height = np.maximum(np.asarray(size, float) * self.height_um, 1e-6)
        cap = (self.foot_um**2 + height**2) / (2 * height)
        grown = (self.foot_um**2 + self.height_um**2) / (2 * self.height_um)
        return np.asarray(np.minimum(cap, FLATTEST * max(grown, self.foot_um)))

    def curvature(self, size: npt.ArrayLike) -> Floats:
        """Of the cap, in 1/µm; it vanishes with a bud's foot."""
        sizes = np.asarray(size, float)
        bud = np.clip(sizes * self.height_um / (0.35 * self.foot_um), 0.0, 1.0)
        curvature: Floats = bud * bud * (3 - 2 * bud) / self.radius(sizes)
        return curvature


@dataclass(frozen=True)
class Blebbing:
    """How a cell blebs.

    Attributes
    ----------
    lifetimes : Lifetimes
    births_per_um2_per_min : float
        A Poisson process in time and on the free area of the body.
    recurrence : float
        How often another bleb follows at a place, a few seconds after one has gone.
    law : SignalLaw
    """

    lifetimes: Lifetimes
    births_per_um2_per_min: float
    recurrence: float
    law: SignalLaw


@dataclass(order=True)
class _Birth:
    time_s: float
    order: int
    site: int
    direction: Floats


def blebbing_cell(
    rng: np.random.Generator,
    body: Body,
    room: Room,
    blebbing: Blebbing,
    scale: float,
    size: int,
    voxel_um: float,
    duration_s: float,
) -> GrowingCell:
    """Draw all blebs that are there between 0 and `duration_s`.

    A birth is refused where the grown bleb would touch another that lives at that time, or
    leave the field of view; its lifetime plays no part in that.
    """
    law, lifetimes = blebbing.law, blebbing.lifetimes
    alive: list[tuple[float, Shape]] = []
    found: list[Protrusion] = []
    order, sites = count(), count(1)
    ground = Ground.of(body)
    rate = blebbing.births_per_um2_per_min * ground.area_um2 / 60.0
    start = -4.0 * lifetimes.mean_s
    waiting = [_Birth(start, next(order), 0, np.zeros(3))]
    while waiting:
        birth = heapq.heappop(waiting)
        if birth.time_s > duration_s:
            break
        site = birth.site
        if site == 0:  # a new place, and when the next new place is tried
            following = birth.time_s + float(rng.exponential(1.0 / rate))
            heapq.heappush(waiting, _Birth(following, next(order), 0, np.zeros(3)))
            birth.direction = ground.draw(rng)
        former = _draw_bleb(rng, body, birth.direction, scale, voxel_um)
        lifetime = lifetimes.draw(rng)
        course = draw_cycles(rng, birth.time_s, lifetime, EXPANSION_S, LONGEST_CYCLE_S)
        alive = [(end, shape) for end, shape in alive if end > birth.time_s]
        grown = former.shape(1.0)
        if not room.admits(grown, [shape for _, shape in alive]):
            continue
        site = site or next(sites)
        alive.append((course.end_s, grown))
        again = rng.uniform() < blebbing.recurrence
        rest = REST_S[0] + float(rng.exponential(REST_S[1]))
        if again:
            later = _Birth(course.end_s + rest, next(order), site, birth.direction)
            heapq.heappush(waiting, later)
        made = protrusion(rng, len(found) + 1, site, former.base, former, course, law)
        if made.course.end_s + law.lag_s > 0:
            found.append(made)
    return GrowingCell(body, tuple(found), law, size, voxel_um)


def _draw_bleb(
    rng: np.random.Generator, body: Body, direction: Floats, scale: float, voxel_um: float
) -> BlebFormer:
    foot = max(scale * (0.65 + 0.8 * float(rng.beta(1.4, 2.2))), LEAST_BASE_VOXELS * voxel_um)
    base = body.surface(direction)
    axis = body.normals(base) + rng.normal(0, 0.12, 3)
    return BlebFormer(
        base=base,
        axis=axis / np.linalg.norm(axis),
        foot_um=foot,
        height_um=foot * rng.uniform(1.0, 1.7),
        blend_um=foot * rng.uniform(0.3, 0.5),
    )
