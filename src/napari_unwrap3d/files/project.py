"""The project file: one atlas in one ``*.unwrap3d`` file (Zarr v3 in a zip).

Layout, schema version 2 (1 has no direct chart and no cuts)::

    /              attributes: format, schema_version, parameters (TOML text), quality,
                   provenance (JSON)
    /surface       a group per chart; attributes: type (the class), values (scalars, JSON)
    /surface/vertices, faces, ...        an array per array
    /surface/fields                      a group per mapping of arrays
    /sealed/mask                         a group per nested mask or volume
    ...

Arrays are compressed by Blosc (zstd, bitshuffle) and come back bit for bit. Arrays of
positions on a grid are smooth along every axis of the grid; they are stored as the
differences of their bit patterns along those axes (attribute ``differences``), which
is exact, and three times smaller than compressing them as they are.
"""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import charts
from ..errors import FileFormatError, InputError, SchemaError, Unwrap3DError
from ..parameters import Parameters
from ..progress import Progress, silent
from .archive import NODE, check_entries, check_layout, read_node
from .atomic import from_plain, plain, replacing
from .consistency import check_charts

if TYPE_CHECKING:
    import zarr

    from ..atlas import Atlas

FORMAT = "napari-unwrap3d project"
SCHEMA_VERSION = 2
OLDEST_SCHEMA = 1
SUFFIX = ".unwrap3d"

CHARTS = (
    "surface",
    "sealed",
    "reference",
    "sphere",
    "uv",
    "topography",
    "direct",
    "plane",
    "mask",
)
CHUNK_BYTES = 48 * 2**20
SMOOTH_GRIDS = ("nodes", "positions")

# The classes that a group can be of, by name: no other name of a file is looked up.
TYPES = {
    name: kind
    for name, kind in vars(charts).items()
    if isinstance(kind, type)
    and is_dataclass(kind)
    and kind.__module__.startswith(f"{charts.__name__}.")
}

# What zipfile, zarr, numpy and the charts raise on files that hold something else.
_DAMAGED = (
    zipfile.BadZipFile,
    struct.error,
    OSError,
    EOFError,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    ArithmeticError,
    RuntimeError,
)


# Saving ----------------------------------------------------------------------


def save_project(atlas: Atlas, path: str | Path, progress: Progress | None = None) -> Path:
    """Save an atlas, with everything needed to open it again, in one file.

    Parameters
    ----------
    atlas : Atlas
        Complete or not: charts that it does not have are left out.
    path : path
        ``.unwrap3d`` is appended unless it is there. An existing file is replaced
        only when the new one is complete.
    progress : Progress, optional

    Returns
    -------
    Path
        The file that was written.
    """
    import zarr
    from zarr.storage import ZipStore

    report = progress if progress is not None else silent()
    path = Path(path)
    if path.suffix != SUFFIX:
        path = path.with_name(path.name + SUFFIX)
    present = {name: getattr(atlas, name) for name in CHARTS if atlas.has(name)}
    size = sum(_bytes(chart) for chart in present.values()) or 1
    written = 0
    with replacing(path) as partial, ZipStore(partial, mode="w") as store:
        root = zarr.create_group(store, attributes=_root_attributes(atlas))
        for name, chart in present.items():
            part = report.part(written / size, (written + _bytes(chart)) / size)
            _write_group(root, name, chart, part)
            written += _bytes(chart)
    return path


def _root_attributes(atlas: Atlas) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "parameters": atlas.parameters.to_toml(),
        "quality": plain(atlas.quality),
        "provenance": plain(atlas.provenance),
    }


def _is_arrays(value: Any) -> bool:
    return (
        isinstance(value, Mapping)
        and len(value) > 0
        and all(isinstance(item, np.ndarray) for item in value.values())
    )


def _bytes(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return value.nbytes
    if is_dataclass(value):
        return sum(_bytes(getattr(value, item.name)) for item in fields(value))
    if _is_arrays(value):
        return sum(array.nbytes for array in value.values())
    return 0


def _write_group(parent: zarr.Group, name: str, chart: Any, report: Progress) -> None:
    parts = {item.name: getattr(chart, item.name) for item in fields(chart)}
    values = {
        key: plain(value)
        for key, value in parts.items()
        if not (isinstance(value, np.ndarray) or is_dataclass(value) or _is_arrays(value))
    }
    attributes = {"type": type(chart).__name__, "values": values}
    group = parent.create_group(name, attributes=attributes)
    for key, value in parts.items():
        report.check()
        if isinstance(value, np.ndarray):
            _write_array(group, key, value, report, smooth=key in SMOOTH_GRIDS)
        elif is_dataclass(value):
            _write_group(group, key, value, report.part(0.0, 1.0))
        elif _is_arrays(value):
            _write_mapping(group, key, value, report)
    report(1.0, f"saving {name}")


def _write_mapping(
    parent: zarr.Group, name: str, arrays: Mapping[str, npt.NDArray[Any]], report: Progress
) -> None:
    # Names of fields are free text, so they stand in the attributes and not in paths.
    group = parent.create_group(name, attributes={"type": "mapping", "names": list(arrays)})
    for index, array in enumerate(arrays.values()):
        _write_array(group, str(index), array, report)


def _write_array(
    group: zarr.Group,
    name: str,
    values: npt.NDArray[Any],
    report: Progress,
    smooth: bool = False,
) -> None:
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


# Loading ---------------------------------------------------------------------


def load_project(path: str | Path, progress: Progress | None = None) -> Atlas:
    """Open a saved atlas. The file need not be trusted: see :mod:`.archive`.

    Parameters
    ----------
    path : path
        A ``*.unwrap3d`` file.
    progress : Progress, optional

    Returns
    -------
    Atlas

    Raises
    ------
    FileFormatError
        The file is truncated, damaged or no project.
    SchemaError
        It is of a newer version, or of one too old.
    UnsafeFileError
        It names or declares what it must not.
    InputError
        There is no such file.
    """
    from ..atlas import REQUESTED, Atlas

    report = progress if progress is not None else silent()
    with _opened(Path(path)) as root:
        summary = _root(root)
        present = [name for name in CHARTS if name in root]
        loaded: dict[str, Any] = dict.fromkeys(CHARTS)
        for index, name in enumerate(present):
            report(index / len(present), f"reading {name}")
            loaded[name] = _read_group(root[name], report)
        check_charts(loaded)
        asked = {name: loaded.pop(name) for name in REQUESTED}
        return Atlas(
            **loaded,
            on_request={name: chart for name, chart in asked.items() if chart is not None},
            parameters=Parameters.from_toml(str(summary["parameters"])),
            quality=summary["quality"],
            provenance=summary["provenance"],
        )


def load_surface(path: str | Path) -> charts.Surface:
    """The surface of a saved atlas, without its other charts.

    Raises
    ------
    InputError
        There is no such file, or the project has no surface.
    FileFormatError
        As in :func:`load_project`.
    """
    with _opened(Path(path)) as root:
        surface = _read_group(root["surface"], silent()) if "surface" in root else None
    if not isinstance(surface, charts.Surface):
        raise InputError(f"The project {Path(path).name!r} has no surface.")
    return surface


def read_summary(path: str | Path) -> dict[str, Any]:
    """The root attributes of a project and the charts it has, without its arrays.

    Returns
    -------
    dict
        ``schema_version``, ``parameters`` (TOML text), ``quality``, ``provenance`` and
        ``charts`` (names).

    Raises
    ------
    FileFormatError, InputError
        As in :func:`load_project`.
    """
    with _opened(Path(path)) as root:
        return {**_root(root), "charts": [name for name in CHARTS if name in root]}


@contextmanager
def _opened(path: Path) -> Iterator[zarr.Group]:
    """The root of a project that is safe to read; errors in the block are those of damage."""
    import zarr
    from zarr.storage import ZipStore

    if not path.is_file():
        raise InputError(f"There is no file {path.name!r}.", hint=f"Looked for {path}.")
    try:
        if not zipfile.is_zipfile(path):
            raise FileFormatError(
                f"{path.name!r} is no project of napari-unwrap3d, or its end is missing.",
                bytes=path.stat().st_size,
                hint="Copy the file again if it came over a network, or make it anew with "
                "`napari-unwrap3d run`.",
            )
        _check(path)
        with ZipStore(path, mode="r") as store:
            yield zarr.open_group(store, mode="r", zarr_format=3, use_consolidated=False)
    except Unwrap3DError:
        raise
    except _DAMAGED as error:
        raise FileFormatError(
            f"{path.name!r} is damaged ({type(error).__name__}: {error}).",
            hint="Copy the file again, or make it anew with `napari-unwrap3d run`.",
        ) from error


def _check(path: Path) -> None:
    """Raise unless the file is a project of a known schema that holds what it declares."""
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        check_entries(archive, size)
        if NODE not in archive.namelist():
            raise FileFormatError(
                f"{path.name!r} is a zip file, but no project of napari-unwrap3d.",
                hint="Projects are written by `napari-unwrap3d run` or atlas.save(...).",
            )
        attributes = read_node(archive, NODE).get("attributes", {})
        if attributes.get("format") != FORMAT:
            raise FileFormatError(
                f"{path.name!r} is a Zarr file, but no project of napari-unwrap3d.",
                hint="Stacks in Zarr format are read by read_stack(...).",
            )
        _check_schema(path.name, attributes.get("schema_version"))
        check_layout(archive, size)


def _check_schema(name: str, version: Any) -> None:
    if type(version) is not int:
        raise FileFormatError(f"{name!r} does not say of which schema it is.", found=version)
    if version > SCHEMA_VERSION:
        raise SchemaError(
            f"{name!r} was written by a newer version of napari-unwrap3d.",
            file_schema=version,
            known_schema=SCHEMA_VERSION,
            hint="Update with `pip install --upgrade napari-unwrap3d`.",
        )
    if version < OLDEST_SCHEMA:
        raise SchemaError(
            f"{name!r} was written by a version of napari-unwrap3d that is no longer read.",
            file_schema=version,
            oldest_schema=OLDEST_SCHEMA,
            hint="Make it anew with `napari-unwrap3d run`.",
        )


def _root(root: zarr.Group) -> dict[str, Any]:
    attributes = root.attrs.asdict()
    return {
        "schema_version": attributes["schema_version"],
        "parameters": attributes["parameters"],
        "quality": dict(from_plain(attributes["quality"])),
        "provenance": dict(from_plain(attributes["provenance"])),
    }


def _read_group(group: Any, report: Progress) -> Any:
    attributes = group.attrs.asdict()
    kind = attributes["type"]
    if kind == "mapping":
        names = attributes["names"]
        if str(len(names)) in group or len(set(names)) < len(names):
            raise FileFormatError(f"The names of {group.path!r} are not those of its arrays.")
        arrays = (group[str(index)] for index in range(len(names)))
        return {name: _read_array(array, report) for name, array in zip(names, arrays, strict=True)}
    cls = TYPES[kind]
    values = {key: _restored(value) for key, value in attributes["values"].items()}
    for key in (item.name for item in fields(cls) if item.name in group):
        item = group[key]
        read = _read_array if hasattr(item, "shape") else _read_group
        values[key] = read(item, report)
    return cls(**values)


def _restored(value: Any) -> Any:
    """JSON has no tuples; charts have no lists."""
    value = from_plain(value)
    return tuple(value) if isinstance(value, list) else value


def _read_array(array: Any, report: Progress) -> npt.NDArray[Any]:
    axes = list(array.attrs["differences"])
    dtype = np.dtype(str(array.attrs["dtype"]))
    values: npt.NDArray[Any] = np.empty(array.shape, dtype)
    for block in _blocks(array.shape, array.chunks[0] if array.ndim else 1):
        report.check()
        part = np.ascontiguousarray(array[block])
        values[block] = _integrate(part, dtype, axes) if axes else part
    return values
