"""Closing the handles, holes and cavities of a solid: genus 0 for every input.

A hull that is a topological ball is shrunk onto the mask, farthest voxels first,
changing only simple points. What cannot be removed are membranes across the handles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..errors import EmptyMaskError, MapError
from .distance import distance_to
from .simple_points import Solid, change_simple_points

# Hulls are tried from tight to wide.
HULL_RADII = (1, 2, 4, 8, 16, 32, 64)
MARGIN = 3


def fill_cavities(solid: Solid) -> Solid:
    """The solid with everything that it encloses (6-connected background) filled."""
    background, count = ndimage.label(~np.pad(solid, 1))
    if count <= 1:
        return solid
    filled: Solid = (background != background[0, 0, 0])[1:-1, 1:-1, 1:-1]
    return filled


def box_around(solid: Solid, margin: int) -> tuple[slice, ...]:
    """The smallest box that holds a solid (not empty), and a margin, within the array."""
    sides = []
    for axis, length in enumerate(solid.shape):
        others = tuple(other for other in range(solid.ndim) if other != axis)
        taken = np.flatnonzero(solid.any(axis=others))
        sides.append(
            slice(max(int(taken[0]) - margin, 0), min(int(taken[-1]) + 1 + margin, length))
        )
    return tuple(sides)


def largest_part(solid: Solid) -> Solid:
    """The largest 26-connected component of a solid."""
    labels, count = ndimage.label(solid, structure=np.ones((3, 3, 3)))
    if count <= 1:
        return solid
    largest: Solid = labels == np.argmax(np.bincount(labels.ravel())[1:]) + 1
    return largest


def largest_parts(labels: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """The same labels (z, y, x), each on its largest 26-connected part only."""
    kept = np.zeros_like(labels)
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is not None:
            kept[box][largest_part(labels[box] == label)] = label
    return kept


def euler_characteristic(solid: Solid) -> int:
    """Euler characteristic of a solid of closed cubes (26-connected).

    For a filled solid of one component it is 1 minus the number of handles.
    """
    padded = np.pad(solid, 1)
    cubes = int(solid.sum())
    planes = [padded]
    total = -cubes
    # Faces, edges and corners belong to the solid when one of their cubes does.
    for axes, sign in (((0,), 1), ((1,), 1), ((2,), 1), ((0, 1), -1), ((0, 2), -1), ((1, 2), -1)):
        total += sign * int(_any_of_neighbors(planes[0], axes).sum())
    total += int(_any_of_neighbors(padded, (0, 1, 2)).sum())
    return total


def _any_of_neighbors(solid: Solid, axes: tuple[int, ...]) -> Solid:
    for axis in axes:
        lower = [slice(None)] * 3
        upper = [slice(None)] * 3
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        solid = solid[tuple(lower)] | solid[tuple(upper)]
    return solid


def handles(solid: Solid) -> int:
    """Number of handles of a filled solid of one component."""
    return 1 - euler_characteristic(solid)


def make_well_composed(solid: Solid, iterations: int = 100) -> Solid:
    """Add voxels until no critical configuration is left; see :mod:`simple_points`."""
    result = solid.copy()
    for _ in range(iterations):
        bad = _critical_blocks(result)
        if not bad.any():
            return result
        # A block is named by its lowest voxel; fill all eight voxels of it.
        grown = np.pad(bad, ((1, 1),) * 3)
        result |= _any_of_neighbors(grown, (0, 1, 2))
    raise MapError(
        "The mask could not be made well-composed.",
        blocks=int(bad.sum()),
        hint="Smooth the mask, or choose a smaller working voxel.",
    )


def is_well_composed(solid: Solid) -> bool:
    """Whether no 2×2×2 block holds a critical configuration."""
    return not _critical_blocks(solid).any()


def _critical_blocks(solid: Solid) -> Solid:
    """(z−1, y−1, x−1) bool: the 2×2×2 blocks with a critical configuration."""
    corner = {
        (i, j, k): solid[
            i : solid.shape[0] - 1 + i, j : solid.shape[1] - 1 + j, k : solid.shape[2] - 1 + k
        ]
        for i in (0, 1)
        for j in (0, 1)
        for k in (0, 1)
    }
    bad = np.zeros(corner[0, 0, 0].shape, bool)
    for axis in range(3):
        for layer in (0, 1):
            a, b, c, d = (corner[_insert(axis, layer, p)] for p in ((0, 0), (1, 1), (0, 1), (1, 0)))
            bad |= (a == b) & (c == d) & (a != c)
    count = sum(value.view(np.uint8) for value in corner.values())
    for p in ((0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)):
        q = (1 - p[0], 1 - p[1], 1 - p[2])
        both, neither = corner[p] & corner[q], ~corner[p] & ~corner[q]
        bad |= ((count == 2) & both) | ((count == 6) & neither)
    return bad


def _insert(axis: int, value: int, others: tuple[int, int]) -> tuple[int, int, int]:
    rest = list(others)
    rest.insert(axis, value)
    return rest[0], rest[1], rest[2]


def seal(mask: Solid) -> Solid:
    """The smallest topological ball around a solid that differs from it only by membranes.

    Parameters
    ----------
    mask : ndarray, (z, y, x) bool
        One 26-connected component.

    Returns
    -------
    ndarray, (z, y, x) bool
        Contains `mask`; one component, no handle, no cavity, well-composed.

    Raises
    ------
    EmptyMaskError
        `mask` has no voxel.
    """
    if not mask.any():
        raise EmptyMaskError("There is nothing to seal: the mask is empty.", voxels=0)
    box = ndimage.find_objects(mask.astype(np.uint8))[0]
    inner = fill_cavities(mask[box])
    if _is_ball(inner) and is_well_composed(np.pad(inner, 1)):
        return _place(inner, box, mask.shape, 0)
    solid = np.pad(inner, MARGIN)
    distance = distance_to(solid)
    hulls = (_hull(distance, radius) for radius in HULL_RADII)
    hull = next((hull for hull in hulls if _is_ball(hull)), _inside(solid.shape))
    ball = change_simple_points(hull, hull & ~solid, distance, new_value=False)
    return _place(ball, box, mask.shape, MARGIN)


def _inside(shape: tuple[int, ...]) -> Solid:
    """Everything but the border of the array, which must stay empty."""
    inside = np.zeros(shape, bool)
    inside[1:-1, 1:-1, 1:-1] = True
    return inside


def _hull(distance: npt.NDArray[np.float32], radius: int) -> Solid:
    """What lies within a radius of the solid, cut off at the border and without cavities."""
    near = (distance <= radius) & _inside(distance.shape)
    return fill_cavities(make_well_composed(fill_cavities(near)) & _inside(distance.shape))


def _is_ball(hull: Solid) -> bool:
    return euler_characteristic(hull) == 1 and ndimage.label(hull)[1] == 1


def _place(part: Solid, box: tuple[slice, ...], shape: tuple[int, ...], pad: int) -> Solid:
    """Put a padded part back into the whole volume; what lies outside must be empty."""
    out = np.zeros(shape, bool)
    source, target = [], []
    for axis in range(3):
        start = box[axis].start - pad
        low, high = max(start, 0), min(start + part.shape[axis], shape[axis])
        source.append(slice(low - start, high - start))
        target.append(slice(low, high))
    out[tuple(target)] = part[tuple(source)]
    if int(out.sum()) != int(part.sum()):
        raise MapError(
            "Sealing the cell needs room outside the volume.",
            voxels_outside=int(part.sum() - out.sum()),
            hint="Give the volume a wider empty border.",
        )
    return out


def sealed_parts(mask: Solid, ball: Solid, *, smallest: int = 1) -> tuple[dict[str, Any], ...]:
    """What closing handles changed, one entry per connected part, largest first.

    Each entry has ``kind`` ("cavity": enclosed by the mask; "membrane": across a handle
    or hole; "cut": through a handle; "contact": a few voxels where the mask touched
    itself at an edge or corner), ``position`` (z, y, x) in voxels and ``voxels``.
    """
    filled = fill_cavities(mask)
    parts: list[dict[str, Any]] = []
    changes = (("cavity", filled & ~mask), ("membrane", ball & ~filled), ("cut", filled & ~ball))
    for kind, changed in changes:
        labels, count = ndimage.label(changed, structure=np.ones((3, 3, 3)))
        if count == 0:
            continue
        index = np.arange(1, count + 1)
        sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
        centres = ndimage.center_of_mass(changed, labels, index)
        for size, centre in zip(sizes, centres, strict=True):
            if size >= smallest:
                name = "contact" if kind != "cavity" and size <= 2 else kind
                position = tuple(float(c) for c in centre)
                parts.append({"kind": name, "position": position, "voxels": int(size)})
    return tuple(sorted(parts, key=lambda part: -part["voxels"]))
