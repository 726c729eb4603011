"""A movie of one simulated cell: the stack, made frame by frame, and the truth of each frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Mask, Size3, Stack, Volume, check_voxel_size
from ..errors import InputError, ParameterError
from ..geometry.rigid import Rigid
from ..progress import Progress, silent
from .blebbing import Blebbing, blebbing_cell
from .bodies import Body, StandingBody, draw_body, fibonacci_directions
from .cells import SMALLEST
from .courses import Lifetimes, SignalLaw
from .drifting import draw_poses
from .growing import GrowingCell, Moment
from .microscope import Microscope, fluorescence
from .recording import Recording, Texture, cortical
from .room import Room
from .scenes import FIELD_OF_VIEW_UM, MARGIN_VOXELS

if TYPE_CHECKING:
    import pandas as pd

MOVIES = ("blebs",)
CHANNELS = {"blebs": ("membrane", "septin")}
TIME_STEPS_S = {"blebs": 1.21}
LAWS = {"blebs": SignalLaw(lag_s=6.0, sign=-1, correlation=0.9, contrast=0.6)}
REACH_UM = {"blebs": 1.7}
MOMENTS_IN_MEMORY = 2


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """What is known of one timepoint, in the world of its stack.

    Attributes
    ----------
    timepoint : int
    time_s : float
    mask : Mask
        The cell on the isotropic working grid.
    body : Mask
        The cell without its protrusions.
    labels : Volume, int32
        In the voxels of `mask` outside `body` the identity of the protrusion, else 0. A
        protrusion has the same at all timepoints.
    signal : Volume, float32
        Near the surface: the signal that the second channel shows in the cortex, before
        bleaching and optics; of mean 1. Sample it at vertices by linear interpolation.
    pose : Rigid
        From this timepoint's world to the cell's own, which is that of timepoint 0.
    protrusions : pandas.DataFrame
        One row for each protrusion that stands on the body: `id`, `height_um`,
        `speed_um_per_s` of its top, `curvature_per_um` of its surface, `signal` on it.
    """

    timepoint: int
    time_s: float
    mask: Mask
    body: Mask
    labels: Volume
    signal: Volume
    pose: Rigid
    protrusions: pd.DataFrame


@dataclass(frozen=True, eq=False)
class SimulatedMovie:
    """A movie and its truth.

    The cell has a world of its own, which does not move: the world of timepoint 0. Frames are
    made when they are asked for, each by itself, and are the same in whatever order.

    Attributes
    ----------
    kind : str
    seed : int
    cell : GrowingCell
        Everything that happens, in the cell's own world.
    poses : tuple of Rigid
        From the cell's own world to that of every timepoint.
    texture : Texture
    recording : Recording
    time_step_s : float
    floor_normal : ndarray, (3,), or None
        Up from the flat bottom of the cell, in the cell's own world.
    lifetimes : Lifetimes
        What the lifetimes of the protrusions were drawn from.
    """

    kind: str
    seed: int
    cell: GrowingCell
    poses: tuple[Rigid, ...]
    texture: Texture
    recording: Recording
    time_step_s: float
    floor_normal: Floats | None
    lifetimes: Lifetimes
    _moments: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_moments", lru_cache(MOMENTS_IN_MEMORY)(self._moment))

    def __reduce__(self) -> Any:
        return (type(self), tuple(getattr(self, name) for name in _FIELDS))

    def __len__(self) -> int:
        return len(self.poses)

    # What is recorded ---------------------------------------------------------------

    @property
    def channels(self) -> tuple[str, ...]:
        return CHANNELS[self.kind]

    @property
    def stack(self) -> Stack:
        """``tczyx``, uint16 camera counts; voxel (0, 0, 0) is centred on the origin.

        A dask array with one chunk per timepoint, which is simulated when it is read.
        """
        import dask.array

        shape = self.frame_shape
        # dask declares no types.
        map_blocks: Any = dask.array.map_blocks
        data = map_blocks(
            _frame_of_block,
            dask.array.arange(len(self), chunks=1),
            movie=self,
            chunks=((1,) * len(self), *((n,) for n in shape)),
            new_axis=[1, 2, 3, 4],
            dtype=np.uint16,
            meta=np.empty((0,) * 5, np.uint16),
        )
        name = f"{self.kind} {self.seed}"
        return Stack(
            data, "tczyx", self.recording.voxel_size, self.time_step_s, self.channels, name
        )

    @property
    def frame_shape(self) -> tuple[int, int, int, int]:
        """(c, z, y, x) of every timepoint."""
        extent = (self.cell.size - 1) * self.cell.voxel_um
        z, y, x = (int(np.floor(extent / v + 1e-9)) + 1 for v in self.recording.voxel_size)
        return len(self.channels), z, y, x

    def frame(self, timepoint: int) -> npt.NDArray[np.uint16]:
        """Camera counts (c, z, y, x) of one timepoint.

        Raises
        ------
        InputError
            There is no such timepoint.
        """
        self._check(timepoint)
        moment = self._moments(timepoint)
        return self.recording.image(self._dyes(moment, self.poses[timepoint]), timepoint)

    def frames(self) -> Iterator[tuple[npt.NDArray[np.uint16], FrameTruth]]:
        """The counts (c, z, y, x) and the truth of every timepoint, one after another."""
        for timepoint in range(len(self)):
            yield self.frame(timepoint), self.truth(timepoint)

    # What is known ------------------------------------------------------------------

    @property
    def times_s(self) -> Floats:
        """Seconds (T,) since the first timepoint."""
        return np.arange(len(self)) * self.time_step_s

    def truth(self, timepoint: int) -> FrameTruth:
        """What is known of one timepoint.

        Raises
        ------
        InputError
            There is no such timepoint.
        """
        self._check(timepoint)
        moment = self._moments(timepoint)
        voxel = (self.cell.voxel_um,) * 3
        time_s = timepoint * self.time_step_s
        return FrameTruth(
            timepoint=timepoint,
            time_s=time_s,
            mask=Mask(moment.mask, voxel),
            body=Mask(moment.body, voxel),
            labels=Volume(moment.labels, voxel),
            signal=Volume(moment.signal, voxel),
            pose=self.poses[timepoint].inverse(),
            protrusions=self._state(time_s),
        )

    @property
    def protrusions(self) -> pd.DataFrame:
        """One row for each protrusion that is there in the movie.

        `id`, `site`, `birth_s` (may lie before the movie), `end_s` (may lie after it),
        `lifetime_s`, `cycles`, `peak_s`, `height_um` at the peak, `complete` (it is born and
        ends within the movie), `z_um`, `y_um`, `x_um` of its foot in the cell's own world.
        """
        import pandas as pd

        last = float(self.times_s[-1])
        rows = [
            {
                "id": one.identity,
                "site": one.site,
                "birth_s": one.course.birth_s,
                "peak_s": one.course.peak_s,
                "end_s": one.course.end_s,
                "lifetime_s": one.course.lifetime_s,
                "cycles": len(one.course.cycles),
                "height_um": one.former.height_um,
                "complete": one.course.birth_s >= 0 and one.course.end_s <= last,
                **_place(one.base_um),
            }
            for one in self.cell.protrusions
            if one.course.end_s > 0 and one.course.birth_s < last
        ]
        return pd.DataFrame(rows)

    @property
    def events(self) -> pd.DataFrame:
        """One row for each cycle of extension and retraction of each protrusion.

        `id` and `cycle` of the protrusion, `birth_s`, `peak_s` and `end_s` of the cycle, its
        `lifetime_s`, `height_um` at its peak, `z_um`, `y_um`, `x_um` of the protrusion's foot
        in the cell's own world.
        """
        import pandas as pd

        last = float(self.times_s[-1])
        rows = [
            {
                "id": one.identity,
                "cycle": number,
                "birth_s": cycle.begin_s,
                "peak_s": cycle.peak_s,
                "end_s": cycle.end_s,
                "lifetime_s": cycle.end_s - cycle.begin_s,
                "height_um": cycle.peak * one.former.height_um,
                **_place(one.base_um),
            }
            for one in self.cell.protrusions
            for number, cycle in enumerate(one.course.cycles)
            if cycle.end_s > 0 and cycle.begin_s < last
        ]
        return pd.DataFrame(rows)

    def body_points(self, count: int) -> BodyPoints:
        """Points that are fixed in the cell, evenly spread over its body."""
        if count < 1:
            raise ParameterError("There is at least one point.", count=count)
        points = self.cell.body.surface(fibonacci_directions(count))
        return BodyPoints(points, self.poses, self._moments, self.cell.voxel_um)

    # Parts --------------------------------------------------------------------------

    def _moment(self, timepoint: int) -> Moment:
        return self.cell.moment(timepoint * self.time_step_s, self.poses[timepoint])

    def _dyes(self, moment: Moment, pose: Rigid) -> tuple[Any, ...]:
        body, voxel = self.cell.body, self.cell.voxel_um
        nucleus = pose.apply(body.centre), 0.5 * float(body.semi_axes.min())
        texture = self.texture.on_grid(self.cell.size, voxel, pose)
        return (
            fluorescence(moment.field, texture, voxel, nucleus),
            cortical(moment.field, moment.signal, voxel),
        )

    def _state(self, time_s: float) -> pd.DataFrame:
        import pandas as pd

        law, step = self.cell.law, 0.01
        alive = self.cell.alive(time_s)
        return pd.DataFrame(
            {
                "id": [one.identity for one in alive],
                "height_um": [float(one.height_um(time_s)) for one in alive],
                "speed_um_per_s": [
                    float(one.height_um(time_s + step) - one.height_um(time_s - step)) / (2 * step)
                    for one in alive
                ],
                "curvature_per_um": [float(one.curvature(time_s)) for one in alive],
                "signal": [1 + law.sign * law.contrast * float(one.lead(time_s)) for one in alive],
            }
        )

    def _check(self, timepoint: int) -> None:
        if not 0 <= timepoint < len(self):
            raise InputError(
                f"There is no timepoint {timepoint}.",
                timepoints=len(self),
                hint=f"Timepoints are counted from 0 to {len(self) - 1}.",
            )


_FIELDS = (
    "kind",
    "seed",
    "cell",
    "poses",
    "texture",
    "recording",
    "time_step_s",
    "floor_normal",
    "lifetimes",
)


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """Points that are fixed in the cell.

    Attributes
    ----------
    points : ndarray, (n, 3)
        (z, y, x) in µm on the body, in the cell's own world.
    """

    points: Floats
    _poses: tuple[Rigid, ...]
    _moments: Any
    _voxel_um: float

    def at(self, timepoint: int) -> Floats:
        """Where they lie (n, 3) in µm in the world of a timepoint."""
        return self._poses[timepoint].apply(self.points)

    def free(self, timepoint: int) -> npt.NDArray[np.bool_]:
        """Which of them (n,) lie on the cell's surface then: no protrusion covers them."""
        from ..geometry.interpolate import sample_linear

        index = self.at(timepoint) / self._voxel_um
        level = sample_linear(self._moments(timepoint).field, index)
        return np.asarray(np.abs(level) < 0.5 * self._voxel_um)


def _place(point: Floats) -> dict[str, float]:
    return {"z_um": float(point[0]), "y_um": float(point[1]), "x_um": float(point[2])}


def _frame_of_block(timepoints: Any, movie: SimulatedMovie) -> Any:
    return movie.frame(int(timepoints[0]))[None]


def movie(
    kind: str = "blebs",
    seed: int = 0,
    *,
    timepoints: int = 60,
    size: int = 128,
    voxel_size: Size3 = (0.3, 0.15, 0.15),
    working_voxel_um: float = 0.15,
    time_step: float | None = None,
    drift_um: float = 0.5,
    rotation_deg: float = 0.0,
    bleaching: float = 0.3,
    depth_decay: float = 0.0,
    tilt_deg: float | None = None,
    lag_s: float | None = None,
    correlation: float | None = None,
    lifetimes: Lifetimes | None = None,
    births_per_um2_per_min: float = 0.5,
    microscope: Microscope | None = None,
    progress: Progress | None = None,
) -> SimulatedMovie:
    """Simulate a movie of one cell; its frames are made when they are read."""
    stack_voxel = check_voxel_size(voxel_size)
    report = progress or silent()
    report(0.0, "Drawing the cell")
    rng = np.random.default_rng([seed, MOVIES.index(kind), 77])
    law = LAWS[kind]
    law = SignalLaw(
        law.lag_s if lag_s is None else lag_s,
        law.sign,
        law.correlation if correlation is None else correlation,
        law.contrast,
    )
    step = TIME_STEPS_S[kind] if time_step is None else time_step
    lifetimes = lifetimes or Lifetimes()

    field_um = (size - 1) * working_voxel_um
    scale = size * working_voxel_um / FIELD_OF_VIEW_UM
    slack = (MARGIN_VOXELS + 1) * working_voxel_um + drift_um
    slack += np.radians(rotation_deg) * field_um / 4
    centre = np.full(3, field_um / 2)
    reach = max(REACH_UM[kind] * scale, 7 * working_voxel_um)
    body: Body = draw_body(rng, centre, field_um / 2 - slack - reach)
    up = None
    if tilt_deg is not None:
        angle = np.radians(tilt_deg)
        up = np.array([-np.cos(angle), np.sin(angle), 0.0])
        body = StandingBody.of(body, up, 0.6)
    room = Room(slack, field_um - slack, 3.5 * working_voxel_um)
    blebbing = Blebbing(lifetimes, births_per_um2_per_min, 0.35, law)
    duration = (timepoints - 1) * step
    cell = blebbing_cell(rng, body, room, blebbing, scale, size, working_voxel_um, duration)
    poses = draw_poses(rng, timepoints, centre, drift_um, rotation_deg)
    texture = Texture.draw(rng)
    recording = Recording(
        microscope or Microscope(),
        working_voxel_um,
        stack_voxel,
        bleaching,
        depth_decay,
        timepoints,
        (seed, MOVIES.index(kind), 78),
    )
    report(1.0)
    return SimulatedMovie(kind, seed, cell, poses, texture, recording, step, up, lifetimes)
