"""What came of a batch: a row for each item, as tables and in words."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..files.atomic import replacing, write_json

if TYPE_CHECKING:
    import pandas as pd

State = Literal["done", "skipped", "failed", "left"]
SUMMARY = "summary"
ALL_DONE, SOME_FAILED = 0, 3


@dataclass
class Row:
    """One item: a cell, a timepoint of a movie, or what is made of all of its timepoints.

    Attributes
    ----------
    name : str
        Of the cell's or the movie's folder in the output.
    file : str
    label, timepoint : int or None
        None where there is none.
    stage : str
        The last that was tried: ``cell``; of timepoints ``register``, ``segment``, ``frame``,
        ``protrusions``; of movies ``common``, ``alike`` (what their protrusions have in common),
        ``tracks``, ``measurements``; ``open`` of a file that cannot be read.
    state : str
        ``done``, ``skipped`` (it was there), ``failed``, or ``left`` (the batch was stopped).
    reason : str
        Why it failed.
    seconds : float
        Of all its stages in this run.
    peak_memory_gb : float
        Of the worker's process meanwhile.
    volume_um3, area_um2, outside_fraction : float or None
    protrusions, tracks : int or None
        How many were found.
    """

    name: str
    file: str
    label: int | None = None
    timepoint: int | None = None
    stage: str = ""
    state: State = "left"
    reason: str = ""
    seconds: float = 0.0
    peak_memory_gb: float = 0.0
    volume_um3: float | None = None
    area_um2: float | None = None
    outside_fraction: float | None = None
    protrusions: int | None = None
    tracks: int | None = None

    def measure(self, numbers: dict[str, Any]) -> None:
        """Take the numbers that a row has."""
        for name in ("volume_um3", "area_um2", "outside_fraction"):
            if numbers.get(name) is not None:
                setattr(self, name, float(numbers[name]))
        for name in ("protrusions", "tracks"):
            if numbers.get(name) is not None:
                setattr(self, name, int(numbers[name]))


@dataclass(frozen=True)
class BatchResult:
    """What came of a batch.

    Attributes
    ----------
    output : Path
    rows : tuple of Row
    about : dict
        Versions, parameters, workers.
    """

    output: Path
    rows: tuple[Row, ...]
    about: dict[str, Any]

    @property
    def counts(self) -> dict[str, int]:
        """State → how many items."""
        found = Counter(row.state for row in self.rows)
        return {state: found.get(state, 0) for state in ("done", "skipped", "failed", "left")}

    @property
    def failed(self) -> tuple[Row, ...]:
        return tuple(row for row in self.rows if row.state == "failed")

    @property
    def exit_code(self) -> int:
        """0 when everything is there, 3 when something failed."""
        return SOME_FAILED if self.failed else ALL_DONE

    @property
    def table(self) -> pd.DataFrame:
        """The rows."""
        import pandas as pd

        names = [each.name for each in fields(Row)]
        table = pd.DataFrame([asdict(row) for row in self.rows], columns=names)
        for name in ("label", "timepoint", "protrusions", "tracks"):
            table[name] = table[name].astype("Int64")
        return table

    def write(self) -> None:
        """Write ``summary.csv`` and ``summary.json``."""
        with replacing(self.output / f"{SUMMARY}.csv") as partial:
            self.table.to_csv(partial, index=False)
        write_json(
            self.output / f"{SUMMARY}.json",
            {**self.about, "counts": self.counts, "items": [asdict(row) for row in self.rows]},
        )


def in_words(counts: dict[str, int]) -> str:
    """How many items are done, and how many not."""
    return ", ".join(f"{count} {state}" for state, count in counts.items() if count)


def place(row: Row) -> str:
    """Which item a row is of, for a person."""
    timepoint = "" if row.timepoint is None else f", timepoint {row.timepoint}"
    return f"{row.name}{timepoint}"
