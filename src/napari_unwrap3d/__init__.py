"""Unwrap the surface of a cell: from a 3D stack to every chart of it, and the maps between.

The public API in one screen::

    import napari_unwrap3d as unwrap3d

    stack = unwrap3d.read_stack("cell.tif")                     # or read_mesh, or Mask(...)
    atlas = unwrap3d.unwrap(stack, unwrap3d.Parameters.preset("blebs"))
    points, valid = atlas.map(points, "surface", "uv")
    values = atlas.carry(values, "uv", "surface", kind="label")
    signal = unwrap3d.sample_signal(stack, atlas, channel=1)    # one value per vertex
    atlas.annotations.add("cell bottom")                        # drawn on one chart, on all
    protrusions = unwrap3d.segment_protrusions(atlas)           # .labels, .volume, .table
    atlas.save("cell.unwrap3d")
    movie = unwrap3d.unwrap_movie(stack_with_t)                 # one space for all timepoints
    curvature = movie.uv("mean_curvature_per_um")               # (t, v, u), lazily
    tracks = unwrap3d.track_protrusions(movie)                  # or track_flow: regions
    found = unwrap3d.measure_tracks(movie, tracks)              # .tables, .numbers
    unwrap3d.write_tracks("tracks.geff", tracks, movie)         # or .csv, .parquet, .xml
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .errors import Cancelled, Unwrap3DError
from .progress import Progress
from .provenance import package_version

if TYPE_CHECKING:
    from . import simulate
    from .annotations import Annotations
    from .atlas import Atlas, load
    from .charts import (
        UV,
        Mask,
        Plane,
        Protrusions,
        Reference,
        SealedSurface,
        Sphere,
        Stack,
        Surface,
        Topography,
        Tracks,
        Volume,
    )
    from .files.annotation_export import export_annotations
    from .files.autosave import save_annotations
    from .files.meshes import read_mesh
    from .files.movie_files import export_movie
    from .files.stacks import read_stack
    from .files.tracks import read_tracks, write_tracks
    from .geometry.compare import compare_meshes
    from .measuring.analysis import measure_tracks
    from .motion.kymograph import kymograph
    from .motion.movie import Movie, load_movie, unwrap_movie
    from .parameters import Parameters
    from .pipeline import Pipeline, unwrap
    from .protrusions.editing import ProtrusionEdits
    from .protrusions.segment import segment_protrusions
    from .sampling import sample_signal
    from .tracking.edits import TrackEdits
    from .tracking.laying import lay_tracks
    from .tracking.objects import track_protrusions
    from .tracking.regions import track_flow
    from .unwrapping import uv_views

__version__ = package_version()

# What is imported from where when it is first asked for: importing the package is quick.
_LAZY = {
    "Annotations": "annotations",
    "Atlas": "atlas",
    "load": "atlas",
    "Mask": "charts",
    "Plane": "charts",
    "Protrusions": "charts",
    "ProtrusionEdits": "protrusions.editing",
    "Reference": "charts",
    "SealedSurface": "charts",
    "Sphere": "charts",
    "Stack": "charts",
    "Surface": "charts",
    "Topography": "charts",
    "TrackEdits": "tracking.edits",
    "Tracks": "charts",
    "UV": "charts",
    "Volume": "charts",
    "export_annotations": "files.annotation_export",
    "save_annotations": "files.autosave",
    "export_movie": "files.movie_files",
    "read_mesh": "files.meshes",
    "read_stack": "files.stacks",
    "read_tracks": "files.tracks",
    "write_tracks": "files.tracks",
    "lay_tracks": "tracking.laying",
    "measure_tracks": "measuring.analysis",
    "track_flow": "tracking.regions",
    "track_protrusions": "tracking.objects",
    "compare_meshes": "geometry.compare",
    "kymograph": "motion.kymograph",
    "Movie": "motion.movie",
    "load_movie": "motion.movie",
    "unwrap_movie": "motion.movie",
    "Parameters": "parameters",
    "Pipeline": "pipeline",
    "unwrap": "pipeline",
    "sample_signal": "sampling",
    "segment_protrusions": "protrusions.segment",
}
_MODULES = {"simulate": ".simulate", "uv_views": ".unwrapping.uv_views"}

__all__ = [
    "UV",
    "Annotations",
    "Atlas",
    "Cancelled",
    "Mask",
    "Movie",
    "Parameters",
    "Pipeline",
    "Plane",
    "Progress",
    "ProtrusionEdits",
    "Protrusions",
    "Reference",
    "SealedSurface",
    "Sphere",
    "Stack",
    "Surface",
    "Topography",
    "TrackEdits",
    "Tracks",
    "Unwrap3DError",
    "Volume",
    "__version__",
    "compare_meshes",
    "export_annotations",
    "export_movie",
    "kymograph",
    "load",
    "lay_tracks",
    "load_movie",
    "measure_tracks",
    "read_mesh",
    "read_stack",
    "read_tracks",
    "sample_signal",
    "save_annotations",
    "segment_protrusions",
    "simulate",
    "track_flow",
    "track_protrusions",
    "unwrap",
    "unwrap_movie",
    "uv_views",
    "write_tracks",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        value = getattr(import_module(f".{_LAZY[name]}", __name__), name)
    elif name in _MODULES:
        value = import_module(_MODULES[name], __name__)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value
