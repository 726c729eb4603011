"""Shapes that the tests of the core share: solids on grids, meshes, and two small cells."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy import ndimage

from napari_unwrap3d.charts import Floats, Ints, Mask
from napari_unwrap3d.geometry.mesh import orient_outward, signed_volume
from napari_unwrap3d.geometry.remesh import relax, simplify
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.progress import silent

VOXEL_UM = 0.1
# Enough for a small cell, quickly there, and its reference has none of the bumps.
QUICK = Parameters.from_dict(
    {
        "reference": {"stop": "fixed", "fixed_iteration": 10, "vertices": 4000},
        "sphere": {"tolerance": 0.006},
        "uv": {"rows": 64},
    }
)


def grid(shape: tuple[int, int, int] | int) -> Floats:
    """Index coordinates (z, y, x, 3) of a grid, from its centre."""
    size = (shape,) * 3 if isinstance(shape, int) else shape
    index = np.stack(np.indices(size), axis=-1).astype(float)
    return index - (np.array(size) - 1) / 2


def ball(radius: float, shape: int) -> np.ndarray:
    return np.linalg.norm(grid(shape), axis=-1) < radius


def torus(ring: float, tube: float, shape: tuple[int, int, int]) -> np.ndarray:
    """A ring around the z axis, in the middle of the grid."""
    z, y, x = np.moveaxis(grid(shape), -1, 0)
    return np.hypot(np.hypot(y, x) - ring, z) < tube


def pear() -> Mask:
    """A smooth body of genus 0 that is not a ball."""
    points = grid(45)
    solid = np.linalg.norm(points - [-6, 0, 0], axis=-1) < 11
    solid |= np.linalg.norm(points - [8, 0, 0], axis=-1) < 8
    return Mask(solid, (0.1,) * 3)


def tube_along(curve: Floats, radius: float, shape: tuple[int, int, int]) -> np.ndarray:
    """Voxels within a distance of a densely sampled curve (n, 3) in index coordinates."""
    from scipy.spatial import cKDTree

    index = np.stack(np.indices(shape), axis=-1).reshape(-1, 3)
    return (cKDTree(curve).query(index)[0] < radius).reshape(shape)


def trefoil(size: float) -> Floats:
    t = np.linspace(0, 2 * np.pi, 2000)
    x = np.sin(t) + 2 * np.sin(2 * t)
    y = np.cos(t) - 2 * np.cos(2 * t)
    return size * np.stack([-np.sin(3 * t), y, x], axis=1)


def knot() -> np.ndarray:
    shape = (24, 46, 46)
    return tube_along(trefoil(6.0) + (np.array(shape) - 1) / 2, 2.6, shape)


def sponge(seed: int = 0, size: int = 18) -> np.ndarray:
    """One component of random holes."""
    noise = np.random.default_rng(seed).random((size,) * 3)
    mask = ndimage.gaussian_filter(noise, 1.0) > 0.5
    labels, _ = ndimage.label(mask, structure=np.ones((3, 3, 3)))
    return np.pad(labels == np.argmax(np.bincount(labels.ravel())[1:]) + 1, 4)


def linked_rings_and_bar() -> np.ndarray:
    mask = np.pad(torus(8, 2.2, (7, 27, 27)), ((12, 12), (4, 4), (4, 4)))
    points = grid(mask.shape)
    points[..., 1] -= 8  # a second ring through the first one
    z, y, x = np.moveaxis(points, -1, 0)
    mask |= np.hypot(np.hypot(y, z) - 8, x) < 2.2
    mask[15, 4:31, 17:19] = True  # joined to one piece
    return mask


def icosphere(subdivisions: int = 3) -> tuple[Floats, Ints]:
    """Unit vectors and faces of positive signed volume."""
    return outward(trimesh.creation.icosphere(subdivisions=subdivisions))


def outward(mesh: trimesh.Trimesh) -> tuple[Floats, Ints]:
    vertices = np.array(mesh.vertices, dtype=float)
    faces = np.array(mesh.faces, dtype=np.int64)
    return vertices, orient_outward(vertices, faces)


def torus_mesh(ring: float = 3.0, tube: float = 1.0, n: int = 48) -> tuple[Floats, Ints]:
    return outward(trimesh.creation.torus(ring, tube, n, n // 2))


def lumpy(subdivisions: int = 4, seed: int = 0, size: float = 0.25) -> tuple[Floats, Ints]:
    """A smooth body without any symmetry."""
    directions, faces = icosphere(subdivisions)
    rng = np.random.default_rng(seed)
    radius = np.ones(len(directions))
    for axis in rng.normal(size=(8, 3)):
        closeness = directions @ (axis / np.linalg.norm(axis))
        radius += size * rng.uniform(-0.5, 1.0) * np.exp(4.0 * (closeness - 1.0))
    vertices = directions * radius[:, None] * np.array([1.0, 1.15, 1.3])
    assert signed_volume(vertices, faces) > 0
    return vertices, faces


def bumpy() -> tuple[Floats, Ints]:
    """A body with narrow bumps, as blebs are."""
    directions, faces = icosphere(4)
    radius = np.ones(len(directions))
    for axis in np.random.default_rng(1).normal(size=(6, 3)):
        radius += 0.4 * np.exp(40 * (directions @ (axis / np.linalg.norm(axis)) - 1))
    return directions * radius[:, None] * [1, 1.1, 1.2], faces


def elongated(vertices: int = 2500, seed: int = 0, length: float = 2.0) -> tuple[Floats, Ints]:
    """A lumpy body several times as long as wide, of near-equilateral triangles."""
    points, faces = lumpy(5, seed, size=0.8)
    fewer, triangles = simplify(points * [1.0, 1.0, length], faces, vertices)
    return relax(fewer, triangles, silent())


def rotation(seed: int) -> Floats:
    """A random proper rotation (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def directions(count: int, seed: int = 0) -> Floats:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


# Where the bumps of the small cell are: axis (z, y, x), distance of the centre, radius. All
# different, so that a mirrored cell is another cell. The last one is the cap of a mushroom,
# which overhangs the cortex.
BUMPS = (
    ((1.0, 0.1, 0.2), 18.0, 6.0),
    ((-0.2, 1.0, 0.3), 18.5, 5.0),
    ((0.1, -0.4, 1.0), 17.5, 4.0),
    ((-0.6, -0.5, -0.6), 27.0, 6.5),
)
CORTEX = 17.0
STALK = 2.6
CELL_SHAPE = 76
CELL_ORIGIN = (1.0, -2.0, 3.0)


def small_cell_mask(*, handle: bool = False) -> Mask:
    """A ball with three bumps and a mushroom; with `handle` also an arch, so its genus is 1."""
    points = grid(CELL_SHAPE)
    solid = np.linalg.norm(points, axis=-1) < CORTEX
    for axis, distance, radius in BUMPS:
        unit = np.array(axis) / np.linalg.norm(axis)
        solid |= np.linalg.norm(points - distance * unit, axis=-1) < radius
    along = points @ unit
    across = np.linalg.norm(points - along[..., None] * unit, axis=-1)
    solid |= (across < STALK) & (along > 0) & (along < distance)
    if handle:
        z, y, x = np.moveaxis(points, -1, 0)
        ring = np.hypot(z, x + CORTEX + 1.0)
        solid |= np.hypot(ring - 6.0, y) < 2.6
    return Mask(solid, (VOXEL_UM,) * 3, CELL_ORIGIN)


def cell_centre() -> Floats:
    """Centre of the small cell's ball in µm."""
    return np.array(CELL_ORIGIN) + VOXEL_UM * (CELL_SHAPE - 1) / 2
