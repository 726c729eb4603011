"""Write the tables of docs/ from results.json, the parameters and the limits of the quality.

    .venv/bin/python benchmarks/tables.py            # write them
    .venv/bin/python benchmarks/tables.py --check    # say which page is not in step

A page holds a table between ``<!-- table: NAME -->`` and ``<!-- end of table -->``. What is
written there by hand is lost.
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.protrusions.columns import COLUMNS
from napari_unwrap3d.quality import LIMITS

PROJECT = Path(__file__).resolve().parents[1]
RESULTS = PROJECT / "benchmarks" / "results.json"
PAGES = PROJECT / "docs"
PLACE = re.compile(r"(<!-- table: ([\w ]+) -->\n).*?(<!-- end of table -->)", re.DOTALL)

Results = dict[str, dict[str, Any]]
SPEEDS = ("ruffle-speed", "lateral-speed", "retrograde-speed")
PROTRUSION_KINDS = ("blebs", "lamellipodia", "filopodia")
# The title of a row: the entry, and whether more is better.
PROTRUSION_NUMBERS = {
    "F1 at IoU ½": ("f1", True),
    "IoU of the surface": ("iou", True),
    "cortex to the true body (voxels)": ("cortex", False),
    "volume: median error": ("volume", False),
    "volume: bias": ("volume-bias", False),
    "area: median error": ("area", False),
    "height: median error": ("height", False),
}

# Groups of entries with one entry per case, in the order of the steps.
CASES = {
    "charts": "every chart reached",
    "reference": "topological defects of the reference",
    "conformal-flips": "flipped faces, conformal sphere",
    "conformal": "mean Q, conformal sphere",
    "equiareal-flips": "flipped faces, equiareal sphere",
    "equiareal": "mean \\|log λ\\|, equiareal sphere",
    "uv-located": "pixels with the right place",
    "uv-round-trip": "reference to uv and back, largest error",
    "topography-folded": "folded cells of the topography",
    "topography": "vertices back within 0.01 voxel",
    "chamfer": "S_topo to the surface, Chamfer distance",
    "area": "area of S_topo against the surface",
    "volume": "volume of S_topo against the surface",
    "labels": "labels uv to reference and back, smallest IoU",
    "direct": "direct chart certified one to one",
    "direct-time": "direct chart, time",
    "direct-area": "direct chart, mean \\|log λ\\|",
    "direct-cortex": "direct chart, how far the cortex is off its place",
    "direct-equiareal": "direct chart at registration 0.1, certified one to one",
    "direct-area-equiareal": "direct chart at registration 0.1, mean \\|log λ\\|",
    "direct-labels": "labels surface to direct and back, mean IoU",
    "plane": "plane certified one to one",
    "plane-round-trip": "surface to plane and back",
}
ROUTES = {
    "sphere": "surface → sphere by the flow",
    "conformal": "surface → conformal sphere",
    "reference": "surface → reference → equiareal sphere, outermost sheet",
    "equiareal": "surface → equiareal sphere",
    "direct": "direct chart (registered with the reference)",
    "topography": "topographic mesh (Step 6)",
    "plane": "plane (Step 7)",
}


# The tables ------------------------------------------------------------------------------


def charts_table(results: Results) -> str:
    """One row per bar: how many cases hold it, the median and the worst case."""
    rows = []
    for bar, title in CASES.items():
        cases = {
            name.rsplit("/", 1)[1]: entry
            for name, entry in results.items()
            if name.startswith(f"core/{bar}/")
        }
        if not cases:
            continue
        entries = list(cases.values())
        values = [entry["value"] for entry in entries if entry["value"] is not None]
        held = sum(bool(entry["holds"]) for entry in entries)
        rows.append(
            [
                title,
                _bars(entries),
                f"{held} of {len(entries)}",
                number(statistics.median(values)) if values else "",
                _worst(cases),
            ]
        )
    return table(["what", "bar", "held", "median", "worst case"], rows)


def _bars(entries: list[dict[str, Any]]) -> str:
    limits = sorted({entry["bar"] for entry in entries})
    unit = entries[0]["unit"].replace("|", "\\|")
    return f"{' or '.join(number(limit) for limit in limits)} {unit}"


def _worst(cases: dict[str, dict[str, Any]]) -> str:
    """The case whose value is furthest on the bad side of the median of all."""
    valued = {name: entry for name, entry in cases.items() if entry["value"] is not None}
    if len({entry["value"] for entry in valued.values()}) < 2:
        return "all alike"
    largest_is_good = _is_at_least(valued.values())
    choose = min if largest_is_good else max
    name = choose(valued, key=lambda case: valued[case]["value"])
    return f"{number(valued[name]['value'])} ({name})"


def _is_at_least(entries: Iterable[dict[str, Any]]) -> bool:
    """Whether a bar is a least value: some entry that holds lies above, or fails below it."""
    return any(
        (entry["holds"] and entry["value"] > entry["bar"])
        or (not entry["holds"] and entry["value"] < entry["bar"])
        or (entry["holds"] and entry["value"] == entry["bar"] == 1)
        for entry in entries
    )


def failures_table(results: Results) -> str:
    """Every case that misses a bar."""
    rows = []
    for bar, title in CASES.items():
        for name, entry in results.items():
            if name.startswith(f"core/{bar}/") and not entry["holds"]:
                case = name.rsplit("/", 1)[1]
                rows.append([title, case, number(entry["value"]), number(entry["bar"])])
    return table(["what", "case", "measured", "bar"], rows)


def speed_table(results: Results) -> str:
    """CPU time, memory and cancellation."""
    rows = [
        [title, f"{number(entry['value'])} {entry['unit']}", number(entry["bar"])]
        for name, title in (
            ("core/time/blebs-1024x512", "mask to topographic surface, 1024 × 512"),
            ("core/time/blebs-512x256", "mask to topographic surface, 512 × 256"),
            ("core/memory/blebs-1024x512", "most memory, 1024 × 512"),
            ("core/cancel/blebs-0", "slowest cancellation"),
        )
        if (entry := results.get(name)) is not None
    ]
    return table(["what", "measured", "bar"], rows)


def advection_table(results: Results) -> str:
    """The Poisson flow and the paper's advection side by side."""
    rows = []
    for name, entry in _group(results, "advection"):
        for method in ("poisson", "advection"):
            found = entry.get(method, {})
            rows.append(
                [
                    name,
                    "Poisson flow" if method == "poisson" else "advection",
                    number(found.get("iterations")),
                    number(found.get("log_lambda")),
                    number(found.get("flips")),
                    number(found.get("cpu_s")),
                    _times_less(entry) if method == "poisson" else "",
                ]
            )
    heads = [
        "cell",
        "method",
        "iterations",
        "mean \\|log λ\\|",
        "flipped",
        "CPU s",
        "less CPU (to the best)",
    ]
    return table(heads, rows)


def _times_less(entry: dict[str, Any]) -> str:
    """How many times less CPU, and so to the advection's best iteration."""
    return f"{number(entry['value'])} × ({number(entry.get('ratio_to_best'))} ×)"


def closeness_table(results: Results) -> str:
    """What the reference swallows of every simulated cell, and how far it is from the body."""
    rows = [
        [
            f"{name} {cell['seed']}",
            f"{100 * cell['inside']:.1f} %",
            f"{100 * entry['bar']:g} %",
            number(cell["distance_voxels"]),
            f"{cell['volume_percent']:+.1f} %",
        ]
        for name, entry in _group(results, "closeness")
        for cell in entry.get("cells", [])
    ]
    heads = ["cell", "swallowed", "authors'", "distance to the body (voxels)", "volume"]
    return table(heads, rows)


def references_table(results: Results) -> str:
    """The flow against the opened cell, the worst of each kind's simulated cells."""
    rows = []
    for method in ("flow", "cortex", "second_cortex"):
        for kind in PROTRUSION_KINDS:
            cells = results.get(f"protrusions/reference/{method}/{kind}", {}).get("cells", [])
            if cells:
                rows.append(
                    [
                        f"`{method}`",
                        kind,
                        number(max(cell["distance_voxels"] for cell in cells)),
                        f"{100 * max(cell['swallowed'] for cell in cells):.1f} %",
                        number(max(cell["mean_abs_log_lambda"] for cell in cells)),
                        number(max(cell["folded"] for cell in cells)),
                    ]
                )
    heads = [
        "`reference.method`",
        "cells",
        "distance (voxels)",
        "swallowed",
        "\\|log λ\\|",
        "folded",
    ]
    return table(heads, rows)


def protrusions_table(results: Results) -> str:
    """The worst of each kind's simulated cells, from the true mask and from the recording."""
    rows = []
    for title, (quantity, least) in PROTRUSION_NUMBERS.items():
        row = [title]
        for kind in PROTRUSION_KINDS:
            for suffix in ("", "-noisy"):
                names = [f"protrusions/{quantity}{suffix}/{kind}-{seed}" for seed in range(3)]
                values = [results[name]["value"] for name in names if name in results]
                worst = min(values) if least else max(values)
                row.append(number(worst))
        rows.append(row)
    heads = [f"{kind}{of}" for kind in PROTRUSION_KINDS for of in ("", ", noisy")]
    return table(["", *heads], rows)


def bars_table(start: str, names: tuple[str, ...], results: Results) -> str:
    """Every number with its bar, of the entries whose names begin like this."""
    begins = tuple(start + name for name in names) or start
    rows = [
        [
            name[len(start) :],
            f"{number(entry['value'])} {entry['unit']}".replace("|", "\\|"),
            number(entry["bar"]),
            "yes" if entry["holds"] else "**no**",
        ]
        for name, entry in sorted(results.items())
        if name.startswith(begins)
    ]
    return table(["what", "measured", "bar", "held"], rows)


def tracks_means_table(results: Results) -> str:
    """Errors of means over places, with and without the area elements as weights."""
    start = "tracks/mean/"
    percents = ("value", "over_the_poles", "median")
    plain = ("uncorrected", "uncorrected_over_the_poles", "uncorrected_median")
    rows = [
        [name[len(start) :], *(f"{100 * entry[key]:.2g} %" for key in (*percents, *plain))]
        for name, entry in sorted(results.items())
        if name.startswith(start)
    ]
    heads = ["error of the mean, worst place", "over the poles", "median"]
    heads += ["not weighed, worst", "over the poles", "median"]
    return table(["cell", *heads], rows)


def routes_table(results: Results) -> str:
    """Every route with the paper's figures beside it."""
    rows = []
    for route, title in ROUTES.items():
        entry = results.get(f"core/routes/{route}")
        if entry is None:
            continue
        paper = entry.get("paper", {})
        rows.append(
            [
                title,
                _beside(entry.get("chamfer_um"), paper.get("chamfer_um")),
                _beside(entry.get("sliced_wasserstein_um"), paper.get("sliced_wasserstein_um")),
                _above_noise(entry),
                _beside(
                    entry.get("area_difference_percent"), paper.get("area_difference_percent"), True
                ),
                number(entry.get("flips")),
                number(entry.get("log_lambda")),
                number(entry.get("mean_q")),
                number(entry.get("cpu_s")),
            ]
        )
    heads = ["route", "CD (µm)", "SW₁ (µm)", "SW₁ by area (µm)", "ΔA (%)"]
    heads += ["flipped", "\\|log λ\\|", "Q", "CPU s"]
    return table(heads, rows)


def _beside(ours: float | None, papers: float | None, signed: bool = False) -> str:
    """Our number, and the paper's in brackets."""
    found = number(ours, signed)
    return found if papers is None else f"{found} [{number(papers, signed)}]"


def _above_noise(entry: dict[str, Any]) -> str:
    """The distance between points drawn by area, and what it is for one and the same surface."""
    if "sliced_wasserstein_area_um" not in entry:
        return ""
    noise = number(entry["sliced_wasserstein_noise_um"])
    return f"{number(entry['sliced_wasserstein_area_um'])} (noise {noise})"


def _group(results: Results, bar: str) -> list[tuple[str, dict[str, Any]]]:
    start = f"core/{bar}/"
    return [(name[len(start) :], e) for name, e in results.items() if name.startswith(start)]


def machine_table(results: Results) -> str:
    """What the numbers were measured on."""
    return table(
        ["", ""], [[name, str(value)] for name, value in results.get("machine", {}).items()]
    )


def quality_table(_: Results) -> str:
    """The numbers that are judged, and their limits."""
    rows = []
    for (chart, name), limit in LIMITS.items():
        sign = "≥" if limit.least else "≤"
        rows.append(
            [
                chart,
                f"`{name}`",
                f"{limit.title}: {limit.meaning}".replace("|", "\\|"),
                f"{sign} {limit.green:g}",
                "any" if limit.amber >= 1e9 else f"{sign} {limit.amber:g}",
            ]
        )
    return table(["chart", "number", "meaning", "good", "fair"], rows)


def parameters_table(step: str) -> Callable[[Results], str]:
    """A table of the parameters of one step."""

    def made(_: Results) -> str:
        rows = []
        group = getattr(unwrap3d.Parameters(), step)
        for name, info in type(group).model_fields.items():
            extra = info.json_schema_extra or {}
            unit = f" {extra['unit']}" if extra.get("unit") else ""
            value = getattr(group, name)
            shown = "empty" if value is None else f"{_plain(value)}{unit}"
            source = extra.get("source", "")
            rows.append([f"`{step}.{name}`", shown, _escaped(info.description), _escaped(source)])
        return table(["parameter", "default", "what it does", "in the paper"], rows)

    return made


def columns_table(_: Results) -> str:
    """The columns of the table of protrusions."""
    rows = [
        [f"`{name}`", column.unit, _escaped(column.meaning)] for name, column in COLUMNS.items()
    ]
    return table(["column", "unit", "what it is"], rows)


def _plain(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value}"


def _escaped(text: str | None) -> str:
    return (text or "").replace("|", "\\|")


TABLES: dict[str, Callable[[Results], str]] = {
    "charts": charts_table,
    "failures": failures_table,
    "speed": speed_table,
    "advection": advection_table,
    "closeness": closeness_table,
    "references": references_table,
    "protrusions": protrusions_table,
    "movies": partial(bars_table, "movies/", ()),
    "tracks": partial(bars_table, "tracks/", ()),
    "tracks speeds": partial(bars_table, "tracks/", SPEEDS),
    "tracks means": tracks_means_table,
    "routes": routes_table,
    "machine": machine_table,
    "quality": quality_table,
    "protrusion columns": columns_table,
    **{f"parameters {step}": parameters_table(step) for step in unwrap3d.Parameters.model_fields},
}


# Writing ---------------------------------------------------------------------------------


def number(value: float | None, signed: bool = False) -> str:
    """Three significant digits; large counts as they are."""
    if value is None:
        return ""
    if isinstance(value, int) or abs(value) >= 1000:
        return f"{value:+.0f}" if signed else f"{value:.0f}"
    return f"{value:+.3g}" if signed else f"{value:.3g}"


def table(heads: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "".join("| " + " | ".join(cells) + " |\n" for cells in lines)


def filled(text: str, results: Results) -> str:
    """A page with its tables made anew."""
    return PLACE.sub(lambda m: f"{m[1]}\n{TABLES[m[2]](results)}\n{m[3]}", text)


def read_results() -> Results:
    return dict(json.loads(RESULTS.read_text("utf-8"))) if RESULTS.exists() else {}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    options = parser.parse_args()
    stale = write_pages(options.check)
    words = "not in step" if options.check else "written"
    print(f"{words}: {', '.join(stale) or 'none'}")
    return int(options.check and bool(stale))


def write_pages(check: bool = False) -> list[str]:
    """Bring the pages into step with the results, or only say which are not."""
    results = read_results()
    stale = []
    for page in sorted(PAGES.glob("*.md")):
        text = page.read_text("utf-8")
        made = filled(text, results)
        if made != text:
            stale.append(page.name)
            if not check:
                page.write_text(made, "utf-8")
    return stale


if __name__ == "__main__":
    sys.exit(main())
