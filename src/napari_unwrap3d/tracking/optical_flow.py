"""Optical flow on the sphere: how the pattern of one uv image moves to the next.

The paper computes the flow of 8-bit uv images, padded as the sphere continues (Methods, "Bleb
segmentation and tracking" and "Optical flow ROI tracking"; Farnebäck 2003,
doi:10.1007/3-540-45103-X_50). Padding makes the flow go on over the seam and the poles, but
around a pole the image is stretched without limit. So the flow is computed a second time on the
image of the sphere turned by a right angle, whose equator holds the poles of the first, and the
two are blended as displacements of directions, each where it is stretched less.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats
from ..errors import AxesError, InputError
from ..geometry.padding import pad_sphere, wrap_uv
from ..unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction

Method = Literal["farneback", "dis"]
Bytes = npt.NDArray[np.uint8]
Engine = Callable[[Bytes, Bytes], npt.NDArray[np.float32]]

GREY_LEVELS = 255
# Parts of the image's height: 50 of 256 rows, as in the paper; and the default window.
PADDING, WINDOW = 50 / 256, 1 / 16
PYRAMID_SCALE, LEVELS, ITERATIONS, POLY_N, POLY_SIGMA = 0.5, 3, 5, 7, 1.5
# Where a chart is stretched by 1 / sine, the other one takes over with this power of it.
BLEND_POWER = 4
# Rows z, y, x: the north pole (1, 0, 0) goes to the middle of the turned image's equator.
TURN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
LARGEST_SAMPLE = 200_000


class SphereFlow:
    """Finds the flow between uv images of one size.

    Parameters
    ----------
    rows : int
        N.
    method : {"farneback", "dis"}
    window_px : float, optional
        Over what length motion is taken to be the same; a sixteenth of the rows unless given.
        Dense inverse search has windows of its own.
    """

    def __init__(
        self, rows: int, method: Method = "farneback", window_px: float | None = None
    ) -> None:
        self.rows = rows
        self._padding = int(np.ceil(PADDING * rows))
        window = WINDOW * rows if window_px is None else window_px
        self._engine = _farneback(window) if method == "farneback" else _dis()

    def between(self, before: Bytes, after: Bytes) -> Floats:
        """Displacements (N, 2N, 3) of the pixels' directions on the unit sphere (turned frame).

        Parameters
        ----------
        before, after : ndarray, (N, 2N) uint8

        Raises
        ------
        AxesError
            An image is of another shape.
        """
        for image in (before, after):
            if image.shape != (self.rows, 2 * self.rows):
                raise AxesError(
                    "The images of a flow are N × 2N.", shape=image.shape, rows=self.rows
                )
        plain = self._in_chart(before, after)
        turned = self._in_chart(self._turned(before), self._turned(after)) @ TURN
        turned = _sampled(turned.astype(np.float32), self._turning[1])
        share = self._share[..., None]
        blended: Floats = share * plain + (1 - share) * turned
        return blended

    def _in_chart(self, before: Bytes, after: Bytes) -> Floats:
        """Displacements of directions as one image shows them."""
        width = self._padding
        padded = self._engine(pad_sphere(before, width), pad_sphere(after, width))
        flow = padded[width:-width, width:-width, ::-1].astype(np.float64)  # (v, u)
        return self._arrived(flow) - self._directions

    def _arrived(self, flow: Floats) -> Floats:
        ends = (pixel_grid(self.rows) + flow).reshape(-1, 2)
        return uv_to_direction(ends, self.rows).reshape(*flow.shape[:2], 3)

    def _turned(self, image: Bytes) -> Bytes:
        return np.asarray(_sampled(image, self._turning[0]))

    @cached_property
    def _directions(self) -> Floats:
        return directions_of_pixels(self.rows)

    @cached_property
    def _turning(self) -> tuple[Floats, Floats]:
        """Where the pixels of the turned image are in the plain one, and the other way round."""
        flat = self._directions.reshape(-1, 3)
        shape = (*self._directions.shape[:2], 2)
        there, back = (
            direction_to_uv(flat @ turn, self.rows).reshape(shape) for turn in (TURN, TURN.T)
        )
        return there, back

    @cached_property
    def _share(self) -> Floats:
        """How much (N, 2N) the plain image counts."""
        height = self._directions[..., 0]
        own = (1 - height**2) ** (BLEND_POWER / 2)
        other = (1 - (self._directions @ TURN.T)[..., 0] ** 2) ** (BLEND_POWER / 2)
        share: Floats = own / (own + other)
        return share


def directions_of_pixels(rows: int) -> Floats:
    """Unit vectors (N, 2N, 3) (z, y, x), in the turned frame, of all pixels."""
    grid = pixel_grid(rows)
    return uv_to_direction(grid.reshape(-1, 2), rows).reshape(*grid.shape[:2], 3)


def tangents_at(points: Floats, rows: int, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Unit vectors (*shape, 3) along v (southwards) and along u at (v, u) (n, 2)."""
    inclination = (points[:, 0] + 0.5) * np.pi / rows
    azimuth = (points[:, 1] + 0.5) * np.pi / rows - np.pi
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    south = np.stack(
        [-np.sin(inclination), np.cos(inclination) * sine, np.cos(inclination) * cosine], axis=-1
    )
    east = np.stack([np.zeros_like(azimuth), cosine, -sine], axis=-1)
    return south.reshape(*shape, 3), east.reshape(*shape, 3)


def in_pixels(displacement: Floats, rows: int) -> Floats:
    """Displacements of directions (N, 2N, 3) as (v, u) in pixels (N, 2N, 2).

    Over a pole they go on into rows below 0 and from N on. Near the poles steps along u grow
    without limit, as pixels do.
    """
    south, east = tangents_at(pixel_grid(rows).reshape(-1, 2), rows, (rows, 2 * rows))
    inclination = (np.arange(rows) + 0.5) * np.pi / rows
    v = np.einsum("ijk,ijk->ij", displacement, south)
    u = np.einsum("ijk,ijk->ij", displacement, east) / np.sin(inclination)[:, None]
    return np.stack([v, u], axis=-1) * rows / np.pi


# Images --------------------------------------------------------------------------


def grey_limits(images: Iterable[npt.ArrayLike], clipped_percent: float) -> tuple[float, float]:
    """The values that are shown as black and as white at all timepoints.

    Parameters
    ----------
    images : iterable of array-like (N, 2N)
        NaN does not count.
    clipped_percent : float
        How many percent of the values lie beyond either; 0: none, as in the paper.

    Raises
    ------
    InputError
        No image has a finite value.
    """
    low, high = np.inf, -np.inf
    sample: list[npt.NDArray[Any]] = []
    for image in images:
        values = np.asarray(image)
        values = values[np.isfinite(values)]
        if len(values) == 0:
            continue
        low, high = min(low, float(values.min())), max(high, float(values.max()))
        if clipped_percent > 0:
            sample.append(values[:: len(values) // LARGEST_SAMPLE + 1])
    if low > high:
        raise InputError("The images that a flow is computed from hold no finite value.")
    if sample:
        every = np.concatenate(sample)
        low, high = np.percentile(every, [clipped_percent, 100 - clipped_percent]).tolist()
    return low, high


def grey(image: npt.NDArray[Any], limits: tuple[float, float]) -> Bytes:
    """A uv image in 8 bits; where it is not known, as at the nearest pixel that is."""
    low, high = limits
    values = np.asarray(image, np.float64)
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(values.shape, np.uint8)
    if not known.all():
        values = _filled(values, known)
    scaled = (values - low) / max(high - low, np.finfo(float).tiny)
    return np.rint(GREY_LEVELS * np.clip(scaled, 0, 1)).astype(np.uint8)


def _filled(values: Floats, known: npt.NDArray[np.bool_]) -> Floats:
    width = len(values) // 4
    hidden = pad_sphere(~known, width)
    nearest = ndimage.distance_transform_edt(hidden, return_distances=False, return_indices=True)
    v, u = nearest[:, width:-width, width:-width]
    filled: Floats = pad_sphere(values, width)[v, u]
    return np.where(np.isfinite(filled), filled, np.nanmedian(values))


def _sampled(image: npt.NDArray[Any], places: Floats) -> npt.NDArray[Any]:
    """Bilinear values of a uv image at (v, u) (h, w, 2), over seam and poles."""
    import cv2

    rows = len(image)
    at = wrap_uv(places.reshape(-1, 2), rows).reshape(places.shape).astype(np.float32) + 1
    padded = np.ascontiguousarray(pad_sphere(image, 1))
    found: npt.NDArray[Any] = cv2.remap(padded, at[..., 1], at[..., 0], cv2.INTER_LINEAR)
    return found


# Methods -------------------------------------------------------------------------


def _farneback(window_px: float) -> Engine:
    import cv2

    size = max(round(window_px), 3)

    def flow(before: Bytes, after: Bytes) -> npt.NDArray[np.float32]:
        found: Any = cv2.calcOpticalFlowFarneback(
            before,
            after,
            None,  # type: ignore[call-overload]
            PYRAMID_SCALE,
            LEVELS,
            size,
            ITERATIONS,
            POLY_N,
            POLY_SIGMA,
            cv2.OPTFLOW_FARNEBACK_GAUSSIAN,
        )
        return np.asarray(found, np.float32)

    return flow


def _dis() -> Engine:
    import cv2

    engine: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def flow(before: Bytes, after: Bytes) -> npt.NDArray[np.float32]:
        return np.asarray(engine.calc(before, after, None), np.float32)

    return flow
