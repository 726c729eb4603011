"""A report of measurements: one HTML file with all panels and numbers, and the tables beside it."""

from __future__ import annotations

import html
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.atomic import write_json, write_text
from ..provenance import environment
from .plot_kinds import PAPER
from .plots import PLOTS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from .measurements import Measurements

REPORT, NUMBERS, SETTINGS = "report.html", "numbers.json", "parameters.toml"
PANEL_INCHES = (4.6, 3.2)
TALL_INCHES = (4.6, 6.0)
TALL = ("aligned",)
# Bare enough to be read in any viewer, with nothing loaded from elsewhere.
STYLE = """
body { font: 15px/1.5 sans-serif; color: #222; margin: 2em auto; max-width: 1100px; padding: 0 1em }
h1 { font-size: 1.6em; margin-bottom: 0 } h2 { font-size: 1.15em; margin: 1.6em 0 .3em }
.panels { display: flex; flex-wrap: wrap; gap: 1.5em } figure { margin: 0; max-width: 520px }
figcaption { font-size: .87em; color: #555 } svg { max-width: 100%; height: auto }
table { border-collapse: collapse; font-size: .9em }
td, th { padding: .15em .8em; text-align: left; border-bottom: 1px solid #ddd }
td + td { font-variant-numeric: tabular-nums } pre { font-size: .8em; overflow-x: auto }
"""


def write_report(
    measurements: Measurements,
    folder: str | Path,
    *,
    title: str = "",
    pictures: Mapping[str, Figure] | None = None,
    choices: Mapping[str, Iterable[str]] | None = None,
) -> Path:
    """Write a report of measurements.

    ``report.html`` holds every panel as SVG, the numbers and the parameters in one file that
    needs no other. Beside it are the numbers behind every panel (``<panel>.csv``), all tables
    (``tables/<name>.csv``), ``numbers.json`` and ``parameters.toml``.

    Parameters
    ----------
    measurements : Measurements
    folder : path
        Made if it is not there.
    title : str
        The movie's name unless given.
    pictures : mapping of str to matplotlib Figure, optional
        Further panels by their captions, before the others.
    choices : mapping of str to iterable of str, optional
        Which of a plot's choices are drawn, by the plot's name; the first unless given.

    Returns
    -------
    Path
        Of the HTML file.
    """
    path = Path(folder)
    (path / "tables").mkdir(parents=True, exist_ok=True)
    panels = [_panel(svg_of(figure), caption) for caption, figure in (pictures or {}).items()]
    panels += _plot_panels(measurements, path, choices or {})
    for name, table in measurements.tables.items():
        _write_csv(table, path / "tables" / f"{name}.csv")
    write_json(path / NUMBERS, measurements.numbers)
    write_text(path / SETTINGS, measurements.parameters.to_toml())
    write_text(path / REPORT, _page(measurements, title or measurements.name, panels))
    return path / REPORT


def svg_of(figure: Figure) -> str:
    """A figure as SVG to be put into a page; the same figure gives the same text."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "unwrap3d", "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def plot_figure(measurements: Measurements, name: str, choice: str = "") -> Figure:
    """One of the plots on paper, as a figure of its own.

    Raises
    ------
    KeyError
        There is no plot of this name.
    """
    from matplotlib.figure import Figure

    size = TALL_INCHES if name in TALL else PANEL_INCHES
    figure = Figure(figsize=size, layout="constrained", facecolor=PAPER["background"])
    PLOTS[name].draw(figure, measurements, (), PAPER, choice)
    return figure


def _plot_panels(
    measurements: Measurements, path: Path, choices: Mapping[str, Iterable[str]]
) -> list[str]:
    panels = []
    for name, kind in PLOTS.items():
        why = kind.missing(measurements)
        if why:
            panels.append(f"<p><b>{kind.title}</b>: {html.escape(why)}</p>")
            continue
        for choice in tuple(choices.get(name, ())) or ("",):
            file = f"{name}-{choice}.csv" if choice else f"{name}.csv"
            _write_csv(kind.numbers(measurements, (), choice), path / file)
            caption = f"{kind.title}. {kind.meaning} Numbers: {file}"
            panels.append(_panel(svg_of(plot_figure(measurements, name, choice)), caption))
    return panels


def _panel(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _page(measurements: Measurements, title: str, panels: list[str]) -> str:
    made = ", ".join(f"{name} {version}" for name, version in environment().items())
    numbers = "".join(_rows(measurements.numbers))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>\n"
        f"<h1>{html.escape(title)}</h1>\n"
        f"<p>{html.escape(_in_words(measurements))}</p>\n"
        f'<div class="panels">{"".join(panels)}</div>\n'
        f"<h2>Numbers</h2>\n<table>{numbers}</table>\n"
        f"<h2>Parameters</h2>\n<pre>{html.escape(measurements.parameters.to_toml())}</pre>\n"
        f"<h2>Made with</h2>\n<p>{html.escape(made)}</p>\n</body></html>\n"
    )


def _in_words(measurements: Measurements) -> str:
    tracks = measurements.tracks
    method = f" ({tracks.method})" if tracks.method else ""
    return (
        f"{len(tracks.ids)} tracks{method} over {tracks.timepoints} timepoints, "
        f"every {tracks.time_step_s:g} s."
    )


def _rows(numbers: Mapping[str, Any], before: str = "") -> Iterable[str]:
    """Rows of a table of numbers; what holds others gives a row for each of them."""
    for name, value in numbers.items():
        if name == "made_with":
            continue
        if isinstance(value, Mapping):
            yield from _rows(value, f"{before}{name} ")
            continue
        shown = f"{value:.4g}" if isinstance(value, float) else _listed(value)
        label = html.escape(f"{before}{name}".replace("_", " "))
        yield f"<tr><td>{label}</td><td>{html.escape(shown)}</td></tr>"


def _listed(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(f"{one:.4g}" if isinstance(one, float) else str(one) for one in value)
    return "–" if value is None else str(value)


def _write_csv(table: pd.DataFrame, path: Path) -> None:
    write_text(path, table.to_csv(index=False, lineterminator="\n"))
