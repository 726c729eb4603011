"""Patches in loops."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry.disk import disk_topology
from napari_unwrap3d.geometry.holes import boundary_loops
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.geometry.patch import fan_patch, least_bending


def circle(count, bend=0.0):
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([bend * np.cos(2 * angle), np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("count", [3, 7, 30])
def test_a_fan_fits_its_loop_and_covers_it(count):
    rim = circle(count)
    vertices, faces = fan_patch(rim, 3)
    assert disk_topology(faces).is_disk
    assert set(boundary_loops(faces)[0]) == set(range(count))
    np.testing.assert_array_equal(vertices[:count], rim)
    polygon = 0.5 * count * np.sin(2 * np.pi / count)
    assert face_areas(vertices, faces).sum() == pytest.approx(polygon)
    assert set(faces.ravel()) == set(range(len(vertices)))


def test_a_fan_runs_along_its_loop():
    _, faces = fan_patch(circle(9), 2)
    ends = {(a, b) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
    assert all((k, (k + 1) % 9) in ends for k in range(9))


def test_the_patch_of_a_bent_loop_is_harmonic():
    rim = circle(60, bend=0.1)
    vertices, faces = fan_patch(rim, 3)
    free = np.arange(len(vertices)) >= 60
    found = least_bending(vertices, faces, free)
    np.testing.assert_array_equal(found[:60], rim)
    # z = 0.1 (y² − x²) is harmonic and has this border.
    expected = 0.1 * (found[:, 1] ** 2 - found[:, 2] ** 2)
    np.testing.assert_allclose(found[:, 0], expected, atol=2e-3)


def test_a_patch_continues_what_is_around_it():
    rings = np.linspace(1.0, 1.3, 4)
    around = [np.pad(circle(40)[:, 1:] * r, ((0, 0), (1, 0))) for r in rings]
    for ring, radius in zip(around, rings, strict=True):
        ring[:, 0] = -0.25 * radius**2  # a paraboloid, of constant Laplacian
    vertices, faces = fan_patch(around[0], 3)
    outside = np.concatenate(around[1:])
    number = np.concatenate([np.arange(40), len(vertices) + np.arange(len(outside))]).reshape(4, 40)
    a, b = number[:-1], np.roll(number, -1, axis=1)[:-1]
    c, d = number[1:], np.roll(number, -1, axis=1)[1:]
    ring_faces = [np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)]
    points = np.concatenate([vertices, outside])
    free = (np.arange(len(points)) >= 40) & (np.arange(len(points)) < len(vertices))
    found = least_bending(points, np.concatenate([faces, *ring_faces]), free)
    centre = found[40]
    assert -0.25 < centre[0] < -0.25 + 0.3  # above the rim's plane, where the bowl goes on
    flat = least_bending(vertices, faces, np.arange(len(vertices)) >= 40)
    assert flat[40, 0] == pytest.approx(-0.25)
    assert centre[0] > -0.25 + 0.1
