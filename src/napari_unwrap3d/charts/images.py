"""The charts on the (u, v) grid: uv, topography and plane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import AxesError
from .volumes import Floats, Ints


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
