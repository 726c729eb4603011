"""The data that the steps pass on: stack, mask, and the charts of one cell.

All are frozen and checked when made. Arrays are in numpy order: volumes
``(z, y, x)``, vertices ``(n, 3)`` as ``(z, y, x)`` in µm, faces ``(m, 3)``
counter-clockwise seen from outside, which means that the signed volume computed
from the ``(z, y, x)`` array as it is stored is positive. A voxel's centre lies at
``origin + index * voxel_size``, as in napari.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import AxesError, InputError, MeshError, NotFiniteError, VoxelSizeMissingError

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Size3 = tuple[float, float, float]

AXES = "tczyx"

# A picometre and a metre: beyond, the unit was mistaken.
SMALLEST_VOXEL_UM, LARGEST_VOXEL_UM = 1e-6, 1e6
LARGEST_ANISOTROPY = 100.0

ARRAYS = "A surface has vertices (n, 3) as (z, y, x) in µm, and faces (m, 3) with their indices."


def check_voxel_size(voxel_size: Any) -> Size3:
    """Three positive finite numbers (z, y, x) in µm, or a clear error."""
    hint = "Give it as voxel_size=(z, y, x) in µm, e.g. (0.3, 0.104, 0.104)."
    if voxel_size is None:
        raise VoxelSizeMissingError("The voxel size is not known.", hint=hint)
    try:
        sizes = tuple(float(s) for s in np.atleast_1d(np.asarray(voxel_size, dtype=float)))
    except (TypeError, ValueError):
        raise InputError(
            "A voxel size has numbers only.", got=repr(voxel_size), hint=hint
        ) from None
    if len(sizes) != 3:
        raise AxesError("A voxel size has three numbers.", numbers=len(sizes), hint=hint)
    if not all(np.isfinite(s) and s > 0 for s in sizes):
        raise InputError("Voxel sizes must be positive.", voxel_size=sizes, hint=hint)
    if min(sizes) < SMALLEST_VOXEL_UM or max(sizes) > LARGEST_VOXEL_UM:
        raise InputError(
            "No microscope has such voxels; are the lengths in µm?",
            voxel_size=sizes,
            hint=f"{hint} Of a mesh in another unit, read_mesh(path, scale=...) takes the µm.",
        )
    if max(sizes) > LARGEST_ANISOTROPY * min(sizes):
        raise InputError(
            "The voxel is too long for its width: nothing is known between such slices.",
            voxel_size=sizes,
            ratio=max(sizes) / min(sizes),
            hint=f"{hint} Are all three in µm, and in the order z, y, x?",
        )
    return sizes


@dataclass(frozen=True, eq=False)
class Stack:
    """Image data as it was read: lazily, with axes, voxel size and channels.

    Attributes
    ----------
    data : array-like
        numpy or dask array, one axis per letter of `axes`. Never loaded as a whole.
    axes : str
        Letters out of ``tczyx`` in this order; ``zyx`` are always there.
    voxel_size : (float, float, float)
        (z, y, x) in µm.
    time_step : float or None
        Seconds between two timepoints; None when unknown or without a t axis.
    channels : tuple of str
        Names of the channels; empty without a c axis.
    name : str
        What the user calls it, e.g. the file's name.
    """

    data: Any
    axes: str
    voxel_size: Size3
    time_step: float | None = None
    channels: tuple[str, ...] = ()
    name: str = "stack"

    def __post_init__(self) -> None:
        object.__setattr__(self, "voxel_size", check_voxel_size(self.voxel_size))
        expected = "".join(a for a in AXES if a in self.axes)
        if self.axes != expected or not self.axes.endswith("zyx"):
            raise AxesError(
                f"The axes must be 'zyx', 'tzyx', 'czyx' or 'tczyx', not {self.axes!r}.",
                hint="Name the axes when reading, e.g. read_stack(path, axes='tzyx').",
            )
        if self.data.ndim != len(self.axes):
            raise AxesError(
                "The number of axes does not fit the data.",
                dimensions=self.data.ndim,
                axes=self.axes,
                hint="A stack is (z, y, x) with t and c in front where they exist.",
            )
        if np.dtype(self.data.dtype).kind not in "biuf":
            raise InputError(
                "The intensities of a stack are real numbers.",
                dtype=str(self.data.dtype),
                hint="Convert them first, e.g. numpy.abs(data) of complex numbers.",
            )

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(int(n) for n in self.data.shape)

    @property
    def timepoints(self) -> int:
        return self.shape[0] if "t" in self.axes else 1

    def volume(self, t: int = 0, c: int = 0) -> Any:
        """One (z, y, x) volume, still lazy."""
        data = self.data
        if "t" in self.axes:
            data = data[t]
        if "c" in self.axes:
            data = data[c]
        return data


@dataclass(frozen=True, eq=False)
class Volume:
    """Values on a regular grid in space.

    Attributes
    ----------
    data : ndarray, (z, y, x)
    voxel_size : (float, float, float)
        (z, y, x) in µm.
    origin : (float, float, float)
        Position (z, y, x) in µm of the centre of voxel (0, 0, 0).
    """

    data: Any
    voxel_size: Size3
    origin: Size3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "voxel_size", check_voxel_size(self.voxel_size))
        object.__setattr__(self, "origin", tuple(float(o) for o in self.origin))
        if self.data.ndim != 3:
            raise AxesError(
                "A volume has three axes (z, y, x).",
                dimensions=int(self.data.ndim),
                hint="Choose one timepoint and one channel.",
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        z, y, x = self.data.shape
        return int(z), int(y), int(x)

    def to_index(self, points: npt.ArrayLike) -> Floats:
        """Points (n, 3) in µm as fractional indices (n, 3)."""
        return (np.asarray(points, dtype=float) - self.origin) / self.voxel_size

    def to_world(self, index: npt.ArrayLike) -> Floats:
        """Fractional indices (n, 3) as points (n, 3) in µm."""
        world: Floats = np.asarray(index, dtype=float) * self.voxel_size + np.asarray(self.origin)
        return world


@dataclass(frozen=True, eq=False)
class Mask(Volume):
    """Binary volume of one cell; see :class:`Volume`. `data` is bool."""

    def __post_init__(self) -> None:
        super().__post_init__()
        data = np.asarray(self.data)
        if data.dtype != np.bool_:
            if data.dtype.kind == "f" and not np.isfinite(data).all():
                raise NotFiniteError(
                    "The mask contains NaN or infinite values.",
                    voxels=int((~np.isfinite(data)).sum()),
                    hint="A mask is True inside the cell and False outside.",
                )
            values = np.unique(data)
            if len(values) > 2:
                raise InputError(
                    "A mask has two values; this looks like a label image or an intensity.",
                    values=len(values),
                    hint="Pick one label (labels == 3), or pass a Stack to have it segmented.",
                )
            data = data != 0
        object.__setattr__(self, "data", data)


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
        Smooth level-set function on the same grid whose zero set is the mesh.
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
        "reference" or "uniform": which areas an equiareal sphere has.
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


@dataclass(frozen=True, eq=False)
class UV:
    """``S(u, v)``: the image grid of the unwrapped sphere (Step 4), N × 2N.

    Row v runs from the north pole (row 0) to the south pole, column u around.
    Pixel (v, u) is centred at inclination ``(v + ½) π / N`` and azimuth
    ``(u + ½) 2π / 2N − π``.

    Attributes
    ----------
    rotation : ndarray, (3, 3)
        Proper rotation; ``sphere.vertices @ rotation.T`` has the unwrapping axis
        as its first (z) coordinate.
    face : ndarray, (N, 2N) int64
        The face of the reference (and sphere) that each pixel lies in.
    weights : ndarray, (N, 2N, 3)
        Barycentric weights of the pixel in that face.
    positions : ndarray, (N, 2N, 3)
        The point (z, y, x) in µm of the reference under each pixel.
    fields : mapping of str to ndarray, (N, 2N)
        ``conformal_error``, ``area_distortion``, ``area_um2`` (the dA of a pixel) and
        whatever was carried to the chart.
    """

    rotation: Floats
    face: Ints
    weights: Floats
    positions: Floats
    fields: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rows, columns = self.face.shape
        if columns != 2 * rows:
            raise AxesError("A uv image is N × 2N.", shape=self.face.shape)

    def with_fields(self, **fields: npt.NDArray[Any]) -> UV:
        """The same chart with more fields."""
        return replace(self, fields={**self.fields, **fields})

    @property
    def shape(self) -> tuple[int, int]:
        return int(self.face.shape[0]), int(self.face.shape[1])


@dataclass(frozen=True, eq=False)
class Topography:
    """The (d, u, v) space normal to the reference, and the surface in it (Steps 5, 6).

    Attributes
    ----------
    nodes : ndarray, (D, N + 2, 2N, 3) float32
        Position (z, y, x) in µm of every node. Rows 1…N are the pixel rows 0…N − 1; the first
        and the last row are the streamlines of the poles, repeated around. Between nodes
        positions are trilinear. Nodes deeper than the shape allows repeat the deepest one.
    d_um : ndarray, (D,)
        Signed arc length of each layer from the reference in µm, outward positive.
    first_layer, last_layer : ndarray, (N + 2, 2N) int64
        The deepest and the outermost layer that each column reaches. A column ends where
        the shape allows no more, i.e. before cells would fold.
    mask : ndarray, (D, N, 2N) bool
        The cell's mask mapped into (d, v, u).
    surface : ndarray, (n, 3)
        The input surface's vertices as (d µm, v, u); NaN where a vertex has no image.
    cut_vertices : ndarray, (m, 3), cut_faces : ndarray, (k, 3)
        The same mesh cut along the seam so that it can be drawn: vertices (d µm, v, u), of
        which `cut_origin` (m,) tells the vertex of the surface they are.
    meshed_vertices : ndarray, (p, 3), meshed_faces : ndarray, (q, 3)
        The paper's S_topo: marching cubes of the mapped mask, as (z, y, x) in µm.
    folded_cells : int
        Cells next to the surface whose Jacobian would not be positive at every corner. They
        are left out, with what lies beyond them: where the map is defined it does not fold.
    fields : mapping of str to ndarray, (N, 2N)
        ``height_um`` and ``mean_curvature_per_um`` of what lies outermost over each pixel.
    """

    nodes: npt.NDArray[np.float32]
    d_um: Floats
    first_layer: Ints
    last_layer: Ints
    mask: npt.NDArray[np.bool_]
    surface: Floats
    cut_vertices: Floats
    cut_faces: Ints
    cut_origin: Ints
    meshed_vertices: Floats
    meshed_faces: Ints
    folded_cells: int = 0
    fields: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        layers, rows, columns = self.nodes.shape[:3]
        if columns != 2 * (rows - 2) or len(self.d_um) != layers:
            raise AxesError(
                "The nodes of a topography are (D, N + 2, 2N, 3).", shape=self.nodes.shape
            )

    @property
    def positions(self) -> npt.NDArray[np.float32]:
        """Positions (z, y, x) in µm of the nodes at the pixels, (D, N, 2N, 3), a view."""
        return self.nodes[:, 1:-1]

    @property
    def shape(self) -> tuple[int, int, int]:
        """(D, N, 2N)."""
        layers, rows, columns = self.nodes.shape[:3]
        return int(layers), int(rows) - 2, int(columns)


@dataclass(frozen=True, eq=False)
class Plane:
    """The topographic surface flattened to the (u, v) plane (Step 7), certified one to one.

    It is the sealed surface's mesh with other positions. Every pixel centre is covered by
    exactly one face, none is flipped. The poles, where u has no meaning, are one point of
    the surface each and the upper and the lower border of the image.

    Attributes
    ----------
    vertices : ndarray, (n, 2)
        (v, u) in pixels of the sealed surface's vertices; u up to a number of whole turns.
    turns : ndarray, (m, 3) int64
        Corner k of face f lies at ``vertices[faces[f, k]] + (0, 2N · turns[f, k])``, so that
        faces over the seam are in one piece.
    pole_faces : ndarray, (2,) int64
        The faces that hold the north and the south pole.
    pole_weights : ndarray, (2, 3)
        Barycentric weights of the poles in them.
    face : ndarray, (N, 2N) int64
        The face of the sealed surface that each pixel lies in.
    weights : ndarray, (N, 2N, 3)
        Barycentric weights of the pixel in that face.
    positions : ndarray, (N, 2N, 3)
        The point (z, y, x) in µm of the sealed surface under each pixel.
    of_sealed : bool
        Whether something had to be sealed, so that not the surface itself is flattened.
    laplacian : str
        The weights that gave it: "robust", "cotangent" or "positive".
    iterations : int
        Iterations of the topographic cMCF.
    fields : mapping of str to ndarray, (N, 2N)
        ``conformal_error``, ``area_distortion``, ``area_um2`` (the dA of a pixel).
    """

    vertices: Floats
    turns: Ints
    pole_faces: Ints
    pole_weights: Floats
    face: Ints
    weights: Floats
    positions: Floats
    of_sealed: bool = False
    laplacian: str = "robust"
    iterations: int = 0
    fields: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rows, columns = self.face.shape
        if columns != 2 * rows:
            raise AxesError("An image of the plane is N × 2N.", shape=self.face.shape)

    @property
    def shape(self) -> tuple[int, int]:
        return int(self.face.shape[0]), int(self.face.shape[1])
