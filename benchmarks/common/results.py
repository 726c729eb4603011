"""The file of results: one entry per bar and case, written anew after every case."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import napari_unwrap3d as unwrap3d

HERE = Path(__file__).resolve().parents[1]
RESULTS = HERE / "results.json"
SHOWN = ("value", "bar", "unit", "holds", "grid")
PACKAGES = ("numpy", "scipy", "numba", "scikit-image", "libigl", "trimesh")

Entry = dict[str, Any]
Entries = dict[str, Entry]


@dataclass(frozen=True)
class Bar:
    """A limit that a measured value is held against."""

    limit: float
    unit: str
    at_least: bool = False

    def entry(self, value: float | None, **more: Any) -> Entry:
        """An entry of the results; no value never holds."""
        measured = None if value is None else float(value)
        if measured is None or measured != measured:
            holds = False
        else:
            holds = measured >= self.limit if self.at_least else measured <= self.limit
        kept = {name: item for name, item in more.items() if item not in (None, "")}
        return {
            "value": significant(measured),
            "bar": self.limit,
            "unit": self.unit,
            "holds": holds,
            **kept,
        }


def significant(value: float | None, digits: int = 5) -> float | None:
    """Rounded to a few significant digits, so that the file reads well; counts as they are."""
    if value is None or value != value:
        return None
    if value == int(value) and abs(value) < 1e15:
        return int(value)
    rounded = float(f"{value:.{digits}g}")
    return rounded


def machine() -> dict[str, Any]:
    """The machine and the versions that the numbers were measured with."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        "system": platform.platform(),
        "python": platform.python_version(),
        "napari-unwrap3d": unwrap3d.__version__,
        **{name: version(name) for name in PACKAGES},
    }


def _cpu_model() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


def read() -> Entries:
    """The entries so far, without the machine."""
    if not RESULTS.exists():
        return {}
    entries = json.loads(RESULTS.read_text(encoding="utf-8"))
    entries.pop("machine", None)
    return dict(entries)


def merge(new: Entries, drop: Iterable[str] = ()) -> Entries:
    """Write `new` over the results so far, without those named in `drop`."""
    left_out = set(drop)
    entries = {name: entry for name, entry in read().items() if name not in left_out} | new
    content = {"machine": machine(), **dict(sorted(entries.items()))}
    temporary = RESULTS.with_suffix(".tmp")
    temporary.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8")
    temporary.replace(RESULTS)
    return entries


def show(entries: Entries) -> None:
    """Print entries as a table."""
    for name, entry in sorted(entries.items()):
        mark = "holds" if entry["holds"] else "FAILS"
        more = {key: item for key, item in entry.items() if key not in SHOWN}
        note = "".join(f"  {key} {item}" for key, item in more.items())
        print(
            f"  {mark}  {name:45s} {entry['value']!s:>10} {entry['unit']}"
            f"  [bar {entry['bar']}]{note}",
            flush=True,
        )


def summarise(entries: Entries) -> None:
    """Print every bar with the number of cases that hold it, and its worst case."""
    bars: dict[str, list[str]] = {}
    for name in entries:
        bars.setdefault(name.rsplit("/", 1)[0], []).append(name)
    for bar, names in sorted(bars.items()):
        held = sum(bool(entries[name]["holds"]) for name in names)
        failing = [name.rsplit("/", 1)[1] for name in names if not entries[name]["holds"]]
        tail = f"  not held: {', '.join(failing)}" if failing else ""
        print(f"{bar:28s} {held:3d} of {len(names):3d}{tail}")
