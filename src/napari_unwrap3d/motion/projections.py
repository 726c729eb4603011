"""Surface-limited projections of all timepoints of a movie, on the same pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..charts import Floats, Stack
from ..errors import InputError
from ..imaging.register import Registered
from ..imaging.roi import channel_index, chosen_volume
from ..imaging.surface_projection import (
    REACH_UM,
    Axis,
    Statistic,
    SurfaceProjection,
    box_around,
    surface_projection,
)
from ..progress import Progress, silent
from .stages import MovieWork
from .timelapse import Timelapse

if TYPE_CHECKING:
    from .movie import Movie


@dataclass(frozen=True, eq=False)
class Projections:
    """Projects any timepoint of a movie; all images have the same extent.

    Attributes
    ----------
    work : MovieWork
        With the stack of intensities.
    channel : int or str
    reach_um : float
        On both sides of the surface.
    axis : "z", "y" or "x"
    statistic : "max" or "mean"
    box : ndarray, (2, 3)
        What is shown, in µm of the common world.
    """

    work: MovieWork
    channel: int | str
    reach_um: float
    axis: Axis
    statistic: Statistic
    box: Floats

    @classmethod
    def of(
        cls,
        movie: Movie,
        channel: int | str = 0,
        reach_um: float = REACH_UM,
        axis: Axis = "z",
        *,
        statistic: Statistic = "max",
        stack: Stack | None = None,
        progress: Progress | None = None,
    ) -> Projections:
        """Look where the cell is at all timepoints.

        Parameters
        ----------
        movie : Movie
        channel, reach_um, axis, statistic
            See :func:`~napari_unwrap3d.imaging.surface_projection.surface_projection`.
        stack : Stack, optional
            What the movie was made from, where it was opened without it.
        progress : Progress, optional

        Raises
        ------
        InputError
            The movie's source is not known, or has no intensities.
        ParameterError
            There is no such channel.
        """
        work = movie.work
        if stack is not None:
            work = MovieWork(Timelapse.of(stack, movie.time_step_s), movie.parameters, movie.folder)
        first = None if work is None else work.lapse.at(0)
        if work is None or not isinstance(first, Stack):
            raise InputError(
                "A projection needs the stack that the movie was made from.",
                hint="Give it, or open the movie with it (`--stack FILE`).",
            )
        if len(work.lapse) != len(movie):
            raise InputError(
                "The stack is not that of the movie.",
                stack_timepoints=len(work.lapse),
                movie_timepoints=len(movie),
            )
        channel_index(first, channel)
        report = progress or silent()
        boxes = []
        for timepoint in range(len(movie)):
            report(timepoint / len(movie), "where the cell is")
            boxes.append(box_around(movie.folder.mask(timepoint)[0], reach_um))
        corners = np.array(boxes)
        box = np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
        return cls(work, channel, float(reach_um), axis, statistic, box)

    def at(self, timepoint: int, progress: Progress | None = None) -> SurfaceProjection:
        """The projection of one timepoint, in the common world.

        Raises
        ------
        InputError
            There is no such timepoint, or the cell lies outside of the stack.
        """
        source = self.work.lapse.at(timepoint)
        assert isinstance(source, Stack)
        registered: Registered = self.work.registered(timepoint)
        mask, _ = self.work.folder.mask(timepoint)
        return surface_projection(
            chosen_volume(source, 0, self.channel),
            source.voxel_size,
            mask,
            self.reach_um,
            self.axis,
            statistic=self.statistic,
            pose=registered.of_channel(channel_index(source, self.channel)),
            box=self.box,
            progress=progress,
        )

    def all(self, progress: Progress | None = None) -> Iterator[SurfaceProjection]:
        """Every timepoint in order."""
        report = progress or silent()
        count = len(self.work.lapse)
        for timepoint in range(count):
            yield self.at(timepoint, report.part(timepoint / count, (timepoint + 1) / count))
