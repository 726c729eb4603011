"""Parameters of the paper's protrusions: by height and curvature in (d, u, v)."""

from __future__ import annotations

from .base import StepParameters, setting


class TopographicParameters(StepParameters):
    """Protrusions by topography (the paper's method): height, binary, instances, volumes."""

    asymmetry: float = setting(
        0.25,
        "Asymmetry p",
        "Weight of what lies above the baseline; 1 − p of what lies below.",
        source="Methods, reference surface inference, p = 0.25",
        gt=0,
        lt=1,
    )
