"""Keeps the workers of a batch busy, and notes what comes of every piece of work."""

from __future__ import annotations

import queue
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from ..errors import Unwrap3DError
from ..progress import POLL_SECONDS, Progress
from .cluster import slots
from .memory import GB
from .result import Row, in_words
from .tasks import Failure, Piece, Task
from .worker import Done, run_piece

if TYPE_CHECKING:
    from distributed import Client, Future

LOG = "log"


@dataclass
class Driver:
    """Hands pieces of work to workers, as many as they can do at a time.

    Pieces name files, and no more of them wait on the cluster than it has workers for: a movie
    may be as long as it likes. The jobs come in their order, and where one has nothing that can
    be done now, as its common space is built, the next ones go on.
    """

    tasks: list[Task]
    output: Path
    client: Client
    retries: int
    report: Progress
    limit_bytes: float
    before: tuple[Row, ...] = ()
    watch: Callable[[list[Row]], None] | None = None
    _flying: dict[Any, tuple[Task, Piece]] = field(default_factory=dict)
    _answers: queue.Queue[Any] = field(default_factory=queue.Queue)
    _begun: int = 0

    def run(self) -> None:
        """Do everything that can be done.

        Raises
        ------
        Cancelled
            The user asked to stop.
        """
        self._tell()
        self._fill()
        while self._flying:
            self.report.check()
            try:
                future = self._answers.get(timeout=POLL_SECONDS)
            except queue.Empty:
                self._check_cluster()
                continue
            self._take(future)
            self._fill()
            self._tell()

    @property
    def rows(self) -> list[Row]:
        """Of all items, also those that are not begun."""
        found = list(self.before)
        for task in self.tasks:
            found += task.rows or task.new_rows()
        return found

    def counts(self) -> dict[str, int]:
        """How many items are done, failed and left."""
        states = [row.state for row in self.rows]
        return {state: states.count(state) for state in ("done", "skipped", "failed", "left")}

    # Giving ------------------------------------------------------------------------

    def _fill(self) -> None:
        free = slots(self.client) - len(self._flying)
        for task, piece in self._ready(free):
            self._submit(task, piece)

    def _ready(self, count: int) -> Iterator[tuple[Task, Piece]]:
        """What can be done now: what the others of a movie wait for, then in order of the jobs."""
        for _ in range(count):
            serial = (task for task in self.tasks if task.ready and task.ready[0].serial)
            task = next(serial, None) or next((t for t in self.tasks if t.ready), None)
            while task is None and self._begun < len(self.tasks):
                self._begin()
                task = next((t for t in self.tasks if t.ready), None)
            if task is None:
                return
            yield task, task.ready.popleft()

    def _begin(self) -> None:
        task = self.tasks[self._begun]
        self._begun += 1
        try:
            task.begin()
        except (Unwrap3DError, OSError) as error:
            task.ready.clear()
            task.rows = [Row(task.job.name, task.job.file, task.job.label)]
            task.rows[0].stage, task.rows[0].state = "open", "failed"
            task.rows[0].reason = str(error)

    def _submit(self, task: Task, piece: Piece) -> None:
        piece.tries += 1
        future = self.client.submit(
            run_piece,
            task.path,
            task.digest,
            piece.stages,
            piece.timepoint,
            task.keys(piece),
            key=f"unwrap3d-{uuid4().hex}",
            pure=False,
        )
        self._flying[future.key] = task, piece
        future.add_done_callback(self._answers.put)

    # Taking ------------------------------------------------------------------------

    def _take(self, future: Future[Any]) -> None:
        task, piece = self._flying.pop(future.key)
        if future.status == "finished":
            outcome: Done | Failure = future.result()
        elif future.status == "error":
            outcome = self._failure(future, task, piece)
        elif piece.tries <= self.retries:  # the scheduler lost it
            task.ready.appendleft(piece)
            return
        else:
            outcome = Failure("", f"The scheduler lost it {piece.tries} times.")
        future.release()
        self._log(task, piece, outcome)
        task.take(piece, outcome)

    def _failure(self, future: Future[Any], task: Task, piece: Piece) -> Failure:
        from distributed import KilledWorker

        error = future.exception()
        stage = str(getattr(error, "stage", "") or piece.stages[-1])
        log = str(getattr(error, "log", ""))
        if isinstance(error, KilledWorker):
            return Failure(stage, _killed(error, self.limit_bytes))
        if isinstance(error, MemoryError):
            return Failure(stage, f"A worker's memory was not enough. {error}".strip(), log)
        if isinstance(error, Unwrap3DError):
            return Failure(stage, str(error), log)
        trace = "".join(traceback.format_exception(error))
        return Failure(stage, f"{type(error).__name__}: {error}", f"{log}\n{trace}".strip())

    def _check_cluster(self) -> None:
        if self.client.status in ("closed", "closing"):
            raise Unwrap3DError(
                "The scheduler of the batch is gone.",
                hint="Run the same command again: what was done is not done again.",
            )

    # Telling -----------------------------------------------------------------------

    def _tell(self) -> None:
        total = sum(task.pieces if task.rows else 1 for task in self.tasks)
        done = sum(task.finished for task in self.tasks)
        if self.watch is not None:
            self.watch(self.rows)
        self.report(done / total if total else 1.0, in_words(self.counts()))

    def _log(self, task: Task, piece: Piece, outcome: Done | Failure) -> None:
        folder = self.output / LOG
        folder.mkdir(parents=True, exist_ok=True)
        if isinstance(outcome, Failure):
            lines = [f"== {piece.named}: failed in {outcome.stage}: {outcome.reason}"]
        else:
            made = "done" if any(outcome.made.values()) else "there already"
            peak = f"{outcome.peak_bytes / GB:.2f} GB"
            lines = [f"== {piece.named}: {made} in {outcome.seconds:.2f} s, {peak}"]
        with (folder / f"{task.job.name}.log").open("a", encoding="utf-8") as file:
            file.write("\n".join([*lines, *filter(None, [outcome.log])]) + "\n")


def _killed(error: Any, limit_bytes: float) -> str:
    times = int(getattr(error, "allowed_failures", 0)) + 1
    limit = f" (its limit is {limit_bytes / GB:.1f} GB)" if limit_bytes else ""
    return (
        f"Its worker's process ended {times} times while it worked on it, most often because it "
        f"took more memory than a worker may{limit}. Give workers more memory (--workers 1, "
        "--memory GB), or choose a larger working voxel or a crop."
    )
