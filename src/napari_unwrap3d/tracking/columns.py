"""From the tables of protrusions at all timepoints to the columns of tracks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import FrameProtrusions, Ints


def protrusion_columns(
    detections: Iterable[FrameProtrusions], timepoint: Ints, label: Ints
) -> dict[str, npt.NDArray[Any]]:
    """The columns (n,) of the tables of protrusions for rows of tracks.

    Parameters
    ----------
    detections : iterable of FrameProtrusions
    timepoint : ndarray, (n,)
    label : ndarray, (n,)
        The protrusion of that timepoint; 0 and unknown ones have no values (NaN, or "").

    Returns
    -------
    dict of str to ndarray
        Without ``label``.
    """
    found: dict[str, npt.NDArray[Any]] = {}
    for one in detections:
        rows = np.flatnonzero((timepoint == one.timepoint) & (label > 0))
        names = np.asarray(one.columns["label"])
        order = np.argsort(names)
        at = np.searchsorted(names[order], label[rows])
        known = np.isin(label[rows], names)
        rows, source = rows[known], order[at[known]]
        for name, values in one.columns.items():
            if name == "label":
                continue
            column = np.asarray(values)
            if name not in found:
                found[name] = _empty(column, len(timepoint))
            found[name][rows] = column[source]
    return found


def _empty(like: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    if like.dtype.kind in "fiub":
        return np.full(count, np.nan)
    return np.full(count, "", dtype=object)
