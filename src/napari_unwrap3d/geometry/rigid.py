"""Rigid motions of space: a rotation and a shift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

# Rotations that turn no point of a cell by a thousandth of a voxel count as none.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Rigid:
    """The motion ``x ↦ rotation @ x + translation`` of points (z, y, x) in µm.

    Attributes
    ----------
    rotation : ndarray, (3, 3)
        Proper.
    translation : ndarray, (3,)
        In µm.
    """

    rotation: Floats = field(default_factory=lambda: np.eye(3))
    translation: Floats = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def about(cls, centre: npt.ArrayLike, rotation: npt.ArrayLike, shift: npt.ArrayLike) -> Rigid:
        """A rotation about a point in µm, and a shift in µm after it."""
        point, turn = np.asarray(centre, float), np.asarray(rotation, float)
        return cls(turn, point - turn @ point + np.asarray(shift, float))

    @classmethod
    def from_list(cls, values: Sequence[float]) -> Rigid:
        """Undo :meth:`to_list`."""
        numbers = np.asarray(values, dtype=np.float64)
        return cls(numbers[:9].reshape(3, 3), numbers[9:12])

    def to_list(self) -> list[float]:
        """The nine entries of the rotation, row by row, and the translation."""
        return [float(x) for x in (*self.rotation.ravel(), *self.translation)]

    def apply(self, points: npt.ArrayLike) -> Floats:
        """Where points (..., 3) in µm go."""
        moved: Floats = np.asarray(points, float) @ self.rotation.T + self.translation
        return moved

    def inverse(self) -> Rigid:
        """The motion back."""
        return Rigid(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, first: Rigid) -> Rigid:
        """The motion that does `first`, then this one."""
        return Rigid(self.rotation @ first.rotation, self.apply(first.translation))

    @property
    def turns(self) -> bool:
        """Whether it is more than a shift."""
        return bool(np.abs(self.rotation - np.eye(3)).max() > SAME)

    @property
    def is_identity(self) -> bool:
        return not self.turns and not self.translation.any()

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation in degrees."""
        # From the skew part, which small angles do not lose to rounding.
        skew = self.rotation - self.rotation.T
        sine = np.sqrt(skew[2, 1] ** 2 + skew[0, 2] ** 2 + skew[1, 0] ** 2) / 2
        return float(np.degrees(np.arctan2(sine, (np.trace(self.rotation) - 1) / 2)))
