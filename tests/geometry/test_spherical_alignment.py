"""A spherical mesh moved to wanted places."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry.distortion import flipped_faces
from napari_unwrap3d.geometry.mesh import unit
from napari_unwrap3d.geometry.spherical_alignment import angles, best_rotation, move_towards
from napari_unwrap3d.progress import silent
from shapes import icosphere, rotation


@pytest.mark.parametrize("seed", range(3))
def test_a_rotation_is_found_exactly(seed: int) -> None:
    directions, _ = icosphere(3)
    turn = rotation(seed)
    found = best_rotation(directions, directions @ turn.T, np.ones(len(directions)))
    np.testing.assert_allclose(found, turn, atol=1e-10)


def test_a_part_that_was_pulled_aside_does_not_turn_the_whole() -> None:
    directions, _ = icosphere(3)
    turn = rotation(5)
    targets = directions @ turn.T
    aside = directions[:, 0] > 0.6
    targets[aside] = unit(targets[aside] + [0.0, 0.8, 0.0])
    found = best_rotation(directions, targets, np.ones(len(directions)))
    assert np.degrees(angles(directions @ found.T, directions @ turn.T)).max() < 0.5


def swirled(directions: np.ndarray, size: float) -> np.ndarray:
    """A smooth one-to-one map of the sphere: every circle of latitude turns by its own angle."""
    angle = size * directions[:, 0]
    cosine, sine = np.cos(angle), np.sin(angle)
    z, y, x = directions.T
    return np.stack([z, cosine * y + sine * x, cosine * x - sine * y], axis=1)


def test_a_smooth_map_is_reached() -> None:
    directions, faces = icosphere(4)
    targets = swirled(directions, 0.6)
    moved = move_towards(directions, faces, targets, np.ones(len(directions)), silent())
    assert angles(directions, targets).max() > 0.25
    assert angles(moved, targets).max() < 0.01
    assert flipped_faces(moved, faces) == 0


def test_no_face_flips_whatever_the_targets() -> None:
    directions, faces = icosphere(4)
    rng = np.random.default_rng(0)
    folded = unit(directions * [1.0, 1.0, -1.0] + 0.5 * rng.normal(size=directions.shape))
    moved = move_towards(directions, faces, folded, np.ones(len(directions)), silent())
    assert flipped_faces(moved, faces) == 0
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1.0)


def test_targets_that_are_not_believed_do_not_pull() -> None:
    directions, faces = icosphere(4)
    targets, weights = directions.copy(), np.ones(len(directions))
    wrong = directions[:, 0] > 0.9
    targets[wrong] = unit(targets[wrong] + [0.0, 1.0, 0.0])
    weights[wrong] = 0.0
    moved = move_towards(directions, faces, targets, weights, silent())
    assert angles(moved, directions).max() < 1e-3
