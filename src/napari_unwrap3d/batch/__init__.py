"""Many cells and movies at once: timepoints × cells × files on many workers.

Everything that is made is a file that appears when it is complete, with the key of what it
was made from. The same batch again therefore does what is missing and nothing else, also after
its workers, or all of it, were killed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .inputs import Reading
    from .jobs import Exports
    from .planning import Plan, plan_batch
    from .result import BatchResult, Row
    from .running import run_batch, run_plan

# Workers import this package before they have a cache for kernels: the rest waits.
_LAZY = {
    "BatchResult": "result",
    "Exports": "jobs",
    "Plan": "planning",
    "Reading": "inputs",
    "Row": "result",
    "plan_batch": "planning",
    "run_batch": "running",
    "run_plan": "running",
}

__all__ = [
    "BatchResult",
    "Exports",
    "Plan",
    "Reading",
    "Row",
    "plan_batch",
    "run_batch",
    "run_plan",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_LAZY[name]}", __name__), name)
    globals()[name] = value
    return value
