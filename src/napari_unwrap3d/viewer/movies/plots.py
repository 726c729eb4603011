"""Plots of a movie over time, in napari's colours: drift, what leaves the space, volume and area.

A click goes to the timepoint under it; a line shows which one is in the views.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import Signal
from qtpy.QtWidgets import QWidget

from ..steps.plots import CHOSEN, FONT, LINE, Plot

if TYPE_CHECKING:
    import pandas as pd

    from ...charts import Floats
    from ..session import Session

ROW_HEIGHT = 105
COLOURS = (LINE, "#66bb6a", "#ef5350", "#ab47bc")
# Columns of the table of the registration, and what they are called.
SHIFTS = {"shift_z_um": "z", "shift_y_um": "y", "shift_x_um": "x"}


@dataclass(frozen=True)
class Row:
    """One pair of axes: curves of one quantity over time.

    Attributes
    ----------
    title : str
        With the unit.
    curves : mapping of str to ndarray, (T,)
        By name; NaN where nothing is known.
    limit : float or None
        A level that should not be exceeded.
    """

    title: str
    curves: Mapping[str, Floats]
    limit: float | None = None


class TimePlot(Plot):
    """Curves over time in one or more rows.

    Signals
    -------
    picked(int)
        A timepoint was clicked.
    """

    picked = Signal(int)

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(session, parent)
        self.times_s: Floats = np.zeros(0)
        self.rows: list[Row] = []
        self.timepoint: int | None = None
        self._lines: list[Any] = []
        self.setToolTip("Click to see that timepoint.")

    def show_rows(self, times_s: Floats, rows: Sequence[Row]) -> None:
        """Draw curves over time (T,) in s; rows without a finite value are left out."""
        known = [row for row in rows if any(np.isfinite(c).any() for c in row.curves.values())]
        self.times_s, self.rows = np.asarray(times_s, float), known
        self.setVisible(bool(known))
        if known:
            self.setFixedHeight(ROW_HEIGHT * len(known) + 12)
            self.redraw()

    def show_timepoint(self, timepoint: int | None) -> None:
        """Show which timepoint is in the views."""
        self.timepoint = timepoint
        for line in self._lines:
            line.set_visible(timepoint is not None)
            if timepoint is not None:
                line.set_xdata([self._time(timepoint)] * 2)
        if self.canvas is not None:
            self.canvas.draw_idle()

    def _time(self, timepoint: int) -> float:
        return float(self.times_s[min(timepoint, len(self.times_s) - 1)])

    def _on_canvas(self) -> None:
        self.canvas.mpl_connect("button_press_event", self._on_press)

    def _on_press(self, event: Any) -> None:
        if event.inaxes is not None and event.button == 1 and event.xdata is not None:
            self.picked.emit(int(np.abs(self.times_s - event.xdata).argmin()))

    def _draw(self, colours: dict[str, str]) -> None:
        every = self.figure.subplots(len(self.rows), 1, sharex=True, squeeze=False)[:, 0]
        self._lines = []
        for axes, row in zip(every, self.rows, strict=True):
            for (name, curve), colour in zip(row.curves.items(), COLOURS, strict=False):
                axes.plot(
                    self.times_s, curve, color=colour, marker=".", markersize=4, linewidth=1,
                    label=name,
                )  # fmt: skip
            if row.limit is not None:
                axes.axhline(row.limit, color=COLOURS[2], linewidth=1, linestyle="--")
            self.style(axes, colours, row.title, "left")
            axes.locator_params(axis="y", nbins=4)
            if len(row.curves) > 1:
                self._name_curves(axes, row, colours)
            self._lines.append(axes.axvline(self.times_s[0], color=CHOSEN, linewidth=1))
        every[-1].set_xlabel("s", fontsize=FONT, color=colours["text"], labelpad=1)
        self.show_timepoint(self.timepoint)

    @staticmethod
    def _name_curves(axes: Any, row: Row, colours: dict[str, str]) -> None:
        legend = axes.legend(
            fontsize=FONT,
            frameon=False,
            loc="upper right",
            bbox_to_anchor=(1.0, 1.25),
            ncols=len(row.curves),
            handlelength=1.0,
            borderpad=0.0,
        )
        for text in legend.get_texts():
            text.set_color(colours["text"])


def drift_rows(table: pd.DataFrame) -> list[Row]:
    """Of :meth:`Movie.registration_table`: shift, angle, and what the registration left."""
    shifts = {name: column(table, which) for which, name in SHIFTS.items() if which in table}
    rows = [Row("shift (µm)", shifts)] if shifts else []
    angle = column(table, "angle_deg")
    if (np.nan_to_num(angle) != 0).any():
        rows.append(Row("angle (°)", {"angle": angle}))
    left = {
        "before": column(table, "residual_before"),
        "after": column(table, "residual"),
    }
    return [*rows, Row("residual (1 − correlation)", left)]


def outside_rows(record: Mapping[str, Any], table: pd.DataFrame | None, limit: float) -> list[Row]:
    """Which share of every timepoint's surface leaves the space: estimated, and measured.

    Parameters
    ----------
    record : mapping
        Of the common space.
    table : DataFrame or None
        :meth:`Movie.check_table`, where frames were made.
    limit : float
        The share that may leave it.
    """
    advice = record.get("recommendation", {})
    curves: dict[str, Floats] = {
        method: 100.0 * np.asarray(shares, dtype=np.float64)
        for method, shares in advice.get("outside", {}).items()
    }
    if table is not None:
        measured = 100.0 * column(table, "outside_fraction")
        if np.isfinite(measured).any():
            curves["measured"] = measured
    return [Row("surface outside (%)", curves, 100.0 * limit)]


def size_rows(table: pd.DataFrame) -> list[Row]:
    """Of :meth:`Movie.check_table`: volume and area over time."""
    return [
        Row("volume (µm³)", {"volume": column(table, "volume_um3")}),
        Row("area (µm²)", {"area": column(table, "area_um2")}),
    ]


def column(table: pd.DataFrame, name: str) -> Floats:
    """A column as numbers; NaN where it has none, or is not there."""
    if name not in table:
        return np.full(len(table), np.nan)
    return np.asarray(table[name].astype(float), dtype=np.float64)
