"""What a plot of measurements is, and how all of them look."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from ..motion.uv_stacks import field_label

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from .measurements import Measurements

TRACK_GID = "track-"
# On paper; the window passes those of its theme.
PAPER: Mapping[str, str] = {"background": "#ffffff", "text": "#222222", "secondary": "#9a9a9a"}
# Dark enough on white and light enough on black (Wong 2011, doi:10.1038/nmeth.1618).
LINE, OTHER, THIRD, MARK = "#2b8cbe", "#e69f00", "#cc79a7", "#d55e00"
CHOSEN = ("#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#0072b2")
FAINT = 0.35
FONT = 8.0
# Ends of the names of columns, the longest first, and the unit that each says.
UNITS = {
    "_um_per_min": "µm/min",
    "_per_um2": "1/µm²",
    "_per_um": "1/µm",
    "_um3": "µm³",
    "_um2": "µm²",
    "_um": "µm",
    "_px": "pixels",
    "_s": "s",
}


class Draw(Protocol):
    """Draws into an empty figure or part of one."""

    def __call__(
        self,
        figure: Figure | SubFigure,
        measurements: Measurements,
        selection: Collection[int],
        colours: Mapping[str, str],
        choice: str,
    ) -> None: ...


@dataclass(frozen=True)
class PlotKind:
    """One kind of plot of measurements, for the window and for reports.

    Attributes
    ----------
    title : str
    meaning : str
        What is seen, in one sentence.
    draw : callable(figure, measurements, selection, colours, choice)
        Draws into an empty matplotlib figure or subfigure. `selection` are the tracks that stand
        out; where there is none, all are alike. `colours` are "background", "text" and
        "secondary", by default :data:`PAPER`. `choice` is one of `choices`, or empty for the
        first. Curves of single tracks can be picked; :func:`track_of` says which it is.
    numbers : callable(measurements, selection, choice) -> DataFrame
        The numbers behind what is drawn, with units in the names of the columns.
    choices : callable(measurements) -> tuple of str
        What can be plotted, such as the columns of the series; empty where there is one thing.
    missing : callable(measurements) -> str
        Why there is nothing to draw, in words for the user; empty where there is something.
    """

    title: str
    meaning: str
    draw: Draw
    numbers: Callable[[Measurements, Collection[int], str], pd.DataFrame]
    choices: Callable[[Measurements], tuple[str, ...]]
    missing: Callable[[Measurements], str]


def column_label(name: str) -> str:
    """What a person reads for a column of measurements, with its unit."""
    for side in ("on", "off"):
        if name.startswith(f"{side}_"):
            inner = column_label(name.removeprefix(f"{side}_"))
            return f"{inner[:1].lower()}{inner[1:]}, {side} the protrusion".capitalize()
    if name.startswith("signal_") or name == "mean_curvature_per_um":
        return field_label(name)
    for end, unit in UNITS.items():
        if name.endswith(end):
            return f"{name.removesuffix(end).replace('_', ' ').capitalize()} ({unit})"
    return name.replace("_", " ").capitalize()


def track_of(artist: Any) -> int | None:
    """The track that a picked artist belongs to, or None."""
    gid = artist.get_gid()
    known = isinstance(gid, str) and gid.startswith(TRACK_GID)
    return int(gid.removeprefix(TRACK_GID)) if known else None


def styled(axes: Axes, colours: Mapping[str, str], x: str, y: str, title: str = "") -> Axes:
    """Axes with only the lines that are needed, in the given colours."""
    text, line = colours["text"], colours["secondary"]
    axes.set_facecolor(colours["background"])
    axes.tick_params(colors=text, labelsize=FONT - 1, length=2)
    axes.set_xlabel(x, fontsize=FONT, color=text, labelpad=2)
    axes.set_ylabel(y, fontsize=FONT, color=text, labelpad=2)
    if title:
        axes.set_title(title, fontsize=FONT, color=text, pad=3, loc="left", wrap=True)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(line)
    return axes


def legend(axes: Axes, colours: Mapping[str, str]) -> None:
    """A legend without a frame, where the axes have something to explain."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=FONT - 1, frameon=False, labelcolor=colours["text"], handlelength=1.4)
