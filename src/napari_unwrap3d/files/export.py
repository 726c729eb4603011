"""Everything that an atlas gives, as files in one folder."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Stack, Volume
from ..errors import InputError
from ..progress import Progress, silent
from . import protrusion_export
from .atomic import write_json, write_text
from .formats import Formats
from .meshes import FIELD_SUFFIXES, write_mesh
from .ome_zarr import write_ome_zarr
from .pictures import write_pictures
from .project import save_project
from .stacks import write_image
from .tables import quality_rows, write_table
from .texture import atlas_texture, write_textured_mesh

if TYPE_CHECKING:
    from ..atlas import Atlas

PROJECT_NAME = "cell.unwrap3d"

# What an export may write: only these are removed from a folder that is used again.
FOLDERS = ("meshes", "pictures")
FILES = (
    PROJECT_NAME,
    "uv.ome.tif",
    "topography.ome.tif",
    "topography_layers.csv",
    "quality.csv",
    "quality.json",
    "parameters.toml",
    "provenance.json",
)
OTHER_FILES = (
    "uv.ome.zarr",
    "direct.ome.tif",
    "direct.ome.zarr",
    "topography.ome.zarr",
    "topography_layers.parquet",
    "quality.parquet",
    *protrusion_export.entries(),
)
ENTRIES = FOLDERS + FILES + OTHER_FILES


def export_atlas(
    atlas: Atlas,
    folder: str | Path,
    *,
    stack: Stack | None = None,
    pictures: bool = True,
    formats: Formats | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write meshes, images, the project, tables and pictures of an atlas.

    Parameters
    ----------
    atlas : Atlas
        Complete or not: what needs a missing chart is left out.
    folder : path
        New, empty, or with `overwrite` the folder of an earlier export. It changes only
        when everything has been written.
    stack : Stack, optional
        Its channels are sampled into (d, u, v), beside the mask.
    pictures : bool
    formats : Formats, optional
        By default PLY, OME-TIFF and CSV. In OBJ the surface, the reference and the sphere
        have a texture.
    overwrite : bool
        Replace an earlier export. Other files in the folder are left alone.
    progress : Progress, optional

    Returns
    -------
    list of Path
        The files, in the order of their names.

    Raises
    ------
    InputError
        The folder is not empty and `overwrite` is False.
    """
    report = progress if progress is not None else silent()
    chosen = formats if formats is not None else Formats()
    check_folder(folder, overwrite)
    with replacing_folder(folder, ENTRIES) as partial:
        _write_tables(atlas, partial, chosen)
        _write_meshes(atlas, partial / "meshes", chosen, report.part(0.0, 0.1))
        if atlas.has("protrusions"):
            protrusion_export.write_protrusions(atlas, partial, chosen, report.part(0.1, 0.2))
        _write_images(atlas, partial, stack, chosen, report.part(0.2, 0.5))
        save_project(atlas, partial / PROJECT_NAME, report.part(0.5, 0.75))
        if pictures:
            write_pictures(atlas, partial / "pictures", report.part(0.75, 1.0))
        written = files_below(partial)
        report(1.0, "files")
    return [Path(folder) / path for path in written]


def export_protrusions(
    atlas: Atlas,
    folder: str | Path,
    *,
    formats: Formats | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write the protrusions alone: their table, label images and closed meshes.

    Parameters
    ----------
    atlas : Atlas
        With its protrusions.
    folder : path
        New, empty, or with `overwrite` the folder of an earlier export.
    formats : Formats, optional
        By default PLY, OME-TIFF and CSV.
    overwrite : bool
    progress : Progress, optional

    Returns
    -------
    list of Path
        The files, in the order of their names.

    Raises
    ------
    InputError
        The folder is not empty and `overwrite` is False.
    """
    report = progress if progress is not None else silent()
    chosen = formats if formats is not None else Formats()
    check_folder(folder, overwrite)
    with replacing_folder(folder, ("meshes", *protrusion_export.entries())) as partial:
        (partial / "meshes").mkdir()
        protrusion_export.write_protrusions(atlas, partial, chosen, report)
        written = files_below(partial)
    return [Path(folder) / path for path in written]


def files_below(folder: Path) -> list[Path]:
    """The files in a folder and below it, in the order of their names, relative to it."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def check_folder(folder: str | Path, overwrite: bool) -> None:
    """Raise when an export to `folder` would be refused."""
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{str(folder)!r} is a file, not a folder.", hint="Choose another output.")
    if folder.is_dir() and not overwrite:
        found = sum(1 for _ in folder.iterdir())
        if found:
            raise InputError(
                f"The folder {str(folder)!r} is not empty.",
                entries=found,
                hint="Choose another folder, or pass --overwrite (overwrite=True) to replace an "
                "earlier export in it.",
            )


@contextmanager
def replacing_folder(folder: str | Path, names: tuple[str, ...] = ()) -> Iterator[Path]:
    """Give a temporary folder inside `folder`; its content moves up at the end.

    When the block raises, also through Ctrl-C, nothing has changed.

    Parameters
    ----------
    folder : path
        Made when it does not exist.
    names : tuple of str
        Entries of an earlier export: those that are not written anew are removed.
    """
    folder = Path(folder)
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    # Inside, not beside: the folder may be a mount of its own, across which nothing moves.
    partial = Path(tempfile.mkdtemp(prefix=".unwrap3d-", suffix=".partial", dir=folder))
    try:
        yield partial
        remove_entries(folder, {*names, *(entry.name for entry in partial.iterdir())})
        for entry in sorted(partial.iterdir()):
            os.replace(entry, folder / entry.name)
            made = False
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if made:
            folder.rmdir()


def remove_entries(folder: Path, names: Iterable[str] = ENTRIES) -> None:
    """Remove files and folders in `folder`, by default those of an earlier export."""
    for path in (folder / name for name in names):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


# Parts -----------------------------------------------------------------------


def _write_tables(atlas: Atlas, folder: Path, formats: Formats) -> None:
    for suffix in formats.tables:
        write_table(folder / f"quality{suffix}", quality_rows(atlas))
    write_json(folder / "quality.json", atlas.quality)
    write_json(folder / "provenance.json", atlas.provenance)
    write_text(folder / "parameters.toml", atlas.parameters.to_toml())


def _write_meshes(atlas: Atlas, folder: Path, formats: Formats, report: Progress) -> None:
    folder.mkdir()
    for name, vertices, faces, fields in _meshes(atlas):
        for suffix in formats.meshes:
            report.check()
            path = folder / f"{name}{suffix}"
            texture = atlas_texture(atlas, name) if suffix == ".obj" else None
            if texture is not None:
                write_textured_mesh(path, vertices, faces, *texture)
            else:
                write_mesh(path, vertices, faces, fields if suffix in FIELD_SUFFIXES else None)
    report(1.0, "meshes")


def _meshes(atlas: Atlas) -> Iterator[tuple[str, Floats, Ints, Mapping[str, Any]]]:
    """Name, vertices, faces and fields of every mesh of an atlas."""
    for name in ("surface", "sealed", "reference", "sphere"):
        if atlas.has(name):
            chart = getattr(atlas, name)
            fields = atlas.reference.fields if name == "sphere" else chart.fields
            if name == "surface" and atlas.has("protrusions"):
                fields = {**fields, **protrusion_export.surface_fields(atlas)}
            yield name, chart.vertices, chart.faces, fields
    if atlas.has("direct"):
        direct = atlas.direct
        yield "direct", direct.vertices, direct.faces, {"cortex": direct.cortex.astype(np.uint8)}
    if atlas.has("sphere"):
        sphere = atlas.sphere
        yield "sphere_conformal", sphere.conformal, sphere.faces, atlas.reference.fields
    if atlas.has("topography"):
        flat = atlas.topography
        yield "topographic_surface", flat.meshed_vertices, flat.meshed_faces, {}
        fields = {name: field[flat.cut_origin] for name, field in atlas.surface.fields.items()}
        fields["surface_vertex"] = flat.cut_origin
        yield "topographic_surface_duv", flat.cut_vertices, flat.cut_faces, fields


def _write_images(
    atlas: Atlas, folder: Path, stack: Stack | None, formats: Formats, report: Progress
) -> None:
    if atlas.has("uv"):
        fields = atlas.uv.fields
        image = np.stack([np.asarray(field, dtype=np.float32) for field in fields.values()])
        for suffix in formats.images:
            _write_image(folder / f"uv{suffix}", image, "cyx", tuple(fields))
    if atlas.has("direct"):
        carried = {
            name: atlas.carry(np.nan_to_num(field), "surface", "direct")
            for name, field in atlas.surface.fields.items()
        }
        image = np.stack([field.astype(np.float32) for field in carried.values()])
        for suffix in formats.images:
            _write_image(folder / f"direct{suffix}", image, "cyx", tuple(carried))
    report(0.1, "uv image")
    if atlas.has("topography"):
        d_um = atlas.topography.d_um
        names, volumes = topography_channels(atlas, stack, report.part(0.1, 0.8))
        for suffix in formats.images:
            _write_image(folder / f"topography{suffix}", volumes, "czyx", names, d_um)
        layers = [{"layer": i, "d_um": float(d)} for i, d in enumerate(d_um)]
        for suffix in formats.tables:
            write_table(folder / f"topography_layers{suffix}", layers)
    report(1.0, "topography image")


def _write_image(
    path: Path,
    image: npt.NDArray[Any],
    axes: str,
    channels: tuple[str, ...],
    d_um: Floats | None = None,
) -> None:
    """Write an image over (v, u), with d as z where it has layers; pixels have no size in µm."""
    sizes: dict[str, float] = {}
    origin: dict[str, float] = {}
    if d_um is not None:
        sizes["z"] = float(d_um[1] - d_um[0]) if len(d_um) > 1 else 1.0
        origin["z"] = float(d_um[0])
    if path.suffix == ".zarr":
        write_ome_zarr(path, image, axes, sizes=sizes, origin=origin, channels=channels)
    else:
        write_image(path, image, axes, sizes=sizes, channels=channels)


def topography_channels(
    atlas: Atlas, stack: Stack | None, report: Progress
) -> tuple[tuple[str, ...], npt.NDArray[Any]]:
    """The mask and the channels of a stack in (d, v, u).

    Returns
    -------
    names : tuple of str
        "mask" and the stack's channels.
    volumes : ndarray, (c, D, N, 2N)
        In the stack's type; uint8 without a stack.
    """
    chart = atlas.topography
    if stack is None:
        return ("mask",), chart.mask[None].view(np.uint8)
    count = stack.shape[stack.axes.index("c")] if "c" in stack.axes else 1
    kind = np.dtype(stack.data.dtype)
    kind = kind if kind.kind in "u" and kind.itemsize <= 2 else np.dtype(np.float32)
    names = stack.channels if len(stack.channels) == count else _numbered(count)
    volumes = np.empty((count + 1, *chart.shape), dtype=kind)
    volumes[0] = chart.mask
    for channel in range(count):
        report(channel / count, "sampling the stack")
        volume = _around_topography(atlas, stack, channel)
        values = np.asarray(atlas.carry(volume, "volume", "topography", kind="scalar"))
        values = np.nan_to_num(values, nan=0.0)
        if kind.kind == "u":
            values = np.clip(np.rint(values), 0, np.iinfo(kind).max)
        volumes[channel + 1] = values
    return ("mask", *names), volumes


def _numbered(count: int) -> tuple[str, ...]:
    return ("intensity",) if count == 1 else tuple(f"channel {i}" for i in range(count))


def _around_topography(atlas: Atlas, stack: Stack, channel: int) -> Volume:
    """One channel, loaded only where the topography is."""
    positions = atlas.topography.positions
    data = stack.volume(atlas.parameters.stack.timepoint, channel)
    size = np.asarray(stack.voxel_size)
    low = np.floor(positions.min(axis=(0, 1, 2)) / size).astype(int) - 1
    high = np.ceil(positions.max(axis=(0, 1, 2)) / size).astype(int) + 2
    low, high = np.clip(low, 0, None), np.clip(high, 0, data.shape)
    box = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    z, y, x = (float(c) for c in low * size)
    return Volume(np.asarray(data[box]), stack.voxel_size, (z, y, x))
