"""How an entry of the zoo is kept, and the ball most of them are made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from napari_unwrap3d import errors
from shapes import VOXEL_UM, icosphere

VOXEL = (VOXEL_UM,) * 3
ROUND, FACES = icosphere(3)
# The polyhedron has less volume than its ball.
ROUND_UM3 = 4.153


@dataclass(frozen=True)
class Refused:
    """An input that ends in an error of this type, which says this and measured these."""

    make: Callable[[Path], Any]
    error: type[errors.Unwrap3DError]
    words: str
    measured: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Repaired:
    """An input of which a cell of this volume is made, and these words say how.

    Without a volume it is that of the voxels.
    """

    make: Callable[[Path], Any]
    words: str
    volume_um3: float | None = None


def together(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(v) for v, _ in parts)])
    faces = [f + start for (_, f), start in zip(parts, starts, strict=False)]
    return np.concatenate([v for v, _ in parts]), np.concatenate(faces)


def turned(every: int) -> np.ndarray:
    faces = FACES.copy()
    faces[::every] = faces[::every, ::-1]
    return faces
