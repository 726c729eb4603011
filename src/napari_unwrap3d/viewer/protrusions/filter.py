"""Which protrusions and measures are shown: those of a motif, and within a range of one measure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...charts import MOTIFS

if TYPE_CHECKING:
    from ...charts import Protrusions

# What is shown of the table at first.
COLUMNS_FIRST = ("label", "motif", "height_max_um", "area_um2", "volume_um3", "width_um", "neck_um")


@dataclass(frozen=True)
class Filter:
    """What lets a protrusion through.

    Attributes
    ----------
    motif : str
        One of :data:`MOTIFS`; empty for all.
    column : str
        The measure that the range is of; empty for none.
    low, high : float or None
        The ends of the range; None for no end.
    """

    motif: str = ""
    column: str = ""
    low: float | None = None
    high: float | None = None

    def hidden(self, found: Protrusions) -> frozenset[int]:
        """The labels that it does not let through; what has no value has none in the range."""
        columns = found.columns
        kept = np.ones(found.count, bool)
        if self.motif in MOTIFS and "motif" in columns:
            kept &= np.asarray(columns["motif"]) == MOTIFS.index(self.motif)
        if self.column in columns:
            values = np.asarray(columns[self.column], dtype=float)
            if self.low is not None:
                kept &= values >= self.low
            if self.high is not None:
                kept &= values <= self.high
        return frozenset(np.asarray(columns["label"])[~kept].tolist())

    def plain(self) -> dict[str, Any]:
        """As a project keeps it."""
        return asdict(self)


def filter_from(known: Mapping[str, Any]) -> Filter:
    """A filter from what a project kept; ValueError where that makes no sense."""
    ends = [None if known[end] is None else float(known[end]) for end in ("low", "high")]
    if not all(end is None or math.isfinite(end) for end in ends):
        raise ValueError("a range that is not finite")
    return Filter(str(known["motif"]), str(known["column"]), *ends)
