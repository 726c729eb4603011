"""Random regions on the uv image, many of them over the seam and the poles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
SMALLEST, LARGEST = 0.25, 0.9  # radii of the discs in radians
REGIONS = 20


def pixel_directions(rows: int) -> npt.NDArray[np.float64]:
    """Unit vectors (N, 2N, 3) (z, y, x) of the pixels' centres, the north pole at +z."""
    return directions_of(np.moveaxis(np.indices((rows, 2 * rows)), 0, -1), rows)


def directions_of(pixels: npt.NDArray[Any], rows: int) -> npt.NDArray[np.float64]:
    """Unit vectors (..., 3) (z, y, x) of (v, u) in pixels (..., 2)."""
    inclination = (pixels[..., 0] + 0.5) * np.pi / rows
    azimuth = (pixels[..., 1] + 0.5) * np.pi / rows - np.pi
    flat = np.sin(inclination)
    return np.stack([np.cos(inclination), flat * np.sin(azimuth), flat * np.cos(azimuth)], axis=-1)


def random_regions(rows: int, seed: int) -> list[Mask]:
    """Twenty regions (N, 2N): five around each pole, five over the seam, five anywhere.

    Every second one is irregular: a union of two to four overlapping discs. Discs are
    geodesic, of radius 0.25 to 0.9 rad.
    """
    rng = np.random.default_rng(seed)
    directions = pixel_directions(rows)
    regions = []
    for number in range(REGIONS):
        centre = _centre(number % 4, rng)
        region = _disc(directions, centre, rng)
        if number % 2:
            for _ in range(int(rng.integers(1, 4))):
                region |= _disc(directions, _near(centre, rng), rng)
        regions.append(region)
    return regions


def _centre(place: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    if place < 2:
        pole = np.array([1.0 if place == 0 else -1.0, 0.0, 0.0])
        return _unit(pole + 0.1 * rng.normal(size=3))
    if place == 2:
        inclination = rng.uniform(0.15, 0.85) * np.pi
        return np.array([np.cos(inclination), 0.0, -np.sin(inclination)])
    return _unit(rng.normal(size=3))


def _near(centre: npt.NDArray[np.float64], rng: np.random.Generator) -> npt.NDArray[np.float64]:
    return _unit(centre + 0.4 * rng.normal(size=3))


def _disc(
    directions: npt.NDArray[np.float64],
    centre: npt.NDArray[np.float64],
    rng: np.random.Generator,
) -> Mask:
    inside: Mask = directions @ centre > np.cos(rng.uniform(SMALLEST, LARGEST))
    return inside


def _unit(vector: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    unit: npt.NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def intersection_over_union(first: Mask, second: Mask) -> float:
    """Shared pixels over pixels of either."""
    return float((first & second).sum() / (first | second).sum())
