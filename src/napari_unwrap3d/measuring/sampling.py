"""The series of tracks, of annotations and of the whole surface, in one pass over the frames.

Paper, Methods, "Bleb timeseries extraction": means over a place on the surface are means over the
same place of the uv image, with every pixel weighed by its area element dA.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Frame, Ints
from ..fields import CURVATURE
from ..geometry.spread import spread_directions
from ..geometry.uv_boxes import BoxSums, label_sums, largest_part_sums
from ..motion.frames import AREA
from ..parameters import Parameters
from ..progress import Progress
from ..unwrapping.elements import region_means
from ..unwrapping.uv import direction_to_uv
from .bending import curvature_threshold
from .fields import image_of
from .places import Places

if TYPE_CHECKING:
    from ..motion.movie import Movie

# So many places of the surface stand for all of it.
SPOTS = 4000
SIDES = ("on", "off")


@dataclass(frozen=True, eq=False)
class Sampled:
    """What was read from the frames of a movie.

    Attributes
    ----------
    columns : dict of str to ndarray, (m,)
        Of the rows of the places: ``area_um2``, ``area_px``, every field, and, of protrusions
        and boxes, the same with ``on_`` and ``off_`` before it.
    spots : dict of str to ndarray, (k, T)
        The fields at places that are spread evenly over the sphere.
    regions : dict of str to ndarray
        Of annotations: ``region``, ``label``, ``timepoint``, ``area_um2``, ``area_px``, fields.
    threshold_per_um : float or None
        The mean curvature above which a box is on a protrusion.
    """

    columns: dict[str, Floats]
    spots: dict[str, Floats]
    regions: dict[str, npt.NDArray[Any]]
    threshold_per_um: float | None = None


def sample(
    movie: Movie,
    places: Places,
    fields: Sequence[str],
    parameters: Parameters,
    progress: Progress,
    regions: Sequence[str] = (),
) -> Sampled:
    """Read fields of all frames at the places of tracks.

    Parameters
    ----------
    movie : Movie
    places : Places
    fields : sequence of str
        Of the movie.
    parameters : Parameters
        With which the protrusions are found that the places know.
    progress : Progress
    regions : sequence of str
        Annotations that are measured, too.
    """
    spots = Spots.of(movie, fields)
    tracked = TrackSums(movie, places, tuple(fields), parameters)
    annotated = RegionSums(movie, tuple(regions), tuple(fields))
    by_curvature = places.kind == "box"
    if by_curvature:
        # One threshold for the whole movie has to be known before any box is looked at.
        bent = Spots.of(movie, [CURVATURE])
        _each_frame(movie, [bent.add], progress.part(0.0, 0.4))
        tracked.threshold = curvature_threshold([bent.values[CURVATURE]])
    takers = [spots.add, tracked.add, annotated.add]
    _each_frame(movie, takers, progress.part(0.4 if by_curvature else 0.0, 1.0))
    return Sampled(tracked.columns(), spots.values, annotated.columns(), tracked.threshold)


def _each_frame(
    movie: Movie, takers: Sequence[Callable[[Frame], None]], progress: Progress
) -> None:
    for timepoint in range(len(movie)):
        progress(timepoint / len(movie), f"timepoint {timepoint}")
        if not movie.is_lost(timepoint):
            frame = movie.frame(timepoint)
            for take in takers:
                take(frame)


@dataclass(frozen=True, eq=False)
class Spots:
    """Fields over time at places that are spread evenly over the common sphere."""

    pixels: tuple[Ints, Ints]
    values: dict[str, Floats]

    @classmethod
    def of(cls, movie: Movie, fields: Sequence[str], count: int = SPOTS) -> Spots:
        """None of the values is known yet."""
        rows = movie.common.uv.shape[0]
        place = np.rint(direction_to_uv(spread_directions(count), rows)).astype(np.int64)
        pixels = np.clip(place[:, 0], 0, rows - 1), place[:, 1] % (2 * rows)
        return cls(pixels, {name: np.full((count, len(movie)), np.nan) for name in fields})

    def add(self, frame: Frame) -> None:
        for name, values in self.values.items():
            values[:, frame.timepoint] = image_of(frame, name)[self.pixels]


@dataclass(eq=False)
class TrackSums:
    """Means over the places of tracks."""

    movie: Movie
    places: Places
    fields: tuple[str, ...]
    parameters: Parameters
    threshold: float | None = None
    _found: dict[str, Floats] = field(init=False)

    def __post_init__(self) -> None:
        own = [f"{AREA}", "area_px", *self.fields]
        names = list(own)
        if self.places.kind != "region":
            names += [f"{side}_{name}" for side in SIDES for name in own]
        self._found = {name: np.full(len(self.places), np.nan) for name in names}

    def add(self, frame: Frame) -> None:
        rows = self.places.at(frame.timepoint)
        if len(rows) == 0:
            return
        images = [image_of(frame, name) for name in self.fields]
        sums = self._sums(frame, np.reshape(images, (-1, *frame.uv[AREA].shape)), rows)
        everywhere = np.ones(len(rows), bool)
        self._put("", sums, rows, None, everywhere)
        if self.places.kind != "region":
            # Where a protrusion is lost, or has not begun, nothing is known of its own surface.
            own = self.places.label[rows] > 0 if self.places.kind == "protrusion" else everywhere
            self._put("on_", sums, rows, 0, own)
            self._put("off_", sums, rows, 1, everywhere)

    def _sums(self, frame: Frame, images: npt.NDArray[Any], rows: Ints) -> BoxSums:
        corners, areas = self.places.corners[rows], frame.uv[AREA]
        wanted = self.places.label[rows]
        if self.places.kind == "protrusion":
            found = self.movie.protrusions(frame.timepoint, self.parameters)
            return label_sums(images, areas, corners, found.uv, wanted)
        if self.places.kind == "box" and self.threshold is not None:
            bent = np.nan_to_num(frame.uv[CURVATURE], nan=-np.inf) > self.threshold
            return largest_part_sums(images, areas, corners, bent)
        nothing = np.zeros(areas.shape, np.int64)
        return label_sums(images, areas, corners, nothing, np.full(len(rows), -1))

    def _put(
        self, side: str, sums: BoxSums, rows: Ints, part: int | None, known: npt.NDArray[np.bool_]
    ) -> None:
        """The sums of a part of the boxes into the columns of a side."""
        pick = slice(None) if part is None else slice(part, part + 1)
        means = sums.means(part)
        columns = {
            AREA: sums.area[:, pick].sum(axis=1),
            "area_px": sums.pixels[:, pick].sum(axis=1),
            **{name: means[:, i] for i, name in enumerate(self.fields)},
        }
        for name, values in columns.items():
            self._found[side + name][rows] = np.where(known, values, np.nan)

    def columns(self) -> dict[str, Floats]:
        return self._found


@dataclass(eq=False)
class RegionSums:
    """Means over annotations, of the movie or of single timepoints."""

    movie: Movie
    regions: tuple[str, ...]
    fields: tuple[str, ...]
    _rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, frame: Frame) -> None:
        areas = np.nan_to_num(np.asarray(frame.uv[AREA], np.float64))
        for region in self.regions:
            image = self.movie.common.annotations.times.image(region, frame.timepoint)
            labels = np.asarray(image).astype(np.int64)
            size = np.bincount(labels.ravel(), areas.ravel())
            count = np.bincount(labels.ravel())
            means = {
                name: region_means(image_of(frame, name), labels, areas) for name in self.fields
            }
            for label in np.flatnonzero(count).tolist():
                if label:
                    self._rows.append(
                        {
                            "region": region,
                            "label": label,
                            "timepoint": frame.timepoint,
                            AREA: size[label],
                            "area_px": count[label],
                            **{name: means[name][label] for name in self.fields},
                        }
                    )

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        names = ("region", "label", "timepoint", AREA, "area_px", *self.fields)
        return {name: np.array([row[name] for row in self._rows]) for name in names}
