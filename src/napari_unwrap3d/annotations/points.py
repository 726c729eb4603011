"""Named points on the surface, and where they lie on every chart."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from ..charts import Floats
from ..errors import ParameterError
from .edits import Setting
from .history import Edit
from .state import Position

if TYPE_CHECKING:
    from ..atlas import Atlas


class Points:
    """Named points on the surface.

    Attributes
    ----------
    changed : Signal
        After a point was added, moved, renamed or removed.
    """

    changed = Signal()

    def __init__(self, atlas: Atlas, do: Callable[[Edit], None]) -> None:
        self._atlas, self._do = atlas, do
        self._positions: dict[str, Position] = {}

    @property
    def positions(self) -> Mapping[str, Position]:
        """Name to (z, y, x) in µm, in the order in which they were added."""
        return MappingProxyType(self._positions)

    def set(self, name: str, position: npt.ArrayLike) -> None:
        """Put a point, new or not, at the place of the surface that is closest to a position.

        Parameters
        ----------
        name : str
        position : array-like, (3,)
            (z, y, x) in µm.

        Raises
        ------
        ParameterError
            The position is no point, or the name is empty.
        """
        point = np.asarray(position, dtype=np.float64)
        if point.shape != (3,) or not np.isfinite(point).all() or not name.strip():
            raise ParameterError("A point has a name and three coordinates (z, y, x) in µm.")
        z, y, x = self._on_surface(point)
        self._put({**self._positions, name: (z, y, x)})

    def remove(self, name: str) -> None:
        """Take a point away."""
        if name not in self._positions:
            raise ParameterError(f"There is no point {name!r}.")
        self._put({key: kept for key, kept in self._positions.items() if key != name})

    def on(self, chart: str) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Where all points lie on a chart, and whether they do; see ``atlas.map``."""
        points = np.array(list(self._positions.values()), dtype=np.float64).reshape(-1, 3)
        return self._atlas.map(points, "surface", chart)

    def _on_surface(self, point: Floats) -> tuple[float, float, float]:
        surface = self._atlas.surface
        face, weights, _ = self._atlas._surface_locator.closest(point[None])
        z, y, x = (weights[0] @ surface.vertices[surface.faces[face[0]]]).tolist()
        return z, y, x

    def _put(self, positions: dict[str, Position]) -> None:
        self._do(Setting(self.replace, self._positions, positions))

    def replace(self, positions: Mapping[str, Position]) -> None:
        """Put other points in the place of all; not a step to undo."""
        self._positions = dict(positions)
        self.changed.emit()
