"""What can be done to annotations, and taken back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Ints
from .annotation import Annotation, Layer
from .lookup import Labels, Owners
from .tables import NOTHING


@dataclass(eq=False)
class Dirty:
    """Where the labels of annotations changed since somebody was last told."""

    parts: dict[Annotation, tuple[list[Ints], list[Ints]]] = field(default_factory=dict)

    def add(self, annotation: Annotation, vertices: Ints, pixels: Ints) -> None:
        """Note vertices of the surface, and pixels of uv (flat), of an annotation."""
        kept = self.parts.setdefault(annotation, ([], []))
        kept[0].append(vertices)
        kept[1].append(pixels)

    def take(self) -> list[tuple[Annotation, Ints, Ints]]:
        """What was noted: every vertex and pixel once, sorted."""
        parts, self.parts = self.parts, {}
        return [
            (key, _union(vertices), _union(pixels)) for key, (vertices, pixels) in parts.items()
        ]


def _union(parts: list[Ints]) -> Ints:
    return np.unique(np.concatenate(parts)) if parts else NOTHING


@dataclass(frozen=True, eq=False)
class Delta:
    """What some places of a layer had painted, and what they have now."""

    index: Ints
    before: Labels
    after: Labels

    @classmethod
    def of(cls, layer: Layer, index: Ints, values: npt.ArrayLike) -> Delta:
        """The change that painting would make; places that have the label are left out."""
        before = layer.painted[index]
        after = np.broadcast_to(np.asarray(values, before.dtype), before.shape)
        differs = before != after
        return cls(index[differs], before[differs], after[differs])

    @property
    def nbytes(self) -> int:
        return self.index.nbytes + self.before.nbytes + self.after.nbytes

    def apply(self, layer: Layer, *, forward: bool) -> Ints:
        """Paint one or the other, and return where that changes what shows."""
        return layer.paint(self.index, self.after if forward else self.before)


@dataclass(frozen=True, eq=False)
class Painting:
    """Labels painted on the surface, and with them in the image of uv.

    Attributes
    ----------
    image : Delta or None
        None when the annotation had no image of its own yet.
    uv : callable
        Gives the tables of uv.
    """

    annotation: Annotation
    surface: Delta
    image: Delta | None
    uv: Callable[[], Owners]
    dirty: Dirty

    @property
    def nbytes(self) -> int:
        return self.surface.nbytes + (self.image.nbytes if self.image is not None else 0)

    def apply(self, *, forward: bool) -> None:
        annotation, pixels = self.annotation, NOTHING
        vertices = self.surface.apply(annotation.surface, forward=forward)
        if annotation.image is not None:
            pixels = self._paint_image(annotation.image, forward=forward)
        self.dirty.add(annotation, vertices, pixels)

    def _paint_image(self, layer: Layer, *, forward: bool) -> Ints:
        if self.image is not None:
            return self.image.apply(layer, forward=forward)
        owners = self.uv()
        pixels = owners.owned(self.surface.index)
        return layer.paint(pixels, owners.values(pixels, self.annotation.surface.painted))

    def __bool__(self) -> bool:
        return len(self.surface.index) > 0 or (self.image is not None and len(self.image.index) > 0)


@dataclass(frozen=True, eq=False)
class Setting:
    """One value put in the place of another."""

    put: Callable[[Any], None]
    before: Any
    after: Any
    nbytes: int = 0

    def apply(self, *, forward: bool) -> None:
        self.put(self.after if forward else self.before)
