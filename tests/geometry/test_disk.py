"""Harmonic and equiareal maps to the disk."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.errors import NotADiskError
from napari_unwrap3d.geometry.disk import (
    border,
    disk_determinants,
    disk_topology,
    flipped,
    harmonic_disk,
    log_shrinking,
    spread_disk,
)
from napari_unwrap3d.geometry.disk_areas import equiareal_disk
from napari_unwrap3d.progress import silent
from shapes import icosphere, torus_mesh


def rings_mesh(rows, around=24):
    """A disk of `rows` rings (radius, height) around a vertex at the first of them."""
    turn = 2 * np.pi * np.arange(around) / around
    (_, top), *rest = rows
    vertices = [[[top, 0.0, 0.0]]]
    faces = []
    for number, (radius, height) in enumerate(rest):
        # Every second ring half a step on, so that triangles are near-equilateral.
        angle = turn + np.pi / around * (number % 2)
        vertices.append(
            np.stack([np.full(around, height), radius * np.cos(angle), radius * np.sin(angle)], 1)
        )
        here = 1 + number * around + np.arange(around)
        after = np.roll(here, -1)
        if number == 0:
            faces.append(np.stack([np.zeros(around, int), here, after], 1))
            continue
        before, before_after = here - around, after - around
        if number % 2:
            faces += [np.stack([before, here, before_after], 1)]
            faces += [np.stack([before_after, here, after], 1)]
        else:
            faces += [np.stack([before, here, after], 1)]
            faces += [np.stack([before, after, before_after], 1)]
    return np.concatenate(vertices).astype(float), np.concatenate(faces)


def cap(angle, rings=24, around=48):
    """A cap of the unit sphere up to a polar angle, and the polar angles of its vertices."""
    theta = np.linspace(0, angle, rings + 1)
    vertices, faces = rings_mesh(list(zip(np.sin(theta), np.cos(theta), strict=True)), around)
    return vertices, faces, np.arccos(np.clip(vertices[:, 0], -1, 1))


def tube(length, around=12):
    """A closed tube of radius 1: a half ball on a cylinder, open at the bottom."""
    step = 2 * np.pi / around
    theta = np.linspace(0, np.pi / 2, around // 4 + 1)
    below = np.arange(step, length, step)
    rows = [*zip(np.sin(theta), np.cos(theta), strict=True), *((1.0, -h) for h in below)]
    return rings_mesh(rows, around)


def test_a_flat_disk_is_mapped_to_itself():
    vertices, faces = rings_mesh([(r, 0.0) for r in np.linspace(0, 1, 9) ** 1.3])
    points = harmonic_disk(5.0 * vertices + 7.0, faces)
    p, q = (x[:, 0] + 1j * x[:, 1] for x in (points, vertices[:, 1:]))
    turn = p[-1] / q[-1]
    np.testing.assert_allclose(p, turn * q, atol=1e-9)


@pytest.mark.parametrize("angle", [0.7, 2.0])
def test_the_harmonic_map_of_a_cap_is_the_stereographic_projection(angle):
    vertices, faces, theta = cap(angle)
    points = harmonic_disk(vertices, faces)
    expected = np.tan(theta / 2) / np.tan(angle / 2)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), expected, atol=4e-3)
    assert flipped(points, faces) == 0


def test_the_border_is_on_the_circle_by_its_lengths_and_begins_at_the_top():
    vertices, faces, _ = cap(1.5)
    vertices = vertices * [1.0, 1.0, 2.0]
    points, loop = harmonic_disk(vertices, faces), border(faces)
    np.testing.assert_allclose(np.linalg.norm(points[loop], axis=1), 1.0)
    angle = np.unwrap(np.arctan2(points[loop, 1], points[loop, 0]))
    lengths = np.linalg.norm(np.roll(vertices[loop], -1, axis=0) - vertices[loop], axis=1)
    np.testing.assert_allclose(np.diff(angle), 2 * np.pi * lengths[:-1] / lengths.sum())
    first = loop[np.lexsort(vertices[loop].T[::-1])[0]]
    np.testing.assert_allclose(points[first], [-1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("relaxed", [False, True])
def test_renumbering_changes_nothing(relaxed):
    vertices, faces = tube(3.0)
    rng = np.random.default_rng(0)
    order = rng.permutation(len(vertices))
    place = np.argsort(order)
    others = vertices[order], place[faces[rng.permutation(len(faces))]]
    one, other = harmonic_disk(vertices, faces), harmonic_disk(*others)
    if relaxed:
        one, _ = equiareal_disk(vertices, faces, one, silent())
        other, _ = equiareal_disk(*others, other, silent())
    np.testing.assert_allclose(other, one[order], atol=1e-6)


@pytest.mark.parametrize("length", [1.0, 8.0, 25.0])
def test_areas_are_kept_without_flips_however_long(length):
    vertices, faces = tube(length)
    start = harmonic_disk(vertices, faces)
    points, history = equiareal_disk(vertices, faces, start, silent())
    assert flipped(points, faces) == 0
    assert log_shrinking(vertices, points, faces) == pytest.approx(history.min(), rel=1e-6)
    assert history.min() <= 0.05
    loop = border(faces)
    np.testing.assert_allclose(np.linalg.norm(points[loop], axis=1), 1.0)


def test_what_numbers_cannot_resolve_gets_weights_that_yield():
    vertices, faces = tube(80.0)
    points = harmonic_disk(vertices, faces)
    assert flipped(points, faces) == 0


def test_spreading_never_makes_it_worse():
    vertices, faces = tube(6.0)
    start = harmonic_disk(vertices, faces)
    spread = spread_disk(vertices, faces, start)
    assert flipped(spread, faces) == 0
    assert log_shrinking(vertices, spread, faces) < 0.5 * log_shrinking(vertices, start, faces)


def test_determinants_are_twice_the_areas():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 2]])
    np.testing.assert_allclose(disk_determinants(square, faces), [1.0, -1.0])


def test_a_hole_a_handle_and_two_pieces_are_refused():
    vertices, faces, theta = cap(2.0)
    annulus = faces[(theta[faces] > 0.5).all(axis=1)]
    with pytest.raises(NotADiskError) as caught:
        border(annulus)
    assert caught.value.measured["boundary_loops"] == 2
    assert caught.value.measured["genus"] == 0
    ring, ring_faces = torus_mesh()
    with pytest.raises(NotADiskError) as caught:
        harmonic_disk(ring, ring_faces[1:])
    assert caught.value.measured["genus"] == 1
    _, ball_faces = icosphere(2)
    with pytest.raises(NotADiskError) as caught:
        border(ball_faces)
    assert caught.value.measured["boundary_loops"] == 0
    assert disk_topology(np.concatenate([faces, faces + len(vertices)])).pieces == 2
    assert disk_topology(faces).is_disk
