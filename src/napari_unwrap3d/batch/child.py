"""A batch in a process of its own, which tells the one that began it how it goes.

``python -m napari_unwrap3d.batch.child REQUEST.json`` writes one JSON object a line:
``{"kind": "plan" | "progress" | "rows" | "result" | "error", …}``. It is cancelled by a line on
its standard input, or by the end of that.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from ..errors import Cancelled, Unwrap3DError
from ..parameters import Parameters
from ..progress import Progress
from .inputs import Reading
from .memory import GB
from .planning import Plan, plan_batch
from .result import Row, in_words
from .running import run_plan

REPORT_SECONDS = 0.2


class Request(BaseModel):
    """What a batch is asked for.

    Attributes
    ----------
    inputs : list of str
        Files, folders and patterns.
    output : str
        The folder for what is made; the parameters are written into it.
    parameters : str
        TOML text.
    reading : Reading
    timelapse : bool
        The files are the timepoints of one movie.
    every_label : bool
        Stacks are label images: one atlas, or one movie, for each label.
    track, measure : bool
        Of movies; see :func:`~napari_unwrap3d.batch.run_batch`.
    workers : int or None
    memory_gb : float or None
        Of each worker.
    plan_only : bool
        Say what would be done, and do nothing.
    """

    model_config = ConfigDict(extra="forbid")

    inputs: list[str]
    output: str
    parameters: str
    reading: Reading = Reading()
    timelapse: bool = False
    every_label: bool = False
    track: bool = False
    measure: bool = False
    workers: int | None = None
    memory_gb: float | None = None
    plan_only: bool = False

    @property
    def parameters_path(self) -> Path:
        """Where the parameters are written."""
        return Path(self.output) / "parameters.toml"

    def command(self) -> list[str]:
        """The words of the equivalent command line."""
        words = ["napari-unwrap3d", "batch", *self.inputs]
        words += ["--params", str(self.parameters_path), "-o", self.output]
        words += ["--timelapse"] * self.timelapse + ["--mask"] * self.reading.mask
        words += ["--labels", "all"] if self.every_label else []
        words += ["--track"] * (self.track and not self.measure) + ["--measure"] * self.measure
        if self.reading.time_step is not None:
            words += ["--time-step", f"{self.reading.time_step:.10g}"]
        if self.reading.voxel_size is not None:
            words += ["--voxel-size", *(f"{size:.10g}" for size in self.reading.voxel_size)]
        words += [] if self.workers is None else ["--workers", str(self.workers)]
        return words + ([] if self.memory_gb is None else ["--memory", f"{self.memory_gb:.10g}"])


def run(request: Request, send: Any, progress: Progress) -> None:
    """Plan, say so, and run; `send` gets every message as a dict.

    Raises
    ------
    Unwrap3DError, OSError
        As :func:`~napari_unwrap3d.batch.run_batch`.
    """
    plan = plan_batch(
        request.inputs,
        Parameters.from_toml(request.parameters),
        request.output,
        reading=request.reading,
        timelapse=request.timelapse,
        labels="all" if request.every_label else None,
        track=request.track,
        measure=request.measure,
        workers=request.workers,
        memory_gb=request.memory_gb,
        progress=progress.named("plan"),
    )
    send({"kind": "plan", "text": described(plan)})
    if request.plan_only:
        return
    request.parameters_path.parent.mkdir(parents=True, exist_ok=True)
    request.parameters_path.write_text(request.parameters, encoding="utf-8")
    told: dict[int, dict[str, Any]] = {}

    def watch(rows: list[Row]) -> None:
        now = {place: asdict(row) for place, row in enumerate(rows)}
        news = [[place, row] for place, row in now.items() if told.get(place) != row]
        told.update(now)
        if news:
            send({"kind": "rows", "rows": news})

    result = run_plan(plan, progress, watch)
    watch(list(result.rows))
    send({"kind": "result", "text": in_words(result.counts), "failed": len(result.failed)})


def described(plan: Plan) -> str:
    """What will be done, with which workers and how much memory."""
    lines = [f"{plan.in_words}."]
    lines += [f"Cannot be opened: {row.name}: {row.reason}" for row in plan.failed]
    if plan.crew is not None:
        lines.append(f"{plan.crew}.")
    elif plan.estimates:
        lines.append(f"The largest item is estimated to take {max(plan.estimates) / GB:.1f} GB.")
    return "\n".join(lines)


def main(path: str) -> int:
    """Run a request from a file; 0 unless it failed as a whole."""
    lock = threading.Lock()

    def send(message: dict[str, Any]) -> None:
        with lock:
            sys.stdout.write(json.dumps(message) + "\n")
            sys.stdout.flush()

    last = [0.0]

    def report(stage: str, fraction: float, message: str) -> None:
        now = time.monotonic()
        if now - last[0] >= REPORT_SECONDS or fraction >= 1.0:
            last[0] = now
            send({"kind": "progress", "stage": stage, "fraction": fraction, "text": message})

    progress = Progress(report)
    threading.Thread(target=_cancel_when_told, args=(progress,), daemon=True).start()
    try:
        request = Request.model_validate_json(Path(path).read_text(encoding="utf-8"))
        run(request, send, progress)
    except Cancelled:
        text = "Stopped. What was made stays: start again to go on from there."
        send({"kind": "error", "text": text, "cancelled": True})
        return 1
    except (Unwrap3DError, OSError) as error:
        send({"kind": "error", "text": str(error), "cancelled": False})
        return 1
    return 0


def _cancel_when_told(progress: Progress) -> None:
    sys.stdin.readline()
    progress.cancel()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
