"""One timepoint of a movie as the atlas of a cell: everything that works on a cell works on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

from ..atlas import Atlas
from ..charts import UV, Frame, SealedSurface, Surface
from ..progress import Progress
from ..provenance import environment, repairs
from ..unwrapping import measure
from ..unwrapping.outermost import OutermostSurface, with_outermost
from ..unwrapping.surface import sealed_surface
from ..unwrapping.topography import with_surface
from .frames import images

PREFIX = "surface_"


def atlas_in(common: Atlas, frame: Frame, source: Mapping[str, Any], progress: Progress) -> Atlas:
    """The atlas of a timepoint in the common space of its movie.

    Reference, sphere and (d, u, v) space are the common ones and shared, not copied; the
    surface, what is sealed of it, where it lies in the space, and the mask are the frame's.

    Parameters
    ----------
    common : Atlas
        Of the common space, whose parameters the atlas gets.
    frame : Frame
    source : mapping
        What it is of, for the provenance.
    progress : Progress
    """
    cell, chosen = frame.surface, common.parameters
    part = progress.part(0.0, 0.3)
    sealed = sealed_surface(frame.mask, cell, chosen.surface, chosen.sealed, part)
    chart = with_surface(
        common.topography,
        cell,
        frame.topography,
        frame.mask,
        chosen.topography,
        chosen.surface,
        progress.part(0.3, 0.7),
    )
    progress(0.7, "measuring the maps")
    outermost = OutermostSurface(cell, chart)
    chart = with_outermost(chart, outermost, cell)
    numbers = measure.measure_topography(cell, chart, frame.mask.voxel_size[0])
    own = _own_quality(cell, sealed)
    return Atlas(
        surface=cell,
        sealed=sealed,
        reference=common.reference,
        sphere=common.sphere,
        uv=with_images(common.uv, images(outermost, cell)),
        topography=chart,
        mask=frame.mask,
        parameters=chosen,
        quality={**common.quality, **own, "topography": numbers},
        provenance=_provenance(source, own),
    )


def own_atlas(own: Atlas, frame: Frame, source: Mapping[str, Any]) -> Atlas:
    """The own atlas of a timepoint with what its frame knows of the surface.

    Parameters
    ----------
    own : Atlas
        Aligned with the common one.
    frame : Frame
    source : mapping
        What it is of, for the provenance.
    """
    chart = with_images(own.uv, images(own.outermost, frame.surface))
    provenance = {**own.provenance, "source": {**own.provenance["source"], **source}}
    return own.replaced(surface=frame.surface, uv=chart, provenance=provenance)


def with_images(chart: UV, shown: Mapping[str, npt.NDArray[Any]]) -> UV:
    """The chart of the reference with the images of what lies outermost, instead of others."""
    kept = {name: image for name, image in chart.fields.items() if not name.startswith(PREFIX)}
    kept |= {PREFIX + name: image for name, image in shown.items()}
    return UV(chart.rotation, chart.face, chart.weights, chart.positions, kept)


def _own_quality(cell: Surface, sealed: SealedSurface) -> dict[str, dict[str, Any]]:
    return {
        "surface": dict(cell.report),
        "sealed": measure.measure_sealed(cell, sealed),
    }


def _provenance(source: Mapping[str, Any], quality: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "versions": environment(),
        "source": dict(source),
        "steps": {},
        "warnings": [],
        "repairs": repairs(quality),
    }
