"""The cell at every timepoint: its mask in the common world, and the mean of them all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Ints, Mask, Stack, Surface, TemporalMask
from ..errors import InputError, NoMeanError, SeveralCellsError
from ..geometry.rigid import Rigid
from ..imaging.segment import check_mask, segment
from ..imaging.solid import largest_component, with_margin
from ..parameters import Parameters
from ..progress import Progress
from ..unwrapping.solid import closed_mesh, mask_of_mesh
from .timelapse import Source, at_timepoint

# A second piece of the mean with this part of the largest one's volume is another cell.
LARGEST_PIECE = 0.5
# The mean binary volume is meshed at this value (paper, "u-Unwrap3D analysis" of blebs).
MEAN_LEVEL = 0.5


def moved_surface(surface: Surface, pose: Rigid) -> Surface:
    """A mesh in the common world."""
    if pose.is_identity:
        return surface
    return Surface(pose.apply(surface.vertices), surface.faces, surface.fields, surface.report)


def outline(
    source: Source, pose: Rigid, parameters: Parameters, progress: Progress
) -> tuple[Mask, dict[str, Any]]:
    """The cell at one timepoint on the working grid of the common world, and its report.

    Parameters
    ----------
    source : Stack, Mask or Surface
        Of one timepoint.
    pose : Rigid
        Where the timepoint's world lies in the common one; see :func:`segment`.
    parameters : Parameters
    progress : Progress

    Raises
    ------
    Unwrap3DError
        As :func:`segment`, :func:`check_mask` and :func:`mask_of_mesh`.
    """
    chosen = at_timepoint(parameters.stack)
    if isinstance(source, Surface):
        mesh = moved_surface(closed_mesh(source), pose)
        return mask_of_mesh(mesh, chosen.working_voxel_um)
    if isinstance(source, Mask):
        return check_mask(source, chosen, progress, pose)
    assert isinstance(source, Stack)
    return segment(source, chosen, progress, pose)


class MeanOutline:
    """Sums up masks of one working voxel, one by one; memory is that of one volume."""

    def __init__(self) -> None:
        self._counts: npt.NDArray[np.uint16] | None = None
        self._first: Ints = np.zeros(3, np.int64)
        self._edge = 0.0
        self.timepoints = 0

    def add(self, mask: Mask) -> None:
        """Count one more timepoint.

        Raises
        ------
        InputError
            The mask's voxels are not those of the masks before.
        """
        edge = mask.voxel_size[0]
        if self._counts is None:
            self._edge = edge
        if not np.isclose(edge, self._edge, rtol=1e-6):
            raise InputError(
                "The timepoints have different working voxels.",
                first_um=self._edge,
                this_um=edge,
                hint="Set the working voxel (stack.working_voxel_um).",
            )
        # Voxel centres lie at whole multiples of the edge; others are off by less than half.
        first = np.rint(np.asarray(mask.origin) / edge).astype(np.int64)
        stop = first + mask.shape
        if self._counts is None:
            self._counts, self._first = np.zeros(mask.shape, np.uint16), first
        low = np.minimum(self._first, first)
        high = np.maximum(self._first + self._counts.shape, stop)
        before, after = self._first - low, high - self._first - self._counts.shape
        if before.any() or after.any():
            self._counts = np.pad(self._counts, list(zip(before, after, strict=True)))
            self._first = low
        z, y, x = (slice(int(a), int(b)) for a, b in zip(first - low, stop - low, strict=True))
        self._counts[z, y, x] += mask.data
        self.timepoints += 1

    @classmethod
    def of(cls, masks: Iterable[Mask]) -> MeanOutline:
        """The sum of some masks."""
        total = cls()
        for mask in masks:
            total.add(mask)
        return total

    def mask(self) -> TemporalMask:
        """The mean cell: the largest component of what is inside half of the time or more.

        Raises
        ------
        NoMeanError
            There is none, or it is in pieces: the cell is at different places.
        """
        assert self._counts is not None
        mean = self._counts >= MEAN_LEVEL * self.timepoints
        try:
            if mean.any():
                data, _ = largest_component(mean, self._edge**3, LARGEST_PIECE)
                return self.around(data)
        except SeveralCellsError as error:
            raise self._no_mean(mean) from error
        raise self._no_mean(mean)

    def _no_mean(self, mean: npt.NDArray[np.bool_]) -> NoMeanError:
        assert self._counts is not None
        return NoMeanError(
            "The cell moves or changes too much to have a temporal mean.",
            timepoints=self.timepoints,
            inside_half_of_the_time_um3=float(mean.sum()) * self._edge**3,
            inside_at_some_time_um3=float(np.count_nonzero(self._counts)) * self._edge**3,
            hint="Register the timepoints (registration.method), or choose another common space "
            '(movie.common = "each").',
        )

    def around(self, data: npt.NDArray[np.bool_]) -> TemporalMask:
        """A solid on the grid of the sum, with what every timepoint needs of the space."""
        assert self._counts is not None
        z, y, x = (float(i) * self._edge for i in self._first)
        return TemporalMask(
            data,
            (self._edge,) * 3,
            (z, y, x),
            ever=self._counts > 0,
            always=self._counts == self.timepoints,
        )

    def placed(self, mask: Mask) -> TemporalMask:
        """One of the masks that were added, on the grid of the sum."""
        assert self._counts is not None
        data = np.zeros(self._counts.shape, bool)
        tight = with_margin(mask, 0)
        offset = np.rint(np.asarray(tight.origin) / self._edge).astype(np.int64) - self._first
        z, y, x = (slice(int(a), int(a) + n) for a, n in zip(offset, tight.shape, strict=True))
        data[z, y, x] = tight.data
        return self.around(data)
