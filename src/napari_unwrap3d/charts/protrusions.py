"""The protrusions of one cell: which vertices and voxels are whose, and what each measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import AxesError, InputError
from .volumes import Floats, Mask, Volume

if TYPE_CHECKING:
    import pandas as pd

LABEL, MOTIF = "label", "motif"
# What the column "motif" counts from 0.
MOTIFS = ("bleb", "lamellipodium", "filopodium")


@dataclass(frozen=True, eq=False)
class Protrusions:
    """Instances of surface features (blebs, lamellipodia, filopodia, ruffles).

    Attributes
    ----------
    labels : ndarray, (n,) int32
        One per vertex of ``atlas.surface``: which protrusion it belongs to, 0 = none.
    height_um : ndarray, (n,)
        Height of every vertex over the cortex in µm, negative below it.
    volume : Volume, (z, y, x) int32
        On the mask's grid: which protrusion each voxel of the cell belongs to, 0 = cortex,
        or outside of the cell.
    cortex : Mask
        The cell without its protrusions, on the same grid: a voxel of the mask is in the
        cortex or has a label in `volume`, never both.
    columns : mapping of str to ndarray, (k,)
        The table by its columns, whose names carry the unit; ``label`` first, a row per
        protrusion, in the order of the labels. Numbers only: ``motif`` is an index into
        :data:`MOTIFS`.
    method : str
        "cortex" or "topography" (the paper's), or "edited" after a person changed it.
    numbers : mapping
        What was measured on the way, JSON-able.
    """

    labels: npt.NDArray[np.int32]
    height_um: Floats
    volume: Volume
    cortex: Mask
    columns: Mapping[str, npt.NDArray[Any]]
    method: str = "cortex"
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.labels.shape != self.height_um.shape or self.labels.ndim != 1:
            raise AxesError(
                "Protrusions have one label and one height per vertex.",
                labels=self.labels.shape,
                heights=self.height_um.shape,
            )
        if self.volume.shape != self.cortex.shape:
            raise AxesError(
                "The volumes of protrusions and the cortex are on one grid.",
                volume=self.volume.shape,
                cortex=self.cortex.shape,
            )
        lengths = {name: len(column) for name, column in self.columns.items()}
        if LABEL not in lengths or len(set(lengths.values())) > 1:
            raise InputError(
                "The table of protrusions has a label and as many rows in every column.",
                columns=lengths,
            )

    @property
    def count(self) -> int:
        """How many protrusions there are."""
        return len(self.columns[LABEL])

    def per_vertex(self, column: str) -> Floats:
        """A column of the table at every vertex of the surface, (n,); NaN where no label is."""
        labels = np.asarray(self.columns[LABEL], np.int64)
        largest = max(int(self.labels.max(initial=0)), int(labels.max(initial=0)))
        values = np.full(largest + 1, np.nan)
        values[labels] = self.columns[column]
        values[0] = np.nan
        at_vertices: Floats = values[self.labels]
        return at_vertices

    @property
    def table(self) -> pd.DataFrame:
        """A row per protrusion; the names of the columns carry the units, motifs are words."""
        import pandas as pd

        columns = dict(self.columns)
        if MOTIF in columns:
            columns[MOTIF] = np.array(MOTIFS)[columns[MOTIF]]
        return pd.DataFrame(columns)
