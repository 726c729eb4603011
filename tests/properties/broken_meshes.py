"""Meshes that should not be, for the zoo."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import napari_unwrap3d as unwrap3d
from napari_unwrap3d import errors
from napari_unwrap3d.geometry.mesh import edges_with_faces
from properties.cages import FACES, ROUND, ROUND_UM3, Refused, Repaired, together, turned


def mesh(vertices: np.ndarray, faces: np.ndarray = FACES) -> Callable[[Path], unwrap3d.Surface]:
    return lambda folder: unwrap3d.Surface(vertices, faces)


def with_vertex(value: Any) -> np.ndarray:
    vertices = ROUND.copy()
    vertices[7, 1] = value
    return vertices


def touching(size: float) -> tuple[np.ndarray, np.ndarray]:
    """A ball and another of this size that share one vertex."""
    top, bottom = int(np.argmax(ROUND[:, 0])), int(np.argmin(ROUND[:, 0]))
    other = size * ROUND + (ROUND[top] - size * ROUND[bottom])
    vertices, faces = together((ROUND, FACES), (other, FACES))
    faces[faces == len(ROUND) + bottom] = top
    return vertices, faces


def with_fin() -> tuple[np.ndarray, np.ndarray]:
    """A face that hangs on an edge."""
    a, b = edges_with_faces(FACES).vertices[0]
    return np.concatenate([ROUND, 2 * ROUND[[a]]]), np.concatenate([FACES, [[a, b, len(ROUND)]]])


def with_flat_face() -> tuple[np.ndarray, np.ndarray]:
    """An edge is split on one side of it only: between lies a face without area."""
    a, b, tip = FACES[0]
    vertices = np.concatenate([ROUND, [(ROUND[a] + ROUND[b]) / 2]])
    middle = len(ROUND)
    split = [[a, middle, tip], [middle, b, tip], [a, b, middle]]
    return vertices, np.concatenate([FACES[1:], split])


def folded(reach: float) -> np.ndarray:
    """A cap of the ball is pushed through the other side."""
    vertices = ROUND.copy()
    cap = vertices[:, 0] > 0.8
    vertices[cap, 0] -= reach * (vertices[cap, 0] - 0.8) / 0.2
    return vertices


def crossing_lobes() -> np.ndarray:
    """A bent tube whose ends overlap, so that the mesh encloses some places twice."""
    z, y, x = ROUND.T
    turn = 3.4 * x
    around = 1.0 + 0.35 * y
    return np.stack([0.35 * z, around * np.cos(turn), around * np.sin(turn)], axis=1)


def around(vertex: int) -> np.ndarray:
    return np.equal(FACES, vertex).any(axis=1)


def cavities(*sizes: float) -> tuple[np.ndarray, np.ndarray]:
    """Balls in each other, every other one wound inwards."""
    return together(*((s * ROUND, FACES[:, :: 1 - 2 * (i % 2)]) for i, s in enumerate(sizes)))


MESHES: dict[str, Refused | Repaired] = {
    "a NaN vertex": Refused(
        mesh(with_vertex(np.nan)), errors.NotFiniteError, "Vertices", {"vertices": 1}
    ),
    "an infinite vertex": Refused(
        mesh(with_vertex(np.inf)), errors.NotFiniteError, "Vertices", {"vertices": 1}
    ),
    "no faces": Refused(mesh(ROUND, np.zeros((0, 3), int)), errors.MeshError, "empty"),
    "faces of vertices that are not there": Refused(
        mesh(ROUND, FACES + 9), errors.MeshError, "does not exist", {"largest_index": 650}
    ),
    "negative indices": Refused(
        mesh(ROUND, FACES - 1), errors.MeshError, "does not exist", {"smallest_index": -1}
    ),
    "fractions for indices": Refused(
        mesh(ROUND, FACES + 0.5), errors.MeshError, "whole numbers", {"not_whole": FACES.size}
    ),
    "quads": Refused(
        mesh(ROUND, np.column_stack([FACES, FACES[:, 0]])), errors.MeshError, "triangles"
    ),
    "half a ball": Refused(
        mesh(ROUND, FACES[ROUND[FACES].mean(axis=1)[:, 0] > 0]),
        errors.NotWatertightError,
        "hole",
        {"holes": 1},
    ),
    "a hole": Repaired(mesh(ROUND, FACES[~around(5)]), "holes were closed", ROUND_UM3),
    "a face twice": Repaired(
        mesh(ROUND, np.concatenate([FACES, FACES[:5]])),
        r"doubled faces were dropped \(5\)",
        ROUND_UM3,
    ),
    "a face on an edge": Repaired(mesh(*with_fin()), "hanging on the surface", ROUND_UM3),
    "two cells touch in a vertex": Refused(
        mesh(*touching(0.95)), errors.SeveralCellsError, "two components", {"components": 2}
    ),
    "a crumb touches in a vertex": Repaired(
        mesh(*touching(0.3)), "smaller components were dropped", ROUND_UM3
    ),
    "two cells": Refused(
        mesh(*together((ROUND, FACES), (ROUND + 3, FACES))),
        errors.SeveralCellsError,
        "two components",
        {"components": 2},
    ),
    "two cells that overlap": Refused(
        mesh(*together((ROUND, FACES), (ROUND + np.array([0, 0, 1.0]), FACES))),
        errors.SeveralCellsError,
        "two components",
    ),
    "a hollow cell": Repaired(mesh(*cavities(1.0, 0.9)), "as of a cavity", ROUND_UM3),
    "nested cavities": Repaired(mesh(*cavities(1.0, 0.9, 0.85, 0.5)), "cavity", ROUND_UM3),
    "unreferenced vertices": Repaired(
        mesh(np.concatenate([ROUND, [[1e6, 0, 0], [0, 0, 0]]])),
        r"vertices without a face were dropped \(2\)",
        ROUND_UM3,
    ),
    "inside out": Repaired(
        mesh(ROUND, FACES[:, ::-1]), r"turned over to point outwards \(1280\)", ROUND_UM3
    ),
    "every third face turned": Repaired(
        mesh(ROUND, turned(3)), "turned over to point outwards", ROUND_UM3
    ),
    "a face without area": Repaired(
        mesh(*with_flat_face()), "edges of faces without area were turned", ROUND_UM3
    ),
    "a face with a vertex twice": Repaired(
        mesh(ROUND, np.concatenate([FACES, [[1, 1, 2]]])), "repeated vertex", ROUND_UM3
    ),
    "triangle soup": Repaired(
        mesh(ROUND[FACES].reshape(-1, 3), np.arange(FACES.size).reshape(-1, 3)),
        "were merged",
        ROUND_UM3,
    ),
    "a cap through the other side": Repaired(mesh(folded(2.2)), "encloses them inside out"),
    "a bent tube whose ends overlap": Repaired(mesh(crossing_lobes()), "encloses them twice"),
    "a flat mesh": Refused(mesh(ROUND * [1, 1, 0]), errors.MeshError, "Nothing is left"),
    "a mesh in metres": Refused(mesh(1e-6 * ROUND), errors.NotWatertightError, "scale=..."),
}
