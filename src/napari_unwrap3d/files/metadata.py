"""What a file says about its axes, voxel size and times, and the units it says it in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# µm per unit. Names as OME, OME-NGFF, ImageJ and people write them.
MICROMETRES: dict[str, float] = {
    **dict.fromkeys(("µm", "μm", "um", "micron", "microns", "micrometer", "micrometre"), 1.0),
    **dict.fromkeys(("micrometers", "micrometres", "mikrometer"), 1.0),
    **dict.fromkeys(("nm", "nanometer", "nanometre", "nanometers", "nanometres"), 1e-3),
    **dict.fromkeys(("mm", "millimeter", "millimetre", "millimeters", "millimetres"), 1e3),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), 1e4),
    **dict.fromkeys(("m", "meter", "metre"), 1e6),
    **dict.fromkeys(("pm", "picometer", "picometre"), 1e-6),
    **dict.fromkeys(("å", "angstrom", "ångström"), 1e-4),
    **dict.fromkeys(("inch", "in"), 25400.0),
}

# Seconds per unit.
SECONDS: dict[str, float] = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("µs", "μs", "us", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}


@dataclass
class Found:
    """The image in a file and what the file says about it.

    Attributes
    ----------
    data : array-like
        In the order of the file, lazily.
    axes : str
        One lower-case letter per axis; "" when the file does not say.
    voxel_size : mapping
        µm for those of ``z``, ``y``, ``x`` that the file gives in a unit of length.
    time_step : float or None
        Seconds.
    channels : tuple of str
    remark : str
        What the file says about its voxel size, in its own words.
    """

    data: Any
    axes: str = ""
    voxel_size: Mapping[str, float] = field(default_factory=dict)
    time_step: float | None = None
    channels: tuple[str, ...] = ()
    remark: str = ""


def micrometres(value: Any, unit: Any) -> float | None:
    """A length in µm; None when the value or its unit says nothing physical."""
    return _convert(value, unit, MICROMETRES)


def seconds(value: Any, unit: Any = "s") -> float | None:
    """A duration in s; None when the value or its unit says nothing physical."""
    return _convert(value, unit, SECONDS)


def _convert(value: Any, unit: Any, factors: Mapping[str, float]) -> float | None:
    try:
        number = abs(float(value)) * factors[plain_unit(unit)]
    except (TypeError, ValueError, KeyError):
        return None
    return number if np.isfinite(number) and number > 0 else None


def plain_unit(unit: Any) -> str:
    r"""A unit's name in lower case, with escapes as ImageJ writes them (``\u00B5m``) undone."""
    text = re.sub(r"\\u([0-9a-fA-F]{4})", lambda m: chr(int(m[1], 16)), str(unit or ""))
    return text.strip().lower()
