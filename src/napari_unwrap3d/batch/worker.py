"""What a worker does: one piece of work of one job, and what there is to say about it.

Nothing of ours but the caches' locks is imported before the worker has a cache of its own
for compiled kernels.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import glob
import logging
import os
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any

from .locks import held, user_cache

if TYPE_CHECKING:
    from ..motion.movie import Movie
    from ..motion.stages import MovieWork
    from .jobs import Job

CELL = "cell"
# Of a movie whose frames are there.
FURTHER = ("alike", "protrusions", "tracks", "measurements")
LARGEST_LOG = 20_000
# The one movie that this process worked on last: its common space is read once.
_opened: dict[str, Any] = {}
_holding: list[IO[bytes]] = []


@dataclass
class Done:
    """What came of a piece of work.

    Attributes
    ----------
    made : dict of str to bool
        Stage → whether it was made now; False where it was there.
    numbers : dict
        ``volume_um3``, ``area_um2``, ``outside_fraction``, ``protrusions``, ``tracks``, as far
        as they are known.
    source_key : str or None
        Hash of the timepoint's source, so that no one needs to read it again.
    seconds : float
    peak_bytes : int
        The process's largest memory meanwhile; where the system does not tell, so far.
    log : str
    """

    made: dict[str, bool] = field(default_factory=dict)
    numbers: dict[str, Any] = field(default_factory=dict)
    source_key: str | None = None
    seconds: float = 0.0
    peak_bytes: int = 0
    log: str = ""


def run_piece(
    path: str, digest: str, stages: Sequence[str], timepoint: int, keys: Mapping[int, str]
) -> Done:
    """Do one piece of work.

    Parameters
    ----------
    path, digest : str
        Of the job; see :meth:`.jobs.Job.save`.
    stages : sequence of str
        One after the other, of one timepoint.
    timepoint : int
    keys : mapping of int to str
        The hashes of sources that are known.

    Raises
    ------
    Unwrap3DError
        It could not be done. The error's notes hold the log, and ``stage`` says where.
    """
    prepare()
    start = time.perf_counter()
    give_back()
    reset_peak()
    with Log() as log:
        if stages[0] == CELL:
            done = _cell(path)
        elif stages[0] in FURTHER:
            done = _further(path, digest, stages[0], timepoint, log)
        else:
            done = _timepoint(path, digest, stages, timepoint, keys, log)
    done.log = log.text()
    done.seconds = time.perf_counter() - start
    done.peak_bytes = peak_bytes()
    return done


def _cell(path: str) -> Done:
    from .cells import unwrap_cell
    from .jobs import Job

    _let_go()
    made, numbers = unwrap_cell(Job.load(path))
    return Done({CELL: made}, numbers)


def _timepoint(
    path: str,
    digest: str,
    stages: Sequence[str],
    timepoint: int,
    keys: Mapping[int, str],
    log: Log,
) -> Done:
    from ..progress import silent

    work = _movie(path, digest)
    work.know(keys)
    done = Done()
    for stage in stages:
        log.stage = stage
        done.made[stage] = work.run(stage, timepoint, silent())  # type: ignore[arg-type]
    done.numbers = work.folder.numbers(stages[-1], timepoint)
    done.source_key = work.known(timepoint)
    return done


def _further(path: str, digest: str, stage: Any, timepoint: int, log: Log) -> Done:
    from .jobs import Job
    from .movies import make

    log.stage = stage
    job = Job.load(path)
    made, numbers = make(stage, _unwrapped(job, digest, stage), timepoint, job)
    return Done({stage: made}, numbers)


def _movie(path: str, digest: str) -> MovieWork:
    from .jobs import Job

    work: MovieWork = _kept(digest, lambda: Job.load(path).movie())
    return work


def _unwrapped(job: Job, digest: str, stage: str) -> Movie:
    """The movie as its folder holds it now."""
    from ..files.movie import MovieFolder
    from ..motion.movie import load_movie

    if stage != "protrusions":
        # What was drawn in it since is not known to one that is open.
        _let_go()
    common = MovieFolder(Path(job.folder)).common() or {}
    movie: Movie = _kept(f"{digest} {common.get('key')}", lambda: load_movie(job.folder))
    return movie


def _kept(name: str, open_it: Callable[[], Any]) -> Any:
    """What this process has opened under a name; another one is let go."""
    found = _opened.get(name)
    if found is None:
        _let_go()
        found = _opened[name] = open_it()
    return found  # a worker of a cluster may have several threads


def _let_go() -> None:
    """Close what is open."""
    _opened.clear()
    gc.collect()
    give_back()


def look_around(token: str) -> dict[str, str]:
    """What the one who gives the work wants to know before: the version, and a common disk."""
    from ..provenance import package_version

    return {
        "version": package_version(),
        "host": socket.gethostname(),
        "sees": "yes" if Path(token).is_file() else "no",
    }


# The log -----------------------------------------------------------------------------


class Log(logging.Handler):
    """Keeps what the package logs meanwhile; an error takes it along in its notes."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        self.lines: list[str] = []
        self.stage = ""

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(self.format(record))

    def text(self) -> str:
        """The last lines."""
        return "\n".join(self.lines)[-LARGEST_LOG:]

    def __enter__(self) -> Log:
        logger = logging.getLogger("napari_unwrap3d")
        logger.addHandler(self)
        if logger.getEffectiveLevel() > logging.INFO:
            logger.setLevel(logging.INFO)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        logging.getLogger("napari_unwrap3d").removeHandler(self)
        if error is not None:
            error.__dict__["stage"] = self.stage
            error.__dict__["log"] = self.text()


# The process -------------------------------------------------------------------------


def prepare() -> None:
    """Make the process ready for its first piece of work; it stays so."""
    if _holding:
        return
    _holding.append(own_kernel_cache())
    import dask

    # Lazy images are read here: by default a worker hands that to the scheduler and waits,
    # with another piece of work in between.
    dask.config.set(scheduler="synchronous")


# Kernels -----------------------------------------------------------------------------


def own_kernel_cache() -> IO[bytes]:
    """Give this process a cache for compiled kernels that no other process writes to.

    Two that write may take one name for two versions of a kernel. What the user's own cache
    holds is copied; later workers go on with the same one.

    Returns
    -------
    file
        Holds the cache for as long as it is open.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    base = Path(given) if given else user_cache() / "numba"
    number = 0
    lock = None
    while lock is None:
        folder = base / "batch" / f"{socket.gethostname()}-{number}"
        lock = held(folder.with_suffix(".lock"))
        number += 1
    if given:
        _take_over(base, folder)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return lock


def _take_over(cache: Path, own: Path) -> None:
    """Copy the kernels that one cache has and the other has not, or has of an earlier time."""
    for index in cache.rglob("*.nbi"):
        place = index.relative_to(cache)
        target = own / place
        if place.parts[0] == "batch":
            continue
        if target.exists() and target.stat().st_mtime >= index.stat().st_mtime:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        # An index names its versions by number: first those, then the index.
        for version in index.parent.glob(f"{glob.escape(index.stem)}.*.nbc"):
            shutil.copy2(version, target.with_name(version.name))
        shutil.copy2(index, target)


# Memory ------------------------------------------------------------------------------


def give_back() -> None:
    """Have the allocator return what is free to the system, where it can.

    Otherwise what an earlier piece of work took comes on top of what this one takes. To have it
    always do so (``MALLOC_TRIM_THRESHOLD_``) costs a fifth of the time.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # of another C library
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def reset_peak() -> None:
    """Have the system count the largest memory of this process anew, where it can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_bytes() -> int:
    """The largest memory of this process since :func:`reset_peak`, or ever."""
    for line in _status():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    try:
        import resource
    except ImportError:  # Windows
        import psutil

        return int(psutil.Process().memory_info().peak_wset)  # type: ignore[attr-defined, unused-ignore]
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _status() -> Iterator[str]:
    with contextlib.suppress(OSError):
        yield from Path("/proc/self/status").read_text(encoding="ascii").splitlines()
