"""The optical flow of a field of a movie, from timepoint to timepoint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import UV, Floats
from ..errors import InputError
from ..progress import Progress
from .optical_flow import Bytes, Method, SphereFlow, grey, grey_limits

if TYPE_CHECKING:
    from ..motion.movie import Movie

SAMPLED_FRAMES = 12
RATIO = "/"


class FieldImages:
    """The uv images of a field, or of the ratio of two, averaged over time if asked for.

    Memory is that of the images of one average, whatever the number of timepoints.

    Parameters
    ----------
    movie : Movie
    field : str
        A name in ``frame.uv``, or two with a slash in between.
    timepoints : sequence of int
        Those that there are.
    smoothing_s : float
        Full width at half maximum of the average over time (a Hann window); 0: none.

    Raises
    ------
    InputError
        The movie has no such field.
    """

    def __init__(
        self, movie: Movie, field: str, timepoints: Sequence[int], smoothing_s: float = 0.0
    ) -> None:
        self.movie, self.field = movie, field
        self._parts = [part.strip() for part in field.split(RATIO)]
        unknown = [part for part in self._parts if part not in movie.fields]
        if unknown or len(self._parts) > 2:
            raise InputError(
                f"There is no field {unknown[0] if unknown else field!r}.",
                hint=f"Fields: {', '.join(movie.fields)}; or a ratio of two, such as a/b.",
            )
        self._there = np.array(sorted(timepoints), np.int64)
        self._width = smoothing_s / movie.time_step_s
        self._kept: dict[int, npt.NDArray[Any]] = {}

    def at(self, timepoint: int) -> npt.NDArray[Any]:
        """The image (N, 2N) of a timepoint; NaN where it is not known."""
        apart = self._there - timepoint
        near = self._there[np.abs(apart) < max(self._width, 0.5)]
        if self._width < 1 or len(near) < 2:
            return self._single(timepoint)
        kept, self._kept = self._kept, {}
        total, weights = np.zeros(()), np.zeros(())
        for other in near.tolist():
            image = self._kept[other] = kept[other] if other in kept else self._single(other)
            weight = np.cos(np.pi / 2 * (other - timepoint) / self._width) ** 2
            known = np.isfinite(image)
            total = total + weight * np.where(known, image, 0.0)
            weights = weights + weight * known
        return np.asarray(
            np.divide(total, weights, where=weights > 0, out=np.full_like(total, np.nan))
        )

    def _single(self, timepoint: int) -> npt.NDArray[Any]:
        images = [np.asarray(self.movie.frame(timepoint).uv[part]) for part in self._parts]
        if len(images) == 1:
            return images[0]
        below = np.where(images[1] == 0, np.nan, images[1])
        return np.asarray(images[0] / below)


class FlowsOfMovie:
    """The flow between the timepoints of a movie, asked for one after the other.

    Memory is that of two images, whatever the number of timepoints.

    Parameters
    ----------
    images : FieldImages
    timepoints : sequence of int
        Those that will be asked for.
    method : {"farneback", "dis"}
    window_um : float or None
        See :class:`SphereFlow`.
    clipped_percent : float
        See :func:`grey_limits`; percentiles are those of a sample of the timepoints.
    progress : Progress

    Attributes
    ----------
    rows : int
        N.
    uv : mapping of str to ndarray, (N, 2N)
        The images of the timepoint that was asked for last.

    Raises
    ------
    InputError
        No image has a value.
    """

    def __init__(
        self,
        images: FieldImages,
        timepoints: Sequence[int],
        method: Method,
        window_um: float | None,
        clipped_percent: float,
        progress: Progress,
    ) -> None:
        movie = images.movie
        self._images = images
        self.rows = movie.common.uv.shape[0]
        size = None if window_um is None else window_um / pixel_um(movie.common.uv)
        self._flow = SphereFlow(self.rows, method, size)
        self._limits = _limits(images, timepoints, clipped_percent, progress)
        self._before: Bytes | None = None
        self.uv: Mapping[str, npt.NDArray[Any]] = {}

    def to(self, timepoint: int) -> Floats:
        """Displacements of directions (N, 2N, 3) since the timepoint that was asked for before.

        See :meth:`SphereFlow.between`; 0 for the first one.
        """
        self.uv = self._images.movie.frame(timepoint).uv
        after = grey(self._images.at(timepoint), self._limits)
        before, self._before = self._before, after
        if before is None:
            return np.zeros((*after.shape, 3))
        return self._flow.between(before, after)


def pixel_um(uv: UV) -> float:
    """Edge in µm of a pixel of mean area, off the poles."""
    area = np.asarray(uv.fields["area_um2"])
    # The sphere's area is 2 / π of that of an image whose pixels are all like the equator's.
    return float(np.sqrt(area.sum() / area.size * np.pi / 2))


def _limits(
    images: FieldImages, timepoints: Sequence[int], clipped_percent: float, progress: Progress
) -> tuple[float, float]:
    """The values of a field that are black and white at all timepoints."""
    chosen = list(timepoints)
    if clipped_percent > 0 and len(chosen) > SAMPLED_FRAMES:
        places = np.linspace(0, len(chosen) - 1, SAMPLED_FRAMES)
        chosen = [chosen[int(place)] for place in np.rint(places)]

    def found() -> Iterable[npt.NDArray[Any]]:
        for number, timepoint in enumerate(chosen):
            progress(number / len(chosen), f"{images.field}, timepoint {timepoint}")
            yield images.at(timepoint)

    return grey_limits(found(), clipped_percent)
