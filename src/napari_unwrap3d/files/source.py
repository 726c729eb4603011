"""What a cell was unwrapped from, kept in its project so that steps can be run again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..charts import Mask, Stack, Surface
from ..errors import FileFormatError

GROUP = "source"
LARGEST_BYTES = 2 * 2**30


def kept_source(source: Stack | Mask | Surface | None, timepoint: int = 0) -> Any:
    """What of a source goes into a project: of a movie, the timepoint that was unwrapped.

    Parameters
    ----------
    source : Stack, Mask or Surface, optional
    timepoint : int
        Of a stack with a t axis.

    Returns
    -------
    Stack, Mask or Surface, or None
        None for a stack of more than 2 GiB (:data:`LARGEST_BYTES`), which stays where it is.
    """
    if not isinstance(source, Stack):
        return source
    data = source.data[timepoint] if "t" in source.axes else source.data
    if int(np.prod(data.shape)) * np.dtype(data.dtype).itemsize > LARGEST_BYTES:
        return None
    axes = source.axes.replace("t", "")
    return replace(source, data=np.ascontiguousarray(data), axes=axes, time_step=None)


def checked_source(source: Any) -> Stack | Mask | Surface:
    """The source of a file, which need not be trusted.

    Raises
    ------
    FileFormatError
        It is something else.
    """
    if not isinstance(source, Stack | Mask | Surface):
        raise FileFormatError(
            "The project's source is no stack, mask or mesh.",
            type=type(source).__name__,
            hint="The file is damaged: get it anew from its sender.",
        )
    return source
