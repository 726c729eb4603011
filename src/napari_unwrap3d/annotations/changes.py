"""What those who show annotations are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..charts import Ints
from .lookup import Labels


@dataclass(frozen=True, eq=False)
class Change:
    """What an edit changed.

    Attributes
    ----------
    name : str
        Of the annotation.
    vertices : ndarray, (k,) int64
        The vertices of the surface whose label changed.
    labels : ndarray, (k,) uint16
        What they show now.
    pixels : mapping
        For every watched chart the pixels that changed: flat indices and what they show now.
    """

    name: str
    vertices: Ints
    labels: Labels
    pixels: Mapping[str, tuple[Ints, Labels]] = field(default_factory=dict)
