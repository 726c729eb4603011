"""A mesh fitted to another, rigidly and softly."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry.fit import (
    Target,
    fit_mesh,
    fit_rigid,
    fit_soft,
    nearest_rotations,
    rotation_of,
)
from napari_unwrap3d.geometry.remesh import relax, simplify
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.progress import silent
from shapes import icosphere, lumpy, rotation

TURN = np.array([0.2, -0.15, 0.25])
LONG = np.array([1.0, 1.0, 2.0])


def coarse() -> tuple[np.ndarray, np.ndarray]:
    """Another mesh of the lumpy body."""
    return relax(*simplify(*lumpy(size=0.6), 600), silent())


def test_a_small_motion_is_found_though_the_mesh_is_another() -> None:
    vertices, faces = coarse()
    fine, triangles = lumpy(size=0.6)
    motion = Rigid.about(fine.mean(axis=0), rotation_of(TURN), (0.1, 0.05, -0.1))
    target = Target.of(motion.apply(fine), triangles)
    found = fit_rigid(vertices, faces, target, silent())
    off = (motion.inverse() @ found).angle_deg
    assert off < 0.5
    assert np.abs(found.apply(vertices) - motion.apply(vertices)).max() < 0.02


def with_bumps() -> tuple[np.ndarray, np.ndarray]:
    """A body longer than wide, with bumps by which its places can be told."""
    directions, faces = icosphere(5)
    radius = np.ones(len(directions))
    for axis in np.random.default_rng(3).normal(size=(14, 3)):
        radius += 0.3 * np.exp(25 * (directions @ (axis / np.linalg.norm(axis)) - 1))
    return directions * radius[:, None] * [1.0, 1.1, 1.6], faces


def test_a_body_that_is_stretched_takes_its_places_along() -> None:
    fine, triangles = with_bumps()
    vertices, faces = relax(*simplify(fine, triangles, 600), silent())
    stretch = np.array([0.9, 1.0, 1.25])
    found = fit_mesh(vertices, faces, Target.of(fine * stretch, triangles), silent())
    off = np.linalg.norm(found - vertices * stretch, axis=1)
    assert np.median(off) < 0.04
    assert np.percentile(off, 95) < 0.08
    # Without a fit they would be this far away.
    assert np.percentile(np.linalg.norm(vertices - vertices * stretch, axis=1), 95) > 0.3


def test_a_body_that_bends_is_followed_by_and_by() -> None:
    fine, triangles = with_bumps()
    vertices, faces = relax(*simplify(fine, triangles, 600), silent())
    current = vertices
    for curvature in (0.1, 0.2, 0.3):
        current = fit_mesh(current, faces, Target.of(bent(fine, curvature), triangles), silent())
    off = np.linalg.norm(current - bent(vertices, 0.3), axis=1)
    moved = np.linalg.norm(vertices - bent(vertices, 0.3), axis=1)
    assert np.percentile(moved, 95) > 0.4
    assert np.median(off) < 0.12
    assert np.percentile(off, 95) < 0.25


def test_a_smooth_body_is_not_turned_for_a_slightly_better_fit() -> None:
    vertices, faces = coarse()
    fine, triangles = lumpy(size=0.6)
    vertices, fine = vertices * LONG, fine * LONG
    found = fit_mesh(vertices, faces, Target.of(bent(fine, 0.08), triangles), silent())
    left = np.linalg.norm(vertices - bent(vertices, 0.08), axis=1)
    assert np.median(np.linalg.norm(found - bent(vertices, 0.08), axis=1)) < np.median(left)


def bent(points: np.ndarray, curvature: float) -> np.ndarray:
    """Points (n, 3) of a body along x, bent in the x-y plane."""
    z, y, x = points.T
    radius = 1 / curvature - y
    angle = curvature * x
    return np.stack([z, 1 / curvature - radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def test_a_part_that_grows_is_followed_beyond_the_stretch() -> None:
    vertices, faces = coarse()
    target = vertices * (1.0 + 0.15 * (vertices[:, :1] > 0.5))
    found = fit_soft(vertices, vertices, faces, Target.of(target, faces), silent())
    assert np.abs(Target.of(target, faces).locator.closest(found)[2]).max() < 0.06


def test_a_fit_is_the_same_every_time() -> None:
    vertices, faces = coarse()
    target = Target.of(vertices * 1.1, faces)
    one, two = (fit_mesh(vertices, faces, target, silent()) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_rotations_are_nearest_and_proper() -> None:
    points = np.random.default_rng(1).normal(size=(30, 3))
    for seed in range(4):
        turn = rotation(seed)
        spread = points.T @ (points @ turn.T)
        np.testing.assert_allclose(nearest_rotations(spread[None])[0], turn, atol=1e-12)
    mirrored = nearest_rotations((points.T @ (points * [1, 1, -1]))[None])[0]
    assert np.linalg.det(mirrored) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_of(np.zeros(3)), np.eye(3))
