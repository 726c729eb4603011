"""A cell from which protrusions grow and into which they retract: blebs and filopodia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..geometry.rigid import Rigid
from .bodies import Body
from .courses import STEP_S, Course, Follower, SignalLaw, draw_follower
from .protrusions import Shape
from .solids import Field, Solid, Union, body_field, shape_field

# The signal follows the curvature of a protrusion on it, and the opposite one of the ring
# around its foot: at these distances from the protrusion in µm, so much of it.
REACH_UM = 0.9
AROUND_UM = (0.0, 0.12, 0.3, 0.55, REACH_UM)
PART = (1.0, 0.0, -0.6, -0.25, 0.0)
LEAST_SIGNAL = 0.05


class Former(Protocol):
    """Makes the shape of a protrusion of some size."""

    @property
    def height_um(self) -> float:
        """Of the largest size above the body."""
        ...

    def shape(self, size: float) -> Shape:
        """In the cell's own world, at a size from 0 to 1 (0: just hidden in the body)."""
        ...

    def curvature(self, size: npt.ArrayLike) -> Floats:
        """Mean curvature in 1/µm on the protrusion, 0 at size 0."""
        ...


@dataclass(frozen=True, eq=False)
class Protrusion:
    """One protrusion over its life.

    Attributes
    ----------
    identity : int
        From 1, in the order of birth; its label in every volume.
    site : int
        Protrusions that grew one after another at one place have the same.
    base_um : ndarray, (3,)
        Its foot (z, y, x) on the body, in the cell's own world.
    former : Former
    course : Course
    follower : Follower
        The signal that it leads.
    """

    identity: int
    site: int
    base_um: Floats
    former: Former
    course: Course
    follower: Follower

    def height_um(self, time_s: npt.ArrayLike) -> Floats:
        return self.former.height_um * self.course.size(time_s)

    def curvature(self, time_s: npt.ArrayLike) -> Floats:
        return self.former.curvature(self.course.size(time_s))

    def lead(self, time_s: npt.ArrayLike) -> Floats:
        """What of its curvature the signal follows now, in parts of the largest curvature."""
        earlier = np.asarray(time_s, float) - self.follower.law.lag_s
        largest = float(self.former.curvature(1.0))
        return self.follower.value(time_s, self.curvature(earlier) / largest)

    def led(self, time_s: float) -> bool:
        """Whether shape or signal show something of it."""
        return self.course.birth_s < time_s < self.course.end_s + self.follower.law.lag_s


def protrusion(
    rng: np.random.Generator,
    identity: int,
    site: int,
    base_um: Floats,
    former: Former,
    course: Course,
    law: SignalLaw,
) -> Protrusion:
    """A protrusion, and the signal that it leads."""
    first, last = course.birth_s, course.end_s + law.lag_s
    times = np.arange(first, last, STEP_S)
    curvature = former.curvature(course.size(times - law.lag_s)) / float(former.curvature(1.0))
    follower = draw_follower(rng, law, (first, last), curvature)
    return Protrusion(identity, site, base_um, former, course, follower)


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
    """

    field: Field
    mask: Solid
    body: Solid
    labels: npt.NDArray[np.int32]
    signal: Field


@dataclass(frozen=True, eq=False)
class GrowingCell:
    """A body and the protrusions of a whole movie.

    Attributes
    ----------
    body : Body
        In the cell's own world.
    protrusions : tuple of Protrusion
    law : SignalLaw
    size, voxel_um
        Of the working grid.
    """

    body: Body
    protrusions: tuple[Protrusion, ...]
    law: SignalLaw
    size: int
    voxel_um: float
    around: tuple[float, ...] = field(default=AROUND_UM)

    def moment(self, time_s: float, pose: Rigid) -> Moment:
        """The cell at a time, where a pose puts it."""
        union = Union.of(body_field(self.body.moved(pose), self.size, self.voxel_um))
        body = union.field < 0
        signal = np.ones_like(union.field)
        for one in self.protrusions:
            if not one.led(time_s):
                continue
            size = float(one.course.size(time_s))
            shape = placed(one.former.shape(size), pose)
            box, distance = shape_field(shape, union.field.shape, self.voxel_um, REACH_UM)
            if distance.size == 0:
                continue
            if size > 0:
                union.add(one.identity, shape, box, distance)
            lead = self.law.sign * self.law.contrast * float(one.lead(time_s))
            signal[box] += np.float32(lead) * np.interp(distance, AROUND_UM, PART).astype("f4")
        mask = union.field < 0
        np.maximum(signal, np.float32(LEAST_SIGNAL), out=signal)
        return Moment(union.field, mask, body, union.labels(mask, body), signal)

    def alive(self, time_s: float) -> Sequence[Protrusion]:
        """The protrusions that stand on the body at a time."""
        return [one for one in self.protrusions if one.course.size(time_s) > 0]

    @cached_property
    def by_identity(self) -> dict[int, Protrusion]:
        return {one.identity: one for one in self.protrusions}


def placed(shape: Shape, pose: Rigid) -> Shape:
    """A shape of the cell's own world where a pose puts it."""
    return replace(shape, points=pose.apply(shape.points))
