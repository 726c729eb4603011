"""One annotation: what was painted, the shapes over it, and what both show together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..charts import Ints
from ..errors import ParameterError
from .lookup import Labels
from .shapes import Shape, check_label
from .state import Colour, Drawn

if TYPE_CHECKING:
    from .times import Group

Cover = npt.NDArray[np.int32]


class Layer:
    """Labels that were painted, and a cover of labels over some of them.

    Parameters
    ----------
    painted : ndarray, (k,) uint16
        Changed in place by :meth:`paint`.
    """

    def __init__(self, painted: Labels) -> None:
        self.painted = painted
        self.cover: Cover | None = None  # −1: what was painted shows

    def shown(self) -> Labels:
        """What shows, (k,)."""
        if self.cover is None:
            return self.painted
        return np.where(self.cover < 0, self.painted, self.cover).astype(self.painted.dtype)

    def at(self, index: Ints) -> Labels:
        """What shows at some places."""
        painted = self.painted[index]
        if self.cover is None:
            return painted
        cover = self.cover[index]
        return np.where(cover < 0, painted, cover).astype(painted.dtype)

    def paint(self, index: Ints, values: Labels) -> Ints:
        """Paint, and return where that changes what shows."""
        before = self.painted[index]
        self.painted[index] = values
        differs = before != values
        if self.cover is not None:
            differs &= self.cover[index] < 0
        return np.asarray(index[differs])

    def set_cover(self, cover: Cover | None) -> Ints:
        """Put another cover over it, and return where that changes what shows."""
        before = self.shown()
        self.cover = cover
        return np.flatnonzero(before != self.shown())


class Annotation:
    """The labels of one annotation.

    Attributes
    ----------
    surface : Layer
        A label per vertex of the surface: the truth.
    image : Layer or None
        A label per pixel of uv (flat), where it keeps what was drawn there; None as long as
        it only shows the surface's.
    shapes : tuple of Shape
        The later ones lie over the earlier ones.
    colours : mapping
        Colours (r, g, b, a), 0 to 1, of labels that have one of their own.
    group, timepoint : Group and int, or None
        Of a movie: where it is of one timepoint only, see :mod:`.times`.
    """

    def __init__(self, size: int) -> None:
        self.surface = Layer(np.zeros(size, np.uint16))
        self.image: Layer | None = None
        self.shapes: tuple[Shape, ...] = ()
        self.colours: Mapping[int, Colour] = {}
        self.group: Group | None = None
        self.timepoint: int | None = None

    @property
    def empty(self) -> bool:
        """Whether nothing is drawn."""
        painted = self.surface.painted.any() or (
            self.image is not None and self.image.painted.any()
        )
        return not (painted or self.shapes)

    def drawn(self, name: str, shape: tuple[int, ...]) -> Drawn:
        """A copy as plain data; `shape` is that of the image of uv."""
        image = None if self.image is None else self.image.painted.reshape(shape).copy()
        return Drawn(name, self.surface.painted.copy(), image, self.shapes, dict(self.colours))


LONGEST_NAME = 100


def checked_name(name: str) -> str:
    """The name of an annotation or a point.

    Raises
    ------
    ParameterError
        It is no text, empty or too long.
    """
    if not isinstance(name, str) or not name.strip() or len(name) > LONGEST_NAME:
        raise ParameterError(f"A name has 1 to {LONGEST_NAME} characters, not {name!r:.200}.")
    return name


def checked_colours(colours: Mapping[int, Colour]) -> dict[int, Colour]:
    """Colours of labels.

    Raises
    ------
    ParameterError
        A label is no label, or a colour is no four numbers of 0 to 1.
    """
    checked: dict[int, Colour] = {}
    for label, colour in colours.items():
        values = np.asarray(colour, dtype=np.float64)
        if values.shape != (4,) or not ((values >= 0) & (values <= 1)).all():
            raise ParameterError("A colour is (r, g, b, a), each from 0 to 1.", label=label)
        red, green, blue, alpha = values.tolist()
        checked[check_label(label)] = (red, green, blue, alpha)
    return checked
