"""Plots of measurements as files: as they are drawn, or the numbers behind them."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from ..errors import FileFormatError
from ..files.atomic import replacing
from ..files.tables import TABLE_SUFFIXES, write_table
from ..provenance import package_version
from .measurements import Measurements
from .plots import PAPER, PLOTS

FIGURE_SUFFIXES = (".svg", ".pdf", ".png")
INCHES = (4.5, 3.4)
DPI = 300


def write_plot(
    measurements: Measurements,
    name: str,
    path: str | Path,
    selection: Collection[int] = (),
    choice: str = "",
) -> Path:
    """Write a plot on white, or the numbers behind it.

    Parameters
    ----------
    measurements : Measurements
    name : str
        One of :data:`~napari_unwrap3d.measuring.plots.PLOTS`.
    path : path
        ``.svg``, ``.pdf`` (text stays text) or ``.png`` (300 dpi); ``.csv`` or ``.parquet`` of the
        numbers, with the units in the names of the columns.
    selection : collection of int
        Tracks that stand out, see :class:`~napari_unwrap3d.measuring.plots.PlotKind`.
    choice : str
        What is plotted, where there are several things.

    Raises
    ------
    FileFormatError
        The suffix is none of these.
    """
    path, kind = Path(path), PLOTS[name]
    suffix = path.suffix.lower()
    if suffix in TABLE_SUFFIXES:
        return write_table(path, kind.numbers(measurements, selection, choice))
    if suffix not in FIGURE_SUFFIXES:
        raise FileFormatError(
            f"{path.name!r} is no file of a plot.",
            hint=f"Known: {', '.join((*FIGURE_SUFFIXES, *TABLE_SUFFIXES))}.",
        )
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=INCHES, dpi=DPI, facecolor=PAPER["background"], layout="constrained")
    kind.draw(figure, measurements, selection, PAPER, choice)
    # Text that an illustrator can edit, and the same bytes for the same plot.
    fixed: Any = {"svg.fonttype": "none", "svg.hashsalt": name, "pdf.fonttype": 42}
    with replacing(path) as partial, matplotlib.rc_context(fixed):
        figure.savefig(partial, format=suffix[1:], metadata=_metadata(suffix, measurements, kind))
    return path


def _metadata(suffix: str, measurements: Measurements, kind: Any) -> dict[str, Any]:
    """What the plot is of, in the words that each format has for it; no date."""
    software = f"napari-unwrap3d {package_version()}"
    title = f"{kind.title} of {measurements.name}" if measurements.name else kind.title
    if suffix == ".svg":
        return {"Title": title, "Creator": software, "Date": None}
    if suffix == ".pdf":
        return {"Title": title, "Creator": software, "CreationDate": None}
    return {"Title": title, "Software": software}
