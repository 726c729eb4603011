"""Tables as CSV or Parquet, with the units in the names of the columns or quantities."""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import quality
from ..errors import FileFormatError, InputError
from .atomic import replacing, write_text

if TYPE_CHECKING:
    from ..atlas import Atlas

TABLE_SUFFIXES = (".csv", ".parquet")


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


def write_table(path: str | Path, rows: Any) -> Path:
    """Write rows as CSV (UTF-8, comma, full precision) or Parquet, by the suffix.

    Parameters
    ----------
    path : path
        ``.csv`` or ``.parquet``. Replaced only when the table is complete.
    rows : sequence of mapping, or pandas.DataFrame
        Column name, with its unit (``area_um2``), to value; None is an empty cell. The
        columns are those of the rows. In Parquet a column of numbers and text is text.

    Raises
    ------
    FileFormatError
        The suffix is of no table.
    InputError
        Parquet needs pyarrow, which is not installed.
    """
    path = Path(path)
    records: Sequence[Mapping[str, Any]]
    records = rows.to_dict(orient="records") if hasattr(rows, "to_dict") else rows
    names = list(rows.columns) if hasattr(rows, "columns") else []
    columns = list(dict.fromkeys([*names, *(name for row in records for name in row)]))
    if path.suffix.lower() == ".csv":
        return _write_csv(path, columns, records)
    if path.suffix.lower() == ".parquet":
        return _write_parquet(path, columns, records)
    raise FileFormatError(
        f"{path.name!r} is no kind of table that is known.",
        hint=f"Known: {', '.join(TABLE_SUFFIXES)}.",
    )


def check_parquet() -> None:
    """Raise when Parquet cannot be written."""
    if importlib.util.find_spec("pyarrow") is None:
        raise InputError(
            "Parquet needs the package pyarrow, which is not installed.",
            hint='Install it with `pip install "napari-unwrap3d[parquet]"`, or write CSV.',
        )


def _write_csv(path: Path, columns: list[str], rows: Sequence[Mapping[str, Any]]) -> Path:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return write_text(path, text.getvalue())


def _write_parquet(path: Path, columns: list[str], rows: Sequence[Mapping[str, Any]]) -> Path:
    check_parquet()
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({name: _of_one_kind([row.get(name) for row in rows]) for name in columns})
    with replacing(path) as partial:
        pyarrow.parquet.write_table(table, str(partial))
    return path


def _of_one_kind(values: list[Any]) -> list[Any]:
    """Values of one kind, as a column of Parquet has to be: numbers, truth values or text."""
    plain = [value.item() if isinstance(value, np.generic) else value for value in values]
    kinds = {type(value) for value in plain if value is not None}
    if kinds <= {int, float} and len(kinds) > 1:
        return [None if value is None else float(value) for value in plain]
    if len(kinds) <= 1:
        return plain
    return [None if value is None else str(value) for value in plain]
