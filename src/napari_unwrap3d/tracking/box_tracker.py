"""Tracking of boxes on the uv image, as the paper does it.

Paper, Methods, "Bleb segmentation and tracking": the boxes of the protrusions are moved by the
optical flow of the mean curvature and linked by the overlap with those of the next timepoint;
what is lost is moved on for some time; tracks are kept if they last, are bent outwards and have
a protrusion of their own for half of their life; boxes that jump in size are interpolated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.optimize import linear_sum_assignment

from ..charts import FrameProtrusions, Ints, Tracks
from ..charts.tracks import BOX, NEEDED, PLACE, SPACE
from ..charts.volumes import Floats
from ..fields import CURVATURE
from ..geometry.padding import wrap_uv
from ..motion.frames import AREA
from ..parameters import BoxParameters, Parameters
from ..progress import Progress, silent
from ..unwrapping.elements import region_mean
from .boxes import Box, bounding_boxes, overlaps
from .columns import protrusion_columns
from .flows import FieldImages, FlowsOfMovie
from .optical_flow import in_pixels
from .places import height_at, on_surface

if TYPE_CHECKING:
    from ..motion.movie import Movie

OF_BOX = ("box_area_um2", "box_mean_curvature_per_um")


@dataclass(eq=False)
class Path:
    """A box followed over time: one at every timepoint from the first to the last.

    Attributes
    ----------
    first : int
        Timepoint.
    boxes : list of Box
        Written so that each lies near the one before.
    labels : list of int
        The protrusion that each is the box of, or 0.
    curvature : list of float
        Mean over each box in 1/µm, weighed by the area of the surface.
    """

    first: int
    boxes: list[Box]
    labels: list[int]
    curvature: list[float]

    @property
    def last(self) -> int:
        return self.first + len(self.boxes) - 1

    @property
    def missed(self) -> int:
        """For how many timepoints it has been lost."""
        return next((k for k, label in enumerate(reversed(self.labels)) if label), len(self.labels))

    @property
    def matched(self) -> float:
        """For which part of its life it has a protrusion."""
        return sum(label > 0 for label in self.labels) / len(self.labels)

    def ended(self) -> Path:
        """Up to its last protrusion."""
        end = len(self.boxes) - self.missed
        return Path(self.first, self.boxes[:end], self.labels[:end], self.curvature[:end])


def track_boxes(
    movie: Movie,
    detections: Iterable[FrameProtrusions],
    parameters: Parameters,
    progress: Progress | None = None,
) -> Tracks:
    """Follow the boxes of protrusions on the uv image.

    Parameters
    ----------
    movie : Movie
    detections : iterable of FrameProtrusions
        Of the timepoints that there are, in any order.
    parameters : Parameters
        Its groups ``tracking`` (times, curvature) and ``boxes``.
    progress : Progress, optional

    Returns
    -------
    Tracks
        Method "boxes". At every timepoint from the first protrusion of a track to its last:
        the box, its middle (``v_px``, ``u_px``) and what of the surface lies over it, ``label``
        (0 where the box was moved on by the flow), the columns of the table of protrusions,
        ``box_area_um2`` on the common reference surface and ``box_mean_curvature_per_um``.
    """
    progress = progress or silent()
    found = sorted(detections, key=lambda one: one.timepoint)
    paths = _linked(movie, found, parameters, progress.part(0.0, 0.8))
    numbers: dict[str, Any] = {"linked": len(paths)}
    paths = [path for path in paths if _lasts(path, movie, parameters)]
    numbers["long_and_convex"] = len(paths)
    paths = _assigned(paths, found, movie.common.uv.shape[0], parameters.boxes)
    paths = [path for path in paths if path.matched >= parameters.boxes.least_matched]
    numbers["with_protrusions"] = len(paths)
    areas = BoxAreas(np.asarray(movie.common.uv.fields[AREA]))
    repaired = [_repaired(path, areas, parameters.boxes) for path in paths]
    numbers["repaired_boxes"] = sum(count for _, count in repaired)
    paths = [path for path, _ in repaired]
    return _tracks(movie, paths, found, areas, numbers, progress.part(0.8, 1.0))


# Linking -------------------------------------------------------------------------


def _linked(
    movie: Movie, found: Sequence[FrameProtrusions], parameters: Parameters, progress: Progress
) -> list[Path]:
    """Boxes linked from timepoint to timepoint; what is lost is moved on by the flow."""
    if not found:
        return []
    chosen = parameters.boxes
    times = [one.timepoint for one in found]
    flows = FlowsOfMovie(
        FieldImages(movie, chosen.field, times),
        times,
        chosen.flow,
        chosen.window_um,
        chosen.clipped_percent,
        progress.part(0.0, 0.1),
    )
    gap = int(parameters.tracking.gap_s / movie.time_step_s + 1e-9)
    done: list[Path] = []
    active: list[Path] = []
    before = None
    for number, one in enumerate(found):
        progress(0.1 + 0.9 * number / len(found), f"timepoint {one.timepoint}")
        boxes = bounding_boxes(one.uv)
        moves = in_pixels(flows.to(one.timepoint), flows.rows)
        skipped = 0 if before is None else one.timepoint - before - 1
        for path in active:
            # Over timepoints that were lost a box stays, and then makes the whole step.
            _stay(path, skipped)
        _follow(active, boxes, moves, flows.rows, parameters.boxes.least_iou)
        for path in active:
            path.curvature.append(_curvature_in(path.boxes[-1], flows.uv))
        linked = {path.labels[-1] for path in active}
        done += [path for path in active if path.missed > gap]
        active = [path for path in active if path.missed <= gap]
        active += [
            Path(one.timepoint, [box], [label], [_curvature_in(box, flows.uv)])
            for label, box in boxes.items()
            if label not in linked
        ]
        before = one.timepoint
    paths = [path.ended() for path in [*done, *active]]
    return sorted(paths, key=lambda path: (path.first, path.boxes[0].centre))


def _stay(path: Path, timepoints: int) -> None:
    path.boxes += path.boxes[-1:] * timepoints
    path.labels += [0] * timepoints
    path.curvature += [np.nan] * timepoints


def _follow(
    active: list[Path], boxes: dict[int, Box], flow: Floats, rows: int, least_iou: float
) -> None:
    """Give every path its next box, in place: that of a protrusion, or where the flow leads."""
    predicted = [moved_by(path.boxes[-1], flow) for path in active]
    pairs = matched(predicted, list(boxes.values()), rows, least_iou)
    labels = list(boxes)
    for row, (path, box) in enumerate(zip(active, predicted, strict=True)):
        if row in pairs:
            label = labels[pairs[row]]
            path.boxes.append(boxes[label].near(box, rows))
            path.labels.append(label)
        else:
            path.boxes.append(box)
            path.labels.append(0)


def matched(
    boxes: Sequence[Box], others: Sequence[Box], rows: int, least_iou: float
) -> dict[int, int]:
    """Which box is which other one: one to one, with the largest overlap in all."""
    if not boxes or not others:
        return {}
    shared = overlaps(boxes, others, rows)
    shared = np.where(shared > least_iou, shared, 0.0)
    first, second = linear_sum_assignment(-shared)
    good = shared[first, second] > 0
    return dict(zip(first[good].tolist(), second[good].tolist(), strict=True))


def moved_by(box: Box, flow: Floats) -> Box:
    """A box whose sides follow the median flow (N, 2N, 2) (v, u) of the half next to each.

    So it grows and shrinks as what is in it does.
    """
    rows = flow.shape[0]
    v, u = box.pixels(rows)
    within = flow[v, u]
    over = np.floor(np.arange(np.rint(box.top), np.rint(box.bottom)) / rows).astype(np.int64) % 2
    along_v = np.where(over[:, None] == 1, -1.0, 1.0) * within[..., 0]
    along_u = within[..., 1]
    upper, lower = _halves(along_v, 0)
    left, right = _halves(along_u, 1)
    moved = [box.top + upper, box.left + left, box.bottom + lower, box.right + right]
    # A box never shrinks to nothing: then it is moved as a whole.
    if moved[2] - moved[0] < 1 or moved[3] - moved[1] < 1:
        return box.moved(float(np.median(along_v)), float(np.median(along_u)))
    return Box(*moved)


def _halves(values: Floats, axis: int) -> tuple[float, float]:
    """Median of the first and of the last half along an axis; the middle belongs to both."""
    size = values.shape[axis]
    first = np.take(values, np.arange((size + 1) // 2), axis=axis)
    last = np.take(values, np.arange(size // 2, size), axis=axis)
    return float(np.median(first)), float(np.median(last))


def _curvature_in(box: Box, uv: Mapping[str, npt.NDArray[Any]]) -> float:
    """Mean curvature over a box, weighed by the area of the surface."""
    part = [box.cut(uv[name]).astype(np.float64) for name in (CURVATURE, AREA)]
    return region_mean(part[0], None, np.nan_to_num(part[1]))


# Which tracks are kept -------------------------------------------------------------


def _lasts(path: Path, movie: Movie, parameters: Parameters) -> bool:
    """Whether a path is long enough, and what it follows is bent outwards."""
    lifetime = len(path.boxes) * movie.time_step_s
    least = parameters.tracking.least_curvature_per_um
    if lifetime < parameters.tracking.least_lifetime_s:
        return False
    known = [value for value in path.curvature if np.isfinite(value)]
    return least is None or (bool(known) and float(np.mean(known)) >= least)


def _assigned(
    paths: Sequence[Path], found: Sequence[FrameProtrusions], rows: int, parameters: BoxParameters
) -> list[Path]:
    """The paths with every protrusion given to the one that it overlaps most, one to one."""
    labels = [[0] * len(path.boxes) for path in paths]
    for one in found:
        time = one.timepoint
        there = [k for k, path in enumerate(paths) if path.first <= time <= path.last]
        boxes = bounding_boxes(one.uv)
        names = list(boxes)
        here = [paths[k].boxes[time - paths[k].first] for k in there]
        for row, column in matched(here, list(boxes.values()), rows, parameters.least_iou).items():
            labels[there[row]][time - paths[there[row]].first] = names[column]
    return [replace(path, labels=new) for path, new in zip(paths, labels, strict=True) if any(new)]


class BoxAreas:
    """Areas of boxes in µm² on a surface, of which every pixel (N, 2N) has its own."""

    def __init__(self, pixels_um2: Floats) -> None:
        self._pixels = pixels_um2

    def of(self, box: Box) -> float:
        return float(box.cut(self._pixels).sum())


def _repaired(path: Path, areas: BoxAreas, parameters: BoxParameters) -> tuple[Path, int]:
    """A path whose boxes that jump in size are interpolated from the others, and how many."""
    area = np.array([areas.of(box) for box in path.boxes])
    smooth = ndimage.uniform_filter1d(area, parameters.smoothing, mode="nearest")
    wrong = np.abs(area - smooth) > parameters.largest_jump_um2
    if not wrong.any() or wrong.all():
        return path, 0
    corners = np.array([(box.top, box.left, box.bottom, box.right) for box in path.boxes])
    time = np.arange(len(corners))
    for column in corners.T:
        column[wrong] = np.interp(time[wrong], time[~wrong], column[~wrong])
    boxes = [Box(*row) for row in corners.tolist()]
    return replace(path, boxes=boxes), int(wrong.sum())


# Tracks --------------------------------------------------------------------------


def _tracks(
    movie: Movie,
    paths: Sequence[Path],
    found: Sequence[FrameProtrusions],
    areas: BoxAreas,
    numbers: dict[str, Any],
    progress: Progress,
) -> Tracks:
    rows = movie.common.uv.shape[0]
    boxes = [_in_image(box, rows) for path in paths for box in path.boxes]
    length = [len(path.boxes) for path in paths]
    track = np.repeat(np.arange(1, len(paths) + 1), length)
    timepoint = _joined([np.arange(path.first, path.last + 1) for path in paths])
    label = _joined([np.array(path.labels, np.int64) for path in paths])
    places = np.array([box.centre for box in boxes], np.float64).reshape(-1, 2)
    points = _points(movie, timepoint, places, [one.timepoint for one in found], progress)
    own = (*NEEDED, *PLACE, *BOX)
    table = protrusion_columns(found, timepoint, label)
    columns = {
        "track_id": track,
        "timepoint": timepoint,
        **dict(zip(SPACE, points.T, strict=True)),
        **dict(zip(PLACE, wrap_uv(places, rows).T, strict=True)),
        **_sides(boxes),
        "label": label,
        **{name: values for name, values in table.items() if name not in own},
        OF_BOX[0]: np.array([areas.of(box) for box in boxes], np.float64),
        OF_BOX[1]: np.array([value for path in paths for value in path.curvature], np.float64),
    }
    return Tracks.of(
        columns,
        time_step_s=movie.time_step_s,
        timepoints=len(movie),
        rows=rows,
        method="boxes",
        numbers=numbers,
    )


def _joined(parts: Sequence[Ints]) -> Ints:
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def _sides(boxes: Sequence[Box]) -> dict[str, Floats]:
    corners = [(box.top, box.left, box.bottom, box.right) for box in boxes]
    return dict(zip(BOX, np.array(corners, np.float64).reshape(-1, 4).T, strict=True))


def _in_image(box: Box, rows: int) -> Box:
    """The same box, written so that its middle is in the image."""
    v, u = wrap_uv(np.array([box.centre]), rows)[0]
    height, width = (box.bottom - box.top) / 2, (box.right - box.left) / 2
    return Box(v + 0.5 - height, u + 0.5 - width, v + 0.5 + height, u + 0.5 + width)


def _points(
    movie: Movie, timepoint: Ints, places: Floats, known: Sequence[int], progress: Progress
) -> Floats:
    """What of the surface lies over places (n, 2); at lost timepoints, as just before."""
    points = np.full((len(places), 3), np.nan)
    at = np.searchsorted(known, timepoint, side="right") - 1
    for number, frame in enumerate(known):
        rows = np.flatnonzero(at == number)
        if len(rows):
            progress(number / len(known), f"timepoint {frame}")
            points[rows] = on_surface(movie, height_at(movie, frame), places[rows])
    return points
