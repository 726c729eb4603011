"""Synthetic cells with known truth: the sample data, and the yardstick.

A cell is drawn as smooth solids (:mod:`.bodies`, :mod:`.protrusions`), put together on
the working grid (:mod:`.solids`) and imaged by a light-sheet microscope
(:mod:`.microscope`). In a movie (:mod:`.movies`) shapes grow and retract (:mod:`.growing`) or
travel (:mod:`.ruffling`) on a body that drifts. Nothing here knows how the package analyses a cell.
"""

from .cells import SimulatedCell, Truth, cell
from .courses import Lifetimes, SignalLaw
from .microscope import Microscope
from .movies import MOVIES, movie
from .moving import FrameTruth, SimulatedMovie
from .scenes import KINDS

__all__ = [
    "KINDS",
    "MOVIES",
    "FrameTruth",
    "Lifetimes",
    "Microscope",
    "SignalLaw",
    "SimulatedCell",
    "SimulatedMovie",
    "Truth",
    "cell",
    "movie",
]
