"""What a user can set, one model per step, with units, ranges and sources.

The forms of the interface, the options of the command line, the TOML file and the
documentation all come from these models. An unknown key is an error.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from ..errors import ParameterError
from .base import StepParameters, setting
from .imaging import SealedParameters, StackParameters, SurfaceParameters
from .measuring import MeasurementParameters
from .movie import MovieParameters, RegistrationParameters
from .protrusions import ProtrusionParameters
from .refinement import RefinementParameters
from .topographic import TopographicParameters
from .tracking import BoxParameters, FlowParameters, TrackingParameters
from .unwrapping import (
    DirectParameters,
    PlaneParameters,
    ReferenceParameters,
    SphereParameters,
    TopographyParameters,
    UVParameters,
)

__all__ = [
    "PAPER",
    "PRESETS",
    "BoxParameters",
    "DirectParameters",
    "FlowParameters",
    "MeasurementParameters",
    "MovieParameters",
    "Parameters",
    "PlaneParameters",
    "ProtrusionParameters",
    "ReferenceParameters",
    "RefinementParameters",
    "RegistrationParameters",
    "SealedParameters",
    "SphereParameters",
    "StackParameters",
    "StepParameters",
    "SurfaceParameters",
    "TopographicParameters",
    "TopographyParameters",
    "TrackingParameters",
    "UVParameters",
    "setting",
    "toml_value",
]

PAPER = "10.1101/2023.04.12.536640"


class Parameters(StepParameters):
    """All parameters of the pipeline, one group per step."""

    stack: StackParameters = Field(default_factory=StackParameters, title="Stack")
    surface: SurfaceParameters = Field(default_factory=SurfaceParameters, title="Surface")
    sealed: SealedParameters = Field(default_factory=SealedParameters, title="Sealed surface")
    reference: ReferenceParameters = Field(default_factory=ReferenceParameters, title="Reference")
    sphere: SphereParameters = Field(default_factory=SphereParameters, title="Sphere")
    uv: UVParameters = Field(default_factory=UVParameters, title="uv")
    topography: TopographyParameters = Field(
        default_factory=TopographyParameters, title="Topography"
    )
    direct: DirectParameters = Field(default_factory=DirectParameters, title="Direct")
    plane: PlaneParameters = Field(default_factory=PlaneParameters, title="Plane")
    protrusions: ProtrusionParameters = Field(
        default_factory=ProtrusionParameters, title="Protrusions"
    )
    topographic: TopographicParameters = Field(
        default_factory=TopographicParameters, title="Protrusions by topography"
    )
    refinement: RefinementParameters = Field(
        default_factory=RefinementParameters, title="Refinement of protrusions"
    )
    registration: RegistrationParameters = Field(
        default_factory=RegistrationParameters, title="Registration"
    )
    movie: MovieParameters = Field(default_factory=MovieParameters, title="Movie")
    tracking: TrackingParameters = Field(default_factory=TrackingParameters, title="Tracking")
    boxes: BoxParameters = Field(default_factory=BoxParameters, title="Tracking of boxes")
    flow: FlowParameters = Field(default_factory=FlowParameters, title="Flow")
    measurement: MeasurementParameters = Field(
        default_factory=MeasurementParameters, title="Measurements"
    )

    @classmethod
    def preset(cls, name: str) -> Parameters:
        """The paper's values for one kind of protrusion ("Datasets").

        Raises
        ------
        ParameterError
            The name is not one of :data:`PRESETS`.
        """
        if name not in PRESETS:
            raise ParameterError(
                f"There is no preset {name!r}.", hint=f"Presets: {', '.join(PRESETS)}."
            )
        return cls.from_dict(PRESETS[name])

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Parameters:
        """Check and build; a :class:`ParameterError` names every key that is wrong."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            problems = "; ".join(
                f"{'.'.join(map(str, item['loc']))}: {item['msg']} (got {item['input']!r})"
                for item in error.errors()
            )
            raise ParameterError(
                f"Parameters are not valid: {problems}.",
                hint="`napari-unwrap3d info --parameters` lists every parameter with its range.",
            ) from None

    def changed(self, group: str, values: dict[str, Any]) -> Parameters:
        """The parameters with other values in one group, checked as by :meth:`from_dict`."""
        groups = self.model_dump()
        groups[group] |= values
        return self.from_dict(groups)

    @classmethod
    def from_toml(cls, source: str | Path) -> Parameters:
        """Read a TOML file (a Path) or TOML text (a str)."""
        text = source.read_text(encoding="utf-8") if isinstance(source, Path) else source
        try:
            values = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ParameterError(f"The parameters are not valid TOML: {error}.") from None
        return cls.from_dict(values)

    def to_toml(self) -> str:
        """TOML text with a comment (title, unit, source) above every parameter."""
        lines = [f"# Parameters of napari-unwrap3d; the method: doi:{PAPER}"]
        for step in type(self).model_fields:
            group: StepParameters = getattr(self, step)
            lines += ["", f"[{step}]"]
            for name, info in type(group).model_fields.items():
                lines += _toml_lines(name, getattr(group, name), info)
        return "\n".join(lines) + "\n"


def _toml_lines(name: str, value: Any, info: Any) -> list[str]:
    extra = info.json_schema_extra or {}
    unit = f" [{extra['unit']}]" if extra.get("unit") else ""
    source = f" Paper: {extra['source']}." if extra.get("source") else ""
    comment = f"# {info.title}{unit}: {info.description}{source}"
    if value is None:
        return [comment, f"# {name} ="]
    return [comment, f"{name} = {toml_value(value)}"]


def toml_value(value: Any) -> str:
    """A value as it is written in TOML and after ``--set``."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(list(value) if isinstance(value, tuple) else value)


PRESETS: dict[str, dict[str, Any]] = {
    "blebs": {
        "reference": {"iterations": 50, "delta": 5e-4, "threshold": 1e-5},
        "uv": {"rows": 512, "axis_weight": "mean_curvature"},
        "topography": {"step_voxels": 0.5},
    },
    "lamellipodia": {
        "reference": {"iterations": 50, "delta": 5e-4, "threshold": 1e-5},
        "uv": {"rows": 512, "axis_weight": "mean_curvature"},
        "topography": {"step_voxels": 0.5},
    },
    "filopodia": {
        "reference": {
            "iterations": 50,
            "delta": 5e-4,
            "threshold": 1e-4,
            "extra_iterations": 5,
        },
        "uv": {"rows": 512, "axis_weight": "mean_curvature"},
        "topography": {"step_voxels": 0.5},
    },
    "ruffles": {
        "reference": {"iterations": 50, "delta": 1e-5, "threshold": 5e-5},
        "uv": {"rows": 512, "axis_weight": "positive_curvature"},
        "topography": {"step_voxels": 0.5},
    },
}
