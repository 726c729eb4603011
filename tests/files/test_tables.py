"""Tables keep every digit, and appear only when complete."""

from __future__ import annotations

import csv
import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.errors import FileFormatError, InputError
from napari_unwrap3d.files import tables
from napari_unwrap3d.files.atomic import from_plain, plain, replacing, write_json
from napari_unwrap3d.files.tables import write_table

ROWS = [
    {"protrusion": 1, "t": 0, "area_um2": 1.5, "kind": "bleb", "value": 3, "open": True},
    {"protrusion": 2, "t": 1, "area_um2": np.float32(0.1), "kind": None, "value": "none"},
    {"protrusion": np.int64(3), "t": 2.5, "area_um2": math.nan, "value": 1.5, "open": False},
]
COLUMNS = {
    "protrusion": [1, 2, 3],
    "t": [0.0, 1.0, 2.5],
    "area_um2": [1.5, float(np.float32(0.1)), math.nan],
    "kind": ["bleb", None, None],
    "value": ["3", "none", "1.5"],
    "open": [True, None, False],
}


def test_numbers_come_back_exactly(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=50) * 10.0 ** np.arange(-25, 25)
    rows = [{"chart": 'a, "b"\nµ', "area_um2": float(value)} for value in values]
    rows.append({"chart": "last", "area_um2": 1.0, "note": None})
    path = write_table(tmp_path / "table.csv", rows)
    with path.open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(row["area_um2"]) for row in read[:-1]] == values.tolist()
    assert read[0]["chart"] == 'a, "b"\nµ'
    assert read[-1]["note"] == ""


def test_json_has_no_nan_and_plain_values_come_back(tmp_path: Path) -> None:
    value = {"a": [1, 2.5, math.inf, -math.inf], "b": {"c": math.nan, "d": None, "e": True}}
    restored = from_plain(plain(value))
    assert restored["a"] == value["a"]
    assert math.isnan(restored["b"].pop("c"))
    assert restored["b"] == {"d": None, "e": True}
    text = write_json(tmp_path / "x.json", value).read_text()
    assert "NaN" not in text
    assert "Infinity" not in text


def test_numpy_values_become_plain() -> None:
    value = {1: np.float32(0.5), "x": np.arange(3), "y": (np.bool_(True), np.int64(2))}
    assert plain(value) == {"1": 0.5, "x": [0, 1, 2], "y": [True, 2]}


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    path.write_text("before")

    def write_and_fail() -> None:
        with replacing(path) as partial:
            partial.write_text("after")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_and_fail()
    assert [item.name for item in tmp_path.iterdir()] == ["file.txt"]
    assert path.read_text() == "before"


def test_a_data_frame_is_a_table(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"protrusion": [1, 2], "area_um2": [0.1, 2.5]})
    text = write_table(tmp_path / "a.csv", frame).read_text()
    assert text == "protrusion,area_um2\n1,0.1\n2,2.5\n"
    assert write_table(tmp_path / "b.csv", frame[:0]).read_text() == "protrusion,area_um2\n"


def test_parquet_comes_back_with_kinds_and_gaps(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = write_table(tmp_path / "a.parquet", ROWS)
    found = parquet.read_table(path).to_pydict()
    assert list(found) == list(COLUMNS)
    for name, values in COLUMNS.items():
        assert str(found[name]) == str(values), name
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.parquet"]


def test_columns_of_parquet_are_of_one_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is handed to pyarrow, also where that is not installed."""
    pyarrow, parquet = ModuleType("pyarrow"), ModuleType("pyarrow.parquet")
    handed: list[Any] = []
    pyarrow.table = lambda columns: handed.append(columns) or "table"  # type: ignore[attr-defined]
    pyarrow.parquet = parquet  # type: ignore[attr-defined]
    parquet.write_table = lambda table, path: Path(path).write_text(table)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyarrow", pyarrow)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", parquet)
    monkeypatch.setattr(tables, "check_parquet", lambda: None)
    assert write_table(tmp_path / "a.parquet", ROWS).read_text() == "table"
    assert str(handed) == str([COLUMNS])


def test_parquet_without_pyarrow_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"napari-unwrap3d\[parquet\]"):
        write_table(tmp_path / "a.parquet", ROWS)
    assert not list(tmp_path.iterdir())


def test_an_unknown_kind_of_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"a\.xlsx.*\.parquet"):
        write_table(tmp_path / "a.xlsx", ROWS)
