"""From a stack, a label image or a mask to the mask of one cell on the working grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Mask, Size3, Stack, Volume
from ..errors import InputError
from ..geometry.rigid import Rigid
from ..parameters import StackParameters
from ..progress import Progress, silent
from .deconvolve import chosen_psf, read_deconvolved
from .enhance import Image
from .resample import covered, mask_to_working_grid, own_index, to_working_grid
from .roi import chosen_volume, crop_box, cropped_mask, moved
from .scan import (
    Box,
    Scan,
    box_of,
    box_of_value,
    grown,
    missing_label,
    read_box,
    scan,
)
from .solid import (
    MARGIN_VOXELS,
    WHOLE,
    cavities,
    check_border,
    check_not_trivial,
    check_walls,
    filled,
    largest_component,
    sides_at_border,
    touched_sides,
    with_margin,
)
from .threshold import foreground

THRESHOLD_HINT = "Choose another threshold, channel or timepoint."
MASK_HINT = "A mask is True inside the cell and False outside; check the label or the mask."
# A sample of the image, on which a label image is told from an intensity image.
SAMPLE_EDGE = 96
FLAT_FRACTION = 0.8
PIECES_PER_VALUE = 1.5


def segment(
    stack: Stack,
    parameters: StackParameters | None = None,
    progress: Progress | None = None,
    pose: Rigid | None = None,
) -> tuple[Mask, dict[str, Any]]:
    """Find the cell in a stack.

    The stack is cropped, where that is wanted. An image is then deconvolved, enhanced,
    smoothed, corrected for its background and thresholded; the largest component is kept
    and its cavities are filled. With `label`, that label of a label image is taken as it
    is, and so is a stack of two values, which is a mask. Only the cell's bounding box is
    brought into memory.

    Parameters
    ----------
    stack : Stack
    parameters : StackParameters, optional
    progress : Progress, optional
    pose : Rigid, optional
        Where the stack's world lies in the mask's: of a timepoint, in the first one's. Intensities
        are interpolated once, from the stack's own voxels to the mask's grid.

    Returns
    -------
    Mask
        On the isotropic working grid, with empty voxels on all sides.
    dict
        ``source`` (image, label or mask), ``threshold``, ``components``,
        ``dropped_components``, ``dropped_voxels``, ``filled_cavities``, ``filled_voxels``,
        ``touches_border_voxels``, ``border_area_um2``, ``border_fraction``, ``voxels``,
        ``volume_um3``, ``working_voxel_um``, and the box that was read. With a crop or a
        deconvolution also ``crop``, ``deconvolution`` and ``psf_voxels``.

    Raises
    ------
    EmptyMaskError, FullMaskError
        No voxel, or every voxel, belongs to the cell.
    SeveralCellsError
        A second object of comparable size, or walls around several chambers.
    TouchesBorderError
        Too much of the cell lies on the border of the image.
    NotFiniteError
        NaN or infinite intensities.
    InputError
        The label does not occur, or a label image came without a label.
    ParameterError
        There is no such timepoint, channel or crop.
    """
    chosen = parameters or StackParameters()
    report_to = progress or silent()
    volume = chosen_volume(stack, chosen.timepoint, chosen.channel)
    crop = crop_box(volume.shape, stack.voxel_size, chosen)
    if crop is None:
        return _cell(volume, stack.voxel_size, chosen, report_to, pose)
    if pose is None:
        mask, report = _cell(volume[crop], stack.voxel_size, chosen, report_to)
        return moved(mask, crop, stack.voxel_size), _with_crop(report, crop)
    # First to where the crop lies in the stack, then to where that lies in the mask's world.
    corner = np.array([side.start for side in crop]) * stack.voxel_size
    there = pose @ Rigid(translation=corner)
    mask, report = _cell(volume[crop], stack.voxel_size, chosen, report_to, there)
    return mask, _with_crop(report, crop)


def check_mask(
    mask: Mask,
    parameters: StackParameters | None = None,
    progress: Progress | None = None,
    pose: Rigid | None = None,
) -> tuple[Mask, dict[str, Any]]:
    """Take a mask as it is: largest component, isotropic voxels, room on all sides.

    Parameters
    ----------
    mask : Mask
        Any voxel size and origin.
    parameters : StackParameters, optional
        Of these, `working_voxel_um`, `second_cell_fraction` and the crop matter.
    progress : Progress, optional

    Returns
    -------
    Mask, dict
        As :func:`segment`.

    Raises
    ------
    EmptyMaskError, FullMaskError, SeveralCellsError, TouchesBorderError
        As :func:`segment`.
    """
    chosen = parameters or StackParameters()
    edge = chosen.working_voxel_um or min(mask.voxel_size)
    crop = crop_box(mask.shape, mask.voxel_size, chosen, mask.origin)
    part = mask if crop is None else cropped_mask(mask, crop)
    found, report = _finished_mask(
        part, part.shape, edge, chosen, "mask", progress or silent(), pose=pose
    )
    return found, report if crop is None else _with_crop(report, crop)


def _cell(
    volume: Any,
    voxel_size: Size3,
    parameters: StackParameters,
    progress: Progress,
    pose: Rigid | None = None,
) -> tuple[Mask, dict[str, Any]]:
    """The cell in one volume, taken for a label image, a mask or an image."""
    edge = parameters.working_voxel_um or min(voxel_size)
    if parameters.label is not None:
        return _one_value(volume, voxel_size, edge, parameters, parameters.label, progress, pose)
    psf = chosen_psf(parameters, voxel_size, volume.shape)
    found = scan(volume, voxel_size, progress.part(0.0, 0.3))
    if found.two_values and found.highest > found.lowest:
        return _one_value(volume, voxel_size, edge, parameters, found.highest, progress, pose)
    if _looks_like_labels(volume):
        raise InputError(
            "This looks like a label image, and no label was chosen.",
            highest=found.highest,
            hint="Choose the cell's label (parameter stack.label, or --label).",
        )
    return _image(volume, voxel_size, edge, parameters, found, psf, progress, pose)


def _with_crop(report: dict[str, Any], crop: Box) -> dict[str, Any]:
    """The report with the box in voxels of the whole volume."""
    box = [
        [side.start + first, side.start + last]
        for side, (first, last) in zip(crop, report["box"], strict=True)
    ]
    return {**report, "box": box, "crop": [[side.start, side.stop] for side in crop]}


# Masks and labels --------------------------------------------------------------


def _one_value(
    volume: Any,
    voxel_size: Size3,
    edge: float,
    parameters: StackParameters,
    value: float,
    progress: Progress,
    pose: Rigid | None,
) -> tuple[Mask, dict[str, Any]]:
    """The voxels of one value, as they are."""
    given = parameters.label is not None
    if given and volume.dtype.kind not in "biu":
        raise InputError(
            "A label image holds whole numbers.",
            dtype=str(volume.dtype),
            hint="Convert it to whole numbers, or leave the label empty to segment an image.",
        )
    box = box_of_value(volume, value, progress.part(0.3, 0.5))
    if box is None:
        raise missing_label(volume, int(value))
    around = grown(box, np.ones((3, 2), dtype=np.int64), volume.shape)
    part = read_box(volume, voxel_size, around)
    mask = Mask(part.data == value, part.voxel_size, part.origin)
    kind = "label" if given else "mask"
    return _finished_mask(
        mask, volume.shape, edge, parameters, kind, progress.part(0.5, 1.0), around, pose
    )


def _finished_mask(
    mask: Mask,
    image_shape: tuple[int, ...],
    edge: float,
    parameters: StackParameters,
    kind: str,
    progress: Progress,
    box: Box | None = None,
    pose: Rigid | None = None,
) -> tuple[Mask, dict[str, Any]]:
    if mask.shape == tuple(image_shape):
        check_not_trivial(mask.data, MASK_HINT)
    if box is None:
        box = (slice(0, mask.shape[0]), slice(0, mask.shape[1]), slice(0, mask.shape[2]))
    progress(0.1, "components")
    data, report = progress.run(
        largest_component,
        mask.data,
        float(np.prod(mask.voxel_size)),
        parameters.second_cell_fraction,
    )
    contact = np.where(sides_at_border(box, image_shape), touched_sides(data), 0)
    progress(0.5, "working grid")
    whole = Mask(data, mask.voxel_size, mask.origin)
    working = progress.run(mask_to_working_grid, whole, edge, pose)
    check_not_trivial(working.data, "Choose a smaller working voxel.")
    progress(0.9, "border")
    extent = np.asarray(image_shape) * np.asarray(mask.voxel_size)
    report |= check_border(contact, working.data, mask.voxel_size, edge, extent, given=True)
    _, hollow = cavities(working.data)
    report |= {"source": kind, "enclosed_cavities": len(hollow)}
    return _delivered(working, report, parameters, edge, box)


# Images ------------------------------------------------------------------------


def _image(
    volume: Any,
    voxel_size: Size3,
    edge: float,
    parameters: StackParameters,
    found: Scan,
    psf: Image | None,
    progress: Progress,
    pose: Rigid | None,
) -> tuple[Mask, dict[str, Any]]:
    """Find the cell's box on the coarse copy, segment it, and grow the box where it is cut."""
    progress(0.3, "looking for the cell")
    box, others = _coarse_boxes(volume.shape, voxel_size, edge, parameters, found, progress)
    while True:
        part = progress.part(0.4, 0.9)
        cell, touched, report = _segment_box(
            volume, voxel_size, edge, parameters, box, psf, part, pose
        )
        on_border = sides_at_border(box, volume.shape)
        cut = (touched > 0) & ~on_border
        if not cut.any():
            break
        lengths = np.array([side.stop - side.start for side in box])
        step = np.maximum(lengths // 4, 8)[:, None] * cut
        box = grown(box, step, volume.shape)
    progress(0.95, "border")
    contact = np.where(on_border, touched, 0)
    size = (edge, edge, edge)
    extent = np.asarray(volume.shape) * np.asarray(voxel_size)
    report |= check_border(contact, cell.data, size, edge, extent, given=False)
    away = [volume_um3 for other, volume_um3 in others if not _overlap(other, box)]
    report["dropped_components"] += len(away)
    report["dropped_voxels"] += round(sum(away) / edge**3)
    report["source"] = "image"
    return _delivered(cell, report, parameters, edge, box)


def _coarse_boxes(
    shape: tuple[int, ...],
    voxel_size: Size3,
    edge: float,
    parameters: StackParameters,
    found: Scan,
    progress: Progress,
) -> tuple[Box, list[tuple[Box, float]]]:
    """Where the cell lies, and the box and volume in µm³ of everything else.

    Both by segmenting the block means.
    """
    factors = np.asarray(found.factors)
    size = factors * np.asarray(voxel_size)
    coarse_size = (float(size[0]), float(size[1]), float(size[2]))
    mask, _ = foreground(found.coarse, coarse_size, edge, parameters, progress.part(0.3, 0.4))
    if mask.all() or not mask.any():
        # Too coarse to tell; the whole image decides.
        return (slice(0, shape[0]), slice(0, shape[1]), slice(0, shape[2])), []
    cell, _ = largest_component(mask, float(size.prod()), parameters.second_cell_fraction)
    room = (MARGIN_VOXELS + 2 * parameters.smoothing_voxels) * edge / np.asarray(voxel_size)
    margin = (2 * (factors > 1) * factors + np.ceil(room))[:, None].repeat(2, axis=1)
    box = grown(_in_voxels(box_of(cell), found.factors), margin, shape)
    labels, _ = ndimage.label(mask & ~cell, structure=WHOLE)
    sizes = np.bincount(labels.ravel())[1:] * float(size.prod())
    places = [_in_voxels(place, found.factors) for place in ndimage.find_objects(labels)]
    return box, list(zip(places, sizes.tolist(), strict=True))


def _in_voxels(blocks: Box, factors: tuple[int, int, int]) -> Box:
    z, y, x = (slice(b.start * f, b.stop * f) for b, f in zip(blocks, factors, strict=True))
    return z, y, x


def _overlap(one: Box, other: Box) -> bool:
    return all(a.start < b.stop and b.start < a.stop for a, b in zip(one, other, strict=True))


def _segment_box(
    volume: Any,
    voxel_size: Size3,
    edge: float,
    parameters: StackParameters,
    box: Box,
    psf: Image | None,
    progress: Progress,
    pose: Rigid | None,
) -> tuple[Mask, npt.NDArray[np.int64], dict[str, Any]]:
    """The cell in a box, its voxels at the box's six sides (3, 2), and the report."""
    progress(0.0, "reading the cell")
    if psf is None:
        part = read_box(volume, voxel_size, box)
    else:
        during = progress.part(0.0, 0.1)
        part = read_deconvolved(volume, voxel_size, box, psf, parameters, during)
    progress(0.1, "working grid")
    working = progress.run(to_working_grid, part, edge, pose)
    mask, threshold = foreground(
        working.data, working.voxel_size, edge, parameters, progress.part(0.2, 0.6)
    )
    turned = pose if pose is not None and pose.turns else None
    if turned is not None:
        # Nothing is known of the corners around a rotated box.
        mask &= progress.run(covered, working, part, turned)
    check_not_trivial(mask, THRESHOLD_HINT)
    progress(0.6, "components")
    cell, report = progress.run(largest_component, mask, edge**3, parameters.second_cell_fraction)
    progress(0.7, "chambers")
    progress.run(check_walls, cell, parameters.second_cell_fraction)
    if parameters.fill:
        progress(0.9, "cavities")
        cell, holes = progress.run(filled, cell)
        report |= holes
    report["threshold"] = threshold
    if psf is not None:
        report |= {"deconvolution": parameters.deconvolution, "psf_voxels": list(psf.shape)}
    found = Mask(cell, working.voxel_size, working.origin)
    touched = touched_sides(cell) if turned is None else _at_sides(found, part, turned)
    return found, touched, report


# Parts -------------------------------------------------------------------------


def _at_sides(cell: Mask, part: Volume, pose: Rigid) -> npt.NDArray[np.int64]:
    """Voxels (3, 2) of a cell within a voxel of each side of the rotated box it was found in."""
    counts = np.zeros((3, 2), np.int64)
    for axis, (length, size) in enumerate(zip(part.shape, part.voxel_size, strict=True)):
        place = own_index(cell, part, pose, axis)[cell.data]
        thickness = cell.voxel_size[0] / size
        counts[axis] = (place < thickness).sum(), (length - 1 - place < thickness).sum()
    return counts


def _looks_like_labels(volume: Any) -> bool:
    """Whether whole numbers form one flat piece per value, as labels do.

    Nearly all neighbours are equal in a label image, and the voxels of a value hang
    together; the levels of a smooth noise-free image fall into many pieces.
    """
    if volume.dtype.kind not in "iu":
        return False
    from skimage.measure import label

    middle = tuple(
        slice(max(0, n // 2 - SAMPLE_EDGE // 2), n // 2 + SAMPLE_EDGE // 2) for n in volume.shape
    )
    sample: npt.NDArray[Any] = np.asarray(volume[middle])
    cell = sample != 0
    pairs = cell[..., 1:] & cell[..., :-1]
    if not pairs.any():
        return False
    equal = (sample[..., 1:] == sample[..., :-1])[pairs].mean()
    values = np.unique(sample[cell])
    if equal < FLAT_FRACTION or len(values) < 2:
        return False
    pieces = int(label(sample, background=0, connectivity=3).max())
    return pieces <= PIECES_PER_VALUE * len(values)


def _delivered(
    mask: Mask, report: dict[str, Any], parameters: StackParameters, edge: float, box: Box
) -> tuple[Mask, dict[str, Any]]:
    voxels = int(np.count_nonzero(mask.data))
    report |= {
        "voxels": voxels,
        "volume_um3": voxels * edge**3,
        "working_voxel_um": float(edge),
        "timepoint": parameters.timepoint,
        "channel": parameters.channel,
        "label": parameters.label,
        "box": [[side.start, side.stop] for side in box],
    }
    return with_margin(mask), report
