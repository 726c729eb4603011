"""Lines on a surface that is given by its map from the unit sphere: even steps, and lanes beside.

The map is any function from unit vectors (n, 3) to points (n, 3) in µm, so nothing here depends
on an axis, a seam or a pole.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..errors import InputError

Floats = npt.NDArray[np.float64]
Embedding = Callable[[Floats], Floats]

# Corners that are this near to opposite (cosine of the angle) have no shortest way between them.
OPPOSITE = -1.0 + 1e-9
TINY = 1e-12


def great_circles(corners: Floats, largest_angle: float) -> Floats:
    """Unit vectors (n, 3) along the shortest ways between unit vectors (k, 3), in order.

    Parameters
    ----------
    corners : ndarray, (k, 3)
    largest_angle : float
        Between neighbours, in radians.

    Raises
    ------
    InputError
        Two corners lie opposite each other: every way is as short.
    """
    parts = [corners[:1]]
    for i, (start, stop) in enumerate(itertools.pairwise(corners)):
        cosine = float(np.clip(start @ stop, -1.0, 1.0))
        if cosine < OPPOSITE:
            raise InputError(
                "Two corners of the line lie opposite each other, so there is no shortest way.",
                corners=(i, i + 1),
                hint="Put a corner between them.",
            )
        # From the cross product, which small angles do not lose to rounding.
        angle = float(np.arctan2(np.linalg.norm(np.cross(start, stop)), cosine))
        steps = max(int(np.ceil(angle / largest_angle)), 1)
        share = (np.arange(1, steps + 1) / steps)[:, None]
        if angle < TINY:
            parts.append(np.repeat(stop[None], steps, axis=0))
            continue
        way = np.sin((1 - share) * angle) * start + np.sin(share * angle) * stop
        parts.append(way / np.sin(angle))
    return _unit(np.concatenate(parts))


def even_steps(way: Floats, embed: Embedding, step_um: float) -> tuple[Floats, Floats]:
    """Points of a line at even distances along it on the surface.

    Parameters
    ----------
    way : ndarray, (m, 3)
        Unit vectors, dense: the line is straight between their images.
    embed : callable
    step_um : float
        Wanted; the steps are even, so that the last point is the line's end.

    Returns
    -------
    directions : ndarray, (n, 3)
        Unit vectors, n ≥ 2.
    positions_um : ndarray, (n,)
        Arc length from the line's start.

    Raises
    ------
    InputError
        The line has no length.
    """
    lengths = np.linalg.norm(np.diff(embed(way), axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    total = float(along[-1])
    if not total > 0:
        raise InputError("The line has no length.", hint="Draw two points apart from each other.")
    count = max(round(total / step_um), 1) + 1
    positions = np.linspace(0.0, total, count)
    # Where nothing is passed there is nothing to interpolate between.
    moving = np.concatenate([[True], np.diff(along) > 0])
    directions = np.stack(
        [np.interp(positions, along[moving], axis[moving]) for axis in way.T], axis=1
    )
    return _unit(directions), positions


def lanes(
    directions: Floats, embed: Embedding, offsets: int, gap_um: float, reach: float
) -> Floats:
    """Points beside every point of a line, along the surface and square to the line.

    Each is found by going on along a great circle from the one before, by the angle that
    `gap_um` has there on the surface.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors, evenly along the line.
    embed : callable
    offsets : int
        Lanes on each side.
    gap_um : float
        Between lanes, on the surface.
    reach : float
        Angle in radians over which the surface's stretch is measured: about a triangle's.

    Returns
    -------
    ndarray, (n, 2 offsets + 1, 3)
        Unit vectors from the left (of who follows the line, seen from outside) to the right; the
        line itself is in the middle.
    """
    found = np.empty((len(directions), 2 * offsets + 1, 3))
    found[:, offsets] = directions
    if offsets:
        right = _square_to(directions, embed, reach)
        for sign in (-1, 1):
            place, heading = directions, sign * right
            for lane in range(1, offsets + 1):
                angle = gap_um / np.maximum(_stretch(place, heading, embed, reach), TINY)
                place, heading = _onward(place, heading, angle)
                found[:, offsets + sign * lane] = place
    return found


def _square_to(directions: Floats, embed: Embedding, reach: float) -> Floats:
    """Unit tangents (n, 3) of the sphere whose images are square to the line's, to its right."""
    ahead = np.gradient(directions, axis=0)
    ahead -= np.sum(ahead * directions, axis=1, keepdims=True) * directions
    ahead = _unit(ahead)
    # (z, y, x) is left-handed as a triple of coordinates, so this cross product is to the right.
    aside = np.cross(directions, ahead)
    along, across = (_image(directions, way, embed, reach) for way in (ahead, aside))
    size = np.maximum(np.sum(along * along, axis=1, keepdims=True), TINY)
    return _unit(aside - np.sum(along * across, axis=1, keepdims=True) / size * ahead)


def _image(place: Floats, heading: Floats, embed: Embedding, reach: float) -> Floats:
    """Derivative (n, 3) of the map along unit tangents, in µm per radian."""
    there, _ = _onward(place, heading, np.full(len(place), reach))
    back, _ = _onward(place, heading, np.full(len(place), -reach))
    return (embed(there) - embed(back)) / (2 * reach)


def _stretch(place: Floats, heading: Floats, embed: Embedding, reach: float) -> Floats:
    stretch: Floats = np.linalg.norm(_image(place, heading, embed, reach), axis=1)
    return stretch


def _onward(place: Floats, heading: Floats, angle: Floats) -> tuple[Floats, Floats]:
    """Along great circles: where one arrives, and where one heads then."""
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return cosine * place + sine * heading, cosine * heading - sine * place


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: Floats = vectors / np.maximum(length, TINY)
    return unit
