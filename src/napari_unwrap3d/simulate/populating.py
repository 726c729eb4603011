"""Births of protrusions over a movie: a Poisson process in time and on the free surface."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from ..charts import Floats
from ..progress import Progress
from .bodies import Body
from .courses import Course, SignalLaw
from .growing import Former, GrowingCell, Protrusion, draw_protrusion
from .protrusions import Shape
from .room import Ground, Room

REST_S = (2.0, 6.0)  # at least, and the mean of what is more, before the next one at a place

Draw = Callable[[np.random.Generator, Floats, float], tuple[Former, Course] | None]


@dataclass(frozen=True, eq=False)
class Population:
    """What is born on a body, and how often.

    Attributes
    ----------
    body : Body
    room : Room
    draw : callable
        ``draw(rng, direction, birth_s)``: one protrusion on the body in a direction, or None
        where it does not fit there. What it draws must not depend on the others.
    births_per_um2_per_min : float
        On the free area of the body.
    recurrence : float
        How often another one follows at a place, some seconds after one has gone.
    longest_s : float
        That long before the movie the births begin.
    law : SignalLaw
    """

    body: Body
    room: Room
    draw: Draw
    births_per_um2_per_min: float
    recurrence: float
    longest_s: float
    law: SignalLaw


@dataclass(order=True)
class _Birth:
    time_s: float
    order: int
    site: int = field(compare=False)
    direction: Floats = field(compare=False)


def populated(
    rng: np.random.Generator,
    population: Population,
    duration_s: float,
    size: int,
    voxel_um: float,
    progress: Progress,
) -> GrowingCell:
    """A body with everything that grows from it between 0 and `duration_s`.

    A birth is refused where the grown protrusion would touch another that lives at that
    time, or leave the field of view; its lifetime plays no part in that.
    """
    if population.births_per_um2_per_min == 0:
        return GrowingCell(population.body, (), population.law, size, voxel_um)
    law, ground = population.law, Ground.of(population.body)
    rate = population.births_per_um2_per_min * ground.area_um2 / 60.0
    alive: list[tuple[float, Shape]] = []
    found: list[Protrusion] = []
    order, sites, nowhere = count(), count(1), np.zeros(3)
    waiting = [_Birth(-population.longest_s, next(order), 0, nowhere)]
    while waiting:
        birth = heapq.heappop(waiting)
        if birth.time_s > duration_s:
            break
        done = (birth.time_s + population.longest_s) / (duration_s + population.longest_s)
        progress(0.9 * done, "Drawing what grows")
        if birth.site == 0:  # a new place; and when the next new place is tried
            following = birth.time_s + float(rng.exponential(1.0 / rate))
            heapq.heappush(waiting, _Birth(following, next(order), 0, nowhere))
            birth.direction = ground.draw(rng)
        drawn = population.draw(rng, birth.direction, birth.time_s)
        if drawn is None:
            continue
        former, course = drawn
        alive = [(end, shape) for end, shape in alive if end > birth.time_s]
        grown = former.shape(1.0)
        if not population.room.admits(grown, [shape for _, shape in alive]):
            continue
        alive.append((course.end_s, grown))
        site = birth.site or next(sites)
        if rng.uniform() < population.recurrence:
            again = course.end_s + REST_S[0] + float(rng.exponential(REST_S[1]))
            heapq.heappush(waiting, _Birth(again, next(order), site, birth.direction))
        made = draw_protrusion(rng, len(found) + 1, site, former, course, law)
        if course.end_s + law.lag_s > 0:
            found.append(made)
    return GrowingCell(population.body, tuple(found), law, size, voxel_um)
