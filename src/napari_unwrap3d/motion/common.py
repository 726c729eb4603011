"""Which common space suits a movie, and why.

Paper, "Individual blebs dynamically recruit Septins": one static space serves where shape
changes lie within the volume that the topography maps; for large changes every timepoint is
unwrapped by itself and aligned to a common reference.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from ..charts import Mask, TemporalMask
from ..geometry.interpolate import sample_linear

MEAN, TIMEPOINT, EACH = "mean", "timepoint", "each"


@dataclass(frozen=True)
class Recommendation:
    """A common space and the reason for it.

    Attributes
    ----------
    method : str
        "mean", "timepoint" or "each".
    reason : str
        In words for the user, with the numbers.
    outside : dict of str to list of float
        For "mean" and "timepoint": of every timepoint, the estimated share of its surface that
        would leave the mapped shell.
    """

    method: str
    reason: str
    outside: dict[str, list[float]]

    def spread(self, timepoints: Sequence[int], count: int) -> Recommendation:
        """With the shares of some of `count` timepoints in their places; NaN for the others."""
        outside = {}
        for name, shares in self.outside.items():
            every = np.full(count, np.nan)
            every[list(timepoints)] = shares
            outside[name] = every.tolist()
        return Recommendation(self.method, self.reason, outside)

    def to_plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {"method": self.method, "reason": self.reason, "outside": self.outside}


def recommend(
    masks: Iterable[Mask], mean: TemporalMask, first: Mask, largest_outside: float
) -> Recommendation:
    """Choose a common space from the masks of all timepoints.

    A timepoint's border leaves the shell where it goes deeper into the solid than the
    topography follows, near the solid's deepest point, or where it is beyond the medial axis
    of the space around; estimated by the signed distance to the solid.

    Parameters
    ----------
    masks : iterable of Mask
        Of every timepoint, read once.
    mean : TemporalMask
    first : Mask
        Of the timepoint that would make the space.
    largest_outside : float
        The share of a surface that may leave the shell.
    """
    solids = {MEAN: _Shell.around(mean), TIMEPOINT: _Shell.around(first)}
    outside: dict[str, list[float]] = {name: [] for name in solids}
    for mask in masks:
        border = np.argwhere(mask.data & ~ndimage.binary_erosion(mask.data))
        points = mask.to_world(border)
        for name, shell in solids.items():
            outside[name].append(shell.share_outside(points))
    worst = {name: max(shares) for name, shares in outside.items()}
    percent = {name: f"{100 * share:.1f} %" for name, share in worst.items()}
    limit = f"{100 * largest_outside:g} %"
    if worst[MEAN] <= largest_outside:
        reason = (
            f"At no timepoint does more than {percent[MEAN]} of the surface leave the shell around "
            f"the temporal mean (limit {limit}); it changes least as protrusions come and go."
        )
        return Recommendation(MEAN, reason, outside)
    if worst[TIMEPOINT] <= largest_outside:
        reason = (
            f"Up to {percent[MEAN]} of the surface leaves the shell around the temporal mean, and "
            f"{percent[TIMEPOINT]} that around the chosen timepoint (limit {limit})."
        )
        return Recommendation(TIMEPOINT, reason, outside)
    reason = (
        f"The shape changes too much for one space: up to {percent[MEAN]} of the surface leaves "
        f"the shell around the temporal mean and {percent[TIMEPOINT]} that around the chosen "
        f"timepoint (limit {limit})."
    )
    return Recommendation(EACH, reason, outside)


# Deeper than this part of the way to its deepest point a solid's own streamlines end.
DEEPEST_FRACTION = 0.85
# Farther outside than this part of the solid's radius, a column is too wide to be true.
FARTHEST_FRACTION = 1.0


@dataclass(frozen=True, eq=False)
class _Shell:
    solid: Mask
    distance: Any
    depth: float
    height: float

    @classmethod
    def around(cls, solid: Mask) -> _Shell:
        inside = ndimage.distance_transform_edt(solid.data)
        outside = ndimage.distance_transform_edt(~solid.data)
        radius = float(np.cbrt(3 * np.count_nonzero(solid.data) / (4 * np.pi)))
        return cls(
            solid,
            (outside - inside).astype(np.float32),
            DEEPEST_FRACTION * float(inside.max()),
            FARTHEST_FRACTION * radius,
        )

    def share_outside(self, points: Any) -> float:
        """Which share of points (n, 3) in µm leaves the shell."""
        index = self.solid.to_index(points)
        found = sample_linear(self.distance, index)
        # Beyond the grid the distance goes on growing.
        over = np.maximum(np.maximum(-index, index - (np.array(self.solid.shape) - 1)), 0)
        found = found + np.linalg.norm(over, axis=1)
        return float(((found < -self.depth) | (found > self.height)).mean())
