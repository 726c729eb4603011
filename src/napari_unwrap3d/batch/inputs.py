"""What a batch is given: files, folders and patterns, and how each of them is opened.

Workers open the files themselves, so that no image travels and what is read stays lazy.
"""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from ..charts import Mask, Stack, Surface
from ..errors import InputError
from ..files.meshes import MESH_SUFFIXES
from ..files.project import SUFFIX
from ..files.stacks import STACK_SUFFIXES
from ..imaging.roi import chosen_volume
from ..motion.timelapse import Source, Timelapse
from ..parameters import StackParameters
from ..parameters.base import ThreeSizes
from ..progress import Progress

Kind = Literal["stack", "mask", "mesh", "record"]


class Reading(BaseModel):
    """How files are read; see :func:`~napari_unwrap3d.read_stack` and `read_mesh`.

    Attributes
    ----------
    voxel_size : (z, y, x) in µm, axes, dataset
        Of stacks, instead of what the files say.
    time_step : float, optional
        Seconds between two timepoints.
    scale : float, optional
        µm per unit of a mesh file.
    mask : bool
        Stacks are masks: what is not 0 is cell.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    voxel_size: ThreeSizes | None = None
    axes: str | None = None
    dataset: str | None = None
    time_step: float | None = None
    scale: float | None = None
    mask: bool = False


class Recipe(BaseModel):
    """How the source of one cell or of one movie is opened, on any machine that sees the files.

    Attributes
    ----------
    kind : "stack", "mask", "mesh" or "record"
        A record is a source that was in memory, written by the batch itself.
    paths : tuple of str
        Absolute. Several are the timepoints of one movie.
    sequence : bool
        Whether the files are the timepoints of one movie.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Kind
    paths: tuple[str, ...]
    sequence: bool = False
    name: str
    reading: Reading = Reading()

    def single(self, parameters: StackParameters) -> Source:
        """The source of a single cell, still lazy; of a stack over time, the whole stack.

        Raises
        ------
        InputError
            The file cannot be read.
        """
        return self._converted(self.read(0), parameters.timepoint, parameters.channel)

    def lapse(self, parameters: StackParameters) -> Timelapse:
        """The timepoints of a movie, still lazy.

        Raises
        ------
        InputError
            A file cannot be read, or the time between two timepoints is not known.
        """
        step = self.reading.time_step
        if self.sequence:
            return Timelapse.of_lazy(Opened(self, parameters.channel), step, self.name)
        stack = self.read(0)
        assert isinstance(stack, Stack)
        if self.kind == "mask":
            step = stack.time_step if step is None else step
            return Timelapse.of_lazy(MaskStack(stack, parameters.channel), step, self.name)
        return Timelapse.of(stack, step, self.name)

    def timepoint(self, index: int, channel: int) -> Source:
        """The source of one of several files."""
        return self._converted(self.read(index), 0, channel)

    def read(self, index: int) -> Source:
        """What is in one of the files, still lazy where it is a stack."""
        reading, path = self.reading, self.paths[index]
        if self.kind == "record":
            return kept_source_of(Path(path))
        if self.kind == "mesh":
            from ..files.meshes import read_mesh

            return read_mesh(path, scale=reading.scale or 1.0)
        from ..files.stacks import read_stack

        return read_stack(
            path, reading.voxel_size, reading.time_step, axes=reading.axes, dataset=reading.dataset
        )

    def _converted(self, source: Source, timepoint: int, channel: int) -> Source:
        if self.kind != "mask" or not isinstance(source, Stack):
            return source
        return Mask(np.asarray(source.volume(timepoint, channel)) != 0, source.voxel_size)


@dataclass(frozen=True, eq=False)
class Opened(Sequence[Source]):
    """The timepoints of a movie that are a file each, opened when they are asked for."""

    recipe: Recipe
    channel: int

    def __len__(self) -> int:
        return len(self.recipe.paths)

    def __getitem__(self, index: Any) -> Any:
        return self.recipe.timepoint(index, self.channel)


@dataclass(frozen=True, eq=False)
class MaskStack(Sequence[Source]):
    """The timepoints of a stack of masks."""

    stack: Stack
    channel: int

    def __len__(self) -> int:
        return self.stack.timepoints

    def __getitem__(self, index: Any) -> Any:
        volume = self.stack.volume(index, self.channel)
        return Mask(np.asarray(volume) != 0, self.stack.voxel_size)


@dataclass(frozen=True)
class Looked:
    """What planning needs to know of a source.

    Attributes
    ----------
    timepoints : int
    shape : (int, int, int)
        Of one timepoint in voxels (z, y, x); of a mesh, of its solid.
    voxel_size : (float, float, float)
    source_bytes : int
        Of one timepoint, all channels.
    """

    timepoints: int
    shape: tuple[int, int, int]
    voxel_size: tuple[float, float, float]
    source_bytes: int

    @classmethod
    def at(cls, recipe: Recipe, working_voxel_um: float | None) -> Looked:
        """Look at a source; of several files, at the first."""
        source = recipe.read(0)
        timepoints = len(recipe.paths) if recipe.sequence else 1
        if isinstance(source, Surface):
            from ..unwrapping.solid import AUTOMATIC_VOXELS, MARGIN_VOXELS

            extent = np.ptp(source.vertices, axis=0)
            edge = working_voxel_um or float(extent.max()) / AUTOMATIC_VOXELS
            z, y, x = (int(n) for n in np.ceil(extent / edge) + 2 * MARGIN_VOXELS)
            size = source.vertices.nbytes + source.faces.nbytes
            return cls(timepoints, (z, y, x), (edge,) * 3, size)
        z, y, x = (int(n) for n in source.data.shape[-3:])
        volume = z * y * x * np.dtype(source.data.dtype).itemsize
        channels = 1
        if isinstance(source, Stack):
            timepoints = timepoints if recipe.sequence else source.timepoints
            channels = source.shape[source.axes.index("c")] if "c" in source.axes else 1
        return cls(timepoints, (z, y, x), source.voxel_size, volume * channels)


# Files -------------------------------------------------------------------------------


def expanded(inputs: Iterable[str | Path]) -> list[Path]:
    """The files that paths, folders and patterns stand for, each once, in a person's order.

    Raises
    ------
    InputError
        A path does not exist, a folder or a pattern has no file that is read, or a project
        is named.
    """
    found: dict[Path, None] = {}
    for each in inputs:
        paths = list(_below(Path(each)))
        if not paths:
            raise InputError(
                f"There is nothing to unwrap in {str(each)!r}.",
                hint=f"Files that are read: {', '.join((*STACK_SUFFIXES, *MESH_SUFFIXES))}.",
            )
        found |= dict.fromkeys(path.resolve() for path in paths)
    return list(found)


def _below(path: Path) -> Iterator[Path]:
    if not path.exists() and glob.has_magic(str(path)):
        matches = [Path(match) for match in glob.glob(str(path), recursive=True)]
        yield from sorted((p for p in matches if _is_read(p)), key=_as_people_sort)
    elif not path.exists():
        raise InputError(f"There is no file {str(path)!r}.", hint="Check the path.")
    elif path.is_dir() and not _is_stack_folder(path):
        yield from sorted((p for p in path.iterdir() if _is_read(p)), key=_as_people_sort)
    elif path.suffix == SUFFIX:
        raise InputError(
            f"{path.name!r} is a project: it has been unwrapped already.",
            hint="`napari-unwrap3d export` writes its files, `info` shows its quality.",
        )
    else:
        yield path


def kind_of(path: Path, mask: bool) -> Kind:
    """What a file is, told by its suffix."""
    if path.suffix.lower() in MESH_SUFFIXES:
        return "mesh"
    return "mask" if mask else "stack"


def _is_read(path: Path) -> bool:
    if path.name.startswith("."):
        return False
    if path.is_dir():
        return _is_stack_folder(path)
    return path.suffix.lower() in (*STACK_SUFFIXES, *MESH_SUFFIXES)


def _is_stack_folder(path: Path) -> bool:
    """Whether a folder is an OME-Zarr image, and not one with images in it."""
    marks = ("zarr.json", ".zgroup", ".zarray", ".zattrs")
    return path.suffix.lower() == ".zarr" or any((path / mark).is_file() for mark in marks)


def _as_people_sort(path: Path) -> list[Any]:
    """``t2`` before ``t10``."""
    parts = re.split(r"(\d+)", str(path))
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


# Sources in memory -------------------------------------------------------------------

RECORD_CHART = "source"


def kept_source_of(path: Path) -> Source:
    """The source in a record that :func:`keep_sources` wrote."""
    from ..files.project import read_record

    source: Source = read_record(path)[0][RECORD_CHART]
    return source


def keep_sources(source: Source | Timelapse, folder: Path) -> tuple[str, ...]:
    """Write what is in memory, a record for each timepoint, so that workers can open it.

    What is there with the same content is not written again.
    """
    from ..files.project import record_key, write_record

    lapse = source if isinstance(source, Timelapse) else Timelapse((source,), 1.0)
    paths = []
    for timepoint in range(len(lapse)):
        path = folder / f"{timepoint:05d}.zip"
        key = lapse.key(timepoint)
        if record_key(path) != key:
            chart: Any = lapse.at(timepoint)
            if isinstance(chart, Stack):
                chart = replace(chart, data=np.asarray(chart.data))
            write_record(path, {RECORD_CHART: chart}, key, {})
        paths.append(str(path.resolve()))
    return tuple(paths)


# Labels ------------------------------------------------------------------------------

SLAB_BYTES = 1 << 26


def label_voxels(
    recipe: Recipe,
    parameters: StackParameters,
    movie: bool,
    progress: Progress,
    first_only: bool = False,
) -> dict[int, int]:
    """The labels of a label image, and the largest number of voxels of each at any timepoint.

    Everything is read once, a slab at a time; of a movie by choice the first timepoint only.

    Raises
    ------
    InputError
        It is no label image, or has no label.
    """
    count = 1
    source: Source | Timelapse = recipe.single(parameters)
    if movie:
        source = recipe.lapse(parameters)
        count = 1 if first_only else len(source)
    found: dict[int, int] = {}
    for timepoint in range(count):
        progress(timepoint / count, f"labels of {recipe.name}")
        one = source.at(timepoint) if isinstance(source, Timelapse) else source
        for label, voxels in _voxels(one, parameters, movie).items():
            found[label] = max(found.get(label, 0), voxels)
    if not found:
        raise InputError(f"{recipe.name!r} has no label: every voxel is 0.")
    return dict(sorted(found.items()))


def _voxels(source: Source, parameters: StackParameters, movie: bool) -> dict[int, int]:
    if not isinstance(source, Stack) or np.dtype(source.data.dtype).kind not in "biu":
        raise InputError(
            "Labels are taken of label images: stacks of whole numbers.",
            kind=type(source).__name__.lower(),
            dtype=str(getattr(getattr(source, "data", None), "dtype", "none")),
            hint="Leave the labels out to segment an image.",
        )
    sizes: dict[int, int] = {}
    volume = chosen_volume(source, 0 if movie else parameters.timepoint, parameters.channel)
    for slab in _slabs(volume):
        for label, count in zip(*np.unique(slab, return_counts=True), strict=True):
            if label > 0:
                sizes[int(label)] = sizes.get(int(label), 0) + int(count)
    return sizes


def _slabs(volume: Any) -> Iterator[Any]:
    plane = int(np.prod(volume.shape[1:])) * np.dtype(volume.dtype).itemsize
    thick = max(1, SLAB_BYTES // max(plane, 1))
    for start in range(0, volume.shape[0], thick):
        yield np.asarray(volume[start : start + thick])
