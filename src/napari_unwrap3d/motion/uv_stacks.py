"""The uv images of a movie one after the other, and what its fields are called."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..charts import Frame
from ..errors import ParameterError
from ..fields import KNOWN
from ..progress import Progress, silent
from .frames import AREA
from .movie import Movie
from .signals import PREFIX

Images = npt.NDArray[np.float32]

TITLES = {
    "gaussian_curvature": ("Gaussian curvature, integrated", "rad"),
    AREA: ("Area of a pixel dA", "µm²"),
}


def field_label(name: str) -> str:
    """What a person reads for a field of a movie, with its unit."""
    if name.startswith(PREFIX):
        return f"Signal {name.removeprefix(PREFIX)}"
    title, unit = TITLES.get(name) or KNOWN.get(name, (name.replace("_", " "), ""))
    return f"{title} ({unit})" if unit else title


def field_names(movie: Movie) -> tuple[str, ...]:
    """The fields that the first frame has which is there, or is made now; none without any."""
    first = next((t for t in range(len(movie)) if movie.has_frame(t)), None)
    if first is None:
        return movie.fields if movie.work is not None else ()
    return tuple(movie.frame(first).uv)


def check_field(movie: Movie, name: str) -> None:
    """Raise :class:`ParameterError` unless the movie has a field."""
    names = field_names(movie)
    if name not in names:
        raise ParameterError(f"There is no field {name!r}.", hint=f"Fields: {', '.join(names)}.")


def made_frames(
    movie: Movie, progress: Progress | None = None, *, make: bool = True
) -> Iterator[tuple[int, Frame | None]]:
    """Every timepoint and its frame, one in memory at a time.

    Parameters
    ----------
    movie : Movie
    progress : Progress, optional
    make : bool
        Whether frames that are not there are made, where the source is known; None else.
    """
    report = progress or silent()
    for timepoint in range(len(movie)):
        report(timepoint / len(movie), f"timepoint {timepoint}")
        there = (make and movie.work is not None) or movie.has_frame(timepoint)
        yield timepoint, movie.frame(timepoint) if there else None


@dataclass(frozen=True, eq=False)
class UvStacks:
    """Some fields of all timepoints in a temporary file, for what reads them again and again.

    Attributes
    ----------
    images : dict of str to ndarray, (T, N, 2N) float32
        Mapped into memory: what is not used stays on the disk. NaN where a frame is missing.
    missing : frozenset of int
        The timepoints whose frames were not there.
    """

    images: dict[str, Images]
    missing: frozenset[int] = frozenset()

    @classmethod
    def of(
        cls,
        movie: Movie,
        names: Sequence[str],
        progress: Progress | None = None,
        *,
        make: bool = False,
    ) -> UvStacks:
        """Read fields of all frames that are there.

        Raises
        ------
        ParameterError
            The movie has no such field.
        """
        for name in names:
            check_field(movie, name)
        shape = (len(movie), *movie.common.uv.shape)
        images = {name: _mapped(shape) for name in dict.fromkeys(names)}
        missing = set()
        for timepoint, frame in made_frames(movie, progress, make=make):
            for name, stack in images.items():
                stack[timepoint] = np.nan if frame is None else frame.uv[name]
            if frame is None:
                missing.add(timepoint)
        return cls(images, frozenset(missing))


def _mapped(shape: tuple[int, ...]) -> Images:
    """An array in a temporary file that is gone when the array is."""
    with tempfile.TemporaryFile(prefix="unwrap3d-") as file:
        return np.memmap(file, np.float32, "w+", shape=shape)
