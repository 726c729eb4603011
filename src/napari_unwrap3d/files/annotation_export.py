"""What was drawn on a cell, as files in one folder."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..annotations import Annotations, label_rows
from ..errors import InputError
from ..progress import Progress, silent
from .export import check_folder, files_below, replacing_folder
from .formats import Formats
from .meshes import FIELD_SUFFIXES, write_mesh
from .ome_zarr import write_ome_zarr
from .tables import write_table
from .tiff import write_image

CHARTS = ("uv", "direct", "plane", "topography", "volume")
STEMS = ("labels", "points", "vertices", "surface", *(f"{chart}_labels" for chart in CHARTS))


def export_annotations(
    annotations: Annotations,
    folder: str | Path,
    *,
    formats: Formats | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write label images, labels per vertex, and tables of all annotations.

    ``labels`` has a row per annotation and label with its area and means of fields,
    ``vertices`` a row per vertex of the surface, ``points`` a row per point; ``surface`` is
    the mesh with a field per annotation; ``<chart>_labels`` is an image with a channel per
    annotation, of every chart that the atlas has.

    Parameters
    ----------
    annotations : Annotations
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
        There is nothing to be exported, or the folder is not empty and `overwrite` is False.
    """
    report = progress if progress is not None else silent()
    chosen = formats if formats is not None else Formats()
    if not annotations.names and not annotations.points.positions:
        raise InputError("There are no annotations to export.", hint="Draw some first.")
    check_folder(folder, overwrite)
    suffixes = (*chosen.tables, *chosen.images, *chosen.meshes)
    before = tuple(f"{stem}{suffix}" for stem in STEMS for suffix in suffixes)
    with replacing_folder(folder, before) as partial:
        _write_tables(annotations, partial, chosen)
        report(0.2, "tables")
        _write_meshes(annotations, partial, chosen)
        report(0.4, "meshes")
        if annotations.names:
            _write_images(annotations, partial, chosen, report.part(0.4, 1.0))
        written = files_below(partial)
    report(1.0, "files")
    return [Path(folder) / path for path in written]


def column_names(names: tuple[str, ...]) -> dict[str, str]:
    """For every name of an annotation one that mesh formats can hold, all different."""
    columns: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "annotation"
        found, number = plain, 2
        while found in columns.values():
            found, number = f"{plain}_{number}", number + 1
        columns[name] = found
    return columns


def _write_tables(annotations: Annotations, folder: Path, formats: Formats) -> None:
    surface = annotations.atlas.surface
    labels = {
        column: annotations.labels(name).tolist()
        for name, column in column_names(annotations.names).items()
    }
    places = dict(zip(("z_um", "y_um", "x_um"), surface.vertices.T.tolist(), strict=True))
    columns = {"vertex": list(range(len(surface.vertices))), **places, **labels}
    vertices = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    points = [
        {"point": name, "z_um": z, "y_um": y, "x_um": x}
        for name, (z, y, x) in annotations.points.positions.items()
    ]
    for suffix in formats.tables:
        write_table(folder / f"labels{suffix}", label_rows(annotations))
        write_table(folder / f"vertices{suffix}", vertices)
        write_table(folder / f"points{suffix}", points)


def _write_meshes(annotations: Annotations, folder: Path, formats: Formats) -> None:
    surface = annotations.atlas.surface
    fields = {
        column: annotations.labels(name).astype(np.int32)
        for name, column in column_names(annotations.names).items()
    }
    for suffix in formats.meshes:
        kept = fields if suffix in FIELD_SUFFIXES else None
        write_mesh(folder / f"surface{suffix}", surface.vertices, surface.faces, kept)


def _write_images(
    annotations: Annotations, folder: Path, formats: Formats, report: Progress
) -> None:
    atlas, names = annotations.atlas, annotations.names
    for index, chart in enumerate(CHARTS):
        report(index / len(CHARTS), f"labels of {chart}")
        if not atlas.has("mask" if chart == "volume" else chart):
            continue
        image = np.stack([annotations.image(name, chart) for name in names])
        axes = "cyx" if image.ndim == 3 else "czyx"
        sizes: dict[str, float] = {}
        origin: dict[str, float] = {}
        if chart == "volume":
            sizes = dict(zip("zyx", atlas.mask.voxel_size, strict=True))
            origin = dict(zip("zyx", atlas.mask.origin, strict=True))
        elif chart == "topography":
            d_um = atlas.topography.d_um
            sizes, origin = {"z": float(d_um[1] - d_um[0])}, {"z": float(d_um[0])}
        for suffix in formats.images:
            path = folder / f"{chart}_labels{suffix}"
            if suffix == ".ome.zarr":
                write_ome_zarr(path, image, axes, sizes=sizes, origin=origin, channels=names)
            else:
                write_image(path, image, axes, sizes=sizes, channels=names)
