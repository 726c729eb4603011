"""The protrusions of a cell as files: table, label images and closed meshes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..progress import Progress
from ..protrusions.meshes import CORTEX, part_meshes
from .formats import Formats
from .meshes import write_mesh
from .ome_zarr import write_ome_zarr
from .stacks import write_image
from .tables import write_table

if TYPE_CHECKING:
    from ..atlas import Atlas

CHARTS = ("uv", "direct", "topography")
TABLE, VOLUME, FOLDER = "protrusions", "protrusions_volume", "protrusions"


def entries() -> tuple[str, ...]:
    """What may be written beside the meshes, in any format."""
    images = (VOLUME, *(f"protrusions_{chart}" for chart in CHARTS))
    return (
        *(f"{TABLE}{suffix}" for suffix in (".csv", ".parquet")),
        *(f"{name}{suffix}" for name in images for suffix in (".ome.tif", ".ome.zarr")),
    )


def write_protrusions(atlas: Atlas, folder: Path, formats: Formats, report: Progress) -> None:
    """Write the table, label images of every chart there is, and closed meshes of the parts.

    Parameters
    ----------
    atlas : Atlas
        With its protrusions.
    folder : Path
        The meshes go to its folder ``meshes``, which is there.
    formats : Formats
    report : Progress
    """
    for suffix in formats.tables:
        write_table(folder / f"{TABLE}{suffix}", atlas.protrusions.table)
    _write_images(atlas, folder, formats, report.part(0.0, 0.5))
    parts = folder / "meshes" / FOLDER
    parts.mkdir()
    for label, mesh in part_meshes(atlas.protrusions, progress=report.part(0.5, 0.9)).items():
        report.check()
        stem = folder / "meshes" / "cortex" if label == CORTEX else parts / f"protrusion_{label}"
        for suffix in formats.meshes:
            write_mesh(stem.with_name(stem.name + suffix), mesh.vertices, mesh.faces)
    report(1.0, "protrusions")


def surface_fields(atlas: Atlas) -> dict[str, npt.NDArray[Any]]:
    """What the mesh of the surface has of the protrusions: a label and a height per vertex."""
    found = atlas.protrusions
    return {"protrusion": found.labels, "height_over_cortex_um": found.height_um}


def _write_images(atlas: Atlas, folder: Path, formats: Formats, report: Progress) -> None:
    found = atlas.protrusions
    sizes = dict(zip("zyx", found.volume.voxel_size, strict=True))
    origin = dict(zip("zyx", found.volume.origin, strict=True))
    _write(folder / VOLUME, found.volume.data, formats, sizes, origin)
    for index, chart in enumerate(CHARTS):
        report(index / len(CHARTS), f"protrusions in {chart}")
        if not atlas.has(chart):
            continue
        if chart != "topography":
            labels = atlas.carry(found.labels, "surface", chart, kind="label")
            _write(folder / f"protrusions_{chart}", labels, formats)
            continue
        # Filled, as the volume is.
        labels = atlas.carry(found.volume, "volume", chart, kind="label")
        d_um = atlas.topography.d_um
        step = float(d_um[1] - d_um[0]) if len(d_um) > 1 else 1.0
        _write(folder / f"protrusions_{chart}", labels, formats, {"z": step}, {"z": float(d_um[0])})


def _write(
    stem: Path,
    labels: npt.NDArray[Any],
    formats: Formats,
    sizes: Mapping[str, float] | None = None,
    origin: Mapping[str, float] | None = None,
) -> None:
    """A label image, in as few bytes as its labels need."""
    small = labels.max(initial=0) <= np.iinfo(np.uint16).max
    image = labels.astype(np.uint16 if small else np.int32)
    axes = "zyx"[-image.ndim :]
    for suffix in formats.images:
        path = stem.with_name(stem.name + suffix)
        if suffix == ".ome.zarr":
            write_ome_zarr(path, image, axes, sizes=sizes or {}, origin=origin or {})
        else:
            write_image(path, image, axes, sizes=sizes or {})
