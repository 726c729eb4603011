"""A movie of one simulated cell: its frames, made one by one, and the truth of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Mask, Stack, Volume
from ..errors import FileFormatError, InputError, ParameterError
from ..geometry.interpolate import sample_linear
from ..geometry.rigid import Rigid
from ..progress import Progress
from .courses import Lifetimes, SignalLaw
from .moments import LivingCell, Moment, Row
from .recording import Recording, Texture

if TYPE_CHECKING:
    import pandas as pd

MOMENTS_IN_MEMORY = 2
# The first shows the outline of the cell.
CHANNELS = {
    "blebs": ("membrane", "septin"),
    "ruffles": ("CyOFP1", "actin"),
    "filopodia": ("membrane", "actin"),
}


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
    curvature : Volume, float32
        Near the surface: the mean curvature in 1/µm that protrusions add to it, as the signal
        follows it (with the movie's lag).
    pose : Rigid
        From this timepoint's world to the cell's own, which is that of timepoint 0.
    protrusions : pandas.DataFrame
        One row for each protrusion that stands on the body: `id`, `height_um` (of a filopodium
        its length), `speed_um_per_min`, `z_um`, `y_um`, `x_um` in the cell's own world. Of blebs
        and filopodia the speed is that of the top (positive: it grows), and `curvature_per_um`
        and `signal` are those on it; of ruffles it is that along the bottom of the cell, and
        `radius_um` and `azimuth_rad` say where they are over the bottom.
    """

    timepoint: int
    time_s: float
    mask: Mask
    body: Mask
    labels: Volume
    signal: Volume
    curvature: Volume
    pose: Rigid
    protrusions: pd.DataFrame


@dataclass(frozen=True, eq=False)
class Floor:
    """The plane on which a cell stands, in the cell's own world.

    Attributes
    ----------
    point : ndarray, (3,)
        (z, y, x) in µm.
    normal : ndarray, (3,)
        Unit vector, up into the cell.
    """

    point: Floats
    normal: Floats


@dataclass(frozen=True, eq=False)
class SimulatedMovie:
    """A movie and its truth.

    The cell has a world of its own, which does not move: the world of timepoint 0. Frames are
    made when they are asked for, each by itself, and are the same in whatever order.

    Attributes
    ----------
    kind : str
    seed : int
    cell : LivingCell
        Everything that happens, in the cell's own world.
    poses : tuple of Rigid
        From the cell's own world to that of every timepoint.
    texture : Texture
    recording : Recording
    time_step_s : float
    floor : Floor or None
        The flat bottom of the cell.
    lifetimes : Lifetimes or None
        What the lifetimes of blebs were drawn from.
    rates : mapping of str to float
        The speeds and rates of the kind of movie, by the names of the arguments.
    key : str
        Hash of everything that it is made from.
    """

    kind: str
    seed: int
    cell: LivingCell
    poses: tuple[Rigid, ...]
    texture: Texture
    recording: Recording
    time_step_s: float
    floor: Floor | None
    lifetimes: Lifetimes | None
    rates: Mapping[str, float]
    key: str
    _moments: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_moments", lru_cache(MOMENTS_IN_MEMORY)(self._moment))

    def __reduce__(self) -> Any:
        # Without the frames in memory.
        return type(self), tuple(getattr(self, one.name) for one in fields(self) if one.init)

    def __len__(self) -> int:
        return len(self.poses)

    # What is recorded ---------------------------------------------------------------

    @property
    def law(self) -> SignalLaw:
        """How the signal follows the curvature: its lag, sign, correlation and contrast."""
        return self.cell.law

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
            name=f"simulated-{self.key}",
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
        dyes = self.cell.dyes(moment, self.poses[timepoint], self.texture)
        return self.recording.image(dyes, timepoint)

    def frames(self) -> Iterator[tuple[npt.NDArray[np.uint16], FrameTruth]]:
        """The counts (c, z, y, x) and the truth of every timepoint, one after another."""
        for timepoint in range(len(self)):
            yield self.frame(timepoint), self.truth(timepoint)

    def write(self, path: str | Path, progress: Progress | None = None) -> Path:
        """Write the stack as OME-Zarr, frame by frame.

        Parameters
        ----------
        path : path
            Ends in ``.zarr``, best in ``.ome.zarr``.
        progress : Progress, optional

        Raises
        ------
        FileFormatError
            The name is that of another kind of file.
        """
        from ..files.ome_zarr import write_ome_zarr

        if Path(path).suffix.lower() != ".zarr":
            raise FileFormatError(
                f"A movie is written as OME-Zarr, not as {Path(path).name}.",
                hint="Choose a name that ends in .ome.zarr.",
            )
        stack = self.stack
        return write_ome_zarr(
            path,
            stack.data,
            stack.axes,
            sizes=dict(zip("zyx", stack.voxel_size, strict=True)),
            time_step=stack.time_step,
            channels=stack.channels,
            progress=progress,
        )

    # What is known ------------------------------------------------------------------

    @property
    def times_s(self) -> Floats:
        """Seconds (T,) since the first timepoint."""
        return np.arange(len(self), dtype=float) * self.time_step_s

    def truth(self, timepoint: int) -> FrameTruth:
        """What is known of one timepoint.

        Raises
        ------
        InputError
            There is no such timepoint.
        """
        import pandas as pd

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
            curvature=Volume(moment.curvature, voxel),
            pose=self.poses[timepoint].inverse(),
            protrusions=pd.DataFrame(self.cell.state(time_s)),
        )

    @property
    def protrusions(self) -> pd.DataFrame:
        """One row for each protrusion that is there in the movie.

        `id`, `birth_s` (may lie before the movie), `peak_s`, `end_s` (may lie after it),
        `lifetime_s`, `cycles`, `height_um` at the peak, `complete` (it is born and ends within
        the movie), and `z_um`, `y_um`, `x_um` in the cell's own world: of its foot on the body,
        of a ruffle that of its middle at the peak. Blebs and filopodia have a `site` (the same
        for those that grow one after another at one place), filopodia
        `extension_um_per_min` and `retraction_um_per_min`, ruffles `speed_um_per_min` and
        `merged_into` (the id of the one that it becomes part of, or 0).
        """
        return self._table(self.cell.lives())

    @property
    def events(self) -> pd.DataFrame:
        """One row for each cycle of extension and retraction of each protrusion.

        As :attr:`protrusions`, with the number of the `cycle`; `birth_s`, `peak_s`, `end_s`,
        `lifetime_s` and `height_um` are those of the cycle.
        """
        return self._table(self.cell.cycles())

    @property
    def courses(self) -> pd.DataFrame:
        """One row for each protrusion and timepoint: `timepoint`, `time_s`, and its state.

        The columns are those of the protrusions of :meth:`truth`.
        """
        import pandas as pd

        rows = [
            {"timepoint": timepoint, "time_s": float(time_s), **row}
            for timepoint, time_s in enumerate(self.times_s)
            for row in self.cell.state(float(time_s))
        ]
        return pd.DataFrame(rows)

    def body_points(self, count: int) -> BodyPoints:
        """Points that are fixed in the cell, evenly spread over its body."""
        if count < 1:
            raise ParameterError("There is at least one point.", count=count)
        return BodyPoints(
            self.cell.body_points(count), self.poses, self._moments, self.cell.voxel_um
        )

    # Parts --------------------------------------------------------------------------

    def _moment(self, timepoint: int) -> Moment:
        return self.cell.moment(timepoint * self.time_step_s, self.poses[timepoint])

    def _table(self, rows: list[Row]) -> pd.DataFrame:
        """The rows of what is there within the movie."""
        import pandas as pd

        last = float(self.times_s[-1])
        return pd.DataFrame(
            [
                {**row, "complete": bool(row["birth_s"] >= 0 and row["end_s"] <= last)}
                for row in rows
                if row["end_s"] > 0 and row["birth_s"] < last
            ]
        )

    def _check(self, timepoint: int) -> None:
        if not 0 <= timepoint < len(self):
            raise InputError(
                f"There is no timepoint {timepoint}.",
                timepoints=len(self),
                hint=f"Timepoints are counted from 0 to {len(self) - 1}.",
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
        index = self.at(timepoint) / self._voxel_um
        level = sample_linear(self._moments(timepoint).field, index)
        return np.asarray(np.abs(level) < 0.5 * self._voxel_um)


def _place(point: Floats) -> dict[str, float]:
    return {"z_um": float(point[0]), "y_um": float(point[1]), "x_um": float(point[2])}


def _frame_of_block(timepoints: Any, movie: SimulatedMovie) -> Any:
    return movie.frame(int(timepoints[0]))[None]
