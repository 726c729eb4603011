"""What was measured along the tracks of a movie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..charts import Tracks
from ..parameters import Parameters

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Measurements:
    """Tables of what was measured along tracks.

    Attributes
    ----------
    tracks : Tracks
        Those that were measured, gated.
    parameters : Parameters
    tables : mapping of str to DataFrame
        By name: "series" (long form), "tracks", "events", "aligned" and others, with units in the
        names of their columns.
    numbers : mapping
        Single numbers with their units in the names, JSON-able.
    name : str
        Of the movie.
    """

    tracks: Tracks
    parameters: Parameters
    tables: Mapping[str, pd.DataFrame]
    numbers: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
