"""The data that the steps pass on: stack, mask, and the charts of one cell.

All are frozen and checked when made. Arrays are in numpy order: volumes
``(z, y, x)``, vertices ``(n, 3)`` as ``(z, y, x)`` in µm, faces ``(m, 3)``
counter-clockwise seen from outside, which means that the signed volume computed
from the ``(z, y, x)`` array as it is stored is positive. A voxel's centre lies at
``origin + index * voxel_size``, as in napari.
"""

from .images import UV, Plane, Topography
from .meshes import (
    ARRAYS,
    Direct,
    Reference,
    SealedSurface,
    Sphere,
    Surface,
    TriangleMesh,
    check_mesh_arrays,
    whole_numbers,
)
from .movies import Frame
from .protrusions import MOTIFS, Protrusions
from .tracks import FrameProtrusions, Tracks
from .volumes import (
    AXES,
    LARGEST_ANISOTROPY,
    LARGEST_VOXEL_UM,
    SMALLEST_VOXEL_UM,
    Floats,
    Ints,
    Mask,
    Size3,
    Stack,
    TemporalMask,
    Volume,
    check_voxel_size,
)

__all__ = [
    "ARRAYS",
    "AXES",
    "Direct",
    "Floats",
    "Frame",
    "FrameProtrusions",
    "Ints",
    "LARGEST_ANISOTROPY",
    "LARGEST_VOXEL_UM",
    "MOTIFS",
    "Mask",
    "Plane",
    "Protrusions",
    "Reference",
    "SMALLEST_VOXEL_UM",
    "SealedSurface",
    "Size3",
    "Sphere",
    "Stack",
    "Surface",
    "TemporalMask",
    "Topography",
    "Tracks",
    "TriangleMesh",
    "UV",
    "Volume",
    "check_mesh_arrays",
    "check_voxel_size",
    "whole_numbers",
]
