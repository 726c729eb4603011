"""A cell from which protrusions grow and into which they retract: blebs and filopodia."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..geometry.rigid import Rigid
from .bodies import Body
from .courses import STEP_S, Course, Follower, SignalLaw, draw_follower
from .microscope import fluorescence
from .moments import Moment, Row, place
from .protrusions import Shape
from .recording import Texture, cortical
from .solids import Field, Union, body_field, shape_field

# The signal follows the curvature of a protrusion on it, and the opposite one of the ring
# around its foot: at these distances from the protrusion in µm, so much of it.
REACH_UM = 0.9
AROUND_UM = (0.0, 0.12, 0.3, 0.55, REACH_UM)
PART = (1.0, 0.0, -0.6, -0.25, 0.0)
LEAST_SIGNAL = 0.05
DERIVATIVE_STEP_S = 0.01


class Former(Protocol):
    """Makes the shape of a protrusion of some size."""

    @property
    def base(self) -> Floats:
        """Its foot (z, y, x) in µm on the body."""
        ...

    @property
    def height_um(self) -> float:
        """Of the largest size above the body; of a filopodium its length."""
        ...

    @property
    def bud(self) -> float:
        """The size at which its foot is as wide as that of the grown one."""
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
    former : Former
    course : Course
    follower : Follower
        The signal that it leads.
    """

    identity: int
    site: int
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
        return self.follower.value(time_s, self.curvature(earlier) / self.largest_curvature)

    @property
    def largest_curvature(self) -> float:
        """In 1/µm: that of the grown protrusion."""
        return float(self.former.curvature(1.0))

    def led(self, time_s: float) -> bool:
        """Whether shape or signal show something of it."""
        return self.course.birth_s < time_s < self.course.end_s + self.follower.law.lag_s


def draw_protrusion(
    rng: np.random.Generator,
    identity: int,
    site: int,
    former: Former,
    course: Course,
    law: SignalLaw,
) -> Protrusion:
    """A protrusion, and the signal that it leads."""
    first, last = course.birth_s, course.end_s + law.lag_s
    times = np.arange(first, last, STEP_S)
    curvature = former.curvature(course.size(times - law.lag_s)) / float(former.curvature(1.0))
    follower = draw_follower(rng, law, (first, last), curvature)
    return Protrusion(identity, site, former, course, follower)


@dataclass(frozen=True, eq=False)
class GrowingCell:
    """A body and the protrusions of a whole movie.

    Attributes
    ----------
    body : Body
        In the cell's own world.
    protrusions : tuple of Protrusion
        In the order of birth.
    law : SignalLaw
    size, voxel_um
        Of the working grid.
    """

    body: Body
    protrusions: tuple[Protrusion, ...]
    law: SignalLaw
    size: int
    voxel_um: float

    def moment(self, time_s: float, pose: Rigid) -> Moment:
        """The cell at a time, where a pose puts it."""
        union = Union.of(body_field(self.body.moved(pose), self.size, self.voxel_um))
        body = union.field < 0
        grid = union.field.shape
        signal, curvature = np.ones_like(union.field), np.zeros_like(union.field)
        for one in self.protrusions:
            if not one.led(time_s):
                continue
            size = float(one.course.size(time_s))
            # The signal stays on the whole foot while the protrusion shrinks, and after it.
            marked = max(size, one.former.bud)
            shape = placed(one.former.shape(marked), pose)
            box, distance = shape_field(shape, grid, self.voxel_um, REACH_UM)
            part = np.interp(distance, AROUND_UM, PART).astype(np.float32)
            curvature[box] += np.float32(one.curvature(time_s)) * part
            if 0 < size < marked:
                shape = placed(one.former.shape(size), pose)
                union.add(one.identity, shape, *shape_field(shape, grid, self.voxel_um))
            elif size > 0:
                union.add(one.identity, shape, box, distance)
            lead = self.law.sign * self.law.contrast * float(one.lead(time_s))
            signal[box] += np.float32(lead) * part
        mask = union.field < 0
        np.maximum(signal, np.float32(LEAST_SIGNAL), out=signal)
        return Moment(union.field, mask, body, union.labels(mask, body), signal, curvature)

    def dyes(self, moment: Moment, pose: Rigid, texture: Texture) -> tuple[Field, Field]:
        """A dye of cytosol and membrane, and one of the cortex that shows the signal."""
        nucleus = pose.apply(self.body.centre), 0.5 * float(self.body.semi_axes.min())
        uneven = texture.on_grid(self.size, self.voxel_um, pose)
        return (
            fluorescence(moment.field, uneven, self.voxel_um, nucleus),
            cortical(moment.field, moment.signal, self.voxel_um),
        )

    def body_points(self, count: int) -> Floats:
        """Points (n, 3) on the body."""
        return self.body.samples(count)

    def state(self, time_s: float) -> list[Row]:
        """What is known of every protrusion that stands on the body at a time."""
        step, law = DERIVATIVE_STEP_S, self.law
        return [
            {
                "id": one.identity,
                "height_um": float(one.height_um(time_s)),
                "speed_um_per_min": float(
                    one.height_um(time_s + step) - one.height_um(time_s - step)
                )
                / (2 * step / 60.0),
                "curvature_per_um": float(one.curvature(time_s)),
                "signal": 1.0 + law.sign * law.contrast * float(one.lead(time_s)),
                **place(one.former.base),
            }
            for one in self.protrusions
            if one.course.size(time_s) > 0
        ]

    def lives(self) -> list[Row]:
        """What is known of every protrusion over its life."""
        return [
            {
                "id": one.identity,
                "site": one.site,
                "birth_s": one.course.birth_s,
                "peak_s": one.course.peak_s,
                "end_s": one.course.end_s,
                "lifetime_s": one.course.lifetime_s,
                "cycles": len(one.course.cycles),
                "height_um": one.former.height_um,
                **one.course.rates(one.former.height_um),
                **place(one.former.base),
            }
            for one in self.protrusions
        ]

    def cycles(self) -> list[Row]:
        """What is known of every cycle of extension and retraction."""
        return [
            {
                "id": one.identity,
                "cycle": number,
                "birth_s": cycle.begin_s,
                "peak_s": cycle.peak_s,
                "end_s": cycle.end_s,
                "lifetime_s": cycle.end_s - cycle.begin_s,
                "height_um": cycle.peak * one.former.height_um,
                **place(one.former.base),
            }
            for one in self.protrusions
            for number, cycle in enumerate(one.course.cycles)
        ]


def placed(shape: Shape, pose: Rigid) -> Shape:
    """A shape of the cell's own world where a pose puts it."""
    return replace(shape, points=pose.apply(shape.points))
