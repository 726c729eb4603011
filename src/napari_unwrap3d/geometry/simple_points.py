"""Changing voxels of a solid without changing its topology.

A voxel is *simple* when changing it keeps the number of components, handles and
cavities (Bertrand and Malandain 1994, doi:10.1016/0167-8655(94)90046-9): it has one
26-connected component of solid neighbours and one 6-connected component of background
among its 18 neighbours that touches it by a face. A solid is *well-composed*
(Latecki 1997, doi:10.1006/gmip.1997.0443) when no 2×2×2 block holds a critical
configuration; its boundary is then a manifold, and its mesh has its topology whatever
the connectivity. Here a voxel changes only if it is simple and the solid stays
well-composed.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np
import numpy.typing as npt

Solid = npt.NDArray[np.bool_]

OFFSETS = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
CENTRE = 13
_POSITION = {tuple(int(c) for c in offset): n for n, offset in enumerate(OFFSETS)}


def _adjacency(touches: str) -> npt.NDArray[np.uint32]:
    """For each of the 27 positions, a bit mask of its neighbours (without the centre)."""
    masks = np.zeros(27, np.uint32)
    for a in range(27):
        for b in range(27):
            if CENTRE in (a, b) or a == b:
                continue
            step = np.abs(OFFSETS[a] - OFFSETS[b])
            near = step.max() <= 1 if touches == "corner" else step.sum() == 1
            if near:
                masks[a] |= np.uint32(1 << b)
    return masks


def _bits(condition: npt.NDArray[np.bool_]) -> int:
    return sum(1 << n for n in range(27) if n != CENTRE and condition[n])


def _squares() -> npt.NDArray[np.int64]:
    """The 12 2×2 squares with the centre: its two face neighbours, then the diagonal."""
    rows = []
    for axis in range(3):
        first, second = [a for a in range(3) if a != axis]
        for s in (-1, 1):
            for t in (-1, 1):
                p, q, d = [0, 0, 0], [0, 0, 0], [0, 0, 0]
                p[first] = d[first] = s
                q[second] = d[second] = t
                rows.append([_POSITION[tuple(p)], _POSITION[tuple(q)], _POSITION[tuple(d)]])
    return np.array(rows)


def _cubes() -> npt.NDArray[np.int64]:
    """The 8 cubes with the centre: three face neighbours, the edge neighbour opposite to
    each of them, and the corner opposite to the centre.
    """
    rows = []
    for s in (-1, 1):
        for t in (-1, 1):
            for u in (-1, 1):
                faces = [(s, 0, 0), (0, t, 0), (0, 0, u)]
                edges = [(0, t, u), (s, 0, u), (s, t, 0)]
                rows.append([_POSITION[p] for p in (*faces, *edges, (s, t, u))])
    return np.array(rows)


_STEPS = np.abs(OFFSETS).sum(axis=1)
_FACE_BITS = np.uint32(_bits(_STEPS == 1))
_EDGE_BITS = np.uint32(_bits(_STEPS <= 2))
_ALL_BITS = np.uint32(_bits(_STEPS <= 3))
_CORNER_ADJACENCY = _adjacency("corner")
_FACE_ADJACENCY = _adjacency("face")
_SQUARES = _squares()
_CUBES = _cubes()


def change_simple_points(
    solid: Solid, changeable: Solid, priority: npt.NDArray[np.floating], new_value: bool
) -> Solid:
    """Set voxels to `new_value`, highest priority first, keeping the topology.

    Parameters
    ----------
    solid : ndarray, (z, y, x) bool
        A well-composed solid that does not touch the border of the array.
    changeable : ndarray, (z, y, x) bool
        Voxels that may change; none on the border of the array.
    priority : ndarray, (z, y, x) float
        Order of the changes.
    new_value : bool
        False shrinks the solid (and seals handles when the hull of a shape is shrunk onto
        it), True grows it (and cuts handles when a shape is filled from a seed).

    Returns
    -------
    ndarray, (z, y, x) bool
        A well-composed solid with the same components, handles and cavities as `solid`.
    """
    shape = solid.shape
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    values = np.ascontiguousarray(solid).astype(np.uint8).ravel()
    _change(
        values,
        np.ascontiguousarray(changeable).ravel(),
        np.ascontiguousarray(priority, dtype=np.float32).ravel(),
        (OFFSETS @ strides).astype(np.int64),
        np.flatnonzero(_STEPS == 1),
        1 if new_value else 0,
    )
    return values.reshape(shape).astype(bool)


@numba.njit(nogil=True, cache=True)
def _flood(seed, within, adjacency):  # type: ignore[no-untyped-def]
    reached = seed
    front = seed
    while front:
        touched = np.uint32(0)
        for k in range(27):
            if (front >> np.uint32(k)) & np.uint32(1):
                touched |= adjacency[k]
        front = touched & within & ~reached
        reached |= front
    return reached


@numba.njit(nogil=True, cache=True)
def _lowest_bit(bits):  # type: ignore[no-untyped-def]
    return bits & (~bits + np.uint32(1))


@numba.njit(nogil=True, cache=True)
def _is_simple(code):  # type: ignore[no-untyped-def]
    solid = code & _ALL_BITS
    empty = ~code & _EDGE_BITS
    touching = empty & _FACE_BITS
    if solid == 0 or touching == 0:
        return False
    if _flood(_lowest_bit(solid), solid, _CORNER_ADJACENCY) != solid:
        return False
    return (touching & ~_flood(_lowest_bit(touching), empty, _FACE_ADJACENCY)) == 0


@numba.njit(nogil=True, cache=True)
def _stays_well_composed(code, new):  # type: ignore[no-untyped-def]
    for row in range(_SQUARES.shape[0]):
        a = (code >> np.uint32(_SQUARES[row, 0])) & 1
        b = (code >> np.uint32(_SQUARES[row, 1])) & 1
        diagonal = (code >> np.uint32(_SQUARES[row, 2])) & 1
        if a == b and a != new and diagonal == new:
            return False
    for row in range(_CUBES.shape[0]):
        if ((code >> np.uint32(_CUBES[row, 6])) & 1) != new:
            continue
        # The centre and the opposite corner will both be `new`: critical if the six
        # others are all old, or all new but for one antipodal pair.
        count = 0
        pair_is_old = False
        for k in range(3):
            face = (code >> np.uint32(_CUBES[row, k])) & 1
            edge = (code >> np.uint32(_CUBES[row, k + 3])) & 1
            count += (face == new) + (edge == new)
            if face != new and edge != new:
                pair_is_old = True
        if count == 0 or (count == 4 and pair_is_old):
            return False
    return True


@numba.njit(nogil=True, cache=True)
def _has_neighbor(values, i, offsets, face_offsets, new):  # type: ignore[no-untyped-def]
    for k in face_offsets:  # noqa: SIM110 (numba compiles no generators)
        if values[i + offsets[k]] == new:
            return True
    return False


@numba.njit(nogil=True, cache=True)
def _change(values, changeable, priority, offsets, face_offsets, new):  # type: ignore[no-untyped-def]
    heap = [(np.float32(0), np.int64(0))]
    heap.pop()
    queued = np.zeros(len(values), np.bool_)
    for i in range(len(values)):
        if (
            changeable[i]
            and values[i] != new
            and _has_neighbor(values, i, offsets, face_offsets, new)
        ):
            heapq.heappush(heap, (-priority[i], np.int64(i)))
            queued[i] = True
    while len(heap) > 0:
        level, v = heapq.heappop(heap)
        queued[v] = False
        if values[v] == new:
            continue
        code = np.uint32(0)
        for k in range(27):
            if k != CENTRE and values[v + offsets[k]]:
                code |= np.uint32(1) << np.uint32(k)
        if not (_is_simple(code) and _stays_well_composed(code, new)):
            continue
        values[v] = new
        for k in range(27):
            j = v + offsets[k]
            if (
                values[j] != new
                and changeable[j]
                and not queued[j]
                and _has_neighbor(values, j, offsets, face_offsets, new)
            ):
                # A voxel that becomes changeable late must not jump the queue.
                heapq.heappush(heap, (max(-priority[j], level), np.int64(j)))
                queued[j] = True
