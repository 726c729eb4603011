"""One timepoint in the common space: its surface, where it lies in (d, u, v), and its fields.

Paper, Methods, "u-Unwrap3D analysis" of blebs and of ruffles: every ``S^t(x, y, z)`` is mapped
to the one (d, u, v) space, and projected to the plane by d = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ..atlas import Atlas
from ..charts import Floats, Frame, Mask, Stack, Surface, Topography
from ..geometry.curvilinear import in_columns
from ..imaging.register import Registered
from ..parameters import Parameters
from ..progress import Progress
from ..unwrapping.elements import elements
from ..unwrapping.outermost import OutermostSurface
from ..unwrapping.surface import surface
from ..unwrapping.topographic_surface import cut_at_seam
from ..unwrapping.topography import TopographyLocator, to_grid
from ..unwrapping.uv import pixel_distortion
from .projection import OUTERMOST, PLANE, Images, plane_images
from .signals import Signals

AREA = "area_um2"
HEIGHT = "height_um"
OUTSIDE = "outside"


@dataclass(frozen=True, eq=False)
class CommonSpace:
    """The (d, u, v) space of an atlas, and its inverse map, kept for many timepoints."""

    atlas: Atlas

    @cached_property
    def _locator(self) -> TopographyLocator:
        chart = self.atlas.topography
        return TopographyLocator(chart.nodes, chart.d_um, self.atlas.voxel_um)

    def locate(self, points: Floats, progress: Progress) -> Floats:
        """(d µm, v, u) of points (n, 3) in µm, NaN where one leaves the mapped shell."""
        chart = self.atlas.topography
        image, _ = self._locator.locate(points, progress)
        grid = to_grid(image, chart.d_um, chart.shape[1])
        image[~in_columns(grid, chart.first_layer, chart.last_layer)] = np.nan
        return image

    def topography_of(self, cell: Surface, image: Floats) -> Topography:
        """The common topography with another surface in it.

        Parameters
        ----------
        cell : Surface
        image : ndarray, (n, 3)
            (d µm, v, u) of its vertices.
        """
        chart = self.atlas.topography
        vertices, faces, origin = cut_at_seam(image, cell.faces, chart.shape[1])
        return replace(
            chart,
            surface=image,
            cut_vertices=vertices,
            cut_faces=faces,
            cut_origin=origin,
            fields={},
        )


def frame_of(
    space: CommonSpace,
    mask: Mask,
    given: Surface | None,
    stack: Stack | None,
    registered: Registered,
    timepoint: int,
    time_s: float,
    parameters: Parameters,
    progress: Progress,
) -> Frame:
    """Bring one timepoint into a common space.

    Parameters
    ----------
    space : CommonSpace
    mask : Mask
        The cell in the common world.
    given : Surface or None
        A mesh of it there, instead of the mask's.
    stack : Stack or None
        The intensities of this timepoint, in its own world.
    registered : Registered
        From the worlds of the timepoint's channels to the common one.
    timepoint : int
    time_s : float
    parameters : Parameters
    progress : Progress
    """
    cell = surface(mask, parameters.surface, given, progress.part(0.0, 0.4))
    image = space.locate(cell.vertices, progress.part(0.4, 0.6))
    part = progress.part(0.6, 1.0)
    return frame_at(
        space, cell, image, mask, stack, registered, timepoint, time_s, parameters, part
    )


def frame_at(
    space: CommonSpace,
    cell: Surface,
    image: Floats,
    mask: Mask,
    stack: Stack | None,
    registered: Registered,
    timepoint: int,
    time_s: float,
    parameters: Parameters,
    progress: Progress,
) -> Frame:
    """The record of a surface whose place in a space is known; see :func:`frame_of`.

    Parameters
    ----------
    cell : Surface
    image : ndarray, (n, 3)
        (d µm, v, u) of its vertices.
    """
    chart = space.topography_of(cell, image)
    outside = np.asarray(~np.isfinite(image).all(axis=1), np.float32)
    fields: dict[str, npt.NDArray[Any]] = {
        HEIGHT: image[:, 0],
        AREA: elements(cell),
        OUTSIDE: outside,
    }
    if stack is not None:
        signals = Signals.chosen(stack, parameters.movie)
        fields |= signals.at(cell.vertices, mask, registered, progress.part(0.0, 0.4))
    cell = cell.with_fields(**fields)
    progress(0.4, "images")
    outermost = OutermostSurface(cell, chart)
    shown: Images | None = None
    numbers: Mapping[str, Any] = {"projection": OUTERMOST}
    if parameters.movie.projection == PLANE:
        part = progress.part(0.4, 0.9)
        visible = replace(cell, fields=_shown(cell))
        shown, numbers = plane_images(visible, chart, space.atlas.uv, mask, parameters, part)
    return Frame(
        timepoint=timepoint,
        time_s=time_s,
        surface=cell,
        topography=image,
        uv=images(outermost, cell) if shown is None else shown,
        mask=mask,
        numbers={**measured(cell, outermost, space), **numbers},
    )


def _shown(cell: Surface) -> dict[str, npt.NDArray[Any]]:
    """The fields that have an image: the others are of vertices alone."""
    return {name: v for name, v in cell.fields.items() if name not in (AREA, OUTSIDE)}


def images(outermost: OutermostSurface, cell: Surface) -> dict[str, npt.NDArray[np.float32]]:
    """Every field of a surface over the pixels, and the area element of S^t(u, v)."""
    found = {
        name: outermost.image(values).astype(np.float32) for name, values in _shown(cell).items()
    }
    positions = np.stack([outermost.image(axis) for axis in cell.vertices.T], axis=-1)
    found[AREA] = pixel_distortion(positions)[AREA].astype(np.float32)
    return found


def measured(cell: Surface, outermost: OutermostSurface, space: CommonSpace) -> Mapping[str, Any]:
    """What of a timepoint's surface the common space holds, and what (u, v) shows of it."""
    area = np.asarray(cell.fields[AREA])
    outside = np.asarray(cell.fields[OUTSIDE]) > 0
    total = float(area.sum())
    pixels = np.asarray(space.atlas.uv.fields[AREA])
    empty = float(pixels[outermost.face < 0].sum())
    return {
        "area_um2": total,
        "volume_um3": cell.report.get("volume_um3"),
        "outside_area_um2": float(area[outside].sum()),
        "outside_fraction": float(area[outside].sum() / total),
        "empty_area_um2": empty,
        "empty_fraction": empty / float(pixels.sum()),
    }
