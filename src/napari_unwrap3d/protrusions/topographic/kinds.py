"""Blebs, lamellipodia or filopodia: which clustering finds their tops, and which are there.

Whether a protrusion is round, flat or slender shows in the principal axes of its surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from ...charts import Floats, Surface
from ...progress import Progress
from ..segment import Labels

# The paper's clustering of the curvature for each kind.
METHODS = {"blebs": "kmeans", "lamellipodia": "gmm", "filopodia": "kmeans"}
NAMES = {"kmeans": "k-means at one scale", "gmm": "a Gaussian mixture at three scales"}
SHAPES = {"blebs": "round", "lamellipodia": "flat", "filopodia": "slender"}
# Of the standard deviations a ≥ b ≥ c of a piece's surface along its principal axes: half a
# sphere has c / b = 0.58, a tube c / b = 1 and a small b / a, a thin sheet a small c / b.
FLAT = 0.45
SLENDER = 0.4


@dataclass(frozen=True, eq=False)
class Attempt:
    """Instances and what was measured on the way; `numbers` has ``kind`` and ``kind_reason``."""

    labels: Labels
    numbers: Mapping[str, Any] = field(default_factory=dict)


# Gives labels and numbers by the name of the clustering.
Find = Callable[[str, Progress], tuple[Labels, dict[str, Any]]]


def instances_of_kind(
    kind: str, find: Find, surface: Surface, areas: Floats, progress: Progress
) -> Attempt:
    """The instances for a kind, or, when it is "automatic", for the kind that fits best.

    That is the kind whose own clustering puts the largest part of the protrusions' area into
    pieces of the kind's shape.
    """
    if kind != "automatic":
        labels, numbers = find(METHODS[kind], progress)
        return Attempt(labels, {**numbers, "kind": kind, "kind_reason": "asked for"})
    found: dict[str, tuple[Labels, dict[str, Any]]] = {}
    names = sorted(set(METHODS.values()))
    for number, method in enumerate(names):
        part = progress.part(number / len(names), (number + 1) / len(names))
        found[method] = find(method, part)
    shares = {
        name: shape_shares(found[method][0], surface, areas)[name]
        for name, method in METHODS.items()
    }
    best = max(shares, key=lambda name: shares[name])
    labels, numbers = found[METHODS[best]]
    if not labels.any():
        return Attempt(labels, {**numbers, "kind": "none", "kind_reason": "nothing stands out"})
    return Attempt(labels, {**numbers, "kind": best, "kind_reason": _reason(best, shares)})


def _reason(best: str, shares: Mapping[str, float]) -> str:
    others = ", ".join(
        f"{SHAPES[name]} with {NAMES[METHODS[name]]} {100 * share:.0f} %"
        for name, share in shares.items()
        if name != best
    )
    return (
        f"{100 * shares[best]:.0f} % of the protrusions' area is in {SHAPES[best]} pieces with "
        f"{NAMES[METHODS[best]]} ({others})"
    )


def shape_shares(labels: Labels, surface: Surface, areas: Floats) -> dict[str, float]:
    """Kind → which part of the labelled area is in pieces of its shape."""
    total = dict.fromkeys(SHAPES, 0.0)
    order = np.argsort(labels, kind="stable")
    ends = np.searchsorted(labels[order], np.arange(1, labels.max(initial=0) + 2))
    for begin, stop in pairwise(ends):
        piece = order[begin:stop]
        if len(piece):
            kind = kind_of_shape(surface.vertices[piece], areas[piece])
            total[kind] += float(areas[piece].sum())
    labelled = max(float(areas[labels > 0].sum()), 1e-300)
    return {kind: area / labelled for kind, area in total.items()}


def kind_of_shape(points: Floats, weights: Floats) -> str:
    """The kind that points (n, 3) with weights (n,) of one piece look like."""
    share = weights / weights.sum()
    centred = points - share @ points
    variance = np.linalg.eigvalsh((centred * share[:, None]).T @ centred)[::-1]
    longest, middle, shortest = np.sqrt(np.maximum(variance, 0.0))
    if shortest < FLAT * middle:
        return "lamellipodia"
    return "filopodia" if middle < SLENDER * longest else "blebs"
