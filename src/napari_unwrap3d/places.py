"""One place of a cell in all of its charts at once: what a linked cursor shows.

Built for a pointer that moves: what every pixel shows is known beforehand, and a place
takes a fraction of a millisecond. Positions are those of the nearest pixel; for exact
ones there is :meth:`napari_unwrap3d.atlas.Atlas.map`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .atlas import Atlas
from .charts import Floats, Ints
from .maps import ON_SURFACE_VOXELS
from .unwrapping.surface import same_mesh
from .unwrapping.uv import direction_to_uv


@dataclass(frozen=True, eq=False)
class Place:
    """A place of a cell; what does not exist there, or in this atlas, is None.

    Attributes
    ----------
    position : ndarray, (3,)
        (z, y, x) in µm: on the surface, or within the topography anywhere.
    corners, weights : ndarray, (3,)
        Three vertices of the surface and the barycentric weights of the place between them.
    topography : ndarray, (3,)
        (d µm, v, u).
    uv, direct, plane : ndarray, (2,)
        (v, u) in pixels.
    reference : ndarray, (3,)
        (z, y, x) in µm.
    sphere : ndarray, (3,)
        Unit vector (z, y, x).
    conformal : ndarray, (3,)
        Unit vector (z, y, x) on the conformal sphere.
    on_frame : ndarray, (3,)
        (z, y, x) in µm on the surface of a timepoint, where one is shown.
    """

    position: Floats | None = None
    corners: Ints | None = None
    weights: Floats | None = None
    topography: Floats | None = None
    uv: Floats | None = None
    direct: Floats | None = None
    plane: Floats | None = None
    reference: Floats | None = None
    sphere: Floats | None = None
    conformal: Floats | None = None
    on_frame: Floats | None = None


class Places:
    """Finds places of one atlas, by a point of a chart or a face of a mesh.

    Parameters
    ----------
    atlas : Atlas
        With all charts up to the topography; direct and plane are used where they are there.
    """

    def __init__(self, atlas: Atlas) -> None:
        self.atlas = atlas

    def prepare(self) -> Places:
        """Compute what takes time, about a second, so that the first place is as fast as all."""
        self._seen()
        self.atlas._surface_locator.closest(self.atlas.surface.vertices[:1])
        if not self._one_mesh and (self.atlas.has("direct") or self.atlas.has("plane")):
            self.atlas._sealed_locator.closest(self.atlas.surface.vertices[:1])
        return self

    def at_pixel(self, chart: str, point: npt.ArrayLike) -> Place | None:
        """The place under a point of an image; None outside of it.

        Parameters
        ----------
        chart : str
            "uv", "direct", "plane" or "topography".
        point : array-like
            (v, u) in pixels, or (d layer, v, u) of the topography.
        """
        given = np.asarray(point, dtype=float)
        shape = getattr(self.atlas, chart).shape
        index = tuple(int(i) for i in np.floor(given + 0.5))
        if not all(0 <= i < n for i, n in zip(index, shape, strict=True)):
            return None
        if chart == "uv":
            return self._under_uv(given, (index[0], index[1]))
        if chart == "topography":
            return self._at_node(given, (index[0], index[1], index[2]))
        mesh = getattr(self.atlas, chart)
        weights = mesh.weights[index]
        place = self._on_sealed(self.atlas.sealed.faces[mesh.face[index]], weights)
        return replace(place, **{chart: given})

    def on_mesh(self, chart: str, corners: Ints, weights: Floats) -> Place:
        """The place between three vertices of a mesh.

        Parameters
        ----------
        chart : str
            "surface", "sealed", "reference" or "sphere".
        corners : ndarray, (3,)
            Vertices of the mesh.
        weights : ndarray, (3,)
            Barycentric weights.
        """
        if chart == "surface":
            return self._on_surface(corners, weights)
        if chart == "sealed":
            return self._on_sealed(corners, weights)
        direction = weights @ self.atlas.sphere.vertices[corners]
        uv = direction_to_uv(
            (direction / np.linalg.norm(direction))[None] @ self.atlas.uv.rotation.T,
            self.atlas.uv.shape[0],
        )[0]
        rows, columns = self.atlas.uv.shape
        v, u = np.floor(uv + 0.5).astype(int)
        place = self._under_uv(uv, (int(np.clip(v, 0, rows - 1)), int(u) % columns))
        return replace(place, **self._on_reference(corners, weights))

    # From a pixel ------------------------------------------------------------------

    def _under_uv(self, uv: Floats, pixel: tuple[int, int]) -> Place:
        face, weights = self._seen()
        chart = self.atlas.uv
        place = Place(uv=uv, topography=np.array([0.0, *uv]))
        if face[pixel] >= 0:
            place = self._on_surface(self.atlas.surface.faces[face[pixel]], weights[pixel])
            height = self.atlas.outermost.height_um[pixel]
            place = replace(place, uv=uv, topography=np.array([height, *uv]))
        corners = self.atlas.reference.faces[chart.face[pixel]]
        return replace(place, **self._on_reference(corners, chart.weights[pixel]))

    def _at_node(self, point: Floats, node: tuple[int, int, int]) -> Place:
        """A node of the topography: on the surface, if that is near, or in space."""
        chart = self.atlas.topography
        position = chart.positions[node].astype(float)
        d_um = float(np.interp(point[0], np.arange(len(chart.d_um)), chart.d_um))
        topography = np.array([d_um, point[1], point[2]])
        known: dict[str, Any] = {"position": position, "topography": topography, "uv": point[1:]}
        known |= self._under_uv_only(node[1:])
        face, weights, distance = self.atlas._surface_locator.closest(position[None])
        if distance[0] > ON_SURFACE_VOXELS * self.atlas.voxel_um:
            return Place(**known)
        place = self._on_surface(self.atlas.surface.faces[face[0]], weights[0])
        return replace(place, **known)

    def _under_uv_only(self, pixel: tuple[int, ...]) -> dict[str, Any]:
        corners = self.atlas.reference.faces[self.atlas.uv.face[pixel]]
        return self._on_reference(corners, self.atlas.uv.weights[pixel])

    def _on_reference(self, corners: Ints, weights: Floats) -> dict[str, Any]:
        sphere = self.atlas.sphere
        return {
            "reference": weights @ self.atlas.reference.vertices[corners],
            "sphere": weights @ sphere.vertices[corners],
            "conformal": weights @ sphere.conformal[corners],
        }

    def _seen(self) -> tuple[Ints, Floats]:
        """Face (N, 2N) and weights (N, 2N, 3) of the surface that every uv pixel shows."""
        return self.atlas.outermost.face, self.atlas.outermost.weights

    # From a face -------------------------------------------------------------------

    def _on_sealed(self, corners: Ints, weights: Floats) -> Place:
        """On the sealed surface; where it is not the surface itself, the nearest place."""
        if self._one_mesh:
            return self._on_surface(corners, weights)
        position = weights @ self.atlas.sealed.vertices[corners]
        face, near, distance = self.atlas._surface_locator.closest(position[None])
        if distance[0] > ON_SURFACE_VOXELS * self.atlas.voxel_um:
            return Place(position=position, **self._flat(corners, weights))
        place = self._on_surface(self.atlas.surface.faces[face[0]], near[0])
        return replace(place, position=position, **self._flat(corners, weights))

    def _on_surface(self, corners: Ints, weights: Floats) -> Place:
        atlas = self.atlas
        position = weights @ atlas.surface.vertices[corners]
        known: dict[str, Any] = {"position": position}
        dvu = self._unrolled(atlas.topography.surface[corners], weights)
        if dvu is not None:
            rows, columns = atlas.uv.shape
            known |= {"topography": dvu, "uv": dvu[1:]}
            v, u = np.floor(dvu[1:] + 0.5).astype(int)
            known |= self._under_uv_only((int(np.clip(v, 0, rows - 1)), int(u) % columns))
        if atlas.has("direct") or atlas.has("plane"):
            if self._one_mesh:
                known |= self._flat(corners, weights)
            else:
                face, near, _ = atlas._sealed_locator.closest(position[None])
                known |= self._flat(atlas.sealed.faces[face[0]], near[0])
        return Place(corners=corners, weights=weights, **known)

    def _flat(self, corners: Ints, weights: Floats) -> dict[str, Any]:
        """(v, u) in the direct chart and in the plane of a place on the sealed surface."""
        known: dict[str, Any] = {}
        if self.atlas.has("direct"):
            chart = self.atlas.direct
            direction = weights @ chart.vertices[corners] @ chart.rotation.T
            length = np.linalg.norm(direction)
            known["direct"] = direction_to_uv(direction[None] / length, chart.shape[0])[0]
        if self.atlas.has("plane"):
            flat = self._unrolled(self.atlas.plane.vertices[corners], weights)
            if flat is not None:
                known["plane"] = flat
        return known

    def _unrolled(self, corners: Floats, weights: Floats) -> Floats | None:
        """A place between three corners whose last coordinate, u, goes around."""
        columns = self.atlas.uv.shape[1]
        around = corners.copy()
        turns = np.round((around[:, -1] - around[0, -1]) / columns)
        if not np.isfinite(turns).all():
            return None
        around[:, -1] -= turns * columns
        place: Floats = weights @ around
        place[-1] = (place[-1] + 0.5) % columns - 0.5
        return place

    @cached_property
    def _one_mesh(self) -> bool:
        return same_mesh(self.atlas.sealed, self.atlas.surface)
