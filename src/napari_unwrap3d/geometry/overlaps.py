"""Which vertices of a mesh in (d, v, u) another part of it lies over."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def covered(points: Floats, faces: Ints, rows: int, tolerance: float) -> npt.NDArray[np.bool_]:
    """Whether a face lies over each vertex, at the same (v, u) and farther out.

    Each hemisphere is looked at in the plane of polar coordinates around its pole, where
    faces over the seam or the pole are like any other.

    Parameters
    ----------
    points : ndarray, (n, 3)
        (d, v, u); NaN where a vertex has no image.
    faces : ndarray, (m, 3)
    rows : int
        N.
    tolerance : float
        By how much of d a face is farther out.

    Returns
    -------
    ndarray, (n,) bool
        False where a vertex has no image.
    """
    known = np.asarray(np.isfinite(points).all(axis=1))
    whole = faces[known[faces].all(axis=1)]
    hidden = np.zeros(len(points), bool)
    angle = (points[:, 2] + 0.5) * np.pi / rows
    for south in (False, True):
        radius = rows - 0.5 - points[:, 1] if south else points[:, 1] + 0.5
        flat = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        far = radius[whole]
        # Those that lie near the other pole are drawn around that one.
        near = whole[(far.min(axis=1) <= 0.5 * rows) & (far.max(axis=1) < 0.9 * rows)]
        chosen = np.flatnonzero(known & (radius <= 0.5 * rows))
        _hide(points[:, 0].copy(), flat, near, chosen, rows, tolerance, hidden)
    return hidden


@numba.njit(nogil=True, cache=True)
def _hide(height, flat, faces, chosen, rows, tolerance, hidden):  # type: ignore[no-untyped-def]
    """Note in `hidden` which of the chosen vertices lie under a face."""
    middle = rows // 2 + 2
    width = 2 * middle + 1
    start = np.zeros(width * width + 1, np.int64)
    cell = np.empty(len(chosen), np.int64)
    for i in range(len(chosen)):
        x, y = flat[chosen[i]]
        cell[i] = (int(np.floor(x)) + middle) * width + int(np.floor(y)) + middle
        start[cell[i] + 1] += 1
    start = np.cumsum(start)
    place, sorted_ = start.copy(), np.empty(len(chosen), np.int64)
    for i in range(len(chosen)):
        sorted_[place[cell[i]]] = chosen[i]
        place[cell[i]] += 1
    for f in range(len(faces)):
        a, b, c = faces[f]
        top = max(height[a], height[b], height[c]) - tolerance
        (ax, ay), (bx, by), (cx, cy) = flat[a], flat[b], flat[c]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:
            continue
        first_x = max(int(np.floor(min(ax, bx, cx))) + middle, 0)
        last_x = min(int(np.floor(max(ax, bx, cx))) + middle, width - 1)
        first_y = max(int(np.floor(min(ay, by, cy))) + middle, 0)
        last_y = min(int(np.floor(max(ay, by, cy))) + middle, width - 1)
        for i in range(first_x, last_x + 1):
            for k in range(start[i * width + first_y], start[i * width + last_y + 1]):
                vertex = sorted_[k]
                if hidden[vertex] or height[vertex] >= top or vertex in (a, b, c):
                    continue
                x, y = flat[vertex]
                wb = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
                wc = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
                wa = 1.0 - wb - wc
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                over = wa * height[a] + wb * height[b] + wc * height[c]
                if over > height[vertex] + tolerance:
                    hidden[vertex] = True
