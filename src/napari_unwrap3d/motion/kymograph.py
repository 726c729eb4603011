"""Kymographs: a field along a line on the cell, over time (paper, Fig. 5b).

A line is drawn in (u, v) and measured in µm on the reference of the common space, which does not
change in time, so that a slope in a kymograph is a speed on the cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from ..atlas import Atlas
from ..charts import Floats, Frame
from ..errors import AxesError, InputError, ParameterError
from ..geometry.padding import sample_uv_linear, wrap_uv
from ..geometry.surface_lines import even_steps, great_circles, lanes
from ..progress import Progress
from .frames import AREA, HEIGHT
from .uv_stacks import UvStacks, check_field, made_frames

if TYPE_CHECKING:
    import pandas as pd

    from .movie import Movie

Between = Literal["straight", "great circle"]
BETWEEN: tuple[Between, ...] = ("straight", "great circle")
# A line is followed in steps of this part of a pixel.
FINE = 0.25
# The surface's stretch is measured over so many pixels.
STRETCH_PIXELS = 1.5


@dataclass(frozen=True, eq=False)
class SurfaceLine:
    """A line on the common space's reference, at even steps. Make it with :func:`surface_line`.

    Attributes
    ----------
    corners : ndarray, (k, 2)
        (v, u) in pixels, as drawn.
    between : str
        How the corners are joined: "straight" or "great circle".
    points : ndarray, (n, 2)
        (v, u) in pixels, within the image: over the seam u jumps.
    positions_um : ndarray, (n,)
        Arc length on the reference from the line's start.
    lanes : ndarray, (n, L, 2)
        (v, u) of the places whose mean is taken at each point; the line is in the middle.
    width_um : float
    directions : ndarray, (n, 3)
        The points as unit vectors on the common sphere.
    """

    corners: Floats
    between: Between
    points: Floats
    positions_um: Floats
    lanes: Floats
    width_um: float
    directions: Floats

    @property
    def step_um(self) -> float:
        """Between neighbouring points."""
        return float(self.positions_um[1])

    @property
    def length_um(self) -> float:
        return float(self.positions_um[-1])


def surface_line(
    atlas: Atlas,
    corners: npt.ArrayLike,
    width_um: float = 0.0,
    *,
    between: Between = "straight",
    step_um: float | None = None,
) -> SurfaceLine:
    """Measure a line that was drawn in (u, v).

    Parameters
    ----------
    atlas : Atlas
        The common space.
    corners : array-like, (k, 2)
        (v, u) in pixels. Beyond the image they continue over the seam and the poles: from
        u = 2N − 5 to 2N + 5 is ten pixels over the seam.
    width_um : float
        Of the band whose mean is taken, on the reference and square to the line; 0: the line.
    between : "straight" or "great circle"
        straight: the line is what is drawn, straight in the image; great circle: the shortest way
        on the sphere, which does not depend on the axis and takes the short way over seam and
        poles.
    step_um : float, optional
        Between the kymograph's columns; by default the mean size of a pixel.

    Raises
    ------
    AxesError
        The corners are not two or more (v, u).
    ParameterError
        The width or the step is no length, or there is no such way between corners.
    InputError
        The line has no length, or two corners lie opposite each other (great circle).
    """
    given = np.array(corners, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != 2 or len(given) < 2 or not np.isfinite(given).all():
        raise AxesError("A line is two or more finite (v, u).", shape=given.shape)
    if between not in BETWEEN:
        raise ParameterError(f"Corners are joined as {' or '.join(BETWEEN)}, not {between!r}.")
    if not (np.isfinite(width_um) and width_um >= 0):
        raise ParameterError("The width is a length in µm.", width_um=float(width_um))
    rows = atlas.uv.shape[0]
    step = pixel_um(atlas) if step_um is None else float(step_um)
    if not (np.isfinite(step) and step > 0):
        raise ParameterError("The step is a length in µm.", step_um=step)
    if between == "straight":
        way, _ = atlas.map(_dense(given), "uv", "sphere")
    else:
        way = great_circles(atlas.map(given, "uv", "sphere")[0], FINE * np.pi / rows)

    def embed(directions: Floats) -> Floats:
        return atlas.map(directions, "sphere", "reference")[0]

    directions, positions = even_steps(way, embed, step)
    # An odd number of lanes, so that the line itself is one.
    beside = int(np.ceil((width_um / step - 1) / 2)) if width_um > step else 0
    gap = width_um / (2 * beside + 1)
    band = lanes(directions, embed, beside, gap, STRETCH_PIXELS * np.pi / rows)
    places = atlas.map(band.reshape(-1, 3), "sphere", "uv")[0]
    places = wrap_uv(places, rows).reshape(*band.shape[:2], 2)
    points = places[:, beside]
    return SurfaceLine(given, between, points, positions, places, float(width_um), directions)


def pixel_um(atlas: Atlas) -> float:
    """Edge in µm of a square with the mean area of a pixel of the uv image on the reference."""
    return float(np.sqrt(np.mean(atlas.uv.fields[AREA])))


def _dense(corners: Floats) -> Floats:
    """Points along straight lines, at most a part of a pixel apart."""
    parts = [corners[:1]]
    for start, stop in itertools.pairwise(corners):
        steps = max(int(np.ceil(np.abs(stop - start).max() / FINE)), 1)
        parts.append(start + (np.arange(1, steps + 1) / steps)[:, None] * (stop - start))
    return np.concatenate(parts)


def broken_at_seam(points: npt.ArrayLike, rows: int) -> Floats:
    """(v, u) of a line (n, 2) with NaN between neighbours on different sides of seam or pole."""
    given = np.asarray(points, np.float64)
    jump = np.flatnonzero(np.abs(np.diff(given[:, 1])) > rows / 2)
    return np.insert(given, jump + 1, np.nan, axis=0)


# On the surface ------------------------------------------------------------------------


def line_on_surface(
    atlas: Atlas, line: SurfaceLine, frame: Frame | None = None, lift_um: float = 0.0
) -> Floats:
    """Where a line lies in space, (n, 3) in µm.

    Parameters
    ----------
    atlas : Atlas
        The common space.
    line : SurfaceLine
    frame : Frame, optional
        A timepoint: on its outermost surface, by its height over every pixel; NaN where none
        lies there. Without one: on the reference.
    lift_um : float
        How far outwards from there, for what is drawn to be seen.
    """
    if frame is None and not lift_um:
        return atlas.map(line.directions, "sphere", "reference")[0]
    height = np.zeros(len(line.points))
    if frame is not None:
        height = sample_uv_linear(frame.uv[HEIGHT], line.points)
    on_it = np.column_stack([height + lift_um, line.points])
    return atlas.map(on_it, "topography", "volume")[0]


# Kymographs ----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Kymograph:
    """A field along a line, over time.

    Attributes
    ----------
    field : str
        Its name, with the unit.
    values : ndarray, (T, n)
        NaN where there is no surface, or no frame.
    times_s : ndarray, (T,)
    line : SurfaceLine
    name : str
        Of the movie.
    """

    field: str
    values: Floats
    times_s: Floats
    line: SurfaceLine
    name: str = ""

    @property
    def positions_um(self) -> Floats:
        """Along the line (n,), from its start."""
        return self.line.positions_um

    def table(self) -> pd.DataFrame:
        """A row per timepoint and position: ``timepoint, time_s, position_um, v_px, u_px`` and
        the field.
        """
        import pandas as pd

        count, length = self.values.shape
        return pd.DataFrame(
            {
                "timepoint": np.repeat(np.arange(count), length),
                "time_s": np.repeat(self.times_s, length),
                "position_um": np.tile(self.positions_um, count),
                "v_px": np.tile(self.line.points[:, 0], count),
                "u_px": np.tile(self.line.points[:, 1], count),
                self.field: self.values.ravel(),
            }
        )


def kymograph(
    movie: Movie,
    line: SurfaceLine | npt.ArrayLike,
    field: str,
    width_um: float = 0.0,
    *,
    between: Between = "straight",
    step_um: float | None = None,
    stacks: UvStacks | None = None,
    progress: Progress | None = None,
) -> Kymograph:
    """A field of a movie along a line, over time.

    At every position the mean is taken over the width, weighted by the true area dA(t) that each
    place has on the surface at that timepoint.

    Parameters
    ----------
    movie : Movie
        Frames that are not there are made where its source is known; else they are NaN.
    line : SurfaceLine, or array-like (k, 2)
        Corners (v, u) in pixels, see :func:`surface_line`.
    field : str
        One of ``movie.fields``.
    width_um, between, step_um
        See :func:`surface_line`; of corners only.
    stacks : UvStacks, optional
        The field and ``area_um2``, where they were read before.
    progress : Progress, optional

    Raises
    ------
    ParameterError, AxesError, InputError
        There is no such field; and as :func:`surface_line`.
    """
    check_field(movie, field)
    atlas = movie.common
    if not isinstance(line, SurfaceLine):
        line = surface_line(atlas, line, width_um, between=between, step_um=step_um)
    reference = np.asarray(atlas.uv.fields[AREA])
    images: Iterable[tuple[Any, Any] | None]
    if stacks is not None:
        images = zip(stacks.images[field], stacks.images[AREA], strict=True)
    else:
        frames = made_frames(movie, progress)
        images = (None if f is None else (f.uv[field], f.uv[AREA]) for _, f in frames)
    values = np.full((len(movie), len(line.points)), np.nan)
    for timepoint, pair in enumerate(images):
        if pair is not None:
            values[timepoint] = along_line(line, pair[0], pair[1] / reference)
    return Kymograph(field, values, movie.times_s, line, movie.name)


def along_line(line: SurfaceLine, image: npt.NDArray[Any], weight: npt.NDArray[Any]) -> Floats:
    """Weighted means (n,) of an image over the lanes of a line; NaN where there is no value.

    Parameters
    ----------
    line : SurfaceLine
    image : ndarray, (N, 2N)
    weight : ndarray, (N, 2N)
        Area of the surface per area of the reference, at every pixel.
    """
    if image.shape[:2] != weight.shape:
        raise InputError("Image and weight differ.", image=image.shape, weight=weight.shape)
    known = np.isfinite(image) & np.isfinite(weight)
    layers = np.stack([known, np.where(known, image, 0), np.where(known, weight, 0)], axis=-1)
    found = sample_uv_linear(layers, line.lanes.reshape(-1, 2)).reshape(*line.lanes.shape[:2], 3)
    there, value, area = np.moveaxis(found, -1, 0)
    # Next to a gap the mean of the pixels that are there; within it nothing.
    good = there >= 0.5
    safe = np.where(good, there, 1.0)
    area = np.where(good, area, 0.0)
    total = area.sum(axis=1)
    mean = (value / safe * area).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, mean, np.nan)
