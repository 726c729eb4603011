"""The project file: one atlas in one ``*.unwrap3d`` file (Zarr v3 in a zip).

Layout, schema version 4 (1 has no direct chart and no cuts, 2 no annotations, 3 no
protrusions)::

    /              attributes: format, schema_version, parameters (TOML text), quality,
                   provenance, view (JSON)
    /surface       a group per chart; attributes: type (the class), values (scalars, JSON)
    /surface/vertices, faces, ...        an array per array
    /surface/fields                      a group per mapping of arrays
    /sealed/mask                         a group per nested mask or volume
    ...
    /annotations                         see :mod:`.annotated`
    /source                              what was unwrapped; see :mod:`.source`

Arrays are compressed by Blosc (zstd, bitshuffle) and come back bit for bit; see
:mod:`.arrays`.
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
from .annotated import GROUP, checked_view, read_annotations, state_of, write_annotations
from .archive import NODE, check_entries, check_layout, read_node
from .arrays import read_array, write_array
from .atomic import from_plain, plain, replacing
from .consistency import check_charts
from .source import GROUP as SOURCE
from .source import checked_source, kept_source

if TYPE_CHECKING:
    import zarr

    from ..annotations import Annotations
    from ..annotations.state import State
    from ..atlas import Atlas

FORMAT = "napari-unwrap3d project"
SCHEMA_VERSION = 4
OLDEST_SCHEMA = 1
SUFFIX = ".unwrap3d"
MOVIE = "movie.json"  # in the file of a movie, see :mod:`.movie`

CHARTS = (
    "surface",
    "sealed",
    "reference",
    "sphere",
    "uv",
    "topography",
    "direct",
    "plane",
    "protrusions",
    "mask",
)
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


def save_project(
    atlas: Atlas,
    path: str | Path,
    progress: Progress | None = None,
    *,
    annotations: Annotations | State | None = None,
    view: Mapping[str, Any] | None = None,
    source: charts.Stack | charts.Mask | charts.Surface | None = None,
) -> Path:
    """Save an atlas, with everything needed to open it again, in one file.

    Parameters
    ----------
    atlas : Atlas
        Complete or not: charts that it does not have are left out.
    path : path
        ``.unwrap3d`` is appended unless it is there. An existing file is replaced
        only when the new one is complete.
    progress : Progress, optional
    annotations : Annotations or their state, optional
        Those that were drawn on the atlas; its own unless given.
    view : mapping, optional
        What a viewer wants back when the project is opened: JSON-able and small.
    source : Stack, Mask or Surface, optional
        What was unwrapped, so that steps can be run again; see :func:`.source.kept_source`.

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
    state = state_of(annotations if annotations is not None else atlas.annotated)
    attributes = {**_root_attributes(atlas), "view": checked_view(view or {})}
    present = {name: getattr(atlas, name) for name in CHARTS if atlas.has(name)}
    original = kept_source(source, atlas.parameters.stack.timepoint)
    if original is not None:
        present[SOURCE] = original
    size = sum(_bytes(chart) for chart in present.values()) or 1
    written = 0
    with replacing(path) as partial, ZipStore(partial, mode="w") as store:
        root = zarr.create_group(store, attributes=attributes)
        for name, chart in present.items():
            part = report.part(written / size, (written + _bytes(chart)) / size)
            _write_group(root, name, chart, part)
            written += _bytes(chart)
        if state is not None:
            write_annotations(root, state, report)
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
            write_array(group, key, value, report, smooth=key in SMOOTH_GRIDS)
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
        write_array(group, str(index), array, report)


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
        With its annotations in ``atlas.annotations``.

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
    from ..atlas import ON_REQUEST, Atlas

    report = progress if progress is not None else silent()
    with opened(Path(path)) as root:
        summary = _root(root)
        present = [name for name in CHARTS if name in root]
        loaded: dict[str, Any] = dict.fromkeys(CHARTS)
        for index, name in enumerate(present):
            report(index / len(present), f"reading {name}")
            loaded[name] = _read_group(root[name], report)
        check_charts(loaded)
        state = read_annotations(root[GROUP], loaded, report) if GROUP in root else None
        asked = {name: loaded.pop(name) for name in ON_REQUEST}
        atlas = Atlas(
            **loaded,
            on_request={name: chart for name, chart in asked.items() if chart is not None},
            parameters=Parameters.from_toml(str(summary["parameters"])),
            quality=summary["quality"],
            provenance=summary["provenance"],
        )
    if state is not None:
        atlas.annotations.restore(state)
    return atlas


# Records: a few charts in a file of their own ----------------------------------------


def write_record(
    path: Path, record: Mapping[str, Any], key: str, numbers: Mapping[str, Any]
) -> None:
    """Write a few charts, what they were made from and what was measured into one file.

    Parameters
    ----------
    path : Path
        Replaced only when the new one is complete.
    record : mapping of str to chart
    key : str
        Hash of what they were made from.
    numbers : mapping
    """
    import zarr
    from zarr.storage import ZipStore

    attributes = {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "key": key,
        "numbers": plain(numbers),
    }
    with replacing(path) as partial, ZipStore(partial, mode="w") as store:
        root = zarr.create_group(store, attributes=attributes)
        for name, chart in record.items():
            _write_group(root, name, chart, silent())


def read_record(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The charts that :func:`write_record` wrote, and the numbers.

    Raises
    ------
    FileFormatError, InputError
        As in :func:`load_project`.
    """
    with opened(path) as root:
        numbers = dict(from_plain(root.attrs.asdict().get("numbers", {})))
        return {name: _read_group(group, silent()) for name, group in root.groups()}, numbers


def record_key(path: Path) -> str | None:
    """What a record was made from; None without a readable one."""
    key = _record_attributes(path).get("key")
    return key if isinstance(key, str) else None


def record_numbers(path: Path) -> dict[str, Any]:
    """What was measured of a record, without its arrays; empty without a readable one."""
    return dict(from_plain(_record_attributes(path).get("numbers", {})))


def _record_attributes(path: Path) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(path) as archive:
            return dict(read_node(archive, NODE).get("attributes", {}))
    except (OSError, zipfile.BadZipFile, ValueError, Unwrap3DError, KeyError):
        return {}


def load_surface(path: str | Path) -> charts.Surface:
    """The surface of a saved atlas, without its other charts.

    Raises
    ------
    InputError
        There is no such file, or the project has no surface.
    FileFormatError
        As in :func:`load_project`.
    """
    with opened(Path(path)) as root:
        surface = _read_group(root["surface"], silent()) if "surface" in root else None
    if not isinstance(surface, charts.Surface):
        raise InputError(f"The project {Path(path).name!r} has no surface.")
    return surface


def load_source(path: str | Path) -> charts.Stack | charts.Mask | charts.Surface | None:
    """What the cell of a project was unwrapped from; None where it was not kept.

    Raises
    ------
    FileFormatError, InputError
        As in :func:`load_project`.
    """
    with opened(Path(path)) as root:
        if SOURCE not in root:
            return None
        return checked_source(_read_group(root[SOURCE], silent()))


def read_summary(path: str | Path) -> dict[str, Any]:
    """The root attributes of a project and the charts it has, without its arrays.

    Returns
    -------
    dict
        ``schema_version``, ``parameters`` (TOML text), ``quality``, ``provenance``,
        ``view`` (as it was given to :func:`save_project`) and ``charts`` (names).

    Raises
    ------
    FileFormatError, InputError
        As in :func:`load_project`.
    """
    with opened(Path(path)) as root:
        return {**_root(root), "charts": [name for name in CHARTS if name in root]}


@contextmanager
def opened(path: Path) -> Iterator[zarr.Group]:
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
        check_project(path)
        with ZipStore(path, mode="r") as store:
            yield zarr.open_group(store, mode="r", zarr_format=3, use_consolidated=False)
    except Unwrap3DError:
        raise
    except _DAMAGED as error:
        raise FileFormatError(
            f"{path.name!r} is damaged ({type(error).__name__}: {error}).",
            hint="Copy the file again, or make it anew with `napari-unwrap3d run`.",
        ) from error


def check_project(path: Path) -> None:
    """Raise unless the file is a project of a known schema that holds what it declares."""
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        check_entries(archive, size)
        if MOVIE in archive.namelist():
            raise FileFormatError(
                f"{path.name!r} is a movie, not a single cell.",
                hint="Open it with load_movie(...).",
            )
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
        "view": from_plain(checked_view(attributes.get("view", {}))),
    }


def _read_group(group: Any, report: Progress) -> Any:
    attributes = group.attrs.asdict()
    kind = attributes["type"]
    if kind == "mapping":
        names = attributes["names"]
        if str(len(names)) in group or len(set(names)) < len(names):
            raise FileFormatError(f"The names of {group.path!r} are not those of its arrays.")
        arrays = (group[str(index)] for index in range(len(names)))
        return {name: read_array(array, report) for name, array in zip(names, arrays, strict=True)}
    cls = TYPES[kind]
    values = {key: _restored(value) for key, value in attributes["values"].items()}
    for key in (item.name for item in fields(cls) if item.name in group):
        item = group[key]
        read = read_array if hasattr(item, "shape") else _read_group
        values[key] = read(item, report)
    return cls(**values)


def _restored(value: Any) -> Any:
    """JSON has no tuples; charts have no lists."""
    value = from_plain(value)
    return tuple(value) if isinstance(value, list) else value
