"""Read a stack from a file or an array: lazily, with its axes and its voxel size.

The voxel size is read from the file or asked for; it is never guessed.
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from ..charts import AXES, Size3, Stack, check_voxel_size
from ..errors import AxesError, FileFormatError, InputError, VoxelSizeMissingError
from .hdf5 import read_hdf5
from .metadata import Found
from .ome_zarr import read_zarr
from .tiff import damaged, read_tiff, read_tiff_bytes, write_image

__all__ = ["STACK_SUFFIXES", "read_stack", "write_image"]

TIFF_SUFFIXES = (".tif", ".tiff")
HDF5_SUFFIXES = (".h5", ".hdf5", ".hdf")
STACK_SUFFIXES = (*TIFF_SUFFIXES, *HDF5_SUFFIXES, ".zarr", ".zip")

# Files give three axes as z, y, x; more than three have to be named.
UNNAMED = {3: "zyx", 5: "tczyx"}
# What tifffile calls a series of pages whose meaning the file does not tell.
ANONYMOUS_PAGES = {"qyx": "zyx", "iyx": "zyx"}


def read_stack(
    source: Any,
    voxel_size: Sequence[float] | None = None,
    time_step: float | None = None,
    *,
    axes: str | None = None,
    dataset: str | int | None = None,
    channels: Sequence[str] | None = None,
    name: str | None = None,
) -> Stack:
    """Read a stack; the data stay on disk until a part of them is needed.

    Label images are read in the same way.

    Parameters
    ----------
    source : path or array
        OME-TIFF, ImageJ or plain TIFF (also a zip file with one TIFF in it), OME-Zarr,
        HDF5, or a numpy or dask array.
    voxel_size : (float, float, float), optional
        (z, y, x) in µm; instead of what the file says.
    time_step : float, optional
        Seconds between timepoints; instead of what the file says.
    axes : str, optional
        One letter of ``tczyx`` per axis in the order of the data; instead of what the
        file says.
    dataset : str or int, optional
        The dataset of an HDF5 file (default: the only one, or ``raw``), the group of a
        Zarr folder, or the number of the image in a TIFF file.
    channels : sequence of str, optional
        Names of the channels; instead of what the file says.
    name : str, optional
        By default the file's name.

    Returns
    -------
    Stack
        Axes in the order ``tczyx``; t and c axes of length 1 are dropped.

    Raises
    ------
    VoxelSizeMissingError
        The file does not give all of z, y, x in a unit of length.
    AxesError
        The data have no three spatial axes, or their axes are not known.
    FileFormatError
        The file is truncated, damaged, of an unknown kind, or holds several images.
    """
    if hasattr(source, "shape") and hasattr(source, "dtype"):
        found, title = Found(source, remark="an array"), name or "array"
    else:
        path = Path(source)
        found, title = _read(path, dataset), name or path.name
    order = _axes(found, axes, title)
    data, order = _normalised(found.data, order, title)
    named = tuple(channels) if channels is not None else found.channels
    return Stack(
        data,
        order,
        _voxel_size(found, voxel_size, title),
        _time_step(time_step if time_step is not None else found.time_step, order),
        _channel_names(named, data, order, strict=channels is not None),
        title,
    )


# Files -----------------------------------------------------------------------


def _read(path: Path, dataset: str | int | None) -> Found:
    if not path.exists():
        raise FileFormatError(f"There is no file {path}.", hint="Check the path.")
    suffix = path.suffix.lower()
    if suffix in TIFF_SUFFIXES:
        return read_tiff(path, _number(dataset))
    if suffix in HDF5_SUFFIXES:
        return read_hdf5(path, None if dataset is None else str(dataset))
    if suffix == ".zip":
        return _read_zip(path, _number(dataset))
    if suffix == ".zarr" or path.is_dir():
        return read_zarr(path, None if dataset is None else str(dataset))
    raise FileFormatError(
        f"{path.name} is not a kind of stack that is known.",
        hint=f"Known: {', '.join(STACK_SUFFIXES)}. Meshes are read with read_mesh.",
    )


def _number(dataset: str | int | None) -> int | None:
    try:
        return None if dataset is None else int(dataset)
    except ValueError:
        raise InputError(
            f"The images of a TIFF file are numbered, {dataset!r} is no number.",
            hint="Give e.g. dataset=0.",
        ) from None


def _read_zip(path: Path, dataset: int | None) -> Found:
    try:
        with zipfile.ZipFile(path) as archive:
            members = [
                member
                for member in archive.namelist()
                if PurePosixPath(member).suffix.lower() in TIFF_SUFFIXES
                and not member.startswith("__MACOSX/")
            ]
            if len(members) != 1:
                raise FileFormatError(
                    f"{path.name} must hold exactly one TIFF file.",
                    tiff_files=len(members),
                    files=len(archive.namelist()),
                    hint="Unpack it and open the file you mean.",
                )
            content = archive.read(members[0])
    except (zipfile.BadZipFile, EOFError, OSError, RuntimeError) as error:
        raise damaged(path.name, str(error)) from error
    return read_tiff_bytes(content, f"{path.name}/{members[0]}", dataset)


# Axes ------------------------------------------------------------------------


def _axes(found: Found, given: str | None, name: str) -> str:
    """One letter of tczyx per axis of the data, or ``-`` for an axis of length 1 to drop."""
    shape = tuple(int(n) for n in found.data.shape)
    hint = "Name the axes in the order of the data, e.g. axes='tzyx'."
    if given is not None:
        order = given.lower()
        if len(order) != len(shape):
            raise AxesError(
                f"axes={given!r} does not fit {name}.", shape=shape, letters=len(order), hint=hint
            )
    else:
        order = ANONYMOUS_PAGES.get(found.axes, found.axes) or UNNAMED.get(len(shape), "")
        if len(shape) > 2 and not order:
            raise AxesError(f"The axes of {name} are not known.", shape=shape, hint=hint)
        order = _samples_as_channels(order, shape)
    unknown = [a for a in order if a not in AXES]
    repeated = len(set(order)) < len(order)
    if unknown or repeated:
        raise AxesError(
            f"The axes {order!r} of {name} are not letters of 'tczyx', each at most once.",
            shape=shape,
            hint=hint,
        )
    return order


def _samples_as_channels(order: str, shape: tuple[int, ...]) -> str:
    """Colour samples are channels; unknown axes of length 1 are left out further on."""
    if "s" in order and "c" not in order:
        order = order.replace("s", "c")
    free = [a for a in "tc" if a not in order]
    letters = []
    for letter, length in zip(order, shape, strict=False):
        replaced = letter not in AXES and length == 1 and free
        letters.append(free.pop() if replaced else letter)
    return "".join(letters)


def _normalised(data: Any, order: str, name: str) -> tuple[Any, str]:
    shape = dict(zip(order, (int(n) for n in data.shape), strict=False))
    missing = [a for a in "zyx" if shape.get(a, 1) < 2]
    if missing or len(order) != data.ndim:
        raise AxesError(
            f"{name} is not a stack of volumes: it has no extent along "
            f"{', '.join(missing) or 'some axes'}.",
            shape=tuple(data.shape),
            axes=order or "yx",
            hint="A cell is unwrapped from a 3D stack (z, y, x). If an axis is named wrongly, "
            "name the axes in the order of the data, e.g. axes='zyx'.",
        )
    kept = [a for a in AXES if a in order and (a in "zyx" or shape[a] > 1)]
    picked = data
    if len(kept) < len(order):
        picked = data[tuple(slice(None) if a in kept else 0 for a in order)]
    left = [a for a in order if a in kept]
    # Left alone where it is in order: dask reads less of an array that is only sliced.
    if left != kept:
        picked = picked.transpose([left.index(a) for a in kept])
    return picked, "".join(kept)


# Sizes, times and names ------------------------------------------------------


def _voxel_size(found: Found, given: Sequence[float] | None, name: str) -> Size3:
    if given is not None:
        return check_voxel_size(given)
    missing = [axis for axis in "zyx" if axis not in found.voxel_size]
    if missing:
        raise VoxelSizeMissingError(
            f"The voxel size of {name} is not known along {', '.join(missing)}.",
            found=found.remark or "nothing",
            hint="Give it in µm as voxel_size=(z, y, x), e.g. (0.3, 0.104, 0.104), or "
            "--voxel-size 0.3 0.104 0.104 on the command line.",
        )
    return check_voxel_size([found.voxel_size[axis] for axis in "zyx"])


def _time_step(seconds: float | None, order: str) -> float | None:
    if seconds is None or "t" not in order:
        return None
    if not np.isfinite(seconds) or seconds <= 0:
        raise InputError("The time step is positive.", time_step_s=seconds)
    return float(seconds)


def _channel_names(
    names: tuple[str, ...], data: Any, order: str, *, strict: bool
) -> tuple[str, ...]:
    if "c" not in order:
        return ()
    count = int(data.shape[order.index("c")])
    if strict and len(names) != count:
        raise AxesError("The channel names do not fit.", names=len(names), channels=count)
    padded = [*names[:count], *[""] * (count - len(names))]
    return tuple(label or f"channel {i}" for i, label in enumerate(padded))
