"""The signals of one timepoint: which channels, how they are sampled, and their ratios."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Mask, Stack
from ..errors import ParameterError
from ..imaging.register import Registered
from ..imaging.roi import channel_index, chosen_volume
from ..imaging.signal import InwardField, around_cell, surface_signal, whole_cell_mean
from ..parameters import MovieParameters
from ..progress import Progress

PREFIX = "signal_"
ALL = "all"


@dataclass(frozen=True, eq=False)
class Signals:
    """The channels of a stack that are sampled, and the ratios that are made of them.

    Attributes
    ----------
    stack : Stack
        Of one timepoint.
    wanted : tuple of (str, ...)
        One channel, or two whose signals are divided.
    parameters : MovieParameters
    """

    stack: Stack
    wanted: tuple[tuple[str, ...], ...]
    parameters: MovieParameters

    @classmethod
    def chosen(cls, stack: Stack, parameters: MovieParameters) -> Signals:
        """What the parameters name.

        Raises
        ------
        ParameterError
            There is no such channel, or a ratio is not of two.
        """
        text = parameters.signals.strip()
        if text == ALL:
            count = stack.shape[0] if "c" in stack.axes else 1
            names = stack.channels or tuple(str(c) for c in range(count))
            return cls(stack, tuple((name,) for name in names), parameters)
        wanted = []
        for part in filter(None, (item.strip() for item in text.split(","))):
            # A channel may have a name with a slash.
            pair = (part,) if part in stack.channels else tuple(x.strip() for x in part.split("/"))
            if len(pair) > 2:
                raise ParameterError(
                    f"{part!r} is no ratio of two channels.", hint="Write it as 0/1."
                )
            for name in pair:
                channel_index(stack, name)
            wanted.append(pair)
        return cls(stack, tuple(wanted), parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields."""
        return tuple(PREFIX + "_per_".join(pair) for pair in self.wanted)

    def at(
        self, points: Floats, mask: Mask, registered: Registered, progress: Progress
    ) -> dict[str, npt.NDArray[Any]]:
        """The signals under points (n, 3) in µm of the mask's world, by name.

        Parameters
        ----------
        points : ndarray, (n, 3)
        mask : Mask
        registered : Registered
            From the channels' worlds to the mask's: intensities are read, once, where the points
            come from.
        progress : Progress
        """
        if not self.wanted:
            return {}
        field = progress.run(InwardField.of, mask)
        channels = list(dict.fromkeys(name for pair in self.wanted for name in pair))
        found = {}
        for i, name in enumerate(channels):
            part = progress.part((i + 0.2) / len(channels), (i + 1) / len(channels))
            found[name] = self._channel(name, points, mask, field, registered, part)
        return {
            field_name: found[pair[0]] if len(pair) == 1 else _ratio(*(found[n] for n in pair))
            for field_name, pair in zip(self.names, self.wanted, strict=True)
        }

    def _channel(
        self,
        name: str,
        points: Floats,
        mask: Mask,
        field: InwardField,
        registered: Registered,
        progress: Progress,
    ) -> Floats:
        chosen = self.parameters
        pose = registered.of_channel(channel_index(self.stack, name))
        image = around_cell(
            chosen_volume(self.stack, 0, name), self.stack.voxel_size, mask, points, pose
        )
        level = chosen.percentile if chosen.statistic == "percentile" else None
        part = progress.part(0.0, 0.8)
        signal = surface_signal(image, points, field, chosen.depth_um, level, part, pose)
        if chosen.normalize:
            signal = signal / whole_cell_mean(image, mask, progress.part(0.8, 1.0), pose)
        return signal


def _ratio(above: Floats, below: Floats) -> Floats:
    ratio: Floats = above / np.where(below == 0, np.nan, below)
    return ratio
