"""Other views of a uv image: stitched, at the cell's aspect ratio, polar, and a chessboard.

Images are (N, 2N) or (N, 2N, k). Scalars are interpolated over the seam and the poles,
labels are taken from the nearest pixel.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..charts import UV, Floats
from ..errors import AxesError, InputError, ParameterError
from ..geometry.padding import pad_sphere, sample_uv_linear, sample_uv_nearest

Kind = Literal["scalar", "label"]
Pole = Literal["north", "south"]


# Stitched ------------------------------------------------------------------------------


def stitch(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The image (N, 2N + 1, …) whose last column is the first one again (paper, Step 4)."""
    _check(image)
    return np.concatenate([image, image[:, :1]], axis=1)


def unstitch(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The image (N, 2N, …) of a stitched one.

    Raises
    ------
    AxesError
        It is not N × 2N + 1.
    InputError
        Its last column differs from the first: something would be lost.
    """
    rows, columns = image.shape[:2]
    if columns != 2 * rows + 1:
        raise AxesError("A stitched uv image is N × 2N + 1.", shape=image.shape)
    same = image[:, 0] == image[:, -1]
    same |= (image[:, 0] != image[:, 0]) & (image[:, -1] != image[:, -1])
    if not same.all():
        raise InputError(
            "The last column of a stitched image is its first one; here they differ.",
            pixels=int((~same).sum()),
            hint="Filter over the seam, or drop the last column yourself: image[:, :-1].",
        )
    return image[:, :-1]


# Aspect ratio --------------------------------------------------------------------------


def aspect_ratio(uv: UV) -> float:
    """Length of the equator over the mean length from pole to pole, on the reference.

    The paper's N × 2N has the ratio of a sphere, 2; this is that of the cell's own shape
    (paper, "aspect ratio": equatorial circumference to the arc between the poles). A
    meridian and the one half a turn away are one closed curve through both poles.
    """
    positions = uv.positions
    rows = positions.shape[0]
    equator = 0.5 * (positions[rows // 2 - 1] + positions[rows // 2])
    around = np.linalg.norm(np.roll(equator, -1, axis=0) - equator, axis=1).sum()
    # Between a first or last pixel and the one beyond the pole lies the pole itself.
    over_poles = pad_sphere(positions, 1)[:, 1:-1]
    steps = np.linalg.norm(np.diff(over_poles, axis=0), axis=2)
    steps[[0, -1]] *= 0.5
    return float(around / steps.sum(axis=0).mean())


def to_aspect(image: npt.NDArray[Any], ratio: float, kind: Kind = "scalar") -> npt.NDArray[Any]:
    """The image resampled to N rows and about `ratio` times N columns, once around.

    Parameters
    ----------
    image : ndarray, (N, 2N, …)
    ratio : float
        Width over height, e.g. from :func:`aspect_ratio`; 2 changes nothing.
    kind : "scalar" or "label"

    Returns
    -------
    ndarray, (N, M, …)
        Column j lies at u = (j + ½) 2N / M − ½.
    """
    _check(image)
    rows = len(image)
    if not 0.0 < ratio < np.inf:
        raise ParameterError("An aspect ratio is positive.", ratio=ratio)
    columns = max(round(ratio * rows), 1)
    u = (np.arange(columns) + 0.5) * (2 * rows / columns) - 0.5
    points = np.stack(np.meshgrid(np.arange(float(rows)), u, indexing="ij"), axis=-1)
    return _sample(image, points.reshape(-1, 2), kind).reshape(rows, columns, *image.shape[2:])


# Polar ---------------------------------------------------------------------------------


def uv_to_polar(points: npt.ArrayLike, rows: int, pole: Pole = "north") -> Floats:
    """(r, φ) of points (n, 2) (v, u) in pixels.

    r is the inclination from the pole over that of the opposite pole, 0 … 1, and φ the
    azimuth in radians, −π … π, 0 in the middle column.
    """
    v, u = _pairs(points).T
    r = (v + 0.5) / rows
    phi = np.mod((u + 0.5) * np.pi / rows, 2.0 * np.pi) - np.pi
    return np.stack([r if _is_north(pole) else 1.0 - r, phi], axis=1)


def polar_to_uv(points: npt.ArrayLike, rows: int, pole: Pole = "north") -> Floats:
    """(v, u) in pixels of points (n, 2) (r, φ); the inverse of :func:`uv_to_polar`."""
    r, phi = _pairs(points).T
    v = (r if _is_north(pole) else 1.0 - r) * rows - 0.5
    u = np.mod(phi + np.pi, 2.0 * np.pi) * rows / np.pi - 0.5
    return np.stack([v, u], axis=1)


def polar_to_pixel(points: npt.ArrayLike, size: int, pole: Pole = "north") -> Floats:
    """(row, column) in a polar view of `size` pixels of points (n, 2) (r, φ).

    φ = 0 points to the right. Seen from outside φ runs counter-clockwise around the north
    pole and clockwise around the south pole, so that neither view is mirrored.
    """
    r, phi = _pairs(points).T
    radius = 0.5 * size * r
    down = radius * np.sin(phi) * (-1.0 if _is_north(pole) else 1.0)
    centre = 0.5 * (size - 1)
    return np.stack([centre + down, centre + radius * np.cos(phi)], axis=1)


def pixel_to_polar(points: npt.ArrayLike, size: int, pole: Pole = "north") -> Floats:
    """(r, φ) of points (n, 2) (row, column) of a polar view; r > 1 lies outside of the disc."""
    centre = 0.5 * (size - 1)
    down, right = (_pairs(points) - centre).T
    phi = np.arctan2(-down if _is_north(pole) else down, right)
    return np.stack([np.hypot(down, right) / (0.5 * size), phi], axis=1)


def to_polar(
    image: npt.NDArray[Any], pole: Pole = "north", size: int | None = None, kind: Kind = "scalar"
) -> npt.NDArray[Any]:
    """The whole image as a disc around one pole, the other pole being its rim.

    Parameters
    ----------
    image : ndarray, (N, 2N, …)
    pole : "north" or "south"
        The pole in the centre.
    size : int, optional
        Edge of the view in pixels; 2N, which keeps the length of v, unless given.
    kind : "scalar" or "label"

    Returns
    -------
    ndarray, (size, size, …)
        NaN, or 0 for labels, outside of the disc.
    """
    _check(image)
    rows = len(image)
    edge = 2 * rows if size is None else int(size)
    if edge < 1:
        raise ParameterError("A polar view has at least one pixel.", size=edge)
    polar = pixel_to_polar(np.indices((edge, edge)).reshape(2, -1).T, edge, pole)
    inside = polar[:, 0] <= 1.0
    found = _sample(image, polar_to_uv(polar[inside], rows, pole), kind)
    shape = (len(inside), *image.shape[2:])
    view = np.zeros(shape, found.dtype) if kind == "label" else np.full(shape, np.nan)
    view[inside] = found
    return view.reshape(edge, edge, *image.shape[2:])


# Chessboard ----------------------------------------------------------------------------


def chessboard(rows: int, tiles: int = 8) -> npt.NDArray[np.uint8]:
    """Labels 1 and 2 in squares, `tiles` from pole to pole and twice as many around.

    Carried to another chart it shows what the maps do to angles and areas::

        atlas.carry(uv_views.chessboard(rows), "uv", "surface", kind="label")

    Parameters
    ----------
    rows : int
        N of the uv image.
    tiles : int
        From 1 to N.

    Returns
    -------
    ndarray, (N, 2N) uint8
        0 is left for what has no image.
    """
    if not 1 <= tiles <= rows:
        raise ParameterError(
            "A chessboard has from one tile to one per row.", tiles=tiles, rows=rows
        )
    v, u = np.arange(rows) * tiles // rows, np.arange(2 * rows) * tiles // rows
    return ((v[:, None] + u) % 2 + 1).astype(np.uint8)


# ---------------------------------------------------------------------------------------


def _check(image: npt.NDArray[Any]) -> None:
    if image.ndim < 2 or image.shape[1] != 2 * image.shape[0]:
        raise AxesError("A uv image is N × 2N.", shape=image.shape)


def _pairs(points: npt.ArrayLike) -> Floats:
    pairs = np.asarray(points, dtype=np.float64)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise AxesError("Points of an image have two coordinates each.", shape=pairs.shape)
    return pairs


def _is_north(pole: str) -> bool:
    if pole not in ("north", "south"):
        raise ParameterError(f"A pole is 'north' or 'south', not {pole!r}.")
    return pole == "north"


def _sample(image: npt.NDArray[Any], points: Floats, kind: str) -> npt.NDArray[Any]:
    if kind not in ("scalar", "label"):
        raise ParameterError(f"Values are of kind 'scalar' or 'label', not {kind!r}.")
    return sample_uv_nearest(image, points) if kind == "label" else sample_uv_linear(image, points)
