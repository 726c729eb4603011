"""The colours of the labels of annotations."""

from __future__ import annotations

from collections.abc import Mapping

Colour = tuple[float, float, float, float]
Colours = Mapping[int, Colour]

# Distinct on light and dark fields, and for most people who do not see all colours
# (after Okabe and Ito 2008, without black).
PALETTE: tuple[Colour, ...] = (
    (0.90, 0.62, 0.00, 1.0),
    (0.34, 0.71, 0.91, 1.0),
    (0.00, 0.62, 0.45, 1.0),
    (0.94, 0.89, 0.26, 1.0),
    (0.80, 0.47, 0.65, 1.0),
    (0.00, 0.45, 0.70, 1.0),
    (0.84, 0.37, 0.00, 1.0),
)
# By how many colours the labels of one annotation begin after those of the last.
STEP = 3
LABELS = 64


def colour_of(first: int, label: int) -> Colour:
    """The colour of a label of an annotation whose colours begin after so many others."""
    return PALETTE[(STEP * first + label - 1) % len(PALETTE)]
