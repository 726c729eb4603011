"""Series: a value per timepoint of a place on the surface, corrected for distortion.

Paper, Methods, "Bleb timeseries extraction": the mean of a field over a piece of the surface is
its mean over the same piece of the uv image, with every pixel weighed by its area element dA.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from skimage.filters import threshold_multiotsu

from ..charts import Floats, Ints
from ..errors import AxesError, InputError
from ..tracking.boxes import Box
from ..unwrapping.elements import region_means

CURVATURE_CLASSES = 3
LARGEST_SAMPLE = 500_000


@dataclass(frozen=True, eq=False)
class Series:
    """Values over time of one place.

    Attributes
    ----------
    area_um2 : ndarray, (T,)
        Of the surface there; 0 where the place is nowhere.
    mean : ndarray, (T,)
        Of the field over that area; NaN where it is not known.
    """

    area_um2: Floats
    mean: Floats


def label_series(
    images: Iterable[npt.ArrayLike],
    areas: Iterable[npt.ArrayLike],
    labels: Iterable[npt.ArrayLike] | npt.ArrayLike,
) -> dict[int, Series]:
    """The series of every label of label images: masks of protrusions, or an annotation.

    Parameters
    ----------
    images : iterable of array-like (N, 2N)
        The field at every timepoint, such as ``movie.uv("signal_septin")``; NaN does not count.
    areas : iterable of array-like (N, 2N)
        dA(t) of the pixels in µm², such as ``movie.uv("area_um2")``.
    labels : iterable of array-like (N, 2N), or one array (N, 2N)
        Integers from 0 at every timepoint, or the same at all of them; 0 is no label.

    Returns
    -------
    dict of int to Series
        By label.

    Raises
    ------
    AxesError
        They are not of one shape, or not as many.
    """
    still = isinstance(labels, np.ndarray) and labels.ndim == 2
    everywhere: Any = itertools.repeat(labels) if still else labels
    means: list[Floats] = []
    sizes: list[Floats] = []
    for image, area, label in zip(images, areas, everywhere, strict=not still):
        field, weight, part = (np.asarray(x) for x in (image, area, label))
        means.append(region_means(field, part, weight))
        sizes.append(_areas(part, weight))
    present = sorted({int(k) for size in sizes for k in np.flatnonzero(size) if k})
    return {
        label: Series(_column(sizes, label, 0.0), _column(means, label, np.nan))
        for label in present
    }


def box_series(
    images: Iterable[npt.ArrayLike],
    areas: Iterable[npt.ArrayLike],
    boxes: Mapping[int, Mapping[int, Box]],
    timepoints: int,
) -> dict[int, Series]:
    """The series of tracks whose place is a box at every timepoint.

    Parameters
    ----------
    images, areas : iterable of array-like (N, 2N)
        As for :func:`label_series`.
    boxes : mapping of int to mapping of int to Box
        Track → timepoint → box.
    timepoints : int

    Returns
    -------
    dict of int to Series
        By track; NaN at timepoints at which a track has no box.
    """
    found = {track: Series(np.zeros(timepoints), np.full(timepoints, np.nan)) for track in boxes}
    for timepoint, (image, area) in enumerate(zip(images, areas, strict=True)):
        field, weight = np.asarray(image, dtype=np.float64), np.asarray(area, dtype=np.float64)
        for track, places in boxes.items():
            if timepoint in places:
                here = places[timepoint].inside(field.shape[0])
                series = found[track]
                series.area_um2[timepoint] = np.nansum(weight[here])
                series.mean[timepoint] = weighted_mean(field[here], weight[here])
    return found


def weighted_mean(values: npt.ArrayLike, weights: npt.ArrayLike) -> float:
    """Mean of values by their weights; NaN do not count, and NaN where nothing does."""
    field, weight = np.asarray(values, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    known = np.isfinite(field) & (weight > 0)
    total = float(weight[known].sum())
    return float((field[known] * weight[known]).sum()) / total if total > 0 else float("nan")


def curvature_threshold(images: Iterable[npt.ArrayLike]) -> float:
    """The curvature above which the surface counts as bent outwards, one for a whole movie.

    The higher of the two thresholds of Otsu's method with three classes (paper, "Bleb timeseries
    extraction").

    Raises
    ------
    InputError
        There is nothing to tell three classes from.
    """
    values = np.concatenate([np.asarray(image, dtype=np.float64).ravel() for image in images])
    values = values[np.isfinite(values)]
    sample = values[:: max(len(values) // LARGEST_SAMPLE, 1)]
    if len(np.unique(sample[:1000])) < CURVATURE_CLASSES and len(np.unique(sample)) < 3:
        raise InputError(
            "The curvature does not vary enough for three classes.", values=len(np.unique(sample))
        )
    return float(threshold_multiotsu(sample, CURVATURE_CLASSES)[-1])


def on_and_off(curvature: npt.ArrayLike, box: Box, threshold: float) -> tuple[Any, Any]:
    """Which pixels (N, 2N) of a box are on a protrusion and which are not.

    On it is the largest connected part of the box that is bent outwards more than the threshold;
    the rest of the box is off it (paper, "Bleb timeseries extraction").

    Returns
    -------
    on, off : ndarray, (N, 2N) bool
        Together the box.
    """
    field = np.asarray(curvature)
    rows, columns = box.pixels(field.shape[0])
    bent = np.nan_to_num(field[rows, columns], nan=-np.inf) > threshold
    parts, count = ndimage.label(bent, structure=np.ones((3, 3)))
    on = np.zeros(field.shape, bool)
    if count:
        largest = 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
        within = parts == largest
        on[rows[within], columns[within]] = True
    return on, box.inside(field.shape[0]) & ~on


def _areas(labels: Ints, weights: Floats) -> Floats:
    """Area of every label (largest + 1,)."""
    if labels.shape != weights.shape:
        raise AxesError("Labels and areas are of one shape.", labels=labels.shape)
    known = np.isfinite(weights)
    size = int(labels.max(initial=0)) + 1
    place = labels[known].astype(np.int64)
    return np.asarray(np.bincount(place, weights[known], minlength=size), np.float64)


def _column(rows: list[Floats], label: int, missing: float) -> Floats:
    """The entry of a label in every row; rows end at their own largest label."""
    return np.array([row[label] if label < len(row) else missing for row in rows])
