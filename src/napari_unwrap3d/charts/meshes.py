"""The charts that are triangle meshes: in space, or on the sphere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import MeshError, NotFiniteError
from .volumes import Floats, Ints, Mask, Volume

ARRAYS = "A surface has vertices (n, 3) as (z, y, x) in µm, and faces (m, 3) with their indices."


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Vertices (n, 3) float64 zyx and faces (m, 3) int64, with fields per vertex.

    `fields` maps a name (with its unit, e.g. ``"mean_curvature_per_um"``) to an
    array with one entry per vertex.
    """

    vertices: Floats
    faces: Ints
    fields: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = whole_numbers(self.faces)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        check_mesh_arrays(vertices, faces)
        for name, values in self.fields.items():
            if len(values) != len(vertices):
                raise MeshError(
                    f"The field {name!r} has the wrong length.",
                    values=len(values),
                    vertices=len(vertices),
                )

    def with_fields(self, **fields: npt.NDArray[Any]) -> Any:
        """The same chart with more fields."""
        return replace(self, fields={**self.fields, **fields})


def whole_numbers(faces: npt.ArrayLike) -> Ints:
    """Indices of vertices as int64; a fraction is an error, not rounded."""
    given = np.asarray(faces)
    if given.dtype.kind == "f":
        broken = int((given != np.rint(given)).sum())
        if broken:
            raise MeshError(
                "Faces are indices of vertices, so whole numbers.",
                not_whole=broken,
                hint="Were vertices and faces exchanged?",
            )
    return np.ascontiguousarray(given, dtype=np.int64)


def check_mesh_arrays(vertices: npt.NDArray[Any], faces: npt.NDArray[Any]) -> None:
    """Raise unless the arrays can be a triangle mesh with finite vertices."""
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise MeshError("Vertices are an (n, 3) array.", shape=vertices.shape, hint=ARRAYS)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError("Faces are an (m, 3) array of triangles.", shape=faces.shape, hint=ARRAYS)
    if len(vertices) == 0 or len(faces) == 0:
        raise MeshError(
            "The mesh is empty.",
            vertices=len(vertices),
            faces=len(faces),
            hint="Check that the file holds a surface, not only points or lines.",
        )
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices).all(axis=1)).sum())
        raise NotFiniteError(
            "Vertices are NaN or infinite.",
            vertices=bad,
            of=len(vertices),
            hint="Remove them with their faces: small holes are then closed.",
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(
            "A face refers to a vertex that does not exist.",
            smallest_index=int(faces.min()),
            largest_index=int(faces.max()),
            vertices=len(vertices),
            hint="The file is damaged or truncated.",
        )


@dataclass(frozen=True, eq=False)
class Surface(TriangleMesh):
    """``S(x, y, z)``: the mesh of the cell, of any genus, in µm.

    `report` is what was measured and repaired when it was made or read.
    """

    report: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SealedSurface(TriangleMesh):
    """The same cell with handles and holes closed, so genus 0.

    Attributes
    ----------
    mask : Mask
        The sealed solid on the isotropic working grid (well-composed, one
        component, no handle, no cavity).
    sealed : tuple of dict
        What was closed: one entry per handle, hole or cavity with its
        ``position_um`` (z, y, x), ``volume_um3`` and ``kind``.
    membranes : Mask or None
        The voxels that close handles and holes; None if there are none.
    cuts : Mask or None
        The voxels that were taken away to open handles; None if there are none.
    """

    mask: Mask | None = None
    membranes: Mask | None = None
    cuts: Mask | None = None
    sealed: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, eq=False)
class Reference(TriangleMesh):
    """``S_ref(x, y, z)``: smooth genus-0 cortex (paper, Step 1).

    Attributes
    ----------
    mask : Mask
        The solid inside the reference on the isotropic working grid.
    level : Volume
        Smooth level-set function on the same grid whose zero set is the mesh (near the mesh,
        where the sealed surface's own was kept).
    iteration : int
        The iteration of the cMCF at which the flow was stopped.
    total_curvature : ndarray, (iterations + 1,)
        Total absolute Gaussian curvature over 4π at every iteration (1 = convex).
    stopped_by : str
        Which rule stopped the flow.
    """

    mask: Mask | None = None
    level: Volume | None = None
    iteration: int = 0
    total_curvature: Floats = field(default_factory=lambda: np.zeros(0))
    stopped_by: str = ""


@dataclass(frozen=True, eq=False)
class Sphere(TriangleMesh):
    """``S²``: the reference's mesh with its vertices on the unit sphere (Steps 2, 3).

    Attributes
    ----------
    vertices : ndarray, (n, 3)
        Unit vectors (z, y, x) at the chosen blend.
    conformal : ndarray, (n, 3)
        Unit vectors (z, y, x) of the conformal state.
    blend : float
        0 = conformal, 1 = equiareal.
    error_history : ndarray
        Mean |log λ| against the blended target after every iteration.
    method : str
        "poisson" or "advection".
    iteration : int or None
        Of the advection, the iteration that was taken.
    target : str
        "reference" or "uniform": which areas an equiareal sphere has; "common": aligned with
        another timepoint's, it has those that the same places have there.
    criterion, criterion_value : str, float
        What chose the blend or the iteration, and its value there.
    criterion_history : ndarray, (k, 2)
        The blends or iterations that were tried, and their values (infinite with flips).
    flip_history : ndarray
        Flipped faces in every iteration of the advection.
    """

    conformal: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    blend: float = 1.0
    error_history: Floats = field(default_factory=lambda: np.zeros(0))
    method: str = "poisson"
    iteration: int | None = None
    target: str = "reference"
    criterion: str = "equiareal"
    criterion_value: float = float("nan")
    criterion_history: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    flip_history: Ints = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Direct(TriangleMesh):
    """The sealed surface's mesh on the unit sphere and its (u, v) image, one to one.

    It has the faces of the sealed surface and lies in the frame of the sphere chart.

    Attributes
    ----------
    vertices : ndarray, (n, 3)
        Unit vectors (z, y, x), in double precision: faces may be tiny.
    rotation : ndarray, (3, 3)
        The unwrapping rotation of the uv chart.
    face : ndarray, (N, 2N) int64, weights : ndarray, (N, 2N, 3)
        Where in the mesh each pixel's centre lies.
    owner : ndarray, (N, 2N) int64
        The vertex that each pixel belongs to: the nearest corner of its face, or a vertex
        in the pixel that would otherwise have none.
    spokesman : ndarray, (n,) int64
        The vertex whose pixels speak for each vertex: itself, or the nearest one that has
        a pixel.
    registered : ndarray, (n, 3)
        Where the reference's (u, v) puts each vertex (unit vectors; zero: nowhere).
    cortex : ndarray, (n,) bool
        Vertices that are alone over their pixel there, and so are tied to it.
    """

    rotation: Floats = field(default_factory=lambda: np.eye(3))
    face: Ints = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    weights: Floats = field(default_factory=lambda: np.zeros((0, 0, 3)))
    owner: Ints = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    spokesman: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    registered: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    cortex: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))

    @property
    def shape(self) -> tuple[int, int]:
        return int(self.face.shape[0]), int(self.face.shape[1])
