"""A child process per case, with a time limit and one thread: one crash does not end a run."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def options_of(
    parser: argparse.ArgumentParser, measure: Callable[..., Any], arguments: int = 0
) -> argparse.Namespace:
    """Parse the command line; a child of :func:`run_child` measures, answers and ends here.

    Parameters
    ----------
    measure : callable
        Takes what :func:`run_child` was given, as strings, and returns plain values.
    arguments : int
        How many those are.
    """
    parser.add_argument("--child", nargs=arguments + 1, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        *given, answer = options.child
        Path(answer).write_text(json.dumps(measure(*given), default=_plain), "utf-8")
        sys.exit()
    return options


def _plain(value: Any) -> Any:
    """numpy's numbers as Python's, and what else there is as text."""
    return value.item() if hasattr(value, "item") else str(value)


def run_child(
    script: str, *arguments: str, limit_s: float, core: int | list[int] | None = None
) -> Any:
    """Run ``script --child ARGUMENTS FILE`` and return what it wrote into FILE as JSON.

    Parameters
    ----------
    core : int or list of int, optional
        The cores that the child is held to; the package uses as many threads.

    Returns
    -------
    object or str
        A string says why there is nothing: the time limit, or the last words of a crash.
    """
    cores = [core] if isinstance(core, int) else core
    environment = os.environ | dict.fromkeys(ONE_THREAD, "1")
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        command = [sys.executable, script, "--child", *arguments, str(answer)]
        try:
            child = subprocess.run(
                command,
                env=environment,
                timeout=limit_s,
                stderr=subprocess.PIPE,
                text=True,
                check=False,
                preexec_fn=None if cores is None else lambda: os.sched_setaffinity(0, cores),
            )
        except subprocess.TimeoutExpired:
            return f"stopped after the limit of {limit_s:.0f} s"
        if child.returncode != 0 or not answer.exists():
            words = child.stderr.strip().splitlines()[-1:] or ["no message"]
            return f"ended with code {child.returncode}: {words[0]}"
        return json.loads(answer.read_text(encoding="utf-8"))
