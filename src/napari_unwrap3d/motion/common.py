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
from ..geometry.interpolate import sample_linear, sample_nearest

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
    masks: Iterable[Mask], mean: TemporalMask | None, first: Mask, largest_outside: float
) -> Recommendation:
    """Choose a common space from the masks of all timepoints.

    A timepoint's border leaves the shell where it goes deeper into the solid than the
    topography follows, to near the solid's deepest point, or so far out that columns are wide;
    estimated by the signed distance to the solid. A timepoint that does not hold the deepest
    point leaves the shell as a whole.

    Parameters
    ----------
    masks : iterable of Mask
        Of every timepoint, read once.
    mean : TemporalMask or None
        None where the timepoints have too little in common.
    first : Mask
        Of the timepoint that would make the space.
    largest_outside : float
        The share of a surface that may leave the shell.
    """
    solids = {TIMEPOINT: _Shell.around(first)}
    if mean is not None:
        solids = {MEAN: _Shell.around(mean)} | solids
    outside: dict[str, list[float]] = {name: [] for name in solids}
    for mask in masks:
        for name, shell in solids.items():
            outside[name].append(shell.share_outside(mask))
    worst = {name: max(shares) for name, shares in outside.items()}
    fitting = [name for name, share in worst.items() if share <= largest_outside]
    method = fitting[0] if fitting else EACH
    return Recommendation(method, _reason(method, worst, largest_outside), outside)


def _reason(method: str, worst: dict[str, float], largest_outside: float) -> str:
    """Why a common space suits, in words for the user."""
    limit = f"the limit is {100 * largest_outside:g} %"
    around = {MEAN: "the temporal mean", TIMEPOINT: "the chosen timepoint"}
    if method == MEAN:
        return (
            f"At no timepoint does more than {100 * worst[MEAN]:.1f} % of the surface leave the "
            f"shell around the temporal mean ({limit}); the mean changes least as protrusions come "
            "and go."
        )
    parts = [
        f"{100 * share:.1f} % leaves the shell around {around[name]}"
        for name, share in worst.items()
    ]
    if MEAN not in worst:
        parts.insert(0, "the timepoints have too little in common for a mean")
    said = " and ".join(parts)
    if method == TIMEPOINT:
        return f"Of the surface at the worst timepoint, {said} ({limit})."
    return f"The shape changes too much for one space: {said} ({limit})."


# Deeper than this part of the way to its deepest point a solid's own streamlines end.
DEEPEST_FRACTION = 0.85
# Farther outside than this part of the solid's radius, a column is too wide to be true.
FARTHEST_FRACTION = 1.0


@dataclass(frozen=True, eq=False)
class _Shell:
    solid: Mask
    distance: Any
    core: Any
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
            solid.to_world(np.unravel_index(inside.argmax(), inside.shape)),
            DEEPEST_FRACTION * float(inside.max()),
            FARTHEST_FRACTION * radius,
        )

    def share_outside(self, mask: Mask) -> float:
        """Which share of a mask's border leaves the shell; all where it is beside the core."""
        if not sample_nearest(mask.data, mask.to_index(self.core)[None])[0]:
            return 1.0  # columns start all around the core, so that half of them have no surface
        border = np.argwhere(mask.data & ~ndimage.binary_erosion(mask.data))
        index = self.solid.to_index(mask.to_world(border))
        found = sample_linear(self.distance, index)
        # Beyond the grid the distance goes on growing.
        over = np.maximum(np.maximum(-index, index - (np.array(self.solid.shape) - 1)), 0)
        found = found + np.linalg.norm(over, axis=1)
        return float(((found < -self.depth) | (found > self.height)).mean())
