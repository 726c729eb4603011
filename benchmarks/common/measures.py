"""How good meshes and grids are, computed here and not taken from the package.

Vertices are (n, 3), in any frame in which the faces have a positive signed volume.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Marching cubes' edges are at most √2 voxels long, so their meshes are left as they are.
LONGEST_EDGE_VOXELS = 1.5


def trimesh_of(vertices: Floats, faces: Ints) -> Any:
    """The mesh as trimesh sees it, nothing merged or repaired."""
    import trimesh

    return trimesh.Trimesh(vertices, faces, process=False, validate=False)


def topology(vertices: Floats, faces: Ints) -> dict[str, Any]:
    """Euler characteristic, components, and whether the mesh is watertight, by trimesh."""
    mesh = trimesh_of(vertices, faces)
    return {
        "euler_characteristic": int(mesh.euler_number),
        "components": int(mesh.body_count),
        "watertight": bool(mesh.is_watertight and mesh.is_winding_consistent),
        "volume": float(mesh.volume),
    }


def flips(directions: Floats, faces: Ints) -> int:
    """Spherical triangles whose corners do not turn counter-clockwise seen from outside."""
    corners = directions[faces]
    determinants = np.linalg.det(corners)
    return int(np.count_nonzero(~(determinants > 0.0)))


def conformal_error(source: Floats, target: Floats, faces: Ints) -> float:
    """Q, the ratio of the singular values of each face's map, averaged by area.

    From the eigenvalues of the target's first fundamental form relative to the source's.
    """
    first, second = _gram(source, faces), _gram(target, faces)
    relative = np.linalg.solve(first, second)
    half_trace = 0.5 * np.trace(relative, axis1=1, axis2=2)
    root = np.sqrt(np.maximum(half_trace**2 - np.linalg.det(relative), 0.0))
    with np.errstate(divide="ignore"):
        ratio = np.sqrt((half_trace + root) / np.maximum(half_trace - root, 0.0))
    area = np.sqrt(np.linalg.det(first))
    return float(area @ ratio / area.sum())


def _gram(vertices: Floats, faces: Ints) -> Floats:
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    gram: Floats = edges @ edges.transpose(0, 2, 1)
    return gram


def log_area_distortion(source: Floats, target: Floats, faces: Ints) -> float:
    """Mean over the faces of |log λ|, λ their share of one area over that of the other."""
    shares = []
    for vertices in (source, target):
        area = np.sqrt(np.maximum(np.linalg.det(_gram(vertices, faces)), 0.0))
        shares.append(area / area.sum())
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.abs(np.log(shares[0] / shares[1])).mean())


def random_points(vertices: Floats, faces: Ints, count: int, rng: np.random.Generator) -> Floats:
    """Points (count, 3) spread evenly over the area of a mesh."""
    area = np.sqrt(np.linalg.det(_gram(vertices, faces)))
    face = rng.choice(len(faces), size=count, p=area / area.sum())
    a, b = rng.random((2, count))
    beyond = a + b > 1.0
    a, b = np.where(beyond, 1.0 - a, a), np.where(beyond, 1.0 - b, b)
    weights = np.stack([1.0 - a - b, a, b], axis=1)
    points: Floats = np.einsum("ij,ijk->ik", weights, vertices[faces[face]])
    return points


def chamfer(vertices: Floats, others: Floats) -> float:
    """The paper's Chamfer distance: both mean distances to the nearest vertex, summed."""
    forth = cKDTree(others).query(vertices)[0].mean()
    back = cKDTree(vertices).query(others)[0].mean()
    return float(forth + back)


def sampled(vertices: Floats, faces: Ints, edge: float) -> Floats:
    """Vertices of a mesh after halving its edges of more than 1.5 voxels of size `edge`.

    Chamfer distances are taken between vertices: a coarse mesh would be far from itself.
    """
    import trimesh

    limit = LONGEST_EDGE_VOXELS * edge
    found, _ = trimesh.remesh.subdivide_to_size(vertices, faces, limit, max_iter=20)
    return np.asarray(found, dtype=np.float64)


def subdivided(vertices: Floats, faces: Ints) -> Floats:
    """Vertices of a mesh and the middles of its edges."""
    import trimesh

    found, _ = trimesh.remesh.subdivide(vertices, faces)
    return np.asarray(found, dtype=np.float64)


@numba.njit(cache=True)
def folded_cells(nodes, first_layer, last_layer):  # type: ignore[no-untyped-def]
    """Folded cells of a (D, N + 2, 2N, 3) grid around a sphere, and the number of cells.

    A cell is folded when the Jacobian of (d, u, v) ↦ (z, y, x) is not positive at one of its
    eight corners. On a pole, where ∂/∂u vanishes, its limit along the row is taken. Cells
    outside the layers that one of their four columns reaches do not exist.
    """
    _, rows, columns, _ = nodes.shape
    folded = 0
    cells = 0
    d = np.empty(3)
    u = np.empty(3)
    v = np.empty(3)
    for b in range(rows - 1):
        for c in range(columns):
            e = (c + 1) % columns
            first = max(
                first_layer[b, c],
                first_layer[b, e],
                first_layer[b + 1, c],
                first_layer[b + 1, e],
            )
            last = min(
                last_layer[b, c],
                last_layer[b, e],
                last_layer[b + 1, c],
                last_layer[b + 1, e],
            )
            for a in range(first, last):
                cells += 1
                good = True
                for corner in range(8):
                    i = a + corner // 4
                    j = b + (corner // 2) % 2
                    k = c if corner % 2 == 0 else e
                    along = min(max(j, 1), rows - 2)
                    for x in range(3):
                        d[x] = nodes[a + 1, j, k, x] - nodes[a, j, k, x]
                        v[x] = nodes[i, b + 1, k, x] - nodes[i, b, k, x]
                        u[x] = nodes[i, along, e, x] - nodes[i, along, c, x]
                    determinant = (
                        d[0] * (u[1] * v[2] - u[2] * v[1])
                        + d[1] * (u[2] * v[0] - u[0] * v[2])
                        + d[2] * (u[0] * v[1] - u[1] * v[0])
                    )
                    if not determinant > 0.0:
                        good = False
                if not good:
                    folded += 1
    return folded, cells
