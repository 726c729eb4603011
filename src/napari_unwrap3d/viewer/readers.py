"""napari readers: meshes as surface layers, projects as all their charts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..charts import Surface
from ..errors import InputError
from ..files.meshes import MESH_SUFFIXES, read_mesh
from ..files.project import SUFFIX, load_project
from .layers import LayerData, atlas_layers, mesh_layer

Reader = Callable[[str | list[str]], list[LayerData]]


def get_mesh_reader(path: str | list[str]) -> Reader | None:
    """The reader of PLY, OBJ, STL, VTP and OFF files; None for other paths."""
    return read_meshes if _all_end_with(path, MESH_SUFFIXES) else None


def get_project_reader(path: str | list[str]) -> Reader | None:
    """The reader of ``*.unwrap3d`` projects; None for other paths."""
    return read_projects if _all_end_with(path, (SUFFIX,)) else None


def read_meshes(path: str | list[str]) -> list[LayerData]:
    """One surface layer per file, as it is in the file: nothing is repaired or hidden.

    The formats hold no unit; lengths are taken as µm.
    """
    return [_mesh_layer(each) for each in _paths(path)]


def read_projects(path: str | list[str]) -> list[Any]:
    """Open a project in the current window, with its linked views; else, all of its layers.

    Raises
    ------
    InputError
        Several projects at once: a window has one cell.
    """
    import napari

    viewer, paths = napari.current_viewer(), _paths(path)
    if viewer is None:
        return [layer for each in paths for layer in atlas_layers(load_project(each))]
    if len(paths) > 1:
        raise InputError(
            "A window shows one cell.", projects=len(paths), hint="Open one project at a time."
        )
    from .project import open_project

    open_project(viewer, paths[0])
    # What napari takes for "read, and there is nothing to add".
    return [(None,)]


def _mesh_layer(path: Path) -> LayerData:
    surface: Surface = read_mesh(path, repaired=False)
    scalars = [name for name, values in surface.fields.items() if np.ndim(values) == 1]
    return mesh_layer(surface, path.stem, scalars[0] if scalars else "")


def _paths(path: str | list[str]) -> list[Path]:
    return [Path(each) for each in ([path] if isinstance(path, str) else path)]


def _all_end_with(path: Any, suffixes: tuple[str, ...]) -> bool:
    paths = _paths(path)
    return bool(paths) and all(each.suffix.lower() in suffixes for each in paths)
