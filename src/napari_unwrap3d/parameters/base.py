"""What all parameters share: a field with its title, unit and source, and kinds of values."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field


def setting(
    default: Any, title: str, description: str, *, unit: str = "", source: str = "", **limits: Any
) -> Any:
    """A field with its title, unit and source; `limits` are pydantic's ge, le, gt, lt."""
    extra: dict[str, Any] = {"unit": unit, "source": source}
    return Field(default, title=title, description=description, json_schema_extra=extra, **limits)


def _numbers(value: Any) -> Any:
    """The numbers of a text such as ``"0.3, 0.1, 0.1"``, as a form gives it."""
    return re.split(r"[\s,;×]+", value.strip(" []()")) if isinstance(value, str) else value


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
ThreeSizes = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_numbers)]
SixIndices = Annotated[tuple[int, int, int, int, int, int], BeforeValidator(_numbers)]
SixLengths = Annotated[
    tuple[Finite, Finite, Finite, Finite, Finite, Finite], BeforeValidator(_numbers)
]


class StepParameters(BaseModel):
    """Base of the parameters of a step: frozen, and unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


def _has_length(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    length = math.hypot(*vector)
    if not 0.0 < length < math.inf:
        raise ValueError(f"a direction has a positive, finite length; this one's is {length:g}")
    return vector


Direction = Annotated[
    tuple[float, float, float], BeforeValidator(_numbers), AfterValidator(_has_length)
]
