"""The maps between the charts of an atlas, each of them one step, and how they are composed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .charts import Floats
from .geometry.locate import interpolate
from .geometry.padding import wrap_uv
from .progress import silent
from .unwrapping.topography import topography_to_world
from .unwrapping.uv import direction_to_uv, uv_to_direction

if TYPE_CHECKING:
    from .atlas import Atlas

Valid = npt.NDArray[np.bool_]
Mapped = tuple[Floats, Valid]

# Each chart is one step of the method away from the next; maps are composed along it.
CHAIN = ("volume", "topography", "uv", "sphere", "reference")
ON_SURFACE_VOXELS = 1.0


def route(atlas: Atlas, source: str, target: str) -> list[Callable[[Floats], Mapped]]:
    """The maps to compose, in order: each takes points (n, k), and says which have an image."""
    if source == target:
        return []
    if target == "direct":
        return [*route(atlas, source, "surface"), partial(_surface_to_direct, atlas)]
    if source == "direct":
        return [partial(_direct_to_volume, atlas), *route(atlas, "volume", target)]
    if source == "plane":
        return [partial(_plane_to_surface, atlas), *route(atlas, "surface", target)]
    if target == "plane":
        return [*route(atlas, source, "surface"), partial(_surface_to_plane, atlas)]
    if target == "surface":
        if source in ("volume", "topography"):
            return [*route(atlas, source, "volume"), partial(_volume_to_surface, atlas)]
        return [*route(atlas, source, "uv"), partial(_uv_to_surface, atlas)]
    start = "volume" if source == "surface" else source
    if target == "volume" and start in ("uv", "sphere", "reference"):
        # The reference lies in space: no need to go through the topography.
        return route(atlas, start, "reference")
    if start == target:
        return []
    a, b = CHAIN.index(start), CHAIN.index(target)
    names = CHAIN[a : b + 1] if a < b else CHAIN[b : a + 1][::-1]
    return [partial(STEPS[step], atlas) for step in pairwise(names)]


def _volume_to_topography(atlas: Atlas, points: Floats) -> Mapped:
    return atlas._topography_locator.locate(points, silent())


def _topography_to_volume(atlas: Atlas, points: Floats) -> Mapped:
    world, valid = topography_to_world(atlas.topography, points)
    return world, np.asarray(valid)


def _topography_to_uv(atlas: Atlas, points: Floats) -> Mapped:
    return wrap_uv(points[:, 1:], atlas.uv.shape[0]), np.ones(len(points), bool)


def _uv_to_topography(atlas: Atlas, points: Floats) -> Mapped:
    vu = wrap_uv(points, atlas.uv.shape[0])
    return np.column_stack([np.zeros(len(vu)), vu]), np.ones(len(points), bool)


def _uv_to_sphere(atlas: Atlas, points: Floats) -> Mapped:
    directions = uv_to_direction(points, atlas.uv.shape[0]) @ atlas.uv.rotation
    return directions, np.ones(len(points), bool)


def _sphere_to_uv(atlas: Atlas, points: Floats) -> Mapped:
    turned = points @ atlas.uv.rotation.T
    return direction_to_uv(turned, atlas.uv.shape[0]), np.ones(len(points), bool)


def _sphere_to_reference(atlas: Atlas, points: Floats) -> Mapped:
    face, weights = atlas._sphere_locator.locate(points)
    mapped = interpolate(atlas.reference.vertices, atlas.reference.faces, face, weights)
    return mapped, np.ones(len(points), bool)


def _reference_to_sphere(atlas: Atlas, points: Floats) -> Mapped:
    face, weights, _ = atlas._reference_locator.closest(points)
    directions = interpolate(atlas.sphere.vertices, atlas.sphere.faces, face, weights)
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    return directions / length, np.ones(len(points), bool)


def _uv_to_surface(atlas: Atlas, points: Floats) -> Mapped:
    face, weights, valid = atlas.outermost.locate(points)
    return interpolate(atlas.surface.vertices, atlas.surface.faces, face, weights), valid


def _volume_to_surface(atlas: Atlas, points: Floats) -> Mapped:
    _, _, distance = atlas._surface_locator.closest(points)
    return points, distance <= ON_SURFACE_VOXELS * atlas.voxel_um


def _surface_to_direct(atlas: Atlas, points: Floats) -> Mapped:
    face, weights, distance = atlas._sealed_locator.closest(points)
    directions = interpolate(atlas.direct.vertices, atlas.direct.faces, face, weights)
    turned = directions @ atlas.direct.rotation.T
    return (
        direction_to_uv(turned, atlas.direct.shape[0]),
        distance <= ON_SURFACE_VOXELS * atlas.voxel_um,
    )


def _direct_to_volume(atlas: Atlas, points: Floats) -> Mapped:
    rows = atlas.direct.shape[0]
    face, weights = atlas._direct_locator.locate(uv_to_direction(wrap_uv(points, rows), rows))
    mapped = interpolate(atlas.sealed.vertices, atlas.sealed.faces, face, weights)
    return mapped, np.ones(len(points), bool)


def _plane_to_surface(atlas: Atlas, points: Floats) -> Mapped:
    face, weights = atlas._flat_sphere.locate(points)
    mapped = interpolate(atlas.sealed.vertices, atlas.sealed.faces, face, weights)
    if not atlas.plane.of_sealed:
        return mapped, np.ones(len(points), bool)
    return _volume_to_surface(atlas, mapped)


def _surface_to_plane(atlas: Atlas, points: Floats) -> Mapped:
    face, weights, distance = atlas._sealed_locator.closest(points)
    near = distance <= ON_SURFACE_VOXELS * atlas.voxel_um
    return atlas._flat_sphere.at(face, weights), near


STEPS: dict[tuple[str, str], Callable[[Atlas, Floats], Mapped]] = {
    ("volume", "topography"): _volume_to_topography,
    ("topography", "volume"): _topography_to_volume,
    ("topography", "uv"): _topography_to_uv,
    ("uv", "topography"): _uv_to_topography,
    ("uv", "sphere"): _uv_to_sphere,
    ("sphere", "uv"): _sphere_to_uv,
    ("sphere", "reference"): _sphere_to_reference,
    ("reference", "sphere"): _reference_to_sphere,
}
