"""napari's Tracks, which know the time also beside a stack with channels."""

from __future__ import annotations

from typing import Any

import napari.layers
import numpy as np
import numpy.typing as npt


class Tracks(napari.layers.Tracks):
    """Tracks (t, z, y, x) of a movie.

    napari takes the four axes for the last four of the canvas. Beside a stack (t, c, z, y, x) the
    first of them is c: the layer is then told its timepoint, and has no extent along that axis.
    The class is named as napari's, whose name tells of which type a layer is.
    """

    _told: float | None = None

    @property
    def timepoint(self) -> float | None:
        """That the layer was told; None where the canvas shows the time along its first axis."""
        return self._told

    @timepoint.setter
    def timepoint(self, timepoint: float | None) -> None:
        if timepoint != self._told:
            before, self._told = self._told, timepoint
            self.refresh(extent=before is None or timepoint is None)

    @property
    def current_time(self) -> Any:
        """The timepoint that is shown."""
        return super().current_time if self._told is None else self._told

    @property
    def _extent_data(self) -> npt.NDArray[Any]:
        extent = np.array(super()._extent_data)
        if self._told is not None:
            extent[:, 0] = 0
        return extent
