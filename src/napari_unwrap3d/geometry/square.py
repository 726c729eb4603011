"""Between the unit disk and the square [−1, 1]²: the elliptical grid mapping.

Fong 2015, "Analytical methods for squaring the disc", arXiv:1509.06344 (Nowell's mapping);
paper, "Direct 2D unwrapping of protrusion submeshes". Lines of the square's grid become
ellipses; the circle becomes the square's border.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def square_from_disk(points: Floats) -> Floats:
    """Where points (n, 2) of the unit disk lie in the square [−1, 1]²."""
    difference = points[:, 0] ** 2 - points[:, 1] ** 2
    signs = np.array([1.0, -1.0])
    both = 2.0 + signs * difference[:, None]
    shift = 2.0 * np.sqrt(2.0) * points
    # Rounding may take a point of the border just across it.
    roots = np.sqrt(np.maximum(both + shift, 0.0)) - np.sqrt(np.maximum(both - shift, 0.0))
    squared: Floats = np.clip(0.5 * roots, -1.0, 1.0)
    return squared


def disk_from_square(points: Floats) -> Floats:
    """Where points (n, 2) of the square [−1, 1]² lie in the unit disk."""
    disk: Floats = points * np.sqrt(1.0 - 0.5 * points[:, ::-1] ** 2)
    return disk


def pixel_centres(pixels: int) -> Floats:
    """Centres (N·N, 2) of the pixels of an N × N image of the square, row by row."""
    along = (np.arange(pixels) + 0.5) * (2.0 / pixels) - 1.0
    return np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)


def pixels_of(points: Floats, pixels: int) -> Floats:
    """Points (n, 2) of the square in pixels of an N × N image, centres at whole numbers."""
    position: Floats = (points + 1.0) * (0.5 * pixels) - 0.5
    return position
