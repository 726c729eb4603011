"""Lowering the distortion of a spherical mesh vertex by vertex, without ever flipping a face.

The energy of a face is ``w (α (MIPS − 1) + log² λ)`` with the MIPS energy of Hormann and
Greiner (2000), ``MIPS = (σ₁/σ₂ + σ₂/σ₁) / 2``, the area distortion λ against the face's
wanted area, and the share w of the area; a vertex may be tied to a direction,
``γ m max(0, |x − p| − slack)²``.
Each vertex takes a Newton step on the faces around it (Gauss–Seidel), shortened until the
energy falls; a flipped face has infinite energy.
"""

from __future__ import annotations

import numba
import numpy as np

from .area_polish import determinant, tangents
from .hierarchy import smallest_determinant
from .mesh import Floats, Ints, face_areas

# A face thinner than this (1 = equilateral) is given the shape of an equilateral one: its own
# cannot be kept without squeezing its neighbours.
THINNEST_SHAPE = 0.25
LONGEST_STEP = 0.5
SHORTENINGS, SHORTENING = 8, 0.45
_UNTANGLING = 60


def rest_frames(vertices: Floats, faces: Ints, areas: Floats) -> Floats:
    """Inverse frames of the faces' own shapes, scaled to given areas.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    areas : ndarray, (m,)
        Wanted areas on the unit sphere.

    Returns
    -------
    ndarray, (m, 3, 3)
        For each corner: ``(1/l, −x/(l y), 1/y)`` where the edges to the next corners are
        ``(l, 0)`` and ``(x, y)`` in the plane of the face.
    """
    frames = np.empty((len(faces), 3, 3))
    double = 2.0 * face_areas(vertices, faces)
    edges = vertices[faces] - vertices[np.roll(faces, -1, axis=1)]
    squared = np.einsum("fij,fij->f", edges, edges)
    thin = 2.0 * np.sqrt(3.0) * double / np.maximum(squared, 1e-300) < THINNEST_SHAPE
    for corner in range(3):
        a, b, c = (vertices[faces[:, (corner + k) % 3]] for k in range(3))
        u, v = b - a, c - a
        length = np.maximum(np.linalg.norm(u, axis=1), 1e-300)
        x, y = np.einsum("ij,ij->i", u, v) / length, double / length
        length = np.where(thin, 1.0, length)
        x, y = np.where(thin, 0.5, x), np.where(thin, 0.5 * np.sqrt(3.0), y)
        scale = np.sqrt(2.0 * areas / (length * y))
        frames[:, corner, 0] = 1.0 / (length * scale)
        frames[:, corner, 1] = -x / (length * y * scale)
        frames[:, corner, 2] = 1.0 / (y * scale)
    return frames


@numba.njit(nogil=True, cache=True)
def _corner(faces, f, i):  # type: ignore[no-untyped-def]
    if faces[f, 0] == i:
        return 0
    return 1 if faces[f, 1] == i else 2


@numba.njit(nogil=True, cache=True)
def _face_terms(p, b, c, frame):  # type: ignore[no-untyped-def]
    """Squared lengths (aa, bb) and area ratio r of a face with a corner at p; r = 0 if flipped."""
    if not determinant(p, b, c) > 0.0:
        return 0.0, 0.0, 0.0
    j0, j1, j2 = frame[0], frame[1], frame[2]
    aa = bb = ab = 0.0
    for k in range(3):
        e, g = b[k] - p[k], c[k] - p[k]
        along, across = e * j0, e * j1 + g * j2
        aa += along * along
        bb += across * across
        ab += along * across
    squared = aa * bb - ab * ab
    if not squared > 1e-280:
        return 0.0, 0.0, 0.0
    return aa, bb, np.sqrt(squared)


@numba.njit(nogil=True, cache=True)
def _distance(p, q):  # type: ignore[no-untyped-def]
    return np.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@numba.njit(nogil=True, cache=True)
def _energy(x, faces, stars, i, p, frames, weights, alpha, ties, cap):  # type: ignore[no-untyped-def]
    """Energy around vertex i if it were at p; infinite if a face flips or it exceeds `cap`."""
    star, degree = stars
    towards, pull, slack = ties
    total = 0.0
    if pull[i] > 0.0:
        away = max(0.0, _distance(p, towards[i]) - slack)
        total += pull[i] * away * away
    for q in range(degree[i]):
        f = star[i, q]
        k = _corner(faces, f, i)
        b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
        aa, bb, r = _face_terms(p, x[b], x[c], frames[f, k])
        if r == 0.0:
            return np.inf
        log = np.log(r)
        total += weights[f] * (alpha * ((aa + bb) / (2.0 * r) - 1.0) + log * log)
        if total > cap:
            return np.inf
    return total


@numba.njit(nogil=True, cache=True)
def _newton_step(x, faces, stars, i, frames, weights, alpha, ties, s, t):  # type: ignore[no-untyped-def]
    """Newton step in the tangent plane (along s and t) with a positive Hessian."""
    star, degree = stars
    towards, pull, slack = ties
    gs = gt = hst = 0.0
    hss = htt = 1e-300
    if pull[i] > 0.0:
        distance = _distance(x[i], towards[i])
        if distance > slack:
            force = 2.0 * pull[i] * (1.0 - slack / distance)
            for k in range(3):
                gs += force * (x[i, k] - towards[i, k]) * s[k]
                gt += force * (x[i, k] - towards[i, k]) * t[k]
            hss += 2.0 * pull[i]
            htt += 2.0 * pull[i]
    for q in range(degree[i]):
        f = star[i, q]
        corner = _corner(faces, f, i)
        b, c = x[faces[f, (corner + 1) % 3]], x[faces[f, (corner + 2) % 3]]
        frame = frames[f, corner]
        aa, bb, r = _face_terms(x[i], b, c, frame)
        if r == 0.0:
            continue
        opposite = foot = 0.0
        for k in range(3):
            opposite += (c[k] - b[k]) ** 2
            foot += (x[i, k] - b[k]) * (c[k] - b[k])
        foot /= opposite
        # The height over the opposite edge, and the gradient of the squared lengths.
        squared = ns = nt = ls = lt = 0.0
        j0, j1, j2 = frame[0], frame[1], frame[2]
        for k in range(3):
            height = x[i, k] - b[k] - foot * (c[k] - b[k])
            squared += height * height
            ns += height * s[k]
            nt += height * t[k]
            e, g = b[k] - x[i, k], c[k] - x[i, k]
            slope = -2.0 * (e * j0 * j0 + (e * j1 + g * j2) * (j1 + j2))
            ls += slope * s[k]
            lt += slope * t[k]
        if not squared > 1e-300:
            continue
        ns /= squared
        nt /= squared
        log, lengths = np.log(r), aa + bb
        by_log = weights[f] * (2.0 * log - alpha * lengths / (2.0 * r))
        by_lengths = weights[f] * alpha / (2.0 * r)
        gs += by_log * ns + by_lengths * ls
        gt += by_log * nt + by_lengths * lt
        curved = weights[f] * (2.0 * (1.0 + max(0.0, -log)) + alpha * lengths / r)
        round_ = weights[f] * alpha * (j0 * j0 + (j1 + j2) ** 2) / r
        hss += curved * ns * ns + round_
        hst += curved * ns * nt
        htt += curved * nt * nt + round_
    det = hss * htt - hst * hst
    if not det > 0.0:
        return 0.0, 0.0
    return -(htt * gs - hst * gt) / det, -(hss * gt - hst * gs) / det


@numba.njit(nogil=True, cache=True)
def sweep(x, faces, stars, order, frames, weights, alpha, ties):  # type: ignore[no-untyped-def]
    """One Newton step for every vertex in `order`, in place; by how much the energy fell.

    Parameters
    ----------
    x : ndarray, (n, 3) float64
        Unit vectors.
    faces : ndarray, (m, 3) int64
    stars : (ndarray (n, k), ndarray (n,))
        Faces around each vertex, and how many.
    order : ndarray, (p,) int64
    frames : ndarray, (m, 3, 3)
        See :func:`rest_frames`.
    weights : ndarray, (m,)
    alpha : float
        Weight of shape (MIPS) against area.
    ties : (ndarray (n, 3), ndarray (n,), float)
        Directions, how strongly each vertex is tied to its own, and how far it may be from
        it (a chord of the unit sphere) before it feels the tie.
    """
    fallen = 0.0
    p = np.empty(3)
    for i in order:
        before = _energy(x, faces, stars, i, x[i], frames, weights, alpha, ties, np.inf)
        if before == np.inf:
            if not _untangle(x, faces, stars, i, p) > 0.0:
                continue
            before = _energy(x, faces, stars, i, x[i], frames, weights, alpha, ties, np.inf)
        s, t = tangents(x[i])
        along, across = _newton_step(x, faces, stars, i, frames, weights, alpha, ties, s, t)
        length = np.sqrt(along * along + across * across)
        if not length > 1e-13:
            continue
        step = min(1.0, LONGEST_STEP / length)
        for _ in range(SHORTENINGS):
            norm = 0.0
            for k in range(3):
                p[k] = x[i, k] + step * (along * s[k] + across * t[k])
                norm += p[k] * p[k]
            norm = np.sqrt(norm)
            for k in range(3):
                p[k] /= norm
            after = _energy(x, faces, stars, i, p, frames, weights, alpha, ties, before)
            if after < before:
                x[i] = p
                fallen += before - after
                break
            step *= SHORTENING
    return fallen


@numba.njit(nogil=True, cache=True)
def _untangle(x, faces, stars, i, p):  # type: ignore[no-untyped-def]
    """Look for a place of vertex i where no face around it is flipped, ever closer to it."""
    star, degree = stars
    best = smallest_determinant(x, faces, star, degree, i, x[i])
    reach = 0.0
    for q in range(degree[i]):
        f = star[i, q]
        b = faces[f, (_corner(faces, f, i) + 1) % 3]
        squared = 0.0
        for k in range(3):
            squared += (x[b, k] - x[i, k]) ** 2
        reach = max(reach, np.sqrt(squared))
    s, t = tangents(x[i])
    for attempt in range(_UNTANGLING):
        # Directions a golden angle apart leave none out.
        angle = 2.399963229728653 * attempt
        norm = 0.0
        for k in range(3):
            p[k] = x[i, k] + reach * (np.cos(angle) * s[k] + np.sin(angle) * t[k])
            norm += p[k] * p[k]
        norm = np.sqrt(norm)
        for k in range(3):
            p[k] /= norm
        value = smallest_determinant(x, faces, star, degree, i, p)
        if value > best:
            best = value
            x[i] = p
        reach *= 0.85
    return best
