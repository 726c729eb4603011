"""Which numbers of an atlas are good, fair or bad, and why: the one place for the limits.

``atlas.quality`` holds the measured numbers, by chart. Here they become rows with a mark,
for the command line, the tables and the interface.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Mark = Literal["green", "amber", "red", ""]


@dataclass(frozen=True)
class Limit:
    """When a number is good (green), fair (amber) or bad (red), and what it means.

    A value up to `green` is good and up to `amber` fair; with `least`, a value from
    `green` up is good and from `amber` up fair.
    """

    title: str
    green: float
    amber: float
    meaning: str
    least: bool = False

    def mark(self, value: float) -> Mark:
        """The colour of a value; NaN is bad."""
        sign = -1.0 if self.least else 1.0
        if sign * value <= sign * self.green:
            return "green"
        return "amber" if sign * value <= sign * self.amber else "red"

    def reason(self, value: float) -> str:
        """Why the value has its mark."""
        word = "at least" if self.least else "at most"
        return f"{self.meaning}; good: {word} {self.green:g}, fair: {word} {self.amber:g}"


@dataclass(frozen=True)
class Row:
    """One number of one chart.

    Attributes
    ----------
    chart : str
    quantity : str
        The key in ``atlas.quality``, with its unit, e.g. ``"area_um2"``.
    value : object
    mark : str
        "green", "amber", "red", or "" where there is nothing to judge.
    title, reason : str
        In words.
    """

    chart: str
    quantity: str
    value: Any
    mark: Mark = ""
    title: str = ""
    reason: str = ""


LIMITS: dict[tuple[str, str], Limit] = {}


def quality_rows(quality: Mapping[str, Any]) -> list[Row]:
    """Every number of ``atlas.quality``, in the order of the charts, with its mark."""
    return [
        _row(chart, quantity, value)
        for chart, numbers in quality.items()
        for quantity, value in _flat(numbers)
    ]


def worst_mark(rows: list[Row]) -> Mark:
    """The worst mark among rows."""
    marks = {row.mark for row in rows}
    order: tuple[Mark, ...] = ("red", "amber", "green")
    return next((mark for mark in order if mark in marks), "")


def _row(chart: str, quantity: str, value: Any) -> Row:
    limit = LIMITS.get((chart, quantity))
    title = limit.title if limit is not None else quantity.replace("_", " ")
    if limit is None or value is None or isinstance(value, str):
        return Row(chart, quantity, value, title=title)
    number = float(value)
    return Row(chart, quantity, value, limit.mark(number), title, limit.reason(number))


def _flat(numbers: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested names joined by dots; a list of parts counts as their number."""
    for key, value in numbers.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}.")
        elif isinstance(value, list | tuple) and any(isinstance(v, Mapping) for v in value):
            yield name, len(value)
        elif isinstance(value, list | tuple):
            yield name, " ".join(str(v) for v in value)
        else:
            yield name, value
