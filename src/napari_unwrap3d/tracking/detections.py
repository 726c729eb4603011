"""The protrusions of every timepoint of a movie, and where each stands on the common surface."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Frame, FrameProtrusions, Ints
from ..charts.tracks import SPACE
from ..geometry.locate import SurfaceLocator, interpolate
from ..motion.frames import CommonSpace
from ..parameters import Parameters
from ..progress import Progress, silent
from ..protrusions.segment import find_protrusions
from ..protrusions.table import measure_protrusions
from ..provenance import content_hash
from ..unwrapping.outermost import OutermostSurface

if TYPE_CHECKING:
    from ..motion.movie import Movie

VERSION = 1
SEEN = ("protrusions", "topographic", "refinement")
FOOT = ("foot_z_um", "foot_y_um", "foot_x_um")


def protrusions_of(
    movie: Movie, timepoint: int, parameters: Parameters, progress: Progress | None = None
) -> FrameProtrusions:
    """The protrusions of one timepoint: read from the movie's folder, or found and kept there.

    See :meth:`~napari_unwrap3d.motion.movie.Movie.protrusions`.
    """
    progress = progress or silent()
    frame = movie.frame(timepoint, progress.part(0.0, 0.2))
    key = protrusions_key(movie, timepoint, parameters)
    kept = movie.folder.protrusions(timepoint, key)
    if kept is not None:
        return kept
    found = _found(movie, frame, parameters, progress.part(0.2, 1.0))
    movie.folder.keep_protrusions(found, key)
    return found


def protrusions_key(movie: Movie, timepoint: int, parameters: Parameters) -> str:
    """What the protrusions of a timepoint are made from."""
    chosen = [getattr(parameters, name).model_dump_json() for name in SEEN]
    return content_hash(VERSION, "protrusions", movie.folder.frame_key(timepoint), chosen)


def _found(
    movie: Movie, frame: Frame, parameters: Parameters, progress: Progress
) -> FrameProtrusions:
    charts = partial(_chart, movie, frame)
    found = find_protrusions(charts, parameters, progress.part(0.0, 0.8))
    progress(0.8, "measuring the protrusions")
    rows = movie.common.uv.shape[0]
    columns = measure_protrusions(found, frame.mask, frame.surface, frame.topography, rows=rows)
    feet = _feet(movie, columns)
    chart = CommonSpace(movie.common).topography_of(frame.surface, frame.topography)
    outermost = OutermostSurface(frame.surface, chart)
    return FrameProtrusions(
        timepoint=frame.timepoint,
        labels=found.labels,
        uv=_label_image(outermost, found.labels, frame.surface.faces),
        columns={**columns, **dict(zip(FOOT, feet.T, strict=True))},
        numbers=dict(found.numbers),
    )


def _chart(movie: Movie, frame: Frame, name: str) -> Any:
    """A chart of a timepoint; its atlas is made only where a method needs more than its shape."""
    if name in ("surface", "mask"):
        return getattr(frame, name)
    return getattr(movie.atlas(frame.timepoint), name)


def _feet(movie: Movie, columns: Mapping[str, npt.NDArray[Any]]) -> Floats:
    """Where protrusions stand on the common reference surface, (k, 3) in µm.

    That is under their mean direction; of what has left the shell, the nearest place.
    """
    places = np.column_stack([columns["v_px"], columns["u_px"]])
    known = np.isfinite(places).all(axis=1)
    feet = np.full((len(places), 3), np.nan)
    feet[known] = movie.common.map(places[known], "uv", "reference")[0]
    if not known.all():
        centres = np.column_stack([columns[name] for name in SPACE])[~known]
        reference = movie.common.reference
        vertices, faces = reference.vertices, reference.faces
        face, weights, _ = SurfaceLocator(vertices, faces).closest(centres)
        feet[~known] = interpolate(vertices, faces, face, weights)
    return feet


def _label_image(
    outermost: OutermostSurface, labels: npt.NDArray[np.int32], faces: Ints
) -> npt.NDArray[np.int32]:
    """The label of the nearest corner of what lies outermost over every pixel, 0 for nothing."""
    nearest = outermost.weights.argmax(axis=-1)
    vertex = np.take_along_axis(faces[outermost.face], nearest[..., None], axis=-1)[..., 0]
    image: npt.NDArray[np.int32] = np.where(outermost.face >= 0, labels[vertex], 0)
    return image.astype(np.int32)
