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


class FlowsOfMovie:
    """The flow between the timepoints of a movie, asked for one after the other.

    Memory is that of two images, whatever the number of timepoints.

    Parameters
    ----------
    movie : Movie
    field : str
        A name in ``frame.uv``.
    method : {"farneback", "dis"}
    window_um : float or None
        See :class:`SphereFlow`.
    clipped_percent : float
        See :func:`grey_limits`; percentiles are those of a sample of the timepoints.
    timepoints : sequence of int
        Those that will be asked for.
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
        The movie has no such field, or no value of it.
    """

    def __init__(
        self,
        movie: Movie,
        field: str,
        method: Method,
        window_um: float | None,
        clipped_percent: float,
        timepoints: Sequence[int],
        progress: Progress,
    ) -> None:
        if field not in movie.fields:
            raise InputError(
                f"There is no field {field!r}.", hint=f"Fields: {', '.join(movie.fields)}."
            )
        self._movie, self._field = movie, field
        self.rows = movie.common.uv.shape[0]
        size = None if window_um is None else window_um / pixel_um(movie.common.uv)
        self._flow = SphereFlow(self.rows, method, size)
        self._limits = _limits(movie, field, timepoints, clipped_percent, progress)
        self._before: Bytes | None = None
        self.uv: Mapping[str, npt.NDArray[Any]] = {}

    def to(self, timepoint: int) -> Floats:
        """Displacements of directions (N, 2N, 3) since the timepoint that was asked for before.

        See :meth:`SphereFlow.between`; 0 for the first one.
        """
        self.uv = self._movie.frame(timepoint).uv
        after = grey(self.uv[self._field], self._limits)
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
    movie: Movie,
    field: str,
    timepoints: Sequence[int],
    clipped_percent: float,
    progress: Progress,
) -> tuple[float, float]:
    """The values of a field that are black and white at all timepoints."""
    chosen = list(timepoints)
    if clipped_percent > 0 and len(chosen) > SAMPLED_FRAMES:
        places = np.linspace(0, len(chosen) - 1, SAMPLED_FRAMES)
        chosen = [chosen[int(place)] for place in np.rint(places)]

    def images() -> Iterable[npt.NDArray[Any]]:
        for number, timepoint in enumerate(chosen):
            progress(number / len(chosen), f"{field}, timepoint {timepoint}")
            yield movie.frame(timepoint).uv[field]

    return grey_limits(images(), clipped_percent)
