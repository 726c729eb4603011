"""What a movie is made from: one cell at several timepoints, read one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..charts import Mask, Stack, Surface
from ..errors import AxesError, InputError
from ..parameters import StackParameters
from ..provenance import content_hash

Source = Stack | Mask | Surface

TIME_HINT = "Give the seconds between two timepoints, e.g. time_step=1.21 or --time-step 1.21."


@dataclass(frozen=True, eq=False)
class Timelapse:
    """One cell at several timepoints, in the order of time.

    Attributes
    ----------
    sources : Stack, or sequence of Stack, Mask or Surface
        A stack with a t axis, or one source for each timepoint, all of one kind; a sequence may
        open them one by one.
    time_step_s : float
        Seconds between two timepoints.
    name : str
    """

    sources: Stack | Sequence[Source]
    time_step_s: float
    name: str = "movie"

    @classmethod
    def of(
        cls,
        source: Stack | Sequence[Source],
        time_step: float | None = None,
        name: str | None = None,
    ) -> Timelapse:
        """Check what is given.

        Parameters
        ----------
        source : Stack with a t axis, or sequence of Stack, Mask or Surface
        time_step : float, optional
            Seconds between two timepoints; of a stack, instead of its own.
        name : str, optional

        Raises
        ------
        InputError
            There are fewer than two timepoints, they are of different kinds, or the time
            between them is not known.
        AxesError
            A stack has no t axis, or one of a sequence has one.
        """
        if isinstance(source, Stack):
            if source.timepoints < 2:
                raise AxesError(
                    "A movie has at least two timepoints, and this stack has one.",
                    axes=source.axes,
                    shape=source.shape,
                    hint="Unwrap it with unwrap(stack), or name its axes, e.g. axes='tzyx'.",
                )
            step = source.time_step if time_step is None else time_step
            return cls(source, _checked_step(step), name or source.name)
        sources = tuple(source)
        kinds = {type(each).__name__ for each in sources}
        if len(sources) < 2 or len(kinds) > 1 or not isinstance(sources[0], Source):
            raise InputError(
                "A movie is a stack with a t axis, or one stack, mask or mesh for each timepoint.",
                timepoints=len(sources),
                kinds=sorted(kinds),
                hint="Give at least two, all of one kind.",
            )
        for each in sources:
            if isinstance(each, Stack) and "t" in each.axes:
                raise AxesError(
                    "The stack of one timepoint has no t axis.",
                    axes=each.axes,
                    hint="Give the whole stack, or one timepoint of each.",
                )
        first = getattr(sources[0], "name", "")
        return cls(sources, _checked_step(time_step), name or first or "movie")

    @classmethod
    def of_lazy(cls, sources: Sequence[Source], time_step: float | None, name: str) -> Timelapse:
        """Of sources that are opened when they are asked for; checked then, one by one.

        Raises
        ------
        InputError
            There are fewer than two timepoints, or the time between them is not known.
        """
        if len(sources) < 2:
            raise InputError("A movie has at least two timepoints.", timepoints=len(sources))
        return cls(sources, _checked_step(time_step), name)

    def __len__(self) -> int:
        return self.sources.timepoints if isinstance(self.sources, Stack) else len(self.sources)

    @property
    def times_s(self) -> Any:
        """Seconds (T,) since the first timepoint."""
        return np.arange(len(self)) * self.time_step_s

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, their numbers where they have none; empty without intensities."""
        first = self.at(0)
        if not isinstance(first, Stack):
            return ()
        count = first.shape[0] if "c" in first.axes else 1
        return first.channels or tuple(str(c) for c in range(count))

    def at(self, timepoint: int) -> Source:
        """The source of one timepoint, without a t axis; still lazy.

        Raises
        ------
        InputError
            There is no such timepoint.
        """
        if not 0 <= timepoint < len(self):
            raise InputError(
                f"There is no timepoint {timepoint}.",
                timepoints=len(self),
                hint=f"Timepoints are counted from 0 to {len(self) - 1}.",
            )
        if not isinstance(self.sources, Stack):
            return self.sources[timepoint]
        axes = self.sources.axes.replace("t", "")
        return replace(self.sources, data=self.sources.data[timepoint], axes=axes, time_step=None)

    def key(self, timepoint: int) -> str:
        """A hash of everything that is known of a timepoint; reads it."""
        source = self.at(timepoint)
        if isinstance(source, Surface):
            return content_hash("surface", source.vertices, source.faces)
        if isinstance(source, Mask):
            return content_hash("mask", source.data, source.voxel_size, source.origin)
        return content_hash("stack", source.axes, source.voxel_size, np.asarray(source.data))


def at_timepoint(parameters: StackParameters) -> StackParameters:
    """The parameters for a source that has one timepoint only."""
    return parameters.model_copy(update={"timepoint": 0})


def _checked_step(seconds: float | None) -> float:
    if seconds is None:
        raise InputError("The time between two timepoints is not known.", hint=TIME_HINT)
    if not (np.isfinite(seconds) and seconds > 0):
        raise InputError(
            "The time between two timepoints is positive.", seconds=float(seconds), hint=TIME_HINT
        )
    return float(seconds)
