"""What the panels say about the steps: in words, marks and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...parameters import Parameters
from ...quality import Row, quality_rows, worst_mark
from .states import DONE, FAILED, NOT_READY, READY, RUNNING, STALE, StepState

DESCRIPTIONS = {
    "stack": "Finds the cell in the image.",
    "surface": "Makes a mesh of the cell.",
    "sealed": "Closes handles and holes, so that the cell can become a sphere.",
    "reference": "Smooths the protrusions away. What is left is the cortex, from which "
    "everything is measured.",
    "sphere": "Lays the reference on a sphere.",
    "uv": "Unwraps the sphere to an image, like a map of the earth.",
    "topography": "Measures the cell outwards and inwards from the reference.",
    "direct": "Lays the whole surface on one image, also under overhangs. Takes a while.",
    "plane": "Flattens the topographic surface (the paper's Step 7). Takes a while.",
    "protrusions": "Finds every bleb, lamellipodium and filopodium, and measures it.",
}

# What is shown first; "More" shows all.
MAIN = (
    "stack.timepoint",
    "stack.channel",
    "stack.label",
    "stack.smoothing_voxels",
    "stack.threshold",
    "surface.smoothing_voxels",
    "sealed.handles",
    "reference.stop",
    "reference.curvature_limit",
    "reference.fixed_iteration",
    "reference.extra_iterations",
    "sphere.blend",
    "uv.rows",
    "uv.axis_weight",
    "uv.axis_roll_degrees",
    "topography.depth_um",
    "topography.step_voxels",
    "direct.rows",
    "direct.registration",
    "plane.iterations",
    "protrusions.method",
    "protrusions.kind",
    "protrusions.threshold_um",
    "protrusions.least_height_um",
    "topographic.zero",
    "topographic.threshold",
    "topographic.threshold_um",
)
# Running the step asks for them.
IMPLIED = ("direct.compute", "plane.compute", "protrusions.compute")
# The parameter that says which group of parameters the protrusions have.
METHOD = "method"

# Why the table of protrusions does not hold, or there is none.
NO_CELL = "There is no unwrapped cell yet: unwrap one, or open a project."
NOT_FOUND = "Press Run to find and measure the protrusions of this cell."
FINDING = "Finding protrusions …"
OTHERS = "These protrusions belong to other parameters: press Run."
DELETED = "The annotation “protrusions” was deleted: undo that, or segment again."
POINT = "Its peaks do not part it: click a place in each of the two parts. Esc stops."

MARKS = {
    NOT_READY: ("◌", "not ready"),
    READY: ("○", "ready: press Run"),
    RUNNING: ("▶", "running"),
    DONE: ("●", "done"),
    STALE: ("◐", "belongs to other parameters: press Run"),
    FAILED: ("✕", "failed"),
}
COLOURS = {
    NOT_READY: "#9e9e9e",
    READY: "#9e9e9e",
    RUNNING: "#42a5f5",
    STALE: "#ffa000",
    FAILED: "#ef5350",
    "": "#4caf50",
    "green": "#4caf50",
    "amber": "#ffa000",
    "red": "#ef5350",
}

# What is shown in the panel; all numbers are in its tooltip.
NUMBERS: dict[str, dict[str, str]] = {
    "stack": {"volume_um3": "{:,.0f} µm³"},
    "surface": {"area_um2": "{:,.0f} µm²", "genus": "genus {}"},
    "sealed": {"sealed_parts": "{} closed", "genus": "genus {}"},
    "reference": {"iteration": "iteration {}", "genus": "genus {}"},
    "sphere": {"flipped_faces": "{} flips", "mean_abs_log_lambda": "|log λ| {:.4f}"},
    "uv": {"mean_q": "Q {:.3f}", "mean_abs_log_lambda": "|log λ| {:.4f}"},
    "topography": {"folded_cells": "{} folded", "chamfer_voxels": "Chamfer {:.2f} voxels"},
    "direct": {"flipped_faces": "{} flips", "mean_abs_log_lambda": "|log λ| {:.3f}"},
    "plane": {"flipped_faces": "{} flips", "covered_once_fraction": "{:.2%} covered once"},
    "protrusions": {
        "protrusions": "{} found",
        "kind": "kind: {}",
        "kind_reason": "{}",
        "parts_difference": "parts and whole differ by {:.2%}",
    },
}


def mark_of(name: str, step: StepState) -> tuple[str, str, str]:
    """Sign, colour and tooltip of a step's state; a done step is judged by its numbers."""
    sign, meaning = MARKS[step.state]
    if step.state != DONE:
        return sign, COLOURS[step.state], f"{meaning}\n{step.reason}".strip()
    rows = judged(name, step)
    lines = [meaning, *doubts(rows)] if doubts(rows) else [f"{meaning}; every number is good"]
    return sign, COLOURS[worst_mark(rows)], "\n".join(lines)


def status_of(name: str, step: StepState) -> str:
    """One or two lines: what a step waits for, what came of it, or why it failed."""
    if step.state in (NOT_READY, FAILED):
        return "" if step.brief else step.reason
    if step.state == STALE:
        return "What is shown belongs to other parameters."
    if step.state != DONE:
        return ""
    found = doubts(judged(name, step))
    return "\n".join([part for part in (key_numbers(name, step.quality), *found) if part])


def senseless(name: str, parameters: Parameters) -> list[str]:
    """The parameters of a step of which its method takes no notice."""
    if name != "protrusions":
        return []
    by_cortex = parameters.protrusions.method == "cortex"
    group = parameters.topographic if by_cortex else parameters.protrusions
    name = "topographic" if by_cortex else "protrusions"
    return [f"{name}.{parameter}" for parameter in type(group).model_fields if parameter != METHOD]


def judged(name: str, step: StepState) -> list[Row]:
    """The numbers of a step with their marks."""
    return quality_rows({name: step.quality})


def doubts(rows: list[Row]) -> list[str]:
    """Why a mark is not green."""
    return [
        f"{row.title}: {text(row.value)} ({row.reason})"
        for row in rows
        if row.mark in ("amber", "red")
    ]


def key_numbers(name: str, quality: Mapping[str, Any]) -> str:
    """The numbers of a step that a user looks at first, in one line."""
    return ", ".join(
        form.format(quality[key])
        for key, form in NUMBERS[name].items()
        if quality.get(key) is not None
    )


def all_numbers(name: str, step: StepState) -> str:
    """Every number of a step, a line each."""
    return "\n".join(f"{row.title}: {text(row.value)}" for row in judged(name, step))


def text(value: Any) -> str:
    """A number as it is read."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
