"""The pieces of work of one job, handed out as soon as what they need is there."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..files.movie import MovieFolder
from ..motion.stages import stages
from .jobs import PROTRUSIONS, Job
from .result import Row
from .worker import CELL, Done

# These need nothing of other timepoints: one piece of work.
TOGETHER = ("register", "segment")
FRAME = "frame"


@dataclass
class Piece:
    """One piece of work: stages of one timepoint, one after the other."""

    stages: tuple[str, ...]
    timepoint: int
    serial: bool = False
    tries: int = 0

    @property
    def named(self) -> str:
        """For the log."""
        where = "" if self.serial else f" {self.timepoint}"
        return f"{' and '.join(self.stages)}{where}"


@dataclass(frozen=True)
class Failure:
    """Why a piece of work was not done."""

    stage: str
    reason: str
    log: str = ""


@dataclass
class Task:
    """A single cell.

    Attributes
    ----------
    job : Job
    ready : deque of Piece
        What can be done now.
    rows : list of Row
    path, digest : str
        Of the file that tells workers what the job is.
    """

    job: Job
    path: str
    digest: str
    ready: deque[Piece] = field(default_factory=deque)
    rows: list[Row] = field(default_factory=list)
    finished: int = 0

    @property
    def pieces(self) -> int:
        """How many pieces of work there are, as far as that is known."""
        return 1

    def new_rows(self) -> list[Row]:
        """A row for each item, of which nothing was done."""
        return [self._row()]

    def begin(self) -> None:
        """Get ready; called before the first piece is taken."""
        self.rows = self.new_rows()
        self.ready.append(Piece((CELL,), 0))

    def keys(self, piece: Piece) -> dict[int, str]:
        """What is known of the sources that a piece needs."""
        return {}

    def take(self, piece: Piece, outcome: Done | Failure) -> None:
        """Note what came of a piece, and see what can be done now."""
        self.finished += 1
        row = self.rows[0]
        row.stage = CELL
        _note(row, outcome)
        if isinstance(outcome, Done):
            row.state = "done" if outcome.made[CELL] else "skipped"

    def _row(self, timepoint: int | None = None, stage: str = "") -> Row:
        return Row(self.job.name, self.job.file, self.job.label, timepoint, stage)


@dataclass
class MovieTask(Task):
    """A movie: stages in order, the timepoints of one stage at the same time.

    After the frames there may be more stages, see :attr:`.Job.further`. What needs one that
    failed is not tried; the frames stay.
    """

    _known: dict[int, str] = field(default_factory=dict)
    _outstanding: int = 0
    _lost: set[int] = field(default_factory=set)
    _made: set[int] = field(default_factory=set)
    _broken: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        assert self.job.timepoints is not None
        self._groups = list(groups(self.job.timepoints, self.job.further))
        several = [place for place, (_, which) in enumerate(self._groups) if len(which) > 1]
        self._last = several[-1]

    @property
    def pieces(self) -> int:
        lost = len(self._lost)
        per_group = (
            1 if len(timepoints) == 1 else max(len(timepoints) - lost * (place > 0), 0)
            for place, (names, timepoints) in enumerate(self._groups)
            if self._missing(names[-1]) is None
        )
        return max(sum(per_group), self.finished)

    def new_rows(self) -> list[Row]:
        serial = [names[-1] for names, timepoints in self._groups if len(timepoints) == 1]
        timepoints = range(self.job.timepoints or 0)
        return [*(self._row(None, name) for name in serial), *(self._row(t) for t in timepoints)]

    def begin(self) -> None:
        self._folder = MovieFolder(Path(self.job.folder))
        self.job.movie().begin()
        self.rows = self.new_rows()
        self._serial = {row.stage: row for row in self.rows if row.timepoint is None}
        self._timepoints = self.rows[len(self._serial) :]
        self._place = -1
        self._next()

    def keys(self, piece: Piece) -> dict[int, str]:
        if piece.stages[-1] in self.job.further:
            return {}
        if piece.serial:
            return dict(self._known)
        return {t: self._known[t] for t in (0, piece.timepoint) if t in self._known}

    def take(self, piece: Piece, outcome: Done | Failure) -> None:
        self.finished += 1
        self._outstanding -= 1
        row = self._serial[piece.stages[-1]] if piece.serial else self._timepoints[piece.timepoint]
        row.stage = piece.stages[-1]
        _note(row, outcome)
        if isinstance(outcome, Done):
            self._done(piece, row, outcome)
        elif piece.stages[-1] in self.job.further:
            self._break(piece, outcome)
        elif piece.serial:
            self._lose_all(outcome)
        else:
            self._lose(piece.timepoint, outcome)
        if self._outstanding == 0:
            self._next()

    def _done(self, piece: Piece, row: Row, done: Done) -> None:
        made = any(done.made.values())
        if piece.serial:
            row.state = "done" if made else "skipped"
            return
        if done.source_key is not None:
            self._known[piece.timepoint] = done.source_key
        if made:
            self._made.add(piece.timepoint)
        if self._place == self._last:
            row.state = "done" if piece.timepoint in self._made else "skipped"
        if piece.stages[-1] == FRAME:
            self._folder.drop_failure(piece.timepoint)

    def _lose(self, timepoint: int, failure: Failure) -> None:
        """Go on without a timepoint."""
        self._lost.add(timepoint)
        self._folder.keep_failure(timepoint, failure.stage, failure.reason)

    def _lose_all(self, failure: Failure) -> None:
        """Without the common space there is no frame."""
        reason = f"The stage {failure.stage!r} of the movie failed: {failure.reason}"
        for timepoint, row in enumerate(self._timepoints):
            if timepoint not in self._lost:
                row.stage, row.state, row.reason = failure.stage, "failed", reason
                self._lose(timepoint, Failure(failure.stage, reason))

    def _break(self, piece: Piece, failure: Failure) -> None:
        """Go on without what needs a stage after the frames that failed."""
        stage = piece.stages[-1]
        where = "of the movie" if piece.serial else f"of timepoint {piece.timepoint}"
        self._broken.setdefault(stage, f"The stage {stage!r} {where} failed: {failure.reason}")

    def _missing(self, stage: str) -> str | None:
        """Why a stage after the frames cannot be done; None where it can."""
        reasons = (self._broken.get(needed) for needed in self.job.needed(stage))
        return next(filter(None, reasons), None)

    def _leave_out(self, stage: str, reason: str) -> None:
        """Go on without a stage that cannot be done."""
        self._broken[stage] = reason
        rows = [self._serial[stage]] if stage in self._serial else self._timepoints
        for row in rows:
            if row.state == "left":
                row.stage, row.state, row.reason = stage, "failed", reason
        self._next()

    def _next(self) -> None:
        """Hand out the next stage."""
        self._place += 1
        if self._place == len(self._groups):
            return
        names, timepoints = self._groups[self._place]
        missing = self._missing(names[-1])
        if missing is not None:
            self._leave_out(names[-1], missing)
            return
        left = [t for t in range(len(self._timepoints)) if t not in self._lost]
        if not left:
            for row in self._serial.values():
                if row.state == "left":
                    row.state = "failed"
                    row.reason = "No timepoint is left: see why each of them failed."
            return
        if len(timepoints) == 1:
            self.ready.append(Piece(names, 0, serial=True))
        else:
            self.ready.extend(Piece(names, timepoint) for timepoint in left)
        self._outstanding = len(self.ready)


def groups(
    timepoints: int, further: Sequence[str] = ()
) -> Iterator[tuple[tuple[str, ...], Sequence[int]]]:
    """The stages that are done together, and the timepoints of each group.

    Parameters
    ----------
    timepoints : int
    further : sequence of str
        Stages after the frames, see :attr:`.Job.further`.
    """
    waiting: list[str] = []
    for stage, which in stages(timepoints):
        if stage in TOGETHER:
            waiting.append(stage)
            together: Sequence[int] = which
            continue
        if waiting:
            yield tuple(waiting), together
            waiting = []
        yield (stage,), which
    if waiting:
        yield tuple(waiting), together
    for later in further:
        yield (later,), range(timepoints if later == PROTRUSIONS else 1)


def task_of(job: Job, output: Path) -> Task:
    """The task of a job, whose file is written for the workers."""
    path, digest = job.save(output)
    kind = Task if job.timepoints is None else MovieTask
    return kind(job, path, digest)


def _note(row: Row, outcome: Done | Failure) -> None:
    if isinstance(outcome, Failure):
        row.state, row.reason = "failed", outcome.reason
        row.stage = outcome.stage or row.stage
        return
    row.seconds = round(row.seconds + outcome.seconds, 3)
    row.peak_memory_gb = max(row.peak_memory_gb, round(outcome.peak_bytes / 1e9, 3))
    row.measure(outcome.numbers)
