"""The list of the steps: a mark, the time, and the numbers that say how good each chart is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import QGridLayout, QLabel, QWidget

from ..pipeline import STEP_NAMES
from ..quality import quality_rows, worst_mark
from .session import DONE, FAILED, READY, RUNNING, STALE, StepState

TITLES = {
    "stack": "Stack",
    "surface": "Surface",
    "sealed": "Sealed surface",
    "reference": "Reference",
    "sphere": "Sphere",
    "uv": "uv",
    "topography": "Topography",
    "plane": "Plane",
}

MARKS = {
    READY: ("○", "not computed yet"),
    RUNNING: ("▶", "running"),
    DONE: ("●", "done"),
    STALE: ("◐", "belongs to other parameters; press Run"),
    FAILED: ("✕", "failed"),
}
COLOURS = {
    READY: "#9e9e9e",
    RUNNING: "#42a5f5",
    STALE: "#ffa000",
    FAILED: "#ef5350",
    "": "#4caf50",
    "green": "#4caf50",
    "amber": "#ffa000",
    "red": "#ef5350",
}

# What is shown in the list; all numbers are in the tooltip.
NUMBERS: dict[str, dict[str, str]] = {
    "stack": {"volume_um3": "{:,.0f} µm³"},
    "surface": {"area_um2": "{:,.0f} µm²", "genus": "genus {}"},
    "sealed": {"sealed_parts": "{} closed", "genus": "genus {}"},
    "reference": {"iteration": "iteration {}", "genus": "genus {}"},
    "sphere": {"flipped_faces": "{} flips", "mean_abs_log_lambda": "|log λ| {:.4f}"},
    "uv": {"mean_q": "Q {:.3f}", "mean_abs_log_lambda": "|log λ| {:.4f}"},
    "topography": {"folded_cells": "{} folded", "chamfer_voxels": "Chamfer {:.2f}"},
}


class StepList(QWidget):
    """A row per step."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(2)
        grid.setColumnStretch(3, 1)
        self.rows: dict[str, tuple[QLabel, QLabel, QLabel]] = {}
        for row, name in enumerate(STEP_NAMES):
            mark, seconds, numbers = QLabel(), QLabel(), QLabel()
            seconds.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            for column, label in enumerate((mark, QLabel(TITLES[name]), seconds, numbers)):
                grid.addWidget(label, row, column)
            self.rows[name] = (mark, seconds, numbers)

    def show_states(self, steps: Mapping[str, StepState]) -> None:
        """Show how far every step is, and how good its chart."""
        for name, (mark, seconds, numbers) in self.rows.items():
            step = steps[name]
            sign, meaning = MARKS[step.state]
            done = step.state == DONE
            rows = quality_rows({name: step.quality}) if done else []
            mark.setText(sign)
            mark.setStyleSheet(f"color: {COLOURS[worst_mark(rows) if done else step.state]};")
            doubts = [f"{row.title}: {row.reason}" for row in rows if row.mark in ("amber", "red")]
            mark.setToolTip("\n".join([meaning, *doubts]))
            seconds.setText(f"{step.seconds:.1f} s" if done and step.seconds is not None else "")
            numbers.setText(key_numbers(name, step.quality) if done else "")
            numbers.setToolTip("\n".join(f"{row.title}: {_text(row.value)}" for row in rows))


def key_numbers(step: str, quality: Mapping[str, Any]) -> str:
    """The numbers of a step that a user looks at first, in one line."""
    return ", ".join(
        form.format(quality[key])
        for key, form in NUMBERS[step].items()
        if quality.get(key) is not None
    )


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
