"""OME-Zarr stacks (v0.1 to v0.5), read lazily."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import FileFormatError
from .metadata import Found, micrometres, seconds
from .tiff import damaged

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
