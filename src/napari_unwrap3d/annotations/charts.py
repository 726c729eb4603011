"""For every chart: which vertices its pixels show, and which drawing in them marks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..geometry.near import nearest_vertices
from ..geometry.overlaps import covered
from ..geometry.padding import sample_uv_nearest, wrap_uv
from ..maps import ON_SURFACE_VOXELS
from ..shell import nearest_at_nodes, surface_index
from ..unwrapping.direct import ownership
from ..unwrapping.surface import same_mesh
from ..unwrapping.uv import direction_to_uv
from .lookup import Owners, Places, Rows

if TYPE_CHECKING:
    from ..atlas import Atlas

ON_UV = ("reference", "sphere")
SHEETS_APART_VOXELS = 0.5
# How far from the surface voxels show it, so that it is wide enough to be drawn on.
NEAR_VOXELS = 1.5


def nearest_pixels(points: Floats, rows: int) -> Ints:
    """Flat indices of the pixels that hold (v, u) (n, 2), over the seam and poles; −1 for NaN."""
    numbers = np.arange(2 * rows * rows).reshape(rows, 2 * rows)
    known = np.isfinite(points).all(axis=1)
    pixels = np.full(len(points), -1, np.int64)
    pixels[known] = sample_uv_nearest(numbers, points[known])
    return pixels


def nearest_corners(faces: Ints, face: Ints, weights: Floats) -> Ints:
    """The corner nearest to each place (face (k,), weights (k, 3)); −1 without a face."""
    corner: Ints = faces[face, weights.argmax(axis=-1)]
    return np.where(face >= 0, corner, -1)


def uv_owners(atlas: Atlas) -> Owners:
    """A pixel shows what lies outermost; drawing marks the column over (and under) it."""
    outermost, rows = atlas.outermost, atlas.uv.shape[0]
    size = len(atlas.surface.vertices)
    shown = nearest_corners(
        atlas.surface.faces, outermost.face.ravel(), outermost.weights.reshape(-1, 3)
    )
    column = nearest_pixels(atlas.topography.surface[:, 1:], rows)
    return Owners(atlas.uv.shape, size, shown, Rows(column, np.arange(size), 2 * rows * rows))


def direct_owners(atlas: Atlas) -> Owners:
    """One to one with the sealed surface: the owner of a pixel and whom it speaks for."""
    chart = atlas.direct
    return _sealed_owners(atlas, chart.owner, chart.spokesman)


def plane_owners(atlas: Atlas) -> Owners:
    """The flattened sealed surface, in the same way."""
    chart, sealed = atlas.plane, atlas.sealed
    places = wrap_uv(chart.vertices, chart.shape[0])
    owner, spokesman = ownership(sealed, chart.face, chart.weights, places)
    return _sealed_owners(atlas, owner, spokesman)


def topography_owners(atlas: Atlas) -> Owners:
    """Nodes next to the surface show the nearest vertex; each marks that and those it holds."""
    layers, rows, columns = atlas.topography.shape
    nearest, index = nearest_at_nodes(atlas), surface_index(atlas)
    pixel = nearest_pixels(index[:, 1:], rows)
    height = np.rint(np.nan_to_num(index[:, 0], nan=-1.0)).astype(np.int64)
    inside = (pixel >= 0) & (height >= 0) & (height < layers)
    return _sparse_owners(nearest, np.where(inside, height * rows * columns + pixel, -1))


def volume_owners(atlas: Atlas) -> Owners:
    """Voxels of the mask's grid next to the surface, in the same way."""
    mask, surface = atlas.mask, atlas.surface
    index = mask.to_index(surface.vertices)
    margin = (math.ceil(NEAR_VOXELS),) * 3
    nearest = nearest_vertices(index, index, surface.faces, mask.shape, NEAR_VOXELS, margin)
    voxel = np.rint(index).astype(np.int64)
    inside = ((voxel >= 0) & (voxel < mask.shape)).all(axis=1)
    held = np.full(len(voxel), -1, np.int64)
    held[inside] = np.ravel_multi_index(tuple(voxel[inside].T), mask.shape)
    return _sparse_owners(nearest, held)


def _sparse_owners(nearest: npt.NDArray[np.int32], held: Ints) -> Owners:
    """From the vertex nearest to every node, −1 for none, and the node that holds each vertex."""
    size, flat = len(held), nearest.reshape(-1)
    lonely = np.flatnonzero((held >= 0) & (flat[held] < 0))
    flat[held[lonely]] = lonely
    places = Places(nearest >= 0)
    shown = flat[places.flat]
    count = len(shown)
    holder = np.full(size, -1, np.int64)
    holder[held >= 0] = places.rank(held[held >= 0])
    rows = np.concatenate([np.arange(count), holder])
    marked = Rows(rows, np.concatenate([shown, np.arange(size)]), count)
    return Owners(nearest.shape, size, shown, marked, places=places)


def _sealed_owners(
    atlas: Atlas, owner: npt.NDArray[np.integer], spokesman: npt.NDArray[np.integer]
) -> Owners:
    """From pixels that belong to vertices of the sealed surface."""
    size, sealed = len(atlas.surface.vertices), len(atlas.sealed.vertices)
    to_surface, to_sealed = sealed_maps(atlas)
    speaking = np.where(to_sealed >= 0, spokesman[to_sealed], -1)
    # A pixel marks the vertex that it shows, and those that it speaks for.
    rows = np.concatenate([np.where(to_surface >= 0, np.arange(sealed), -1), speaking])
    marked = Rows(rows, np.concatenate([to_surface, np.arange(size)]), sealed)
    group = owner.ravel()
    return Owners(owner.shape, size, to_surface[group], marked, group=group)


def sealed_maps(atlas: Atlas) -> tuple[Ints, Ints]:
    """For each vertex of the sealed surface the one of the surface nearest to it, and back.

    −1 on membranes and cuts, which lie on one of the two only.
    """
    if same_mesh(atlas.sealed, atlas.surface):
        every = np.arange(len(atlas.surface.vertices))
        return every, every
    reach = ON_SURFACE_VOXELS * atlas.voxel_um
    pairs = (
        (atlas.surface, atlas._surface_locator, atlas.sealed),
        (atlas.sealed, atlas._sealed_locator, atlas.surface),
    )
    maps = []
    for mesh, locator, other in pairs:
        face, weights, distance = locator.closest(other.vertices)
        maps.append(np.where(distance <= reach, nearest_corners(mesh.faces, face, weights), -1))
    return maps[0], maps[1]


def surface_owners(atlas: Atlas) -> Owners:
    """The surface itself: every vertex is its own pixel."""
    every = np.arange(len(atlas.surface.vertices))
    return Owners((len(every),), len(every), every, Rows(every, every, len(every)))


@dataclass(frozen=True)
class OnUV:
    """The reference's vertices (and so the sphere's), which show and edit the image of uv.

    Attributes
    ----------
    pixel : ndarray, (m,)
        The pixel (flat) of uv that each vertex of the reference shows.
    within : Rows
        The vertices in every pixel.
    drawn : Rows
        The pixels that drawing at each vertex draws: those nearest to it, and its own.
    """

    pixel: Ints
    within: Rows
    drawn: Rows


def on_uv(atlas: Atlas) -> OnUV:
    """See :class:`OnUV`."""
    uv, count = atlas.uv, len(atlas.reference.vertices)
    turned = atlas.sphere.vertices @ uv.rotation.T
    pixel = nearest_pixels(direction_to_uv(turned, uv.shape[0]), uv.shape[0])
    nearest = nearest_corners(atlas.reference.faces, uv.face.ravel(), uv.weights.reshape(-1, 3))
    every = np.arange(count)
    rows = np.concatenate([nearest, every])
    drawn = Rows(rows, np.concatenate([np.arange(nearest.size), pixel]), count)
    return OnUV(pixel, Rows(pixel, every, nearest.size), drawn)


def outermost_vertices(atlas: Atlas) -> npt.NDArray[np.bool_]:
    """Which vertices (n,) of the surface have an image, and nothing over them."""
    image, faces = atlas.topography.surface, atlas.surface.faces
    tolerance = SHEETS_APART_VOXELS * atlas.voxel_um
    hidden = covered(image, faces, atlas.uv.shape[0], tolerance)
    return np.isfinite(image).all(axis=1) & ~hidden


BUILDERS = {
    "surface": surface_owners,
    "uv": uv_owners,
    "direct": direct_owners,
    "plane": plane_owners,
    "topography": topography_owners,
    "volume": volume_owners,
}
