"""One protrusion as a disk and as a square image: the paper's direct 2D unwrapping.

Paper, Methods, "Direct 2D unwrapping of protrusion submeshes" and, for the holes,
"Refinement of undersegmented blebs".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from ..charts import Surface
from ..errors import InputError, TooSmallError
from ..geometry.disk import flipped, harmonic_disk
from ..geometry.disk_areas import equiareal_disk
from ..geometry.distortion import mean_conformal_error, mean_log_area_distortion
from ..geometry.laplacian import vertex_mass
from ..geometry.locate import SurfaceLocator, interpolate
from ..geometry.mesh import corner_fans, edges_with_faces, face_areas
from ..geometry.square import disk_from_square, pixel_centres, pixels_of, square_from_disk
from ..progress import Progress, silent

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

# Paper: components below a tenth of the surface's area are holes in the segmentation.
LARGEST_HOLE = 0.1
PIXELS = 128


class Submesh(NamedTuple):
    """A part of a surface.

    Attributes
    ----------
    vertices : ndarray, (n,) int64
        Numbers in the surface; one that the border meets twice is listed twice.
    faces : ndarray, (m, 3) int64
        Indices into `vertices`.
    faces_of_surface : ndarray, (m,) int64
        Numbers of the faces in the surface.
    """

    vertices: Ints
    faces: Ints
    faces_of_surface: Ints


@dataclass(frozen=True, eq=False)
class Disk:
    """One protrusion laid on the unit disk and on a square image, one to one.

    Attributes
    ----------
    label : int
    vertices : ndarray, (n,) int64
        Numbers of its vertices in the surface, filled holes included.
    faces : ndarray, (m, 3) int64
        Indices into `vertices`.
    points : ndarray, (n, 2)
        (v, u) in the unit disk, the border on the circle.
    face : ndarray, (N, N) int64, weights : ndarray, (N, N, 3)
        Where on the mesh the centre of each pixel of the square lies.
    quality : mapping
        ``flips``, ``mean_abs_log_area`` (mean |log λ| of the areas), ``mean_q`` (ratio of the
        singular values, 1 where angles are kept) and ``iterations``.
    """

    label: int
    vertices: Ints
    faces: Ints
    points: Floats
    face: Ints
    weights: Floats
    quality: Mapping[str, Any] = field(default_factory=dict)

    @property
    def pixels(self) -> int:
        """Pixels along an edge of the square."""
        return len(self.face)

    @property
    def owner(self) -> Ints:
        """Number in the surface of the vertex (N, N) that weighs most in each pixel."""
        corner = self.weights.argmax(axis=2)
        local = np.take_along_axis(self.faces[self.face], corner[..., None], axis=2)[..., 0]
        owner: Ints = self.vertices[local]
        return owner

    @property
    def square(self) -> Floats:
        """(v, u) of every vertex in pixels of the square, centres at whole numbers (n, 2)."""
        return pixels_of(square_from_disk(self.points), self.pixels)

    def scalars_to_square(self, values: npt.NDArray[Any]) -> Floats:
        """Values at the vertices of the surface, (surface n,) or (…, k), as an image."""
        image: Floats = interpolate(
            values[self.vertices], self.faces, self.face.ravel(), self.weights.reshape(-1, 3)
        )
        return image.reshape(self.pixels, self.pixels, *image.shape[1:])

    def labels_to_square(self, labels: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Labels at the vertices of the surface as an image (N, N)."""
        image: npt.NDArray[Any] = labels[self.owner]
        return image

    def scalars_to_vertices(self, image: npt.NDArray[Any]) -> Floats:
        """Values (n,) at `vertices` of an image (N, N), linear between the pixels."""
        from scipy.ndimage import map_coordinates

        values: Floats = map_coordinates(
            np.asarray(image, np.float64), self.square.T, order=1, mode="nearest"
        )
        return values

    def labels_to_vertices(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Labels (n,) at `vertices` of an image (N, N): those of the pixels that they lie in."""
        row, column = np.clip(np.rint(self.square).astype(np.int64), 0, self.pixels - 1).T
        found: npt.NDArray[Any] = image[row, column]
        return found


def unwrap_disk(
    surface: Surface,
    labels: npt.NDArray[Any],
    label: int,
    *,
    pixels: int = PIXELS,
    equiareal: bool = True,
    tolerance: float = 0.01,
    iterations: int = 100,
    net: Net | None = None,
    progress: Progress | None = None,
) -> Disk:
    """Lay one protrusion on the unit disk and on a square image.

    Holes in its labels are filled; of several pieces the largest is taken, and what hangs on
    it by one edge or by single vertices is left out. The map is harmonic, with the border by
    its lengths, then relaxed to equal areas; the square is the elliptical grid mapping's.

    Parameters
    ----------
    surface : Surface
    labels : ndarray, (n,) int
        One per vertex of the surface, 0 = none.
    label : int
        Which protrusion.
    pixels : int
        N, along an edge of the image.
    equiareal : bool
        Whether areas are relaxed; else the map stays harmonic.
    tolerance, iterations
        Areas are relaxed until mean |log λ| is below the tolerance, or for so many steps.
    net : Net, optional
        Of the surface (:func:`net_of`), where many protrusions of it are unwrapped.
    progress : Progress, optional

    Returns
    -------
    Disk
        Never flipped.

    Raises
    ------
    InputError
        There is no such label, or not one per vertex.
    TooSmallError
        The protrusion has no face.
    NotADiskError
        It has a handle, or more than one border: a bridge, or a band around the cell.
    FlippedFacesError
        It is too long to be resolved in numbers.
    """
    report = progress or silent()
    chosen = np.asarray(labels) == label
    if chosen.shape != (len(surface.vertices),) or label == 0 or not chosen.any():
        raise InputError(
            f"There is no protrusion {label} on this surface.",
            labels=np.asarray(labels).shape,
            vertices=len(surface.vertices),
        )
    net = net_of(surface.vertices, surface.faces) if net is None else net
    filled = fill_labels(net, chosen)
    between: Bools = np.all(filled[surface.faces], axis=1)
    part = largest_piece(surface.vertices, surface.faces, between)
    vertices, faces = surface.vertices[part.vertices], part.faces
    report(0.05, "harmonic disk")
    points = report.run(harmonic_disk, vertices, faces)
    history = np.zeros(0)
    if equiareal:
        points, history = equiareal_disk(
            vertices,
            faces,
            points,
            report.part(0.1, 0.9),
            iterations=iterations,
            tolerance=tolerance,
        )
    report(0.9, "square image")
    flat = _flat(points)
    centres = disk_from_square(pixel_centres(pixels))
    face, weights, _ = SurfaceLocator(flat, faces).closest(_flat(centres))
    weights = np.clip(weights, 0.0, None)
    weights /= weights.sum(axis=1, keepdims=True)
    quality = {
        "flips": flipped(points, faces),
        "mean_abs_log_area": mean_log_area_distortion(vertices, flat, faces),
        "mean_q": mean_conformal_error(vertices, flat, faces),
        "iterations": len(history),
        "vertices_left_out": int((~np.isin(np.flatnonzero(chosen), part.vertices)).sum()),
    }
    return Disk(
        label=int(label),
        vertices=part.vertices,
        faces=faces,
        points=points,
        face=face.reshape(pixels, pixels),
        weights=weights.reshape(pixels, pixels, 3),
        quality=quality,
    )


def _flat(points: Floats) -> Floats:
    """Points (n, 2) of the plane in space."""
    return np.pad(points, ((0, 0), (1, 0)))


# The part of the mesh ------------------------------------------------------------


def largest_piece(
    vertices: Floats, faces: Ints, chosen: Bools, *, across_border: bool = False
) -> Submesh:
    """The largest connected piece of chosen faces (m,).

    Parameters
    ----------
    across_border : bool
        Whether faces are connected across an edge that joins two vertices of the border. Not
        for a disk: beyond such an edge lie faces with next to no area on it, and no way to get
        any.

    Raises
    ------
    TooSmallError
        No face is chosen.
    """
    kept = np.flatnonzero(chosen)
    while True:
        if len(kept) == 0:
            raise TooSmallError(
                "The protrusion has no face of its own, so it cannot be unwrapped.",
                faces=0,
                hint="Delete it, or grow its label by a few vertices.",
            )
        size, fans = corner_fans(faces[kept])
        pieces = _pieces(fans, across_border)
        areas = np.bincount(pieces, face_areas(vertices, faces[kept]))
        largest = pieces == areas.argmax()
        if largest.all():
            break
        kept = kept[largest]
    numbers = np.zeros(size, np.int64)
    numbers[fans.ravel()] = faces[kept].ravel()
    # In the order of the surface's vertices, whatever the order of its faces.
    order = np.argsort(numbers, kind="stable")
    rank = np.empty(size, np.int64)
    rank[order] = np.arange(size)
    return Submesh(numbers[order], rank[fans], kept)


class Net(NamedTuple):
    """What filling holes needs of a surface, and need not find anew for every protrusion.

    Attributes
    ----------
    edges : ndarray, (e, 2) int64
    mass : ndarray, (n,)
        The area that belongs to each vertex.
    """

    edges: Ints
    mass: Floats


def net_of(vertices: Floats, faces: Ints) -> Net:
    """The edges of a mesh and the areas of its vertices."""
    return Net(edges_with_faces(faces).vertices, vertex_mass(vertices, faces))


def fill_labels(net: Net, chosen: Bools) -> Bools:
    """Chosen vertices (n,) with the holes among them.

    A hole is a piece of what is left of the surface, of less than a tenth of its area.
    """
    outside = ~chosen
    edges, mass = net
    edges = edges[outside[edges[:, 0]] & outside[edges[:, 1]]]
    links = sparse.coo_array((np.ones(len(edges), np.int8), tuple(edges.T)), (len(chosen),) * 2)
    count, piece = csgraph.connected_components(links, directed=False)
    areas = np.bincount(piece[outside], mass[outside], minlength=count)
    filled: Bools = chosen | (areas[piece] < LARGEST_HOLE * mass.sum())
    return filled


def _pieces(faces: Ints, across_border: bool) -> Ints:
    """Piece (m,) of each face, connected across edges; see :func:`largest_piece`."""
    edges = edges_with_faces(faces)
    on_border = np.zeros(int(faces.max()) + 1, bool)
    on_border[edges.vertices[edges.valence == 1]] = True
    inner = edges.valence == 2
    if not across_border:
        inner &= ~on_border[edges.vertices].all(axis=1)
    first = edges.first[inner]
    here, there = edges.slots[first] // 3, edges.slots[first + 1] // 3
    links = sparse.coo_array((np.ones(len(here), np.int8), (here, there)), (len(faces),) * 2)
    return np.asarray(csgraph.connected_components(links, directed=False)[1], np.int64)
