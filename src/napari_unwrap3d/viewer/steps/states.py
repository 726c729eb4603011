"""How far every step is, and what a user can do about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ...parameters import Parameters
from ...pipeline import ON_REQUEST, STEP_NAMES, Pipeline

STEPS = (*STEP_NAMES, *(step.name for step in ON_REQUEST))

NOT_READY, READY, RUNNING = "not ready", "ready", "running"
DONE, STALE, FAILED = "done", "stale", "failed"
STATES = {"done": DONE, "stale": STALE, "missing": READY}

TITLES = {
    "stack": "Stack",
    "surface": "Surface",
    "sealed": "Sealed surface",
    "reference": "Reference",
    "sphere": "Sphere",
    "uv": "uv",
    "topography": "Topography",
    "direct": "Direct",
    "plane": "Plane",
    "protrusions": "Protrusions",
}
# A step whose parameters are several groups.
GROUPS = {"protrusions": ("protrusions", "topographic", "refinement")}


@dataclass
class StepState:
    """How far a step is.

    Attributes
    ----------
    state : str
        "not ready" (something is missing; `reason` says what), "ready" (never run),
        "running", "done", "stale" (what is shown belongs to other parameters) or "failed"
        (`reason` says why).
    seconds : float or None
        What the last computation took; None before it.
    quality : mapping
        The numbers of ``atlas.quality`` for this step.
    reason : str
    brief : str
        The reason in a word or two, where it is no fault of this step.
    """

    state: str = READY
    seconds: float | None = None
    quality: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    brief: str = ""


def pipeline_states(
    pipeline: Pipeline | None, parameters: Parameters, blocked: str
) -> dict[str, StepState]:
    """The state of every step for these parameters; `blocked` says why none can run."""
    known = {} if pipeline is None else pipeline.state(parameters)
    states: dict[str, StepState] = {}
    for name in STEPS:
        kept = None if pipeline is None else pipeline.kept.get(name)
        step = StepState(STATES[known.get(name, "missing")])
        if kept is not None:
            step.seconds, step.quality = kept.seconds, kept.numbers
        if step.state == READY:
            missing = _missing(name, states)
            if blocked:
                step.state, step.reason, step.brief = NOT_READY, blocked, "no cell yet"
            elif missing:
                step.state = NOT_READY
                step.brief = f"after {TITLES[missing]}"
                step.reason = f"needs {TITLES[missing]} first; Run computes that, too"
        states[name] = step
    return states


def states_now(
    states: Mapping[str, StepState],
    problems: Mapping[str, str],
    failed: tuple[str, str] | None,
    running: str,
) -> dict[str, StepState]:
    """The states of the steps, with what is wrong and what goes on.

    Parameters
    ----------
    states : mapping
        As of :func:`pipeline_states`; a step that runs is marked in it.
    problems : mapping
        Group of parameters → what of it is out of range.
    failed : (str, str) or None
        The step that failed last, and why.
    running : str
        The step that runs; empty if none does.
    """
    now = dict(states)
    for group, problem in problems.items():
        now[step_of(group)] = StepState(NOT_READY, reason=problem)
    if failed is not None and failed[0] in now:
        step, reason = failed
        now[step] = StepState(FAILED, reason=reason)
    if running:
        now[running].state = RUNNING
    return now


def _missing(name: str, states: Mapping[str, StepState]) -> str:
    """The first earlier step without a result; the steps on request need all others."""
    earlier = STEP_NAMES[: STEP_NAMES.index(name)] if name in STEP_NAMES else STEP_NAMES
    return next((each for each in earlier if states[each].state in (READY, NOT_READY)), "")


def groups_of(step: str) -> tuple[str, ...]:
    """The groups of parameters of a step."""
    return GROUPS.get(step, (step,))


def step_of(group: str) -> str:
    """The step that a group of parameters belongs to."""
    return next((step for step, groups in GROUPS.items() if group in groups), group)


def first_open_step(states: Mapping[str, StepState]) -> str:
    """The first step whose result is missing or belongs to other parameters."""
    return next((name for name in STEP_NAMES if states[name].state != DONE), "")
