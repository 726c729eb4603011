"""The protrusions of every timepoint of a movie, and where each stands on the common surface.

In a movie a protrusion is followed from when it is lower than one of a single cell has to be:
that it is one is known from the time when it is higher. All timepoints have the same kind and
threshold, so that protrusions are not told apart in one way now and in another one later.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import MOTIFS, Floats, Frame, FrameProtrusions, Ints
from ..charts.tracks import SPACE
from ..geometry.locate import SurfaceLocator, interpolate
from ..motion.frames import CommonSpace
from ..parameters import Parameters
from ..progress import Progress, silent
from ..protrusions.kinds import KINDS
from ..protrusions.segment import find_protrusions
from ..protrusions.table import measure_protrusions
from ..provenance import content_hash
from ..unwrapping.outermost import OutermostSurface

if TYPE_CHECKING:
    from ..motion.movie import Movie

VERSION = 2
SEEN = ("protrusions", "topographic", "refinement")
FOOT = ("foot_z_um", "foot_y_um", "foot_x_um")
CERTAIN = "certain"
# So many timepoints, evenly spread, tell what kind of protrusions a movie has.
SAMPLE = 5
AUTOMATIC = "automatic"
KIND_OF = dict(zip(MOTIFS, KINDS, strict=True))


def protrusions_of(
    movie: Movie, timepoint: int, parameters: Parameters, progress: Progress | None = None
) -> FrameProtrusions:
    """The protrusions of one timepoint: read from the movie's folder, or found and kept there.

    See :meth:`~napari_unwrap3d.motion.movie.Movie.protrusions`.
    """
    progress = progress or silent()
    alike = same_for_all(movie, parameters, progress.part(0.0, 0.4))
    _make_frame(movie, timepoint, progress.part(0.4, 0.5))
    key = protrusions_key(movie, timepoint, alike)
    kept = movie.folder.protrusions(timepoint, key)
    if kept is not None:
        return kept
    found = _found(movie, movie.frame(timepoint), alike, progress.part(0.5, 1.0))
    movie.folder.keep_protrusions(found, key)
    return found


def protrusions_of_all(
    movie: Movie, parameters: Parameters, progress: Progress | None = None
) -> Iterator[FrameProtrusions]:
    """The protrusions of all timepoints that are not lost, in the order of time, one by one."""
    progress = progress or silent()
    alike = same_for_all(movie, parameters, progress.part(0.0, 0.05))
    count = len(movie)
    for timepoint in range(count):
        if movie.is_lost(timepoint):
            continue
        part = progress.part(0.05 + 0.95 * timepoint / count, 0.05 + 0.95 * (timepoint + 1) / count)
        part(0.0, f"protrusions of timepoint {timepoint}")
        yield protrusions_of(movie, timepoint, alike, part)


def has_protrusions(movie: Movie, timepoint: int, parameters: Parameters) -> bool:
    """Whether the protrusions of a timepoint are there; `parameters` as of `same_for_all`."""
    key = protrusions_key(movie, timepoint, parameters)
    return movie.folder.has_protrusions(timepoint, key)


def _make_frame(movie: Movie, timepoint: int, progress: Progress) -> None:
    """What is there is not read."""
    if not (0 <= timepoint < len(movie) and movie.has_frame(timepoint)):
        movie.frame(timepoint, progress)


def protrusions_key(movie: Movie, timepoint: int, parameters: Parameters) -> str:
    """What the protrusions of a timepoint are made from; `parameters` as of `same_for_all`."""
    frame = movie.folder.frame_key(timepoint)
    return content_hash(VERSION, "protrusions", frame, _seen(parameters))


def _seen(parameters: Parameters) -> list[str]:
    # Whether single cells have a chart of them, too, changes nothing here.
    chosen = [getattr(parameters, name).model_dump_json(exclude={"compute"}) for name in SEEN]
    return [*chosen, repr(parameters.tracking.followed_part)]


# The same for all timepoints --------------------------------------------------------


def same_for_all(
    movie: Movie, parameters: Parameters, progress: Progress | None = None
) -> Parameters:
    """Parameters in which what was automatic is what some timepoints of the movie tell.

    The kind is that of most protrusions by their motifs (see the table of protrusions; the
    shapes of low buds, which are flat, would tell another), the threshold the median one.
    """
    chosen = parameters.protrusions
    if not is_automatic(parameters):
        return parameters
    told = _told(movie, parameters, progress or silent())
    changes = {"kind": told["kind"]} if chosen.kind == AUTOMATIC else {}
    if _open_threshold(parameters) and told["threshold_um"] is not None:
        changes["threshold_um"] = told["threshold_um"]
    return parameters.model_copy(update={"protrusions": chosen.model_copy(update=changes)})


def is_automatic(parameters: Parameters) -> bool:
    """Whether some timepoints of a movie have to tell what is the same for all."""
    return parameters.protrusions.kind == AUTOMATIC or _open_threshold(parameters)


def is_told(movie: Movie, parameters: Parameters) -> bool:
    """Whether they have told it, as the movie is now; all of its frames must be there."""
    return movie.folder.alike(_alike_key(movie, _sample(movie), parameters)) is not None


def _open_threshold(parameters: Parameters) -> bool:
    chosen = parameters.protrusions
    return chosen.method == "cortex" and chosen.threshold_um is None


def _sample(movie: Movie) -> list[int]:
    """The timepoints that tell."""
    there = [t for t in range(len(movie)) if not movie.is_lost(t)]
    places = np.linspace(0, len(there) - 1, min(SAMPLE, len(there))).round().astype(int)
    return [there[place] for place in places]


def _alike_key(movie: Movie, sample: list[int], parameters: Parameters) -> str:
    frames = [movie.folder.frame_key(timepoint) for timepoint in sample]
    return content_hash(VERSION, "alike", frames, _seen(parameters))


def _told(movie: Movie, parameters: Parameters, progress: Progress) -> dict[str, Any]:
    """``kind`` and ``threshold_um`` of the movie, kept in its folder."""
    sample = _sample(movie)
    for number, timepoint in enumerate(sample):
        part = progress.part(0.5 * number / len(sample), 0.5 * (number + 1) / len(sample))
        _make_frame(movie, timepoint, part)
    key = _alike_key(movie, sample, parameters)
    kept = movie.folder.alike(key)
    if kept is not None:
        return kept
    motifs, thresholds = np.zeros(len(MOTIFS), np.int64), []
    for number, timepoint in enumerate(sample):
        begin = 0.5 + 0.5 * number / len(sample)
        part = progress.part(begin, begin + 0.5 / len(sample))
        found = _found(movie, movie.frame(timepoint), parameters, part)
        motifs += np.bincount(found.columns["motif"], minlength=len(MOTIFS))
        thresholds.append(found.numbers.get("threshold_um"))
    known = [each for each in thresholds if each is not None]
    told = {
        "kind": KIND_OF[MOTIFS[int(motifs.argmax())]],
        "threshold_um": float(np.median(known)) if known else None,
        "motifs": dict(zip(MOTIFS, motifs.tolist(), strict=True)),
        "timepoints": sample,
    }
    movie.folder.keep_alike(key, told)
    return told


# One timepoint ----------------------------------------------------------------------


def _found(
    movie: Movie, frame: Frame, parameters: Parameters, progress: Progress
) -> FrameProtrusions:
    charts = partial(_chart, movie, frame)
    part = parameters.tracking.followed_part
    found = find_protrusions(charts, parameters, progress.part(0.0, 0.8), part)
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
        columns={
            **columns,
            **dict(zip(FOOT, feet.T, strict=True)),
            CERTAIN: _certain(columns, found.numbers),
        },
        numbers={**found.numbers, "protrusions": len(columns["label"])},
    )


def _chart(movie: Movie, frame: Frame, name: str) -> Any:
    """A chart of a timepoint; its atlas is made only where a method needs more than its shape."""
    if name in ("surface", "mask"):
        return getattr(frame, name)
    return getattr(movie.atlas(frame.timepoint), name)


def _certain(
    columns: Mapping[str, npt.NDArray[Any]], numbers: Mapping[str, Any]
) -> npt.NDArray[np.bool_]:
    """Which protrusions are as high and as wide as the parameters ask for in a single cell."""
    high = columns["height_max_um"] >= numbers.get("least_height_um", -np.inf)
    wide = columns["area_um2"] >= numbers.get("least_area_um2", -np.inf)
    return np.asarray(high & wide)


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
