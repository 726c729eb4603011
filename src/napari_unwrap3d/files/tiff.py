"""TIFF stacks: OME-TIFF, ImageJ and plain ones, read lazily; OME-TIFF written."""

from __future__ import annotations

import logging
import threading
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import tifffile

from ..charts import AXES
from ..errors import AxesError, FileFormatError, InputError
from .atomic import replacing
from .metadata import Found, micrometres, seconds

CHUNK_BYTES = 8 * 2**20

# What tifffile logs when the chain of pages ends outside the file.
SIGNS_OF_DAMAGE = ("invalid page offset", "corrupted")
READING_ERRORS = (
    tifffile.TiffFileError,
    zlib.error,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    EOFError,
    OSError,
    RuntimeError,
)


# Reading ---------------------------------------------------------------------


class TiffSource:
    """One image of a TIFF file, sliced like an array.

    The table of pages is read once, on the first read; the file is open only while it
    is read. A pickled source opens the file anew where it arrives.
    """

    def __init__(
        self,
        path: str,
        series: int,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        stamp: tuple[int, int],
        plain_at: tuple[int, str] | None = None,
    ) -> None:
        self.path = path
        self.series = series
        self.shape = shape
        self.dtype = dtype
        self.stamp = stamp
        # Where uncompressed pages lie in one piece: the offset and the stored type.
        self._plain_at = plain_at
        self._lock = threading.Lock()
        self._pages: tuple[tifffile.TiffFile, Any] | None = None

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def __getitem__(self, key: Any) -> npt.NDArray[Any]:
        try:
            with self._lock:
                return self._read(key)
        except READING_ERRORS as error:
            raise damaged(Path(self.path).name, str(error)) from error

    def _read(self, key: Any) -> npt.NDArray[Any]:
        if self._plain_at is not None:
            start, stored = self._plain_at
            values = np.memmap(self.path, stored, "r", start, self.shape)[key]
            return np.array(values, dtype=self.dtype)
        if self._pages is None:
            import zarr

            tif = tifffile.TiffFile(self.path)
            with _open_again(tif):
                store = tif.series[self.series].aszarr(level=0)
                self._pages = tif, zarr.open_array(store, mode="r")
        tif, array = self._pages
        with _open_again(tif):
            return np.asarray(array[key])

    def __reduce__(self) -> tuple[Any, ...]:
        given = (self.path, self.series, self.shape, self.dtype, self.stamp, self._plain_at)
        return TiffSource, given

    def __dask_tokenize__(self) -> tuple[Any, ...]:
        return (type(self).__name__, self.path, self.series, self.stamp)


@contextmanager
def _open_again(tif: tifffile.TiffFile) -> Iterator[None]:
    """Open the file of a parsed TIFF again, and close it afterwards; what was parsed stays."""
    tif.filehandle.open()
    try:
        yield
    finally:
        tif.filehandle.close()


def read_tiff(path: Path, dataset: int | None = None) -> Found:
    """One image of a TIFF file, lazily.

    Parameters
    ----------
    path : Path
    dataset : int, optional
        Which image, in a file that holds several.

    Raises
    ------
    FileFormatError
        The file is truncated, damaged or no TIFF; or holds several stacks.
    """
    with _opened(path, path.name) as tif:
        number = _choose_series(tif, path.name, dataset)
        series = tif.series[number]
        stat = path.stat()
        dtype = np.dtype(series.dtype)
        offset = series.dataoffset
        source = TiffSource(
            str(path.resolve()),
            number,
            tuple(int(n) for n in series.shape),
            dtype.newbyteorder("="),
            (stat.st_mtime_ns, stat.st_size),
            None if offset is None else (int(offset), tif.byteorder + dtype.str[1:]),
        )
        return _described(tif, number, lazy(source, series.axes.lower()))


def read_tiff_bytes(content: bytes, name: str, dataset: int | None = None) -> Found:
    """One image of a TIFF file that is already in memory; see :func:`read_tiff`."""
    with _opened(BytesIO(content), name) as tif:
        number = _choose_series(tif, name, dataset)
        try:
            return _described(tif, number, tif.series[number].asarray())
        except READING_ERRORS as error:
            raise damaged(name, str(error)) from error


def lazy(source: Any, axes: str = "", stored: tuple[int, ...] | None = None) -> Any:
    """A dask array over a source, in pieces of whole planes of about 8 MiB.

    Parameters
    ----------
    source : object
        Has ``shape``, ``dtype`` and reads what is sliced out of it.
    axes : str
        The axes as far as they are known; a piece holds one timepoint and one channel.
    stored : tuple of int, optional
        The pieces in which the file holds the data; none of them is read twice.
    """
    import dask.array

    # dask declares no types.
    from_array: Any = dask.array.from_array
    chunks: list[int] = []
    budget = CHUNK_BYTES // source.dtype.itemsize
    for i, length in reversed(list(enumerate(source.shape))):
        piece = stored[i] if stored else 1
        wanted = length if i >= source.ndim - 2 else -(-min(budget, length) // piece) * piece
        alone = axes[i : i + 1] in ("t", "c")
        chunks.append(1 if alone else int(np.clip(wanted, 1, length)))
        budget //= 1 if alone else max(length, 1)
    nothing = np.empty((0,) * source.ndim, source.dtype)
    return from_array(source, tuple(reversed(chunks)), asarray=True, fancy=False, meta=nothing)


def damaged(name: str, why: str) -> FileFormatError:
    """The error for a file that cannot be read, in the words of whoever failed."""
    missing = "requires the 'imagecodecs'" in why
    return FileFormatError(
        f"{name} cannot be read: {why.strip().rstrip('.')}.",
        hint="Install the package imagecodecs, or save the stack without compression."
        if missing
        else "The file may be truncated or damaged; copy it again or export it anew.",
    )


class _Messages(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


@contextmanager
def _opened(file: Path | IO[bytes], name: str) -> Iterator[tifffile.TiffFile]:
    """Open a TIFF file and raise where tifffile only logs that pages are missing."""
    heard, log = _Messages(), logging.getLogger("tifffile")
    propagate = log.propagate
    log.addHandler(heard)
    log.propagate = False
    try:
        try:
            tif = tifffile.TiffFile(file)
        except READING_ERRORS as error:
            raise damaged(name, str(error)) from error
        with tif:
            try:
                series = list(tif.series)
                _check_extent(tif, series, name)
            except READING_ERRORS as error:
                if isinstance(error, FileFormatError):
                    raise
                raise damaged(name, str(error)) from error
            for text in heard.texts:
                if any(sign in text for sign in SIGNS_OF_DAMAGE):
                    raise damaged(name, text)
            yield tif
    finally:
        log.removeHandler(heard)
        log.propagate = propagate


def _check_extent(tif: tifffile.TiffFile, series: Sequence[Any], name: str) -> None:
    """Raise unless the file reaches as far as its pages say."""
    if not series:
        raise damaged(name, "it holds no image")
    size = int(tif.filehandle.size)
    needed = 0
    for image in series:
        if image.dataoffset is not None:
            needed = max(needed, image.dataoffset + image.nbytes)
            continue
        for page in image.pages:
            if page is not None and page.parent is tif and page.dataoffsets:
                ends = (o + n for o, n in zip(page.dataoffsets, page.databytecounts, strict=True))
                needed = max(needed, *ends)
    if needed > size:
        raise damaged(name, f"it has {size} bytes, its pages need {needed}")


def _choose_series(tif: tifffile.TiffFile, name: str, dataset: int | None) -> int:
    """The number of the image; the only one with three axes unless it is given."""
    stacks = [i for i, series in enumerate(tif.series) if series.ndim >= 3]
    if dataset is None and len(stacks) < 2:
        return stacks[0] if stacks else 0
    if dataset is None or not 0 <= int(dataset) < len(tif.series):
        found = ", ".join(f"{i}: {series.shape}" for i, series in enumerate(tif.series))
        raise FileFormatError(
            f"{name} holds several images: {found}.",
            images=len(tif.series),
            hint=f"Choose one, e.g. dataset={stacks[0] if stacks else 0}.",
        )
    return int(dataset)


def _described(tif: tifffile.TiffFile, number: int, data: Any) -> Found:
    axes = tif.series[number].axes.lower()
    if tif.is_ome and tif.ome_metadata:
        found = _ome(tif.ome_metadata, number)
    elif tif.is_imagej:
        found = _imagej(tif)
    else:
        found = Found(None, remark="a plain TIFF without a physical size")
    found.data, found.axes = data, axes
    return found


def _ome(xml: str, number: int) -> Found:
    """Voxel size, time step and channel names out of OME-XML."""
    try:
        images = ElementTree.fromstring(xml).findall(".//{*}Image")
        pixels = images[min(number, len(images) - 1)].find("{*}Pixels")
    except (ElementTree.ParseError, IndexError):
        pixels = None
    if pixels is None:
        return Found(None, remark="OME-XML that cannot be parsed")
    sizes, said = {}, []
    for axis in "ZYX":
        value = pixels.get(f"PhysicalSize{axis}")
        unit = pixels.get(f"PhysicalSize{axis}Unit", "µm")
        if value is not None:
            said.append(f"{axis.lower()} = {value} {unit}")
        size = micrometres(value, unit)
        if size is not None:
            sizes[axis.lower()] = size
    names = [channel.get("Name") or "" for channel in pixels.findall("{*}Channel")]
    return Found(
        None,
        voxel_size=sizes,
        time_step=seconds(pixels.get("TimeIncrement"), pixels.get("TimeIncrementUnit", "s")),
        channels=tuple(names) if any(names) else (),
        remark="OME-XML with " + (", ".join(said) or "no physical size"),
    )


def _imagej(tif: tifffile.TiffFile) -> Found:
    """Voxel size and time step as ImageJ writes them."""
    said = tif.imagej_metadata or {}
    tags = tif.pages.first.tags
    unit = said.get("unit", "")
    steps: dict[str, Any] = {"z": said.get("spacing")}
    for axis, tag in (("y", "YResolution"), ("x", "XResolution")):
        numerator, denominator = tags.valueof(tag, default=(0, 1))
        steps[axis] = denominator / numerator if numerator else None
    sizes = {axis: micrometres(step, said.get(f"{axis}unit", unit)) for axis, step in steps.items()}
    known = [f"{axis} = {step:g}" for axis, step in steps.items() if step is not None]
    return Found(
        None,
        voxel_size={axis: size for axis, size in sizes.items() if size is not None},
        time_step=seconds(said.get("finterval"), said.get("tunit", "s")),
        remark=f"ImageJ's {', '.join(known) or 'no sizes'}, unit {str(unit) or 'missing'!r}",
    )


# Writing ---------------------------------------------------------------------

STORED: dict[str, npt.DTypeLike] = {"bool": np.uint8, "float64": np.float32, "float16": np.float32}


def write_image(
    path: str | Path,
    data: Any,
    axes: str = "zyx",
    *,
    sizes: Mapping[str, float] | None = None,
    unit: str = "µm",
    time_step: float | None = None,
    channels: Sequence[str] = (),
) -> Path:
    """Write an OME-TIFF; it appears at once when complete.

    Parameters
    ----------
    path : path
        Best ends in ``.ome.tif``.
    data : array-like
        Booleans are stored as uint8, float64 as float32, 64-bit integers as int32.
    axes : str
        Letters out of ``tczyx`` in this order, e.g. ``"yx"``, ``"cyx"`` for the fields of
        a uv image, ``"czyx"`` with d as z for a topography.
    sizes : mapping of str to float, optional
        Step along ``z``, ``y``, ``x`` in `unit`; leave out those without a physical size.
    unit : str
        Unit of `sizes`.
    time_step : float, optional
        Seconds.
    channels : sequence of str
        Names along the c axis.

    Raises
    ------
    AxesError
        Axes, channels and data do not fit together.
    InputError
        The data are not real numbers, or are integers beyond 32 bits.
    """
    path = Path(path)
    array = np.asarray(data)
    check_axes(array, axes, channels)
    if array.dtype.kind not in "biuf":
        raise InputError("An image holds real numbers.", dtype=str(array.dtype))
    if array.dtype.name in STORED:
        array = array.astype(STORED[array.dtype.name])
    elif array.dtype.kind in "iu" and array.dtype.itemsize == 8:
        array = _as_int32(array)
    metadata: dict[str, Any] = {"axes": axes.upper()}
    for axis, size in (sizes or {}).items():
        metadata[f"PhysicalSize{axis.upper()}"] = float(size)
        metadata[f"PhysicalSize{axis.upper()}Unit"] = unit
    if time_step is not None:
        metadata |= {"TimeIncrement": float(time_step), "TimeIncrementUnit": "s"}
    if channels:
        metadata["Channel"] = {"Name": list(channels)}
    with replacing(path) as partial:
        tifffile.imwrite(
            partial,
            array,
            ome=True,
            bigtiff=array.nbytes > 2**31,
            photometric="minisblack",
            compression="zlib",
            compressionargs={"level": 1},  # four times faster than 6, a tenth larger
            metadata=metadata,
        )
    return path


def check_axes(array: npt.NDArray[Any], axes: str, channels: Sequence[str]) -> None:
    """Raise unless axes and channels describe the data of an image to be written."""
    if axes != "".join(a for a in AXES if a in axes) or not axes.endswith("yx"):
        raise AxesError(f"Axes are letters of {AXES!r} in this order, not {axes!r}.")
    if array.ndim != len(axes):
        raise AxesError("The axes do not fit the data.", dimensions=array.ndim, axes=axes)
    if channels and ("c" not in axes or array.shape[axes.index("c")] != len(channels)):
        raise AxesError(
            "The channel names do not fit the data.", names=len(channels), shape=array.shape
        )


def _as_int32(array: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    limits = np.iinfo(np.int32)
    if array.size and (array.min() < limits.min or array.max() > limits.max):
        raise InputError(
            "Integers beyond 32 bits cannot be stored in an OME-TIFF.",
            smallest=int(array.min()),
            largest=int(array.max()),
            hint="Relabel them first.",
        )
    return array.astype(np.int32)
