"""The workers: processes on this machine, or those of a dask cluster that the user has."""

from __future__ import annotations

import logging
import multiprocessing
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from ..errors import InputError
from ..geometry.parallel import THREADS_VARIABLE
from ..provenance import package_version
from .memory import GB, Crew
from .worker import look_around

if TYPE_CHECKING:
    from distributed import Client

LOOPBACK = "127.0.0.1"
WAIT_SECONDS = 60
# Sums in these libraries depend on the number of their threads: one, for the same result
# with any number of workers.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS",
)
# Python tells of what a process that was ended could not tidy; the system does it.
NO_TIDYING = "ignore::UserWarning:multiprocessing.resource_tracker"
# A terminal's Ctrl-C reaches all of its processes: the batch itself ends the workers.
NO_INTERRUPTS = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


@contextmanager
def local(crew: Crew, retries: int) -> Iterator[Client]:
    """Workers on this machine, each a process that does one piece of work at a time.

    Raises
    ------
    InputError
        This is not the main program but one that it has started.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError(
            "A batch was started while Python imports the program for a worker.",
            hint='Start it under `if __name__ == "__main__":`.',
        )
    import dask
    from distributed import Client, LocalCluster

    environment: dict[str, str] = dict.fromkeys(ONE_THREAD, "1")
    environment |= {THREADS_VARIABLE: str(crew.threads), "NUMBA_NUM_THREADS": str(crew.threads)}
    warnings = filter(None, [os.environ.get("PYTHONWARNINGS"), NO_TIDYING])
    environment["PYTHONWARNINGS"] = ",".join(warnings)
    settings = {
        # Nothing is kept between pieces, so that there is nothing to spill, and pausing would
        # not free memory; what remains is that a worker is ended before the machine is full.
        "distributed.worker.memory.target": False,
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.pause": False,
        "distributed.worker.memory.terminate": 0.95,
        "distributed.nanny.pre-spawn-environ": environment,
        # Compiled code may hold a worker's other threads up for minutes.
        "distributed.scheduler.worker-ttl": None,
        "distributed.admin.tick.limit": "1h",
    }
    with (
        dask.config.set(settings),
        _environment(environment),
        LocalCluster(
            n_workers=crew.workers,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            memory_limit=int(crew.memory_bytes),
            dashboard_address=f"{LOOPBACK}:0",
            silence_logs=logging.CRITICAL,
            preload=[NO_INTERRUPTS],
            scheduler_kwargs={"allowed_failures": retries},
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


@contextmanager
def existing(address: str, output: Path) -> Iterator[Client]:
    """The workers of a cluster that runs already.

    Raises
    ------
    InputError
        There is no scheduler or no worker, or a worker does not see the output folder.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=WAIT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"No dask scheduler answers at {address!r} ({error}).",
            hint="Start one with `dask scheduler`, and workers with `dask worker`.",
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WAIT_SECONDS)
        except TimeoutError as error:
            raise InputError(
                f"The scheduler {address!r} has no workers.",
                waited_s=WAIT_SECONDS,
                hint="Start some with `dask worker`.",
            ) from error
        check_workers(client, output)
        yield client


def check_workers(client: Client, output: Path) -> None:
    """Raise unless all workers have this version and see the output folder."""
    token = output / f".look-{uuid4().hex}"
    token.touch()
    try:
        found = client.run(look_around, str(token))
    finally:
        token.unlink(missing_ok=True)
    version = package_version()
    others = sorted({each["version"] for each in found.values()} - {version})
    if others:
        raise InputError(
            "Workers have another version of napari-unwrap3d.",
            here=version,
            there=", ".join(others),
            hint="Install the same version everywhere.",
        )
    blind = sorted({each["host"] for each in found.values() if each["sees"] != "yes"})
    if blind:
        raise InputError(
            "Workers do not see the output folder.",
            hosts=", ".join(blind),
            output=str(output),
            hint="Choose a folder on a disk that all of them share.",
        )


def slots(client: Client) -> int:
    """How many pieces of work are done at the same time."""
    threads: dict[str, int] = client.nthreads()
    return max(1, sum(threads.values()))


def memory_bytes(client: Client) -> float:
    """What the worker with the least memory has for each piece of work; 0 without a limit."""
    workers: dict[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    limits = [float(each["memory_limit"]) / each["nthreads"] for each in workers.values()]
    return min([limit for limit in limits if limit > 0], default=0.0)


def check_memory(client: Client, largest: float) -> str:
    """The workers of a cluster and their memory, in words.

    Raises
    ------
    InputError
        The largest piece of work does not fit into the worker with the least memory.
    """
    limit = memory_bytes(client)
    if 0 < limit < largest:
        raise InputError(
            "The workers of the cluster have not enough memory for each of their threads.",
            needed_gb=largest / GB,
            least_gb=limit / GB,
            hint="Start workers with one thread (--nthreads 1) or with more memory "
            "(--memory-limit), or choose a larger working voxel, a crop or fewer uv.rows.",
        )
    known = f"{limit / GB:.1f} GB or more" if limit else "no limit of memory"
    return (
        f"{slots(client)} pieces of work at a time with {known} for each; the largest item is "
        f"estimated to take {largest / GB:.1f} GB"
    )


@contextmanager
def _environment(names: dict[str, str]) -> Iterator[None]:
    """Set what workers, and Python's helper of their processes, inherit; undone afterwards."""
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(names)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
