"""Arrays of a project: cut into chunks, compressed, and back bit for bit.

Arrays of positions on a grid are smooth along every axis of the grid; they are stored as
the differences of their bit patterns along those axes (attribute ``differences``), which is
exact, and three times smaller than compressing them as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..progress import Progress

if TYPE_CHECKING:
    import zarr

CHUNK_BYTES = 48 * 2**20


def write_array(
    group: zarr.Group,
    name: str,
    values: npt.NDArray[Any],
    report: Progress,
    smooth: bool = False,
) -> None:
    """Write an array of numbers into a group; `smooth` stores its differences.

    Raises
    ------
    InputError
        It is not of numbers or booleans.
    """
    from zarr.codecs import BloscCodec

    if values.dtype.kind not in "biufc":
        raise InputError(
            f"The array {name!r} holds {values.dtype}, which a project cannot keep.",
            hint="Fields are numbers or booleans; turn names into integer labels.",
        )
    values = np.asarray(values, dtype=values.dtype.newbyteorder("="))
    axes = tuple(range(values.ndim - 1)) if smooth and values.dtype.kind == "f" else ()
    stored = np.dtype(f"i{values.dtype.itemsize}") if axes else values.dtype
    rows = _rows(values.shape, values.dtype.itemsize)
    array = group.create_array(
        name,
        shape=values.shape,
        dtype=stored,
        chunks=tuple(max(n, 1) for n in (rows, *values.shape[1:])[: values.ndim]),
        compressors=BloscCodec(cname="zstd", clevel=1, shuffle="bitshuffle"),
        attributes={"differences": list(axes), "dtype": values.dtype.name},
        # Empty chunks are written too, so that a missing chunk is known as damage.
        config={"write_empty_chunks": True},
    )
    for block in _blocks(values.shape, rows):
        part = values[block]
        array[block] = _differences(part, stored, axes) if axes else part
        if values.ndim and len(values):
            report((block[0].stop or 1) / len(values), f"saving {name}")


def _rows(shape: tuple[int, ...], itemsize: int) -> int:
    """How many entries of the first axis make a chunk."""
    if not shape:
        return 1
    row = max(int(np.prod(shape[1:], dtype=np.int64)) * itemsize, 1)
    return int(np.clip(CHUNK_BYTES // row, 1, max(shape[0], 1)))


def _blocks(shape: tuple[int, ...], rows: int) -> Iterator[Any]:
    if not shape:
        yield ()
    elif all(shape):
        for start in range(0, shape[0], rows):
            yield (slice(start, min(start + rows, shape[0])),)


def _lines(bits: npt.NDArray[Any], axis: int) -> npt.NDArray[Any]:
    """A view (before, along, after) of `bits`, contiguous in memory."""
    after = int(np.prod(bits.shape[axis + 1 :]))
    return bits.reshape(-1, bits.shape[axis], after)


def _differences(
    values: npt.NDArray[Any], stored: np.dtype[Any], axes: tuple[int, ...]
) -> npt.NDArray[Any]:
    """Differences of the bit patterns along each axis in turn; integers wrap, so exact."""
    bits = np.array(values, order="C").view(stored)
    for axis in axes:
        lines = _lines(bits, axis)
        after = lines.shape[2]
        flat = lines.reshape(len(lines), -1)  # long rows: numpy is slow on short ones
        flat[:, after:] -= flat[:, :-after].copy()
    return bits


def _integrate(bits: npt.NDArray[Any], dtype: np.dtype[Any], axes: list[int]) -> npt.NDArray[Any]:
    """Undo :func:`_differences` in place."""
    for axis in axes:
        lines = _lines(bits, axis)
        if lines.shape[2] < 64:
            np.cumsum(lines, axis=1, dtype=bits.dtype, out=lines)
        else:  # ten times faster than a cumulative sum with a long stride
            for index in range(1, lines.shape[1]):
                lines[:, index] += lines[:, index - 1]
    return bits.view(dtype)


def read_array(array: Any, report: Progress) -> npt.NDArray[Any]:
    """Read what :func:`write_array` wrote."""
    axes = list(array.attrs["differences"])
    dtype = np.dtype(str(array.attrs["dtype"]))
    values: npt.NDArray[Any] = np.empty(array.shape, dtype)
    for block in _blocks(array.shape, array.chunks[0] if array.ndim else 1):
        report.check()
        part = np.ascontiguousarray(array[block])
        values[block] = _integrate(part, dtype, axes) if axes else part
    return values
