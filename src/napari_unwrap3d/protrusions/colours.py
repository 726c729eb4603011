"""A colour for each protrusion, so that neighbours differ."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable

Colour = tuple[float, float, float, float]

# Hues a golden angle apart: however many there are, the next one lies in the widest gap.
GOLDEN = 0.618033988749895
FIRST_HUE = 0.08
# Lightness and saturation take turns, so that similar hues differ in them.
TONES = ((0.55, 0.85), (0.42, 0.75), (0.68, 0.80))


def instance_colour(label: int) -> Colour:
    """(r, g, b, a), 0 to 1, of a label from 1 on: always the same."""
    lightness, saturation = TONES[label % len(TONES)]
    hue = (FIRST_HUE + GOLDEN * label) % 1.0
    return (*colorsys.hls_to_rgb(hue, lightness, saturation), 1.0)


def instance_colours(labels: Iterable[int]) -> dict[int, Colour]:
    """The colour of every label."""
    return {label: instance_colour(label) for label in labels}
