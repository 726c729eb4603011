"""The fields that are measured: those of the frames, and ratios of two signals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Frame
from ..errors import ParameterError
from ..fields import CURVATURE, SIGNAL
from ..motion.uv_stacks import check_field, field_names
from ..parameters import MeasurementParameters

if TYPE_CHECKING:
    from ..motion.movie import Movie

ALL, PER = "all", "_per_"


def names_in(text: str) -> tuple[str, ...]:
    """Names that are separated by commas."""
    return tuple(dict.fromkeys(name for item in text.split(",") if (name := item.strip())))


def field_named(movie: Movie, text: str) -> str:
    """The name of a field, or of the ratio of two signals that is written as ``a/b``.

    Raises
    ------
    ParameterError
        The movie has no such field.
    """
    parts = [part.strip() for part in text.split("/")]
    for part in parts:
        check_field(movie, part)
    if len(parts) == 1:
        return parts[0]
    if len(parts) > 2 or not all(part.startswith(SIGNAL) for part in parts):
        raise ParameterError(
            f"{text!r} is no ratio of two signals.", hint=f"Write it as {SIGNAL}a/{SIGNAL}b."
        )
    return parts[0] + PER + parts[1].removeprefix(SIGNAL)


def image_of(frame: Frame, name: str) -> npt.NDArray[Any]:
    """A field (N, 2N) over the pixels of a frame; NaN where a ratio has nothing below."""
    if name in frame.uv:
        return frame.uv[name]
    # A channel may have the word in its name, too: the part of which both signals are there.
    for place in range(len(name)):
        if name[place:].startswith(PER):
            above, below = name[:place], SIGNAL + name[place + len(PER) :]
            if above in frame.uv and below in frame.uv:
                under = np.asarray(frame.uv[below], np.float64)
                return np.asarray(frame.uv[above] / np.where(under == 0, np.nan, under))
    raise ParameterError(f"There is no field {name!r}.", hint=f"Fields: {', '.join(frame.uv)}.")


def fields_of(movie: Movie, chosen: MeasurementParameters) -> tuple[str, ...]:
    """The fields whose means are taken.

    Raises
    ------
    ParameterError
        The movie has no such field.
    """
    if chosen.fields.strip() == ALL:
        there = field_names(movie)
        return tuple(name for name in there if name == CURVATURE or name.startswith(SIGNAL))
    return tuple(field_named(movie, name) for name in names_in(chosen.fields))


def correlated_fields(movie: Movie, chosen: MeasurementParameters) -> tuple[str, ...]:
    """The two fields that are correlated; empty where the movie has no signal.

    Raises
    ------
    ParameterError
        They are not two, or the movie has no such field.
    """
    names = names_in(chosen.correlate)
    if not names:
        signals = [name for name in field_names(movie) if name.startswith(SIGNAL)]
        return (CURVATURE, signals[0]) if signals else ()
    if len(names) != 2:
        raise ParameterError(
            "Two fields are correlated.",
            got=chosen.correlate,
            hint=f"Write measurement.correlate as {CURVATURE}, {SIGNAL}septin.",
        )
    return tuple(field_named(movie, name) for name in names)
