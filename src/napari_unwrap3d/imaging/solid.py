"""One solid out of a binary volume: components, cavities, and contact with the border."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Mask, Size3
from ..errors import EmptyMaskError, FullMaskError, SeveralCellsError, TouchesBorderError
from .scan import Box, box_of

logger = logging.getLogger(__name__)

Bools = npt.NDArray[np.bool_]

# Room around the cell for the fields of the later steps.
MARGIN_VOXELS = 8
# Contact with the border up to this part of the surface is closed flat and reported; beyond,
# too much of the surface would be invented. What a person outlined is trusted further.
LARGEST_CONTACT_FOUND = 0.25
LARGEST_CONTACT_GIVEN = 2 / 3
MANY_SIDES = 4
SIDE_CONTACT = 0.01
# Chambers that fill this part of the solid are cells behind walls: two or more enclosed ones
# of comparable size, or three or more in half of the slices (walls in images have gaps).
FOAM_FRACTION = 0.25
FOAM_CHAMBERS = 3
FOAM_SLICES = 0.5
SLICES_LOOKED_AT = 32

WHOLE = np.ones((3, 3, 3), dtype=bool)
OTHER_CELLS = (
    "Unwrap one cell at a time: give a label image and its label, a mask of the cell, or a crop "
    "around it."
)


def check_not_trivial(mask: Bools, hint: str) -> None:
    """Raise unless some voxels are in the mask and some are not."""
    inside = int(np.count_nonzero(mask))
    if inside == 0:
        raise EmptyMaskError("No voxel belongs to the cell.", voxels=mask.size, hint=hint)
    if inside == mask.size:
        raise FullMaskError("Every voxel belongs to the cell.", voxels=mask.size, hint=hint)


def largest_component(
    mask: Bools, voxel_um3: float, second_fraction: float
) -> tuple[Bools, dict[str, Any]]:
    """The component with most voxels, connected through faces, edges or corners.

    Returns
    -------
    ndarray
        The component.
    dict
        ``components``, ``dropped_components``, ``dropped_voxels``.

    Raises
    ------
    SeveralCellsError
        A second component has at least this fraction of the largest one's volume.
    """
    labels, count = ndimage.label(mask, structure=WHOLE)
    sizes = np.bincount(labels.ravel())[1:]
    order = np.argsort(sizes)[::-1]
    largest = int(sizes[order[0]])
    if count > 1 and sizes[order[1]] >= second_fraction * largest:
        alike = int((sizes >= second_fraction * largest).sum())
        raise SeveralCellsError(
            f"There are {alike} objects of comparable size; which one is the cell?",
            largest_um3=largest * voxel_um3,
            second_um3=int(sizes[order[1]]) * voxel_um3,
            components=int(count),
            hint=OTHER_CELLS,
        )
    report = {
        "components": int(count),
        "dropped_components": int(count) - 1,
        "dropped_voxels": int(sizes.sum()) - largest,
    }
    return labels == order[0] + 1, report


def cavities(mask: Bools) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """Labels of the cavities that a solid encloses, and their sizes in voxels.

    What reaches the border of the volume is outside.
    """
    labels, count = ndimage.label(~np.pad(mask, 1))
    outside = labels[0, 0, 0]
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[[0, outside]] = 0
    inner = labels[1:-1, 1:-1, 1:-1].astype(np.int32)
    inner[inner == outside] = 0
    return inner, sizes[sizes > 0].astype(np.int64)


def check_walls(mask: Bools, second_fraction: float) -> None:
    """Raise when the solid consists of walls around chambers, as between touching cells.

    The walls of a stained membrane have gaps, so that chambers are rarely enclosed in
    three dimensions, but they are in the slices.

    Raises
    ------
    SeveralCellsError
    """
    _, sizes = cavities(mask)
    alike = int((sizes >= second_fraction * sizes.max()).sum()) if len(sizes) else 0
    enclosed = int(sizes.sum()) / (int(np.count_nonzero(mask)) + int(sizes.sum()))
    if alike > 1 and enclosed >= FOAM_FRACTION:
        raise _walls(chambers=alike, enclosed_fraction=enclosed)
    for axis in range(3):
        slices, chambers, area = _chambers_in_slices(mask, axis)
        if slices >= FOAM_SLICES and area >= FOAM_FRACTION:
            raise _walls(chambers_per_slice=chambers, enclosed_fraction=area)


def _walls(**measured: float) -> SeveralCellsError:
    return SeveralCellsError(
        "What is bright are walls around several chambers, as between touching cells.",
        **measured,
        hint=OTHER_CELLS,
    )


def _chambers_in_slices(mask: Bools, axis: int) -> tuple[float, float, float]:
    """Fraction of slices with three or more chambers, chambers and their area per slice.

    Slices across less than a quarter of the largest area do not count, nor do chambers
    of less than a hundredth of their slice.
    """
    step = -(-mask.shape[axis] // SLICES_LOOKED_AT)
    found = []
    for i in range(0, mask.shape[axis], step):
        plane = mask.take(i, axis)
        labels, _ = ndimage.label(~np.pad(plane, 1))
        sizes = np.bincount(labels.ravel())
        sizes[[0, labels[0, 0]]] = 0
        area = int(np.count_nonzero(plane)) + int(sizes.sum())
        found.append((area, int((sizes > 0.01 * area).sum()), int(sizes.sum())))
    areas, chambers, hollow = np.array(found, dtype=float).T
    large = areas >= 0.25 * areas.max()
    many = float((chambers[large] >= FOAM_CHAMBERS).mean())
    return many, float(chambers[large].mean()), float(hollow[large].sum() / areas[large].sum())


def filled(mask: Bools) -> tuple[Bools, dict[str, Any]]:
    """The solid with its cavities filled; ``filled_cavities`` and ``filled_voxels``."""
    labels, sizes = cavities(mask)
    report = {"filled_cavities": len(sizes), "filled_voxels": int(sizes.sum())}
    return (mask | (labels > 0)) if len(sizes) else mask, report


def sides_at_border(box: Box, shape: tuple[int, ...]) -> Bools:
    """Which sides (3, 2) of a box lie on the border of the image."""
    return np.array([(side.start == 0, side.stop == n) for side, n in zip(box, shape, strict=True)])


def touched_sides(mask: Bools) -> npt.NDArray[np.int64]:
    """Voxels (3, 2) of the mask on the first and last plane along each axis."""
    planes = [[mask.take(i, axis) for i in (0, -1)] for axis in range(3)]
    return np.array([[np.count_nonzero(plane) for plane in pair] for pair in planes])


def check_border(
    contact: npt.NDArray[np.int64],
    mask: Bools,
    contact_voxel: Size3,
    edge: float,
    extent: Floats,
    *,
    given: bool,
) -> dict[str, Any]:
    """Report where the cell is cut by the border of the image, or refuse it.

    A cell that is cut is closed flat there. The fraction of its surface that this
    invents follows from the contact's area and that of the free surface, which is ⅔ of
    the area of its voxel faces (Cauchy: their mean over all orientations).

    Parameters
    ----------
    contact : ndarray, (3, 2)
        Voxels of the cell on each side of the image, 0 for sides that are no border.
    mask : ndarray
        The cell on the working grid.
    contact_voxel : (float, float, float)
        Voxel size in µm on which `contact` was counted.
    edge : float
        Edge of the voxels of `mask` in µm.
    extent : ndarray, (3,)
        Of the image, in µm.
    given : bool
        The cell was given, as a label or mask: then it is refused only when most of its
        surface is cut. What was found in an image is also refused when it reaches four
        or more sides: that is tissue or background, not one cell in the image.

    Raises
    ------
    TouchesBorderError
    """
    faces = np.prod(contact_voxel) / np.asarray(contact_voxel)
    cut = float((contact.sum(axis=1) * faces).sum())
    exposed = sum(int(np.count_nonzero(np.diff(np.pad(mask, 1), axis=axis))) for axis in range(3))
    free = max(exposed * edge**2 - cut, 0.0) * 2 / 3
    fraction = cut / (cut + free) if cut else 0.0
    whole = np.prod(extent) / extent
    sides = int((contact * faces[:, None] > SIDE_CONTACT * whole[:, None]).sum())
    voxels = int(contact.sum())
    many = not given and sides >= MANY_SIDES
    if fraction > (LARGEST_CONTACT_GIVEN if given else LARGEST_CONTACT_FOUND) or many:
        raise TouchesBorderError(
            f"What was found reaches {sides} of the 6 sides of the image."
            if many
            else "Too much of the cell is cut off by the border of the image.",
            border_voxels=voxels,
            border_area_um2=cut,
            fraction_of_surface=fraction,
            sides=sides,
            hint="One cell inside the image has room around it. For tissue or touching cells: "
            f"{OTHER_CELLS[0].lower()}{OTHER_CELLS[1:]} If the background was taken for the cell, "
            "raise the threshold or correct the background."
            if not given
            else "Take a larger field of view around the cell.",
        )
    if voxels:
        logger.warning(
            "the cell touches the border of the image with %d voxels (%.1f %% of its surface); "
            "it is closed flat there",
            voxels,
            100 * fraction,
        )
    closed = [{"what": "voxels were closed flat at the border of the image", "count": voxels}]
    return {
        **({"repairs": closed} if voxels else {}),
        "touches_border_voxels": voxels,
        "border_area_um2": cut,
        "border_fraction": fraction,
        "touched_sides": sides,
    }


def with_margin(mask: Mask, margin: int = MARGIN_VOXELS) -> Mask:
    """The mask cropped to the cell and surrounded by empty voxels, at the same place."""
    box = box_of(mask.data)
    data = np.pad(mask.data[box], margin)
    first = mask.to_world([[side.start - margin for side in box]])[0]
    return Mask(data, mask.voxel_size, (float(first[0]), float(first[1]), float(first[2])))
