"""Labels, shapes and points that a person draws on a cell, the same on all of its charts."""

from .annotations import Annotations, Change
from .shapes import Shape

__all__ = ["Annotations", "Change", "Shape"]
