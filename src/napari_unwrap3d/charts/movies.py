"""What is kept of a movie: one record per timepoint, and how the timepoints were registered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import AxesError
from .meshes import Surface
from .volumes import Floats, Mask


@dataclass(frozen=True, eq=False)
class Frame:
    """One timepoint in the common space of a movie.

    Attributes
    ----------
    timepoint : int
    time_s : float
        Since the first timepoint.
    surface : Surface
        ``S^t(x, y, z)`` in µm, registered. Fields per vertex: ``mean_curvature_per_um``,
        ``gaussian_curvature``, ``height_um`` (d), ``area_um2`` (dA(t)), ``outside`` (1 where a
        vertex leaves the mapped shell, else 0) and ``signal_*``.
    topography : ndarray, (n, 3)
        ``S^t(d, u, v)``: (d µm, v, u) of every vertex; NaN where one leaves the mapped shell.
    uv : mapping of str to ndarray, (N, 2N) float32
        ``S^t(u, v)``: the fields of the surface over every pixel, and ``area_um2`` (dA(t) of
        the pixel); NaN where no surface lies over it.
    mask : Mask
        The cell on the working grid, registered.
    numbers : mapping
        What was measured, JSON-able; ``outside_area_um2`` and ``outside_fraction`` are of the
        part of the surface without an image, ``empty_area_um2`` and ``empty_fraction`` of the
        part of the reference over which there is no surface.
    """

    timepoint: int
    time_s: float
    surface: Surface
    topography: Floats
    uv: Mapping[str, npt.NDArray[Any]]
    mask: Mask
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.topography.shape != self.surface.vertices.shape:
            raise AxesError(
                "A frame has one (d, v, u) per vertex.",
                topography=self.topography.shape,
                vertices=self.surface.vertices.shape,
            )
        shapes = {image.shape for image in self.uv.values()}
        if len(shapes) > 1:
            raise AxesError("The images of a frame are of one shape.", shapes=sorted(shapes))

    @property
    def outside(self) -> npt.NDArray[np.bool_]:
        """Which vertices (n,) leave the mapped shell."""
        return np.asarray(~np.isfinite(self.topography).all(axis=1))
