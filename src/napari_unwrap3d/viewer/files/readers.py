"""napari readers: meshes as surface layers, tracks as tracks, projects as all their charts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...charts import Surface
from ...errors import InputError
from ...files.meshes import MESH_SUFFIXES, read_mesh
from ...files.movie import is_movie
from ...files.project import MOVIE, SUFFIX, load_project
from ...files.tracks import read_tracks
from ...motion.movie import load_movie
from ..tracks.layer_data import tracks_layer
from ..views.layers import LayerData, atlas_layers, mesh_layer

Reader = Callable[[str | list[str]], list[LayerData]]
# What a file of tracks has within its first bytes.
TRACKS_BEGIN = {".xml": b"<trackmate", ".csv": b"track_id"}
BEGINNING = 4096


def get_mesh_reader(path: str | list[str]) -> Reader | None:
    """The reader of PLY, OBJ, STL, VTP and OFF files; None for other paths."""
    return read_meshes if _all_end_with(path, MESH_SUFFIXES) else None


def get_project_reader(path: str | list[str]) -> Reader | None:
    """The reader of ``*.unwrap3d`` projects, of cells and of movies; None for other paths.

    A movie may also be a folder, or the ``movie.json`` in it.
    """
    paths = [_folder_of(each) for each in _paths(path)]
    ours = bool(paths) and all(_is_ours(each) for each in paths)
    return read_projects if ours else None


def get_tracks_reader(path: str | list[str]) -> Reader | None:
    """The reader of tracks: GEFF, TrackMate's XML, Parquet, and CSV with a column of tracks.

    None for other paths, and for XML and CSV of other things.
    """
    paths = _paths(path)
    return read_track_files if paths and all(_has_tracks(each) for each in paths) else None


def read_track_files(path: str | list[str]) -> list[LayerData]:
    """One Tracks layer per file, in µm and seconds where its points are in space.

    The dock "Tracks" imports the same files, and lays them on the surface of a movie.

    Raises
    ------
    Unwrap3DError
        The file is damaged, or does not tell the size of a pixel or the time step.
    """
    return [tracks_layer(read_tracks(each), each.stem) for each in _paths(path)]


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

    viewer, paths = napari.current_viewer(), [_folder_of(each) for each in _paths(path)]
    if viewer is None:
        atlases = [
            load_movie(each).common if is_movie(each) else load_project(each) for each in paths
        ]
        return [layer for atlas in atlases for layer in atlas_layers(atlas)]
    if len(paths) > 1:
        raise InputError(
            "A window shows one cell.", projects=len(paths), hint="Open one project at a time."
        )
    from .project import open_project

    open_project(viewer, paths[0])
    # What napari takes for "read, and there is nothing to add".
    return [(None,)]


def _folder_of(path: Path) -> Path:
    """The folder of a movie, where its manifest is named."""
    return path.parent if path.name == MOVIE else path


def _is_ours(path: Path) -> bool:
    return is_movie(path) if path.is_dir() else path.suffix.lower() == SUFFIX


def _has_tracks(path: Path) -> bool:
    """Whether a file has tracks, by its suffix and, of XML and CSV, by how it begins."""
    suffix = path.suffix.lower()
    if suffix in (".geff", ".parquet"):
        return True
    mark = TRACKS_BEGIN.get(suffix)
    if mark is None or not path.is_file():
        return False
    with path.open("rb") as file:
        return mark in file.read(BEGINNING).lower()


def _mesh_layer(path: Path) -> LayerData:
    surface: Surface = read_mesh(path, repaired=False)
    scalars = [name for name, values in surface.fields.items() if np.ndim(values) == 1]
    return mesh_layer(surface, path.stem, scalars[0] if scalars else "")


def _paths(path: str | list[str]) -> list[Path]:
    return [Path(each) for each in ([path] if isinstance(path, str) else path)]


def _all_end_with(path: Any, suffixes: tuple[str, ...]) -> bool:
    paths = _paths(path)
    return bool(paths) and all(each.suffix.lower() in suffixes for each in paths)
