"""Tables as CSV, with the units in the names of the columns or quantities."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import quality
from .atomic import write_text

if TYPE_CHECKING:
    from ..atlas import Atlas


def quality_rows(atlas: Atlas) -> list[dict[str, Any]]:
    """The numbers of an atlas as rows: chart, quantity, value, mark, reason.

    The unit is in the name of the quantity (``area_um2``); `mark` is green, amber, red
    or empty, see :mod:`napari_unwrap3d.quality`.
    """
    return [
        {
            "chart": row.chart,
            "quantity": row.quantity,
            "value": row.value,
            "mark": row.mark,
            "reason": row.reason,
        }
        for row in quality.quality_rows(atlas.quality)
    ]


def write_table(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write rows as CSV (UTF-8, comma, full precision); columns are those of the rows.

    Parameters
    ----------
    path : path
        Replaced only when the table is complete.
    rows : sequence of mapping
        Column name to value; None is an empty cell.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return write_text(path, text.getvalue())
