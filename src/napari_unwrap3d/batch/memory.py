"""How much memory a piece of work takes, and how many workers therefore fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..parameters import Parameters
from .inputs import Looked

GB = 1e9
# Fitted to the peak of a process that unwraps a blebbing cell and writes its files, with boxes of
# 128³ and 192³ voxels, 64 to 1024 rows, and 20 000 and 120 000 vertices of the reference (0.86 to
# 4.1 GB, within 10 %): a worker with our libraries and the fields of a small cell; bytes per vertex
# of the reference; per sample (d, u, v); per voxel of the working grid; and per byte of a
# timepoint's image, which is held as floating-point numbers, and twice while it is registered.
BASE_BYTES = 0.75 * GB
PER_VERTEX = 3000.0
PER_SAMPLE = 21.0
PER_VOXEL = 20.0
PER_SOURCE_BYTE = 4.0
# The same of a worker that finds protrusions and measures tracks, fitted to boxes of 72³ to 192³
# voxels and 64 to 512 rows (0.66 to 1.5 GB, of which it says up to a fifth too much).
PER_VOXEL_FOUND = 60.0
# Layers of a topography with steps of half a voxel, by the edge of the grid in voxels.
LAYERS, LAYERS_PER_VOXEL, USUAL_STEP = 35.0, 0.25, 0.5
# What a cell fills of the box around it, where only its number of voxels is known.
FILLED = 0.2
# The part of the free memory that workers may take, and of a worker's that an item may.
USABLE = 0.85
HEADROOM = 0.9


@dataclass(frozen=True)
class Crew:
    """How many workers do the work, and what each of them may take.

    Attributes
    ----------
    workers, threads : int
        Processes, and threads within each.
    memory_bytes : float
        Of each; a worker that takes more is ended by its nurse.
    free_bytes, largest_item_bytes : float
        What there was, and what the largest piece of work is estimated to take.
    """

    workers: int
    threads: int
    memory_bytes: float
    free_bytes: float
    largest_item_bytes: float

    def __str__(self) -> str:
        return (
            f"{self.workers} worker{'s' * (self.workers != 1)} × {self.memory_bytes / GB:.1f} GB, "
            f"of {self.free_bytes / GB:.1f} GB free; the largest item is estimated to take "
            f"{self.largest_item_bytes / GB:.1f} GB"
        )


def estimate(
    looked: Looked,
    parameters: Parameters,
    cell_voxels: int | None = None,
    protrusions: bool = False,
) -> float:
    """The peak memory in bytes of a worker that unwraps a cell.

    Parameters
    ----------
    looked : Looked
    parameters : Parameters
    cell_voxels : int, optional
        Voxels of the cell in the source, where they are known: of a label.
    protrusions : bool
        Whether its protrusions are found, too.
    """
    chosen = parameters.stack
    size = np.asarray(looked.voxel_size)
    edge = chosen.working_voxel_um or float(size.min())
    shape = np.asarray(looked.shape, float)
    if chosen.crop_voxels is not None:
        crop = np.asarray(chosen.crop_voxels).reshape(3, 2)
        shape = np.minimum(shape, np.diff(crop, axis=1)[:, 0])
    elif chosen.crop_um is not None:
        extent = np.diff(np.asarray(chosen.crop_um).reshape(3, 2), axis=1)[:, 0]
        shape = np.minimum(shape, np.ceil(extent / size))
    voxels = float(np.prod(np.maximum(shape, 1)))
    if cell_voxels is not None:
        voxels = min(voxels, cell_voxels / FILLED)
    voxels *= float(np.prod(size)) / edge**3
    layers = (LAYERS + LAYERS_PER_VOXEL * float(np.cbrt(voxels))) * USUAL_STEP
    samples = 2 * parameters.uv.rows**2 * layers / parameters.topography.step_voxels
    unwrapped = (
        BASE_BYTES
        + PER_VERTEX * parameters.reference.vertices
        + PER_SAMPLE * samples
        + PER_VOXEL * voxels
        + PER_SOURCE_BYTE * looked.source_bytes
    )
    found = BASE_BYTES + PER_SAMPLE * samples + PER_VOXEL_FOUND * voxels
    return max(unwrapped, found) if protrusions else unwrapped


def free_bytes() -> float:
    """Memory that this machine, container or job still has."""
    import psutil
    from distributed.system import MEMORY_LIMIT

    return float(min(psutil.virtual_memory().available, MEMORY_LIMIT))


def crew(
    largest: float,
    pieces: int,
    workers: int | None = None,
    threads: int | None = None,
    memory_gb: float | None = None,
    free: float | None = None,
) -> Crew:
    """How many workers fit.

    Parameters
    ----------
    largest : float
        Bytes that the largest piece of work is estimated to take.
    pieces : int
        That can be done at the same time: more workers would idle.
    workers, threads : int, optional
        As many as there are cores, and as many in each as there are cores for it.
    memory_gb : float, optional
        Of each worker, instead of an equal part of what is free.
    free : float, optional
        Bytes; by default what this machine has.

    Raises
    ------
    InputError
        Not even one worker fits, or not the memory that was asked for.
    """
    from dask.system import CPU_COUNT

    free = free_bytes() if free is None else free
    usable = USABLE * free
    needed = largest / HEADROOM if memory_gb is None else memory_gb * GB
    fitting = math.floor(usable / needed)
    if fitting < 1:
        raise InputError(
            "There is not enough memory for one worker.",
            needed_gb=needed / GB,
            usable_gb=usable / GB,
            free_gb=free / GB,
            hint="Choose a larger working voxel (stack.working_voxel_um), a crop or fewer uv.rows; "
            "close other programs; or, if you know better, say how much a worker may take "
            "(--memory GB).",
        )
    wanted = CPU_COUNT if workers is None else workers
    count = max(1, min(wanted, fitting, max(pieces, 1)))
    each = usable / count if memory_gb is None else memory_gb * GB
    within = max(1, CPU_COUNT // count) if threads is None else threads
    return Crew(count, within, each, free, largest)
