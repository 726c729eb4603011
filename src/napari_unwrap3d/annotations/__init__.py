"""Labels, shapes and points that a person draws on a cell, the same on all of its charts."""

from .annotations import Annotations
from .changes import Change
from .measures import PlaneFit, fit_plane, label_rows
from .points import Points
from .shapes import Shape
from .state import State

__all__ = [
    "Annotations",
    "Change",
    "PlaneFit",
    "Points",
    "Shape",
    "State",
    "fit_plane",
    "label_rows",
]
