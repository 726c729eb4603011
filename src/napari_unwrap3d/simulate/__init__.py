"""Synthetic cells with known truth: the sample data, and the yardstick.

A cell is drawn as smooth solids (:mod:`.bodies`, :mod:`.protrusions`), put together on
the working grid (:mod:`.solids`) and imaged by a light-sheet microscope
(:mod:`.microscope`). Nothing here knows how the package analyses a cell.
"""

from .cells import SimulatedCell, Truth, cell
from .microscope import Microscope
from .movies import FrameTruth, SimulatedMovie, movie
from .scenes import KINDS

__all__ = [
    "KINDS",
    "FrameTruth",
    "Microscope",
    "SimulatedCell",
    "SimulatedMovie",
    "Truth",
    "cell",
    "movie",
]
