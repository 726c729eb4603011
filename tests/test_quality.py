"""Marks follow from the limits, at one place."""

from __future__ import annotations

import math

import pytest

from napari_unwrap3d.quality import LIMITS, Limit, in_words, quality_rows, worst_mark


@pytest.mark.parametrize(
    ("value", "mark"), [(0.0, "green"), (1.0, "green"), (1.5, "amber"), (2.1, "red")]
)
def test_marks_of_an_upper_limit(value: float, mark: str) -> None:
    assert Limit("", 1.0, 2.0, "").mark(value) == mark


@pytest.mark.parametrize(
    ("value", "mark"), [(1.0, "green"), (0.99, "green"), (0.95, "amber"), (0.5, "red")]
)
def test_marks_of_a_lower_limit(value: float, mark: str) -> None:
    assert Limit("", 0.99, 0.9, "", least=True).mark(value) == mark


def test_nan_is_never_good() -> None:
    assert all(limit.mark(math.nan) == "red" for limit in LIMITS.values())


def test_limits_are_in_order_and_say_what_they_mean() -> None:
    for limit in LIMITS.values():
        assert (limit.green >= limit.amber) if limit.least else (limit.green <= limit.amber)
        assert limit.title
        assert limit.meaning


def test_every_number_has_a_row_and_only_those_with_a_limit_a_mark() -> None:
    quality = {
        "sphere": {
            "flipped_faces": 0,
            "name": "x",
            "history": [1.0, 2.0],
            "inner": {"area_um2": 2.5},
        },
        "sealed": {"closed": [{"kind": "handle"}, {"kind": "hole"}]},
    }
    rows = {(row.chart, row.quantity): row for row in quality_rows(quality)}
    assert rows["sphere", "flipped_faces"].mark == "green"
    assert rows["sphere", "history"].value == "1.0 2.0"
    assert rows["sphere", "inner.area_um2"].value == 2.5
    assert rows["sealed", "closed"].value == 2
    assert len(rows) == 5


def test_the_worst_mark_counts() -> None:
    quality = {"sphere": {"flipped_faces": 0}}
    assert worst_mark(quality_rows(quality)) == "green"
    assert worst_mark(quality_rows({"sphere": {"flipped_faces": 3}})) == "red"
    assert worst_mark([]) == ""


def test_units_are_in_words() -> None:
    assert in_words("area_um2") == "area (µm²)"
    assert in_words("mean_curvature_per_um") == "mean curvature (1/µm)"


def test_a_blended_sphere_is_not_judged_as_an_equiareal_one() -> None:
    numbers = {"mean_abs_log_lambda": 0.3, "blend": 1.0}
    assert quality_rows({"sphere": numbers})[0].mark == "red"
    assert quality_rows({"sphere": {**numbers, "blend": 0.5}})[0].mark == ""
    assert quality_rows({"sphere": {**numbers, "target": "uniform"}})[0].mark == ""
    assert quality_rows({"sphere": {**numbers, "criterion": "mips"}})[0].mark == ""
