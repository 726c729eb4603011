"""A mesh with a periodic coordinate, opened at the poles."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.errors import MapError
from napari_unwrap3d.geometry.mesh import boundary_edges, euler_characteristic
from napari_unwrap3d.geometry.poles import corners, open_at_poles
from napari_unwrap3d.unwrapping.uv import direction_to_uv
from shapes import icosphere, rotation

ROWS = 32


def image(seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    where, faces = icosphere(3)
    where = where @ rotation(seed).T
    return np.column_stack([np.ones(len(where)), direction_to_uv(where, ROWS)]), faces


def doubled_pole() -> tuple[np.ndarray, np.ndarray]:
    """A sphere with a fold over the north pole: its streamline is crossed three times."""
    where, faces = icosphere(4)
    where = where @ rotation(5).T
    angle = np.arccos(where[:, 0].clip(-1, 1))
    # Beyond the pole and back: the cap of a mushroom that leans over it.
    axis = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    distance = np.arccos((where @ axis).clip(-1, 1))
    profile = np.interp(distance, [0, 0.3, 0.6, 0.9], [0, 0.5, 0.2, 0.9])
    side = where - (where @ axis)[:, None] * axis
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    bent = np.where(distance < 0.9, profile, distance)[:, None]
    moved = np.cos(bent) * axis + np.sin(bent) * side
    d = np.interp(distance, [0, 0.3, 0.6, 0.9], [9, 6, 3, 0])
    assert (angle < 0.9).any()
    return np.column_stack([d, direction_to_uv(moved, ROWS)]), faces


@pytest.mark.parametrize("make", [image, doubled_pole])
def test_it_is_a_cylinder_whose_borders_are_the_poles(make) -> None:
    points, faces = make()
    opened = open_at_poles(points, faces, ROWS)
    assert len(opened.faces) == len(faces) + 10
    assert euler_characteristic(opened.faces) == 0
    border = boundary_edges(opened.faces)
    assert sorted(np.unique(border)) == list(range(len(points), len(points) + 6))
    v = opened.points[len(points) :, 1]
    np.testing.assert_array_equal(v, [-0.5] * 3 + [ROWS - 0.5] * 3)


@pytest.mark.parametrize("make", [image, doubled_pole])
def test_u_closes_around_every_face_and_makes_one_turn_around_a_border(make) -> None:
    points, faces = make()
    opened = open_at_poles(points, faces, ROWS)
    placed = corners(opened.points, opened.faces, opened.turns, ROWS)
    step = np.roll(placed, -1, axis=1) - placed
    edge: dict[tuple[int, int], float] = {}
    for face, along in zip(opened.faces.tolist(), step[:, :, 2].tolist(), strict=True):
        for k in range(3):
            edge[face[k], face[(k + 1) % 3]] = along[k]
    both = [(one, edge[pair[::-1]]) for pair, one in edge.items() if pair[::-1] in edge]
    np.testing.assert_allclose([a + b for a, b in both], 0.0, atol=1e-9)
    for pole, sign in ((0, 1), (1, -1)):
        ring = [e for e in edge if min(e) >= len(points) + 3 * pole and e[::-1] not in edge]
        ring = [e for e in ring if max(e) < len(points) + 3 * pole + 3]
        assert sum(edge[e] for e in ring) == pytest.approx(sign * 2 * ROWS)


def test_the_outermost_crossing_becomes_the_pole() -> None:
    points, faces = doubled_pole()
    opened = open_at_poles(points, faces, ROWS)
    height = opened.pole_weights[0] @ points[faces[opened.pole_faces[0]], 0]
    assert height > 6
    assert opened.points[len(points), 0] == pytest.approx(height)


def test_lengths_are_the_short_way_around() -> None:
    points, faces = image()
    opened = open_at_poles(points, faces, ROWS)
    v = opened.points[opened.faces[:-12], 1]
    away = np.abs(v - (ROWS - 1) / 2).max(axis=1) < ROWS / 4
    assert opened.lengths[:-12][away].max() < ROWS / 4
    assert opened.lengths.min() > 0


def test_the_input_is_left_alone() -> None:
    points, faces = image()
    before = points.copy(), faces.copy()
    open_at_poles(points, faces, ROWS)
    np.testing.assert_array_equal(points, before[0])
    np.testing.assert_array_equal(faces, before[1])


def test_without_a_pole_there_is_nothing_to_open() -> None:
    points, faces = image()
    points[:, 2] *= 0.1
    with pytest.raises(MapError, match="north pole"):
        open_at_poles(points, faces, ROWS)
