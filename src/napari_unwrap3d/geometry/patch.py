"""A patch in a loop: a fan of triangles, made finer, of least bending energy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from .intrinsic import robust_laplacian
from .laplacian import Factor, vertex_mass
from .mesh import boundary_edges

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def fan_patch(rim: Floats, subdivisions: int) -> tuple[Floats, Ints]:
    """A fan from the mean of a loop, each triangle cut into four, again and again.

    Parameters
    ----------
    rim : ndarray, (k, 3)
        In the order in which the patch's faces run along it.
    subdivisions : int

    Returns
    -------
    vertices : ndarray, (n, 3)
        The first k are `rim`; what the cuts add on the loop is removed into the nearer of its
        vertices, so that the patch fits the mesh around it.
    faces : ndarray, (m, 3)
    """
    count, rings = len(rim), 2**subdivisions
    centre = rim.mean(axis=0)
    along = np.roll(rim, -1, axis=0) - rim
    points = [rim, centre[None]]
    # Ring i has i points between one spoke and the next.
    first = np.zeros(rings, np.int64)
    total = count + 1
    for i in range(1, rings):
        first[i] = total
        steps = np.arange(i) / rings
        ring = centre + (i / rings) * (rim - centre)[:, None] + steps[:, None] * along[:, None]
        points.append(ring.reshape(-1, 3))
        total += count * i
    sector = np.arange(count)

    def number(i: int, j: int) -> Ints:
        """The point j steps after each spoke on ring i."""
        if i == 0:
            found = np.full(count, count)
        elif i == rings:
            found = (sector + (2 * j > rings)) % count
        else:
            found = first[i] + (sector * i + j) % (count * i)
        return found

    def triangle(*corners: tuple[int, int]) -> Ints:
        return np.stack([number(i, j) for i, j in corners], axis=1)

    steps_of_rings = [(i, j) for i in range(1, rings + 1) for j in range(i)]
    outer = [triangle((i, j), (i, j + 1), (i - 1, j)) for i, j in steps_of_rings]
    inner = [
        triangle((i, j + 1), (i - 1, j + 1), (i - 1, j)) for i, j in steps_of_rings if j < i - 1
    ]
    found = np.concatenate(outer + inner)
    distinct = (found != np.roll(found, 1, axis=1)).all(axis=1)
    return np.concatenate(points), found[distinct]


def least_bending(vertices: Floats, faces: Ints, free: npt.NDArray[np.bool_]) -> Floats:
    """Vertices (n, 3) with those that are free where they bend the mesh least.

    The integral of the squared Laplacian of the positions over all vertices inside the mesh is
    least (Botsch and Kobbelt 2004, doi:10.1145/1015706.1015772). Where the border of the free
    part is the border of the mesh that is the harmonic patch; where a ring of fixed faces lies
    around, the patch continues it smoothly.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    free : ndarray, (n,) bool
        None on the mesh's border.
    """
    inside = np.ones(len(vertices), bool)
    inside[boundary_edges(faces)] = False
    mass = vertex_mass(vertices, faces)
    rows = robust_laplacian(vertices, faces)[inside]
    weights = sparse.diags_array(1.0 / np.maximum(mass[inside], 1e-6 * mass.mean()))
    moving, still = rows[:, free], rows[:, ~free]
    matrix = moving.T @ weights @ moving
    right = -(moving.T @ (weights @ (still @ vertices[~free])))
    result = vertices.copy()
    result[free] = Factor(matrix).solve(np.ascontiguousarray(right))
    return result
