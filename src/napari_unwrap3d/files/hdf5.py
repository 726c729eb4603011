"""HDF5 stacks as plant-seg and ilastik write them, read lazily."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FileFormatError
from .metadata import Found, micrometres
from .tiff import damaged, lazy

READING_ERRORS = (OSError, KeyError, RuntimeError, ValueError)


@dataclass(frozen=True)
class Hdf5Source:
    """One dataset of an HDF5 file; the file is opened for each read and closed after it."""

    path: str
    dataset: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    stamp: tuple[int, int]

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def __getitem__(self, key: Any) -> npt.NDArray[Any]:
        import h5py

        try:
            with h5py.File(self.path, "r") as file:
                return np.asarray(file[self.dataset][key])
        except READING_ERRORS as error:
            raise damaged(Path(self.path).name, str(error)) from error

    def __dask_tokenize__(self) -> tuple[Any, ...]:
        return (type(self).__name__, self.path, self.dataset, self.stamp)


def read_hdf5(path: Path, dataset: str | None = None) -> Found:
    """One dataset of an HDF5 file: the given one, else ``raw``, else the only one.

    The voxel size comes from the attribute ``element_size_um`` (z, y, x), the axes from
    ilastik's ``axistags`` or from HDF5's dimension labels.

    Raises
    ------
    FileFormatError
        The file is damaged, or which dataset is meant is not clear.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            names: list[str] = []

            def visit(name: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset) and item.ndim >= 2 and item.dtype.kind in "biuf":
                    names.append(name)

            file.visititems(visit)
            shapes = {name: tuple(int(n) for n in file[name].shape) for name in names}
            chosen = _choose(path.name, shapes, dataset)
            item = file[chosen]
            stat = path.stat()
            source = Hdf5Source(
                str(path.resolve()),
                chosen,
                shapes[chosen],
                np.dtype(item.dtype),
                (stat.st_mtime_ns, stat.st_size),
            )
            axes = _axes(item)
            data = lazy(source, axes, item.chunks)
            sizes = np.asarray(item.attrs.get("element_size_um", ())).ravel().tolist()
    except READING_ERRORS as error:
        if isinstance(error, FileFormatError):
            raise
        raise damaged(path.name, str(error)) from error
    known = {axis: micrometres(s, "µm") for axis, s in zip("zyx", sizes[-3:], strict=False)}
    return Found(
        data,
        axes=axes,
        voxel_size={a: s for a, s in known.items() if s is not None} if len(sizes) >= 3 else {},
        remark=f"HDF5's element_size_um {sizes}" if sizes else "no attribute element_size_um",
    )


def _choose(name: str, shapes: dict[str, tuple[int, ...]], dataset: str | None) -> str:
    stacks = [key for key, shape in shapes.items() if len(shape) >= 3]
    wanted = dataset.strip("/") if dataset is not None else None
    if wanted is not None and wanted in shapes:
        return wanted
    if wanted is None:
        raw = [key for key in stacks if key.rpartition("/")[2] == "raw"]
        for candidates in (raw, stacks, list(shapes)):
            if len(candidates) == 1:
                return candidates[0]
    listed = ", ".join(f"{key} {shape}" for key, shape in shapes.items()) or "no image"
    what = f"has no dataset {dataset!r}" if wanted is not None else "holds several datasets"
    raise FileFormatError(
        f"{name} {what if shapes else 'holds no image'}. Found: {listed}.",
        hint=f"Choose one, e.g. dataset={(stacks or list(shapes))[0]!r}." if shapes else "",
    )


def _axes(item: Any) -> str:
    """Axes that the file names, or ""."""
    tags = item.attrs.get("axistags")
    if tags is not None:
        text = tags.decode() if isinstance(tags, bytes) else str(tags)
        try:
            return "".join(str(axis["key"]) for axis in json.loads(text)["axes"]).lower()
        except (json.JSONDecodeError, KeyError, TypeError):
            return ""
    labels = [dimension.label for dimension in item.dims]
    return "".join(labels).lower() if all(len(label) == 1 for label in labels) else ""
