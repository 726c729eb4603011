"""Linking: which detections at different timepoints are one object.

The linear assignment framework of Jaqaman et al. 2008 (doi:10.1038/nmeth.1237), by laptrack:
frame to frame first, then gaps are closed and splits and merges found. Distances are taken in
space, on the common surface, so that there is neither seam nor pole; other features (area,
height) enter the cost as lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..errors import AxesError, ParameterError


@dataclass(frozen=True, eq=False)
class Linked:
    """Tracks of detections.

    Attributes
    ----------
    track_id : ndarray, (n,) int64
        Of every detection, from 1, in the order in which tracks begin.
    splits : ndarray, (k, 2) int64
        (track, track that comes out of it).
    merges : ndarray, (k, 2) int64
        (track, track that it goes into).
    """

    track_id: Ints
    splits: Ints
    merges: Ints

    def links(self, timepoint: Ints) -> Ints:
        """Pairs (m, 2) of detections that follow each other in a track."""
        order = np.lexsort((timepoint, self.track_id))
        same = self.track_id[order][1:] == self.track_id[order][:-1]
        return np.column_stack([order[:-1][same], order[1:][same]])


def link(
    position_um: npt.ArrayLike,
    timepoint: npt.ArrayLike,
    *,
    longest_step_um: float,
    features_um: npt.ArrayLike | None = None,
    gap_timepoints: int = 0,
    longest_gap_um: float | None = None,
    split_um: float | None = None,
    merge_um: float | None = None,
) -> Linked:
    """Link detections into tracks.

    Parameters
    ----------
    position_um : array-like, (n, d)
        Where each detection is; on the common surface (z, y, x).
    timepoint : array-like, (n,) int
    longest_step_um : float
        Longest step from one timepoint to the next, features included.
    features_um : array-like, (n, k), optional
        What else should not change much, each scaled to a length: the cost of a link is the
        sum of squares of all differences.
    gap_timepoints : int
        For how many timepoints a track may be lost and found again; 0: never.
    longest_gap_um : float, optional
        Longest step over a gap; `longest_step_um` unless given.
    split_um, merge_um : float, optional
        How far a track may begin from the middle of another one that it comes out of, or end
        from one that it goes into; neither unless given.

    Returns
    -------
    Linked

    Raises
    ------
    AxesError
        There are not as many positions, timepoints and features.
    ParameterError
        A length is not positive.
    """
    points, times = np.asarray(position_um, np.float64), np.asarray(timepoint, np.int64)
    others = (
        np.zeros((len(points), 0)) if features_um is None else np.asarray(features_um, np.float64)
    )
    if points.ndim != 2 or not len(points) == len(times) == len(others):
        raise AxesError(
            "Every detection has a position, a timepoint and its features.",
            positions=points.shape,
            timepoints=times.shape,
            features=others.shape,
        )
    lengths = {"longest_step_um": longest_step_um, "longest_gap_um": longest_gap_um}
    lengths |= {"split_um": split_um, "merge_um": merge_um}
    for name, length in lengths.items():
        if length is not None and not length > 0:
            raise ParameterError(f"The parameter {name} is a positive length.", got=length)
    if len(points) == 0:
        none = np.zeros((0, 2), np.int64)
        return Linked(np.zeros(0, np.int64), none, none)
    gap = longest_step_um if longest_gap_um is None else longest_gap_um
    tracker = _tracker(longest_step_um, gap_timepoints, gap, split_um, merge_um)
    return _linked(tracker, np.column_stack([points, others]), times)


def _tracker(
    step: float, gap_timepoints: int, gap: float, split: float | None, merge: float | None
) -> Any:
    from laptrack import LapTrack

    return LapTrack(
        metric="sqeuclidean",
        cutoff=step**2,
        gap_closing_metric="sqeuclidean",
        gap_closing_cutoff=gap**2 if gap_timepoints else False,
        # Between the timepoints at the two ends of the gap.
        gap_closing_max_frame_count=gap_timepoints + 1,
        splitting_metric="sqeuclidean",
        splitting_cutoff=False if split is None else split**2,
        merging_metric="sqeuclidean",
        merging_cutoff=False if merge is None else merge**2,
    )


def _linked(tracker: Any, columns: Floats, timepoint: Ints) -> Linked:
    import pandas as pd

    names = [f"c{i}" for i in range(columns.shape[1])]
    table = pd.DataFrame(columns, columns=names).assign(t=timepoint, row=np.arange(len(columns)))
    tracks, splits, merges = tracker.predict_dataframe(
        table, names, frame_col="t", only_coordinate_cols=False
    )
    given = np.zeros(len(columns), np.int64)
    given[tracks["row"].to_numpy()] = tracks["track_id"].to_numpy()
    # In the order in which tracks begin, so that the numbers do not depend on the library.
    order = np.lexsort((np.arange(len(given)), timepoint))
    first, place = np.unique(given[order], return_index=True)
    number = dict(zip(first[np.argsort(place)].tolist(), range(1, len(first) + 1), strict=True))
    renumbered = np.array([number[k] for k in given.tolist()], np.int64)
    return Linked(
        renumbered,
        _pairs(splits, ("parent_track_id", "child_track_id"), number),
        _pairs(merges, ("parent_track_id", "child_track_id"), number),
    )


def _pairs(table: Any, columns: tuple[str, str], number: dict[int, int]) -> Ints:
    if len(table) == 0:
        return np.zeros((0, 2), np.int64)
    pairs = [[number[int(k)] for k in table[column]] for column in columns]
    return np.array(sorted(zip(*pairs, strict=True)), np.int64).reshape(-1, 2)
