"""Tables keep every digit, and appear only when complete."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from napari_unwrap3d.files.atomic import from_plain, plain, replacing, write_json
from napari_unwrap3d.files.tables import write_table


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
