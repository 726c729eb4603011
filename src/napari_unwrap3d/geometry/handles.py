"""Closing or opening each handle of a solid: a topological ball that changes little.

A membrane across a handle's hole adds voxels (:func:`~.topology.seal`), a cut through the
handle itself takes some away. Cuts are found by growing a ball from the deepest voxel
inside the solid through simple points, deepest first: what cannot be added is where the
fronts met around a handle, and there the solid is thinnest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .distance import distance_to
from .simple_points import Solid, change_simple_points
from .topology import MARGIN, fill_cavities, handles, largest_part, seal

Closing = Literal["smaller", "seal", "cut"]
Depth = npt.NDArray[np.float32]

# Membranes and cuts below this are the noise of voxels: closing them is always right.
SMALLEST_CUT = 12
# A cut as wide as this fraction of the body's radius goes through the body itself and would
# leave a sausage, which no sphere shows evenly.
WIDEST_CUT = 0.5
# So many of the largest cuts are decided one by one.
DECIDED_ONE_BY_ONE = 8
# While the rest is sealed, a cut is kept open by so many voxels on either side.
GAP_VOXELS = 3.0
_CORNERS = np.ones((3, 3, 3))


def ball_without_handles(
    solid: Solid, closing: Closing, check: Callable[[], None] = lambda: None
) -> Solid:
    """A topological ball close to a solid: every handle is closed or cut.

    Parameters
    ----------
    solid : ndarray, (z, y, x) bool
        One 26-connected component.
    closing : {"smaller", "seal", "cut"}
        seal: membranes only, so that the ball contains the solid; cut: handles are cut;
        smaller: for each handle what changes fewer voxels, but the body itself is not cut.
        What a cut or a membrane of a few voxels settles is sealed in any case.
    check : callable
        Called between attempts; may raise to cancel.

    Returns
    -------
    ndarray, (z, y, x) bool
        One component, no handle, no cavity, well-composed.

    Raises
    ------
    EmptyMaskError
        `solid` has no voxel.
    """
    sealed = seal(solid)
    full = fill_cavities(solid)
    if closing == "seal" or handles(full) == 0:
        return sealed
    labels, _ = ndimage.label(sealed & ~full, structure=_CORNERS)
    membranes = np.bincount(labels.ravel())[1:]
    membranes = membranes[membranes >= SMALLEST_CUT]
    if len(membranes) == 0:
        return sealed
    check()
    cuts, depth = largest_cuts(full)
    if closing == "cut":
        return _with_cuts(full, depth, cuts)
    cuts = [cut for cut in cuts if cut.sum() < np.pi * (WIDEST_CUT * depth.max()) ** 2]
    if not cuts:
        return sealed
    return _smallest_change(full, depth, cuts, sealed, membranes, check)


def largest_cuts(full: Solid) -> tuple[list[Solid], Depth]:
    """Where a ball that grows inside a filled solid cannot close, largest cut first.

    The second value is the depth in the solid in voxels, `MARGIN` wider on every side.
    """
    padded = np.pad(full, MARGIN)
    depth = distance_to(~padded)
    seed = np.zeros_like(padded)
    seed[np.unravel_index(int(depth.argmax()), depth.shape)] = True
    grown = change_simple_points(seed, padded & ~seed, depth, new_value=True)
    inner = (slice(MARGIN, -MARGIN),) * 3
    labels, count = ndimage.label((padded & ~grown)[inner], structure=_CORNERS)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    largest_first = np.argsort(-sizes, kind="stable")
    cuts = [labels == part + 1 for part in largest_first if sizes[part] >= SMALLEST_CUT]
    return cuts, depth


def _smallest_change(
    full: Solid,
    depth: Depth,
    cuts: list[Solid],
    sealed: Solid,
    membranes: npt.NDArray[np.int64],
    check: Callable[[], None],
) -> Solid:
    """From all sealed or all cut, whichever is closer, decide the largest one by one."""
    chosen = [False] * len(cuts)
    best, change = sealed, _changed(full, sealed)
    every = _with_cuts(full, depth, cuts)
    if _changed(full, every) < change:
        chosen, best, change = [True] * len(cuts), every, _changed(full, every)
    if len(cuts) == 1:
        return best
    for number in range(min(len(cuts), DECIDED_ONE_BY_ONE)):
        size = cuts[number].sum()
        # It can only help to close what takes more than a membrane, and to cut what takes less.
        if size <= membranes.min() if chosen[number] else size >= membranes.max():
            continue
        check()
        other = [use != (k == number) for k, use in enumerate(chosen)]
        used = [cut for cut, use in zip(cuts, other, strict=True) if use]
        attempt = _with_cuts(full, depth, used)
        if _changed(full, attempt) < change:
            chosen, best, change = other, attempt, _changed(full, attempt)
    return best


def _with_cuts(full: Solid, depth: Depth, cuts: list[Solid]) -> Solid:
    """The solid cut at the given places and sealed everywhere else."""
    if not cuts:
        return seal(full)
    # In a gap as thin as a cut, the hull that seal() shrinks would get stuck.
    cut = np.logical_or.reduce(cuts)
    gap = full & (distance_to(cut) <= GAP_VOXELS)
    # What the gap cuts off grows back with it.
    gap = full & ~largest_part(full & ~gap)
    ball = np.pad(seal(full & ~gap), MARGIN)
    room = np.pad(gap & ~cut, MARGIN) & ~ball
    grown = change_simple_points(ball, room, depth, new_value=True)
    inner: npt.NDArray[np.bool_] = grown[(slice(MARGIN, -MARGIN),) * 3]
    return inner


def _changed(full: Solid, ball: Solid) -> int:
    return int((full ^ ball).sum())
