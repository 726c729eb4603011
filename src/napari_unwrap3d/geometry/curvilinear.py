"""A curvilinear (d, v, u) grid around a sphere: evaluation, inversion, Jacobian.

Nodes are stored as (D, N + 2, 2N, 3): the first and the last row are the poles, each the
same streamline repeated around, half a row away from their neighbours; u is periodic.
Between nodes positions are trilinear. "Grid coordinates" below are (layer, row, column)
as stored, so that pixel row v is row v + 1.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..progress import Progress
from .parallel import ranges, run_blocks

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LAYERS_PER_REPORT = 8
ROWS_PER_BLOCK = 16
POINTS_PER_BLOCK = 16384


def rows_from_v(v: Floats, rows: int) -> Floats:
    """Stored row of pixel coordinate v in −½ … N − ½."""
    inner = np.clip(v, 0.0, rows - 1.0)
    return inner + 1.0 + 2.0 * (v - inner)


def v_from_rows(row: Floats, rows: int) -> Floats:
    """Pixel coordinate v of a stored row; the inverse of :func:`rows_from_v`."""
    inner = np.clip(row, 1.0, float(rows))
    return inner - 1.0 + 0.5 * (row - inner)


def evaluate(nodes: npt.NDArray[np.float32], points: Floats) -> Floats:
    """Positions (n, 3) float64 at grid coordinates (n, 3)."""

    def positions(part: slice) -> Floats:
        return np.asarray(_evaluate(nodes, points[part]))

    blocks = ranges(len(points), POINTS_PER_BLOCK)
    return np.concatenate([np.empty((0, 3)), *run_blocks(positions, blocks)])


@numba.njit(nogil=True, cache=True)
def _evaluate(nodes, points):  # type: ignore[no-untyped-def]
    out = np.empty((points.shape[0], 3))
    values = np.empty((3, 4))
    for i in range(points.shape[0]):
        _position_and_jacobian(nodes, points[i, 0], points[i, 1], points[i, 2], values)
        for k in range(3):
            out[i, k] = values[k, 0]
    return out


@numba.njit(nogil=True, cache=True)
def _position_and_jacobian(nodes, d, r, u, out):  # type: ignore[no-untyped-def]
    """Columns of `out` (3, 4): position, and its derivatives by d, r and u."""
    layers, rows, columns, _ = nodes.shape
    d = min(max(d, 0.0), layers - 1.0)
    r = min(max(r, 0.0), rows - 1.0)
    u = u % columns
    a, b, c = min(int(d), layers - 2), min(int(r), rows - 2), min(int(u), columns - 1)
    e = c + 1 if c + 1 < columns else 0
    fd, fr, fu = d - a, r - b, u - c
    for k in range(3):
        p00, p01 = nodes[a, b, c, k], nodes[a, b, e, k]
        p10, p11 = nodes[a, b + 1, c, k], nodes[a, b + 1, e, k]
        q00, q01 = nodes[a + 1, b, c, k], nodes[a + 1, b, e, k]
        q10, q11 = nodes[a + 1, b + 1, c, k], nodes[a + 1, b + 1, e, k]
        y00, y01 = p00 * (1 - fu) + p01 * fu, p10 * (1 - fu) + p11 * fu
        y10, y11 = q00 * (1 - fu) + q01 * fu, q10 * (1 - fu) + q11 * fu
        z0, z1 = y00 * (1 - fr) + y01 * fr, y10 * (1 - fr) + y11 * fr
        out[k, 0] = z0 * (1 - fd) + z1 * fd
        out[k, 1] = z1 - z0
        out[k, 2] = (y01 - y00) * (1 - fd) + (y11 - y10) * fd
        out[k, 3] = ((p01 - p00) * (1 - fr) + (p11 - p10) * fr) * (1 - fd) + (
            (q01 - q00) * (1 - fr) + (q11 - q10) * fr
        ) * fd


def invert(
    nodes: npt.NDArray[np.float32],
    targets: Floats,
    start: Floats,
    iterations: int,
    tolerance: float,
    progress: Progress | None = None,
) -> tuple[Floats, Floats]:
    """Grid coordinates of positions, by damped Newton steps in the trilinear cells.

    Parameters
    ----------
    nodes : ndarray, (D, N + 2, 2N, 3) float32
    targets : ndarray, (n, 3) float64
    start : ndarray, (n, 3) float64
        Grid coordinates to start from.
    iterations : int
    tolerance : float
        Distance at which a point counts as found.
    progress : Progress, optional

    Returns
    -------
    found : ndarray, (n, 3)
        The best grid coordinates met.
    residual : ndarray, (n,)
        Distance from the target to the position there.
    """

    def part(points: slice) -> tuple[Floats, Floats]:
        found, residual = _invert(nodes, targets[points], start[points], iterations, tolerance)
        return found, residual

    blocks = ranges(len(targets), POINTS_PER_BLOCK)
    parts = [(np.empty((0, 3)), np.empty(0)), *run_blocks(part, blocks, progress, "inverting")]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


@numba.njit(nogil=True, cache=True)
def _invert(nodes, targets, start, iterations, tolerance):  # type: ignore[no-untyped-def]
    layers, rows, columns, _ = nodes.shape
    n = targets.shape[0]
    found = np.empty((n, 3))
    residual = np.empty(n)
    m = np.empty((3, 4))
    for i in range(n):
        d, r, u = start[i, 0], start[i, 1], start[i, 2]
        best = 1e300
        for _ in range(iterations):
            d = min(max(d, 0.0), layers - 1.0)
            if r < 0.0:
                r, u = -r, u + columns // 2
            elif r > rows - 1.0:
                r, u = 2.0 * (rows - 1.0) - r, u + columns // 2
            r = min(max(r, 0.0), rows - 1.0)
            u = u % columns
            _position_and_jacobian(nodes, d, r, u, m)
            x, y, z = targets[i, 0] - m[0, 0], targets[i, 1] - m[1, 0], targets[i, 2] - m[2, 0]
            miss = np.sqrt(x * x + y * y + z * z)
            if miss < best:
                best = miss
                found[i, 0], found[i, 1], found[i, 2] = d, r, u
            if miss < tolerance:
                break
            c0 = m[1, 2] * m[2, 3] - m[1, 3] * m[2, 2]
            c1 = m[1, 3] * m[2, 1] - m[1, 1] * m[2, 3]
            c2 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
            det = m[0, 1] * c0 + m[0, 2] * c1 + m[0, 3] * c2
            if det == 0.0:
                # At a pole u does nothing: step aside and try again.
                r += 1e-3 if r < 0.5 * rows else -1e-3
                u += 0.37 * columns
                continue
            s0 = (
                x * c0
                + y * (m[0, 3] * m[2, 2] - m[0, 2] * m[2, 3])
                + z * (m[0, 2] * m[1, 3] - m[0, 3] * m[1, 2])
            ) / det
            s1 = (
                x * c1
                + y * (m[0, 1] * m[2, 3] - m[0, 3] * m[2, 1])
                + z * (m[0, 3] * m[1, 1] - m[0, 1] * m[1, 3])
            ) / det
            s2 = (
                x * c2
                + y * (m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2])
                + z * (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1])
            ) / det
            size = max(abs(s0), abs(s1))
            damping = 1.0 if size < 4.0 else 4.0 / size
            if abs(s2) * damping > 0.25 * columns:
                damping = 0.25 * columns / abs(s2)
            d += damping * s0
            r += damping * s1
            u += damping * s2
        residual[i] = best
    return found, residual


def node_volumes(
    nodes: npt.NDArray[np.float32], first: Ints, last: Ints, progress: Progress
) -> npt.NDArray[np.float32]:
    """Volume (D, N, 2N) that belongs to every node at a pixel, of the cells that there are.

    A cell is cut at half its width in d, v and u into eight parts, one for each of its corners;
    what lies between a pole and the row next to it belongs to that row. The volume of a part
    is that of the trilinear cell by the midpoint rule: all together are the whole.

    Parameters
    ----------
    nodes : ndarray, (D, N + 2, 2N, 3) float32
    first, last : ndarray, (N + 2, 2N) int64
        First and last layer that each column reaches.
    """
    layers, rows, columns = nodes.shape[:3]
    volumes = np.zeros((layers, rows - 2, columns), np.float32)
    for begin in range(0, layers - 1, LAYERS_PER_REPORT):
        progress(begin / layers, "measuring volumes")
        _add_volumes(nodes, first, last, begin, min(begin + LAYERS_PER_REPORT, layers - 1), volumes)
    return volumes


@numba.njit(nogil=True, cache=True)
def _add_volumes(nodes, first, last, begin, end, volumes):  # type: ignore[no-untyped-def]
    """Add the parts of the cells of layers begin … end − 1 to their nodes, in place."""
    _, rows, columns, _ = nodes.shape
    p = np.empty((2, 2, 2, 3), np.float64)
    m = np.empty((3, 3), np.float64)
    for a in range(begin, end):
        for b in range(rows - 1):
            for c in range(columns):
                e = c + 1 if c + 1 < columns else 0
                if a < max(max(first[b, c], first[b, e]), max(first[b + 1, c], first[b + 1, e])):
                    continue
                if a >= min(min(last[b, c], last[b, e]), min(last[b + 1, c], last[b + 1, e])):
                    continue
                for i in range(2):
                    for j in range(2):
                        for k in range(3):
                            p[i, j, 0, k] = nodes[a + i, b + j, c, k]
                            p[i, j, 1, k] = nodes[a + i, b + j, e, k]
                for j in range(2):
                    row = min(max(b + j - 1, 0), rows - 3)
                    fr = 0.25 + 0.5 * j
                    for i in range(2):
                        fd = 0.25 + 0.5 * i
                        for k in range(2):
                            part = _part_of_cell(p, fd, fr, 0.25 + 0.5 * k, m)
                            volumes[a + i, row, e if k else c] += part


@numba.njit(nogil=True, cache=True)
def _part_of_cell(p, fd, fr, fu, m):  # type: ignore[no-untyped-def]
    """An eighth of the determinant of (∂d, ∂u, ∂v) within a cell of corners (2, 2, 2, 3).

    `m` (3, 3) is room for the derivatives.
    """
    for k in range(3):
        y00 = p[0, 0, 0, k] * (1 - fu) + p[0, 0, 1, k] * fu
        y01 = p[0, 1, 0, k] * (1 - fu) + p[0, 1, 1, k] * fu
        y10 = p[1, 0, 0, k] * (1 - fu) + p[1, 0, 1, k] * fu
        y11 = p[1, 1, 0, k] * (1 - fu) + p[1, 1, 1, k] * fu
        below = (p[0, 0, 1, k] - p[0, 0, 0, k]) * (1 - fr) + (p[0, 1, 1, k] - p[0, 1, 0, k]) * fr
        above = (p[1, 0, 1, k] - p[1, 0, 0, k]) * (1 - fr) + (p[1, 1, 1, k] - p[1, 1, 0, k]) * fr
        m[0, k] = (y10 - y00) * (1 - fr) + (y11 - y01) * fr
        m[1, k] = below * (1 - fd) + above * fd
        m[2, k] = (y01 - y00) * (1 - fd) + (y11 - y10) * fd
    determinant = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        + m[0, 1] * (m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    return determinant / 8.0


def count_folded(
    nodes: npt.NDArray[np.float32], first: Ints, last: Ints | None = None
) -> tuple[int, int, float, float]:
    """Number of folded cells, number of cells checked, smallest and mean Jacobian.

    A cell is folded when the determinant of (∂d, ∂u, ∂v) is not positive at one of its eight
    corners. Cells outside the layers that their columns reach are not cells; the corners
    that lie on a pole have no volume and are left out.

    Parameters
    ----------
    nodes : ndarray, (D, N + 2, 2N, 3) float32
    first, last : ndarray, (N + 2, 2N) int64
        First and last layer that each column reaches; by default the last of all.
    """
    if last is None:
        last = np.full(first.shape, len(nodes) - 1)
    folded, cells, smallest, mean = _count_folded(nodes, first, last)
    return int(folded), int(cells), float(smallest), float(mean)


@numba.njit(nogil=True, cache=True)
def repeat_ends(nodes, first, last):  # type: ignore[no-untyped-def]
    """Let every column repeat its first and last node beyond the layers it reaches, in place."""
    layers, rows, columns, _ = nodes.shape
    for b in range(rows):
        for c in range(columns):
            for a in range(first[b, c]):
                for k in range(3):
                    nodes[a, b, c, k] = nodes[first[b, c], b, c, k]
            for a in range(last[b, c] + 1, layers):
                for k in range(3):
                    nodes[a, b, c, k] = nodes[last[b, c], b, c, k]


def trim_folded(
    nodes: npt.NDArray[np.float32],
    first: Ints,
    last: Ints,
    start: int,
    low: Ints,
    high: Ints,
    progress: Progress | None = None,
) -> int:
    """Shorten columns to where none of their cells is folded, in place.

    Parameters
    ----------
    nodes : ndarray, (D, N + 2, 2N, 3) float32
    first, last : ndarray, (N + 2, 2N) int64
        First and last layer that each column reaches; moved past folded cells.
    start : int
        The layer that all columns start from.
    low, high : ndarray, (N + 2, 2N) int64
        Layers between which a column is needed.
    progress : Progress, optional

    Returns
    -------
    int
        Number of folded cells within what is needed: what lies beyond them is lost.
    """

    def look(rows: slice) -> npt.NDArray[np.bool_]:
        return np.asarray(_has_folded(nodes, first, last, rows.start, rows.stop))

    # Looking takes the time, and can be done anywhere in any order; trimming cannot, since a
    # shortened column has fewer cells to be trimmed for.
    blocks = ranges(nodes.shape[1] - 1, ROWS_PER_BLOCK)
    folded = np.concatenate(run_blocks(look, blocks, progress, "checking the Jacobian"))
    return int(_trim(nodes, first, last, start, low, high, np.argwhere(folded)))


@numba.njit(nogil=True, cache=True)
def _has_folded(nodes, first, last, begin, stop):  # type: ignore[no-untyped-def]
    """Which piles of cells (stop − begin, 2N) above rows begin … stop − 1 hold a folded one."""
    columns = nodes.shape[2]
    found = np.zeros((stop - begin, columns), np.bool_)
    p = np.empty((2, 2, 2, 3), np.float64)
    for b in range(begin, stop):
        for c in range(columns):
            e = c + 1 if c + 1 < columns else 0
            bottom = max(max(first[b, c], first[b, e]), max(first[b + 1, c], first[b + 1, e]))
            top = min(min(last[b, c], last[b, e]), min(last[b + 1, c], last[b + 1, e]))
            for a in range(bottom, top):
                lowest, _ = _lowest_determinant(nodes, a, b, c, e, p)
                if not lowest > 0:
                    found[b - begin, c] = True
                    break
    return found


@numba.njit(nogil=True, cache=True)
def _trim(nodes, first, last, start, low, high, places):  # type: ignore[no-untyped-def]
    """Trim the columns around the piles of cells at `places` (n, 2), in their order."""
    columns = nodes.shape[2]
    p = np.empty((2, 2, 2, 3), np.float64)
    lost = 0
    for place in range(len(places)):
        b, c = places[place]
        e = c + 1 if c + 1 < columns else 0
        begin = max(max(first[b, c], first[b, e]), max(first[b + 1, c], first[b + 1, e]))
        end = min(min(last[b, c], last[b, e]), min(last[b + 1, c], last[b + 1, e]))
        bottom = min(min(low[b, c], low[b, e]), min(low[b + 1, c], low[b + 1, e]))
        top = max(max(high[b, c], high[b, e]), max(high[b + 1, c], high[b + 1, e]))
        for a in range(begin, end):
            lowest, _ = _lowest_determinant(nodes, a, b, c, e, p)
            if lowest > 0:
                continue
            lost += bottom <= a < top
            if a < start:
                for r in (b, b + 1):
                    for k in (c, e):
                        first[r, k] = max(first[r, k], a + 1)
            else:
                for r in (b, b + 1):
                    for k in (c, e):
                        last[r, k] = min(last[r, k], a)
                break
    return lost


@numba.njit(nogil=True, cache=True)
def _lowest_determinant(nodes, a, b, c, e, p):  # type: ignore[no-untyped-def]
    """Smallest determinant of (∂d, ∂u, ∂v) at the corners of a cell, and their sum.

    NaN counts as −∞.
    """
    rows = nodes.shape[1]
    for i in range(2):
        for j in range(2):
            for k in range(3):
                p[i, j, 0, k] = nodes[a + i, b + j, c, k]
                p[i, j, 1, k] = nodes[a + i, b + j, e, k]
    lowest = 1e300
    total = 0.0
    for j in range(2):
        # On a pole ∂/∂u vanishes; its direction is that of the row beside it.
        at_pole = (b == 0 and j == 0) or (b == rows - 2 and j == 1)
        beside = 1 - j if at_pole else j
        for i in range(2):
            for k in range(2):
                d0 = p[1, j, k, 0] - p[0, j, k, 0]
                d1 = p[1, j, k, 1] - p[0, j, k, 1]
                d2 = p[1, j, k, 2] - p[0, j, k, 2]
                v0 = p[i, 1, k, 0] - p[i, 0, k, 0]
                v1 = p[i, 1, k, 1] - p[i, 0, k, 1]
                v2 = p[i, 1, k, 2] - p[i, 0, k, 2]
                u0 = p[i, beside, 1, 0] - p[i, beside, 0, 0]
                u1 = p[i, beside, 1, 1] - p[i, beside, 0, 1]
                u2 = p[i, beside, 1, 2] - p[i, beside, 0, 2]
                det = d0 * (u1 * v2 - u2 * v1) + d1 * (u2 * v0 - u0 * v2) + d2 * (u0 * v1 - u1 * v0)
                total += 0.0 if at_pole else det
                if not det >= lowest:
                    lowest = det if det < lowest else -1e300
    return lowest, total


@numba.njit(nogil=True, cache=True)
def _count_folded(nodes, first, last):  # type: ignore[no-untyped-def]
    layers, rows, columns, _ = nodes.shape
    folded = 0
    cells = 0
    smallest = 1e300
    total = 0.0
    p = np.empty((2, 2, 2, 3), np.float64)
    for a in range(layers - 1):
        for b in range(rows - 1):
            for c in range(columns):
                e = c + 1 if c + 1 < columns else 0
                if a < max(max(first[b, c], first[b, e]), max(first[b + 1, c], first[b + 1, e])):
                    continue
                if a >= min(min(last[b, c], last[b, e]), min(last[b + 1, c], last[b + 1, e])):
                    continue
                lowest, part = _lowest_determinant(nodes, a, b, c, e, p)
                cells += 1
                total += part
                smallest = min(smallest, lowest)
                if not lowest > 0:
                    folded += 1
    return folded, cells, smallest, total / max(8 * cells, 1)


def in_columns(grid: Floats, first: Ints, last: Ints) -> npt.NDArray[np.bool_]:
    """Whether all columns between which points (n, 3) lie reach their layer; NaN is nowhere.

    Parameters
    ----------
    grid : ndarray, (n, 3)
        Grid coordinates (layer, row, column).
    first, last : ndarray, (N + 2, 2N) int64
        First and last layer that each column reaches.
    """
    valid = np.asarray(np.isfinite(grid).all(axis=1))
    layer, row, column = np.where(valid[:, None], grid, 0.0).T
    slack = 1e-9 * (int(last.max()) + 1)
    height, width = first.shape
    for r in (np.floor(row), np.ceil(row)):
        for c in (np.floor(column), np.ceil(column)):
            place = r.astype(np.int64).clip(0, height - 1), c.astype(np.int64) % width
            valid &= layer >= first[place] - slack
            valid &= layer <= last[place] + slack
    return valid
