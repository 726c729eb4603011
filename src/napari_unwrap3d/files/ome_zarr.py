"""OME-Zarr images: v0.1 to v0.5 read lazily, v0.5 written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileFormatError, InputError
from ..progress import Progress, silent
from .atomic import replacing
from .metadata import Found, micrometres, seconds
from .tiff import STORED, check_axes, damaged

TYPES = {"t": "time", "c": "channel", "z": "space", "y": "space", "x": "space"}
CHUNK_BYTES = 32 * 2**20

READING_ERRORS = (OSError, KeyError, ValueError, TypeError, RuntimeError)


def read_zarr(path: Path, dataset: str | None = None) -> Found:
    """The full-resolution level of an OME-Zarr image, or a plain Zarr array.

    Parameters
    ----------
    path : Path
        The folder.
    dataset : str, optional
        A group or array inside, e.g. ``"labels/cells"`` or ``"0"``.

    Raises
    ------
    FileFormatError
        The folder is damaged, holds no image, or holds several.
    """
    import zarr

    try:
        node: Any = zarr.open(str(path), mode="r")
        if dataset is not None:
            node = _inside(node, path, dataset)
        if isinstance(node, zarr.Array):
            return Found(_lazy(node), remark="a Zarr array without OME metadata")
        attributes: dict[str, Any] = dict(node.attrs)
        said: Any = attributes.get("ome", attributes)
        if not said.get("multiscales"):
            raise _no_image(node, path)
        image = said["multiscales"][0]
        levels = image["datasets"]
        data = _lazy(node[levels[0]["path"]])
        return _described(data, image, levels[0], said.get("omero", {}))
    except READING_ERRORS as error:
        if isinstance(error, FileFormatError):
            raise
        raise damaged(path.name, f"{type(error).__name__}: {error}") from error


def _lazy(array: Any) -> Any:
    import dask.array

    # dask declares no types.
    from_array: Any = dask.array.from_array
    return from_array(array, chunks=array.chunks, asarray=False, fancy=False)


def _inside(node: Any, path: Path, dataset: str) -> Any:
    if not hasattr(node, "members") or dataset.strip("/") not in node:
        raise _no_image(node, path, dataset)
    return node[dataset.strip("/")]


def _no_image(node: Any, path: Path, dataset: str | None = None) -> FileFormatError:
    members = sorted(name for name, _ in node.members()) if hasattr(node, "members") else []
    what = f"has no member {dataset!r}" if dataset else "is no OME-Zarr image (no multiscales)"
    return FileFormatError(
        f"{path.name} {what}. Found: {', '.join(members) or 'nothing'}.",
        hint=f"Choose what is meant, e.g. dataset={members[0]!r}." if members else "",
    )


def _described(data: Any, image: Any, level: Any, omero: Any) -> Found:
    axes = image.get("axes") or [{"name": name} for name in "tczyx"]
    axes = [{"name": axis} if isinstance(axis, str) else axis for axis in axes]
    steps = [1.0] * len(axes)
    given = False
    for transformation in [
        *level.get("coordinateTransformations", []),
        *image.get("coordinateTransformations", []),
    ]:
        if transformation.get("type") == "scale":
            given = True
            scale = transformation["scale"]
            steps = [step * float(s) for step, s in zip(steps, scale, strict=True)]
    by_name = {str(a["name"]).lower(): (s, a.get("unit")) for a, s in zip(axes, steps, strict=True)}
    sizes = {a: micrometres(*by_name[a]) for a in "zyx" if given and a in by_name}
    said = [
        f"{a} = {by_name[a][0]:g} {by_name[a][1] or '(no unit)'}" for a in "zyx" if a in by_name
    ]
    labels = tuple(str(channel.get("label") or "") for channel in omero.get("channels", []))
    return Found(
        data,
        axes="".join(by_name),
        voxel_size={axis: size for axis, size in sizes.items() if size is not None},
        time_step=seconds(*by_name["t"]) if given and "t" in by_name else None,
        channels=labels if any(labels) else (),
        remark="OME-Zarr's " + (", ".join(said) if given else "axes without a scale"),
    )


# Writing ---------------------------------------------------------------------


def write_ome_zarr(
    path: str | Path,
    data: Any,
    axes: str = "zyx",
    *,
    sizes: Mapping[str, float] | None = None,
    origin: Mapping[str, float] | None = None,
    time_step: float | None = None,
    channels: Sequence[str] = (),
    progress: Progress | None = None,
) -> Path:
    """Write an OME-Zarr image (v0.5, one level); the folder appears at once when complete.

    Parameters
    ----------
    path : path
        Best ends in ``.ome.zarr``. An image that is there is replaced.
    data : array-like
        Booleans are stored as uint8, float64 as float32. A dask array is computed and written
        one by one along its first axis; the range of its channels is that of the first.
    axes : str
        Letters out of ``tczyx`` in this order, as in
        :func:`~napari_unwrap3d.files.tiff.write_image`.
    sizes, origin : mapping of str to float, optional
        Step along, and position of the first sample on, ``z``, ``y``, ``x`` in µm; leave out
        those without a physical size.
    time_step : float, optional
        Seconds.
    channels : sequence of str
        Names along the c axis.
    progress : Progress, optional

    Raises
    ------
    AxesError
        Axes, channels and data do not fit together.
    InputError
        The data are not real numbers.
    """
    import zarr

    lazy = hasattr(data, "compute")
    path, array = Path(path), data if lazy else np.asarray(data)
    check_axes(array, axes, channels)
    if array.dtype.kind not in "biuf":
        raise InputError("An image holds real numbers.", dtype=str(array.dtype))
    array = array.astype(STORED.get(array.dtype.name, array.dtype), copy=False)
    described = _description(path.name, axes, sizes or {}, origin or {}, time_step)
    if channels:
        shown = np.asarray(array[:1]) if lazy else array
        described["omero"] = {"channels": _channels(shown, axes.index("c"), channels)}
    with replacing(path) as partial:
        group = zarr.create_group(partial, zarr_format=3, attributes={"ome": described})
        stored = group.create_array(
            "0",
            shape=array.shape,
            dtype=array.dtype,
            chunks=_chunks(array, axes),
            dimension_names=[*axes],
        )
        if lazy:
            _write_one_by_one(stored, array, progress or silent())
        else:
            stored[...] = array
    return path


def _write_one_by_one(stored: Any, lazy: Any, progress: Progress) -> None:
    """Compute and write along the first axis; memory is that of one."""
    for index in range(len(lazy)):
        progress(index / len(lazy), f"writing {index + 1} of {len(lazy)}")
        stored[index] = np.asarray(lazy[index])
    progress(1.0)


def _description(
    name: str,
    axes: str,
    sizes: Mapping[str, float],
    origin: Mapping[str, float],
    time_step: float | None,
) -> dict[str, Any]:
    steps = {**sizes, **({"t": time_step} if time_step is not None else {})}
    units = {axis: "second" if axis == "t" else "micrometer" for axis in steps}
    known = [
        {"name": axis, "type": TYPES[axis], **({"unit": units[axis]} if axis in units else {})}
        for axis in axes
    ]
    placed: list[dict[str, Any]] = [
        {"type": "scale", "scale": [float(steps.get(axis, 1.0)) for axis in axes]}
    ]
    if origin:
        shift = [float(origin.get(axis, 0.0)) for axis in axes]
        placed.append({"type": "translation", "translation": shift})
    level = {"path": "0", "coordinateTransformations": placed}
    return {
        "version": "0.5",
        "multiscales": [{"name": name.split(".")[0], "axes": known, "datasets": [level]}],
    }


def _channels(array: Any, axis: int, names: Sequence[str]) -> list[dict[str, Any]]:
    """Name, colour and range of each channel, all of which viewers ask for."""
    found = []
    for index, name in enumerate(names):
        values = array.take(index, axis)
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        window = {"min": low, "max": high, "start": low, "end": high}
        found.append({"label": name, "color": "FFFFFF", "active": True, "window": window})
    return found


def _chunks(array: Any, axes: str) -> tuple[int, ...]:
    """Whole planes of one timepoint and channel, as many as make about 32 MiB."""
    plane = max(int(np.prod(array.shape[-2:])) * array.itemsize, 1)
    depth = max(CHUNK_BYTES // plane, 1)
    length = {"t": 1, "c": 1, "z": depth}
    return tuple(
        max(min(n, length.get(axis, n)), 1) for axis, n in zip(axes, array.shape, strict=True)
    )
