"""Blebs, lamellipodia and filopodia: how each is told apart, and which a cell has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .instances import Rules

Labels = npt.NDArray[np.int32]

KINDS = ("blebs", "lamellipodia", "filopodia")
# Part of its height that a peak rises over the saddle to a higher one if it is a protrusion of
# its own; and how high the saddle between two peaks over one root may be, as a part of the
# lower one, if they are two. A sheet's edge has lobes, which are no protrusions; filopodia
# that touch with their tips are still two, as each has a root.
JOIN = {"blebs": 0.12, "lamellipodia": 0.25, "filopodia": 0.0}
SPLIT = {"blebs": 0.6, "lamellipodia": 0.4, "filopodia": 0.5}
# How far the foot reaches around what stands over the threshold, as a part of the radius of the
# ball: the necks of blebs are filled by any blur, where the cell is imaged wider than it is.
FOOT = {"blebs": 0.1, "lamellipodia": 0.2, "filopodia": 0.2}
LEAST_FOOT = 2.5  # voxels
LEAST_RISE = 2.0  # voxels
# Of the three extents of a protrusion (square roots of its voxels' second moments).
FLAT = 2.0  # the middle one over the smallest
LONG = 2.5  # the largest one over the smallest


def rules_of(kind: str, threshold: float, join: float | None, split: float | None) -> Rules:
    """The rules for a kind, with what was given in place of its own."""
    own = JOIN[kind] if join is None else join
    return Rules(
        threshold=threshold,
        own=own,
        split=SPLIT[kind] if split is None else split,
        least=LEAST_RISE,
        tips_join=own > 0,
    )


def chosen_kind(tried: Mapping[str, Labels]) -> tuple[str, str]:
    """The kind whose own protrusions are the largest part of all that its rules find.

    Parameters
    ----------
    tried : mapping of str to ndarray, (z, y, x) int32
        The labels by the rules of every kind.

    Returns
    -------
    str, str
        The kind, and the reason.
    """
    if len(tried) == 1:
        return next(iter(tried)), "chosen"
    found = {kind: shapes(labels) for kind, labels in tried.items()}
    if not any(found.values()):
        return KINDS[0], "nothing stands out of the cortex"
    share = {kind: s.count(kind) / max(len(s), 1) for kind, s in found.items()}
    best = max(share, key=lambda kind: share[kind])
    other = ", ".join(f"{kind} {share[kind]:.0%}" for kind in share if kind != best)
    of = f"{found[best].count(best)} of {len(found[best])}"
    return best, f"{of} protrusions have the shape of {best} ({share[best]:.0%}; {other})"


def shapes(labels: Labels) -> list[str]:
    """The kind that each protrusion looks like, by the extents of its voxels."""
    looks = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None:
            continue
        place = np.argwhere(labels[box] == label)
        if len(place) < 4:
            continue
        moments = np.linalg.eigvalsh(np.cov(place.T))
        small, middle, large = np.sqrt(np.maximum(moments, 1 / 12))
        if middle > FLAT * small:
            looks.append("lamellipodia")
        else:
            looks.append("filopodia" if large > LONG * small else "blebs")
    return looks
