"""Parameters of the protrusions: over the cortex, the default."""

from __future__ import annotations

from typing import Literal

from .base import StepParameters, setting


class ProtrusionParameters(StepParameters):
    """Protrusions: every bleb, lamellipodium and filopodium, with its volume, on request."""

    compute: bool = setting(False, "Find protrusions", "Segment and measure protrusions, too.")
    method: Literal["cortex", "topography"] = setting(
        "cortex",
        "Method",
        "cortex: what stands out of the cell opened by a ball; topography: the paper's way, by "
        "the height and the curvature in (d, u, v).",
    )
    kind: Literal["automatic", "blebs", "lamellipodia", "filopodia"] = setting(
        "automatic",
        "Kind",
        "What to look for; automatic tries all and says which it took and why.",
        source="Methods, Topography guided instance segmentation of protrusions",
    )
    radius: float = setting(
        0.45,
        "Cortex radius",
        "Radius of the ball that opens the cell, as a part of the largest ball that fits in; "
        "smaller where protrusions are as thick as the body.",
        gt=0,
        lt=1,
    )
