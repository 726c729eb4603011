"""The tables of an atlas's charts, built when they are first needed, and read together."""

from __future__ import annotations

import threading
from functools import cached_property
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..charts import Ints
from ..errors import ChartMissingError
from .charts import BUILDERS, ON_UV, OnUV, on_uv, outermost_vertices
from .lookup import Owners
from .shapes import FLAT_CHARTS, Overhang, Shape, pixels_inside, vertices_inside

if TYPE_CHECKING:
    from ..atlas import Atlas

NOTHING = np.zeros(0, np.int64)


class Tables:
    """From pixels of every chart to vertices and back.

    They may be built in a thread; whoever else needs the same then waits for it.
    """

    def __init__(self, atlas: Atlas) -> None:
        self._atlas = atlas
        self._owners: dict[str, Owners] = {}
        self._building = threading.RLock()
        self._inside: WeakKeyDictionary[Shape, tuple[Ints, Ints]] = WeakKeyDictionary()

    def owners(self, chart: str) -> Owners:
        """The tables of a chart; those of the reference and the sphere are uv's.

        Raises
        ------
        ChartMissingError
            There is no such chart to draw in, or the atlas does not have it.
        """
        name = "uv" if chart in ON_UV else chart
        if name not in self._owners:
            if name not in BUILDERS:
                raise ChartMissingError(f"There is no chart {chart!r} to draw in.")
            with self._building:
                if name not in self._owners:
                    self._owners[name] = BUILDERS[name](self._atlas)
        return self._owners[name]

    def ready(self, chart: str) -> bool:
        """Whether the tables of a chart are built."""
        return chart in self._owners if chart not in ON_UV else "on_uv" in self.__dict__

    def shape(self, chart: str) -> tuple[int, ...]:
        """Of the label image of a chart."""
        return self.on_uv.pixel.shape if chart in ON_UV else self.owners(chart).shape

    @cached_property
    def on_uv(self) -> OnUV:
        """How the reference and the sphere show uv."""
        return on_uv(self._atlas)

    @cached_property
    def outermost(self) -> npt.NDArray[np.bool_]:
        """Which vertices (n,) lie on the outermost sheet."""
        return outermost_vertices(self._atlas)

    def touched(self, chart: str, pixels: Ints, overhang: Overhang) -> Ints:
        """The vertices that drawing in pixels (flat) marks."""
        vertices = self.owners(chart).touched(pixels)
        if chart == "uv" and overhang == "outermost":
            vertices = vertices[self.outermost[vertices]]
        return vertices

    def inside(self, shape: Shape) -> tuple[Ints, Ints]:
        """The vertices that a shape marks, and the pixels of its chart (flat)."""
        if shape not in self._inside:
            if shape.chart in FLAT_CHARTS:
                pixels = pixels_inside(shape, self.shape(shape.chart)[0])
                vertices = self.touched(shape.chart, pixels, shape.overhang)
            else:
                vertices, pixels = vertices_inside(shape, self._atlas.surface.vertices), NOTHING
            self._inside[shape] = vertices, pixels
        return self._inside[shape]
