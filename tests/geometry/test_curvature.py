"""Curvatures against closed formulas and Gauss–Bonnet. Convex is positive."""

import numpy as np
import pytest
import trimesh

from napari_unwrap3d.geometry.curvature import (
    angle_deficit,
    corner_angles,
    mean_curvature,
    total_absolute_curvature,
)
from napari_unwrap3d.geometry.distance import signed_distance
from napari_unwrap3d.geometry.mesh import euler_characteristic
from shapes import ball, directions, grid, icosphere, lumpy, outward, rotation, torus_mesh


def test_angles_of_a_triangle() -> None:
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    (angles,) = corner_angles(vertices, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(angles, [np.pi / 2, np.arctan2(4, 3), np.arctan2(3, 4)])


@pytest.mark.parametrize(
    "mesh",
    [icosphere(2), torus_mesh(), lumpy(3), outward(trimesh.creation.box((1, 2, 3)))],
    ids=["sphere", "torus", "lumpy", "box"],
)
def test_gauss_bonnet(mesh: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = mesh
    expected = 2 * np.pi * euler_characteristic(faces)
    noise = 0.05 * np.random.default_rng(0).normal(size=vertices.shape)
    for points in (vertices, vertices + noise, 7 * vertices @ rotation(0).T):
        assert angle_deficit(points, faces).sum() == pytest.approx(expected, abs=1e-9)


def test_the_deficit_of_a_box_sits_in_its_corners() -> None:
    vertices, faces = outward(trimesh.creation.box((1, 2, 3)))
    np.testing.assert_allclose(angle_deficit(vertices, faces), np.pi / 2)


def test_the_deficit_of_a_sphere_follows_its_area() -> None:
    vertices, faces = icosphere(3)
    deficit = angle_deficit(vertices, faces)
    np.testing.assert_allclose(deficit, 4 * np.pi / len(vertices), rtol=0.35)
    assert (deficit > 0).all()


def test_total_curvature_is_one_for_convex_bodies_and_more_for_others() -> None:
    for mesh in (icosphere(3), outward(trimesh.creation.box((1, 5, 2)))):
        assert total_absolute_curvature(*mesh) == pytest.approx(1.0, abs=1e-12)
    # The inner half of a torus has K < 0, as much as the outer half has K > 0.
    assert total_absolute_curvature(*torus_mesh(n=96)) == pytest.approx(2.0, rel=0.01)
    vertices, faces = lumpy(4, size=0.6)
    assert total_absolute_curvature(vertices, faces) > 1.03
    assert total_absolute_curvature(1e-3 * vertices, faces) == pytest.approx(
        total_absolute_curvature(vertices, faces)
    )


def test_collapsed_faces_do_not_disturb_the_total() -> None:
    vertices, faces = icosphere(3)
    vertices[faces[7, 0]] = vertices[faces[7, 1]]
    assert total_absolute_curvature(vertices, faces) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("radius", [8.0, 12.0, 20.0])
def test_mean_curvature_of_a_sphere_is_within_one_percent(radius: float) -> None:
    size = int(2 * radius) + 17
    distance = signed_distance(ball(radius, size))
    points = radius * directions(3000) + (size - 1) / 2
    curvature = mean_curvature(distance, points)
    assert curvature.mean() == pytest.approx(1 / radius, rel=0.01)
    assert curvature.std() < 0.15 / radius  # the staircase of a binary ball


@pytest.mark.parametrize("radius", [8.0, 12.0])
def test_mean_curvature_of_a_cylinder_is_within_one_percent(radius: float) -> None:
    size = int(2 * radius) + 17
    _, y, x = np.moveaxis(grid((40, size, size)), -1, 0)
    distance = signed_distance(np.hypot(y, x) < radius)
    angle = np.linspace(0, 2 * np.pi, 500, endpoint=False)
    centre = (size - 1) / 2
    points = np.stack(
        [
            np.full(500, 19.5),
            radius * np.sin(angle) + centre,
            radius * np.cos(angle) + centre,
        ],
        axis=1,
    )
    assert mean_curvature(distance, points).mean() == pytest.approx(0.5 / radius, rel=0.01)


def test_a_plane_is_flat_and_a_hollow_is_negative() -> None:
    z = grid((30, 30, 30))[..., 0]
    flat = mean_curvature(signed_distance(z < 0), np.full((5, 3), 14.5))
    assert np.abs(flat).max() < 1e-6
    hollow = mean_curvature(signed_distance(~ball(10, 37)), 10 * directions(1000) + 18)
    assert hollow.mean() == pytest.approx(-0.1, rel=0.01)


def test_more_smoothing_gives_less_noise() -> None:
    distance = signed_distance(ball(12, 41))
    points = 12 * directions(1000) + 20
    spread = [mean_curvature(distance, points, smoothing=s).std() for s in (0.7, 1.5, 3.0)]
    assert spread[0] > spread[1] > spread[2]
