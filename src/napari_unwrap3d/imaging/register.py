"""Registration: the rigid motion of every timepoint onto the first, and between channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..charts import Volume
from ..geometry.rigid import Rigid
from ..parameters import RegistrationParameters
from ..progress import Progress


@dataclass(frozen=True, eq=False)
class Registered:
    """Where one timepoint lies in the common world.

    Attributes
    ----------
    pose : Rigid
        From the world of the channel that shows the outline to the common one.
    channels : mapping of int to Rigid
        From the world of another channel to that channel's; absent: the same world.
    numbers : mapping
        ``shift_um`` (of the cell's middle), ``angle_deg``, ``residual_before``, ``residual``
        (1 − correlation) and whatever else was measured, JSON-able.
    """

    pose: Rigid = field(default_factory=Rigid)
    channels: Mapping[int, Rigid] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def of_channel(self, channel: int) -> Rigid:
        """From the world of a channel to the common one; the intensities move once."""
        other = self.channels.get(channel)
        return self.pose if other is None else self.pose @ other

    def to_plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "pose": self.pose.to_list(),
            "channels": {str(c): pose.to_list() for c, pose in self.channels.items()},
            "numbers": dict(self.numbers),
        }

    @classmethod
    def from_plain(cls, values: Mapping[str, Any]) -> Registered:
        """Undo :meth:`to_plain`."""
        return cls(
            Rigid.from_list(values["pose"]),
            {int(c): Rigid.from_list(pose) for c, pose in values["channels"].items()},
            dict(values["numbers"]),
        )


def register(
    fixed: Volume, moving: Volume, parameters: RegistrationParameters, progress: Progress
) -> tuple[Rigid, dict[str, Any]]:
    """The motion that brings one volume onto another, and what was measured.

    Parameters
    ----------
    fixed, moving : Volume
        Of any voxel size, each in its own world.
    parameters : RegistrationParameters
    progress : Progress
    """
    return Rigid(), {}
