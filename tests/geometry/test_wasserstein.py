"""Sliced Wasserstein distances that are known, and what they do not depend on."""

import numpy as np
import pytest
from scipy.stats import wasserstein_distance

from napari_unwrap3d.errors import InputError, MeshError
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.geometry.wasserstein import (
    Sampled,
    sampled_sliced_wasserstein,
    sliced_wasserstein,
)
from shapes import icosphere, lumpy, rotation

MANY = {"projections": 2000, "evaluations": 2, "statistic": "mean"}


def points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)) * (1.0, 2.0, 3.0)


def unevenly(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same surface, with each face at z > 0 cut into three at its centre."""
    centre = vertices[faces].mean(axis=1)
    cut = np.flatnonzero(centre[:, 0] > 0)
    new = len(vertices) + np.arange(len(cut))
    fans = [np.stack([faces[cut, i], faces[cut, i - 2], new], axis=1) for i in range(3)]
    kept = np.delete(faces, cut, axis=0)
    return np.concatenate([vertices, centre[cut]]), np.concatenate([kept, *fans])


@pytest.mark.parametrize("statistic", ["max", "mean"])
@pytest.mark.parametrize("order", [1, 2])
def test_points_are_at_no_distance_from_themselves_in_any_order(statistic, order) -> None:
    cloud = points(101)
    shuffled = np.random.default_rng(1).permutation(cloud)
    assert sliced_wasserstein(cloud, shuffled, statistic=statistic, order=order) < 1e-12


@pytest.mark.parametrize(
    ("statistic", "order", "expected"),
    [
        # The component of t along a random direction is uniform over ±|t| in three dimensions:
        # E|.| = 1/2, E(.)² = 1/3, and the largest of n is n / (n + 1) on average.
        ("mean", 1, 1 / 2),
        ("mean", 2, 1 / np.sqrt(3)),
        ("max", 1, 10 / 11),
        ("max", 2, 10 / 11),
    ],
)
def test_a_translation(statistic: str, order: int, expected: float) -> None:
    cloud, shift = points(50), np.array([3.0, -4.0, 12.0])
    found = sliced_wasserstein(
        cloud, cloud + shift, projections=10, evaluations=600, statistic=statistic, order=order
    )
    assert found == pytest.approx(13 * expected, rel=0.02)


def test_the_papers_variant_of_a_translation() -> None:
    """50 directions and 10 evaluations, as in the paper: 50/51 within 3 standard errors."""
    cloud = points(50)
    found = sliced_wasserstein(cloud, cloud + np.array([0, 0, 1.0]))
    spread = np.sqrt(50 / 52) / 51  # of the largest of 50 uniform numbers
    assert found == pytest.approx(50 / 51, abs=3 * spread / np.sqrt(10))


def test_each_direction_agrees_with_scipy_for_sets_of_different_size() -> None:
    first, second = points(70), points(45, 1)
    directions = np.random.default_rng([7, 0]).normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = [wasserstein_distance(first @ d, second @ d) for d in directions]
    options = {"projections": 4, "evaluations": 1, "seed": 7}
    assert sliced_wasserstein(first, second, **options) == pytest.approx(max(expected))
    found = sliced_wasserstein(first, second, **options, statistic="mean")
    assert found == pytest.approx(np.mean(expected))


def test_it_is_symmetric_and_scales() -> None:
    first, second = points(70), points(45, 1)
    forth = sliced_wasserstein(first, second)
    assert sliced_wasserstein(second, first) == pytest.approx(forth, rel=1e-12)
    assert sliced_wasserstein(2.5 * first, 2.5 * second) == pytest.approx(2.5 * forth)
    shifted = sliced_wasserstein(first + 100, second + 100)
    assert shifted == pytest.approx(forth, rel=1e-9)


def test_it_ignores_a_common_rotation() -> None:
    first, second, turn = points(70), points(45, 1), rotation(3)
    for options in (MANY, {"projections": 500, "evaluations": 4}):
        found = sliced_wasserstein(first @ turn.T, second @ turn.T, **options)
        assert found == pytest.approx(sliced_wasserstein(first, second, **options), rel=0.02)


def test_points_of_a_surface_are_uniform_by_area() -> None:
    """Meshed anew, a surface moves between its vertices and not between its points."""
    vertices, faces = lumpy(3)
    anew, finer = unevenly(vertices, faces)
    assert face_areas(anew, finer).sum() == pytest.approx(face_areas(vertices, faces).sum())
    assert sliced_wasserstein(vertices, anew) > 0.2
    found = sampled_sliced_wasserstein((vertices, faces), (anew, finer), samples=5000)
    assert isinstance(found, Sampled)
    assert found.distance == pytest.approx(found.noise_floor, rel=0.25)
    assert found.noise_floor < 0.01


def test_the_noise_floor_falls_with_the_number_of_points() -> None:
    body = icosphere(2)
    floors = [
        sampled_sliced_wasserstein(body, body, samples=n, projections=20).noise_floor
        for n in (500, 8000)
    ]
    assert floors[0] > 4 * floors[1] > 0


def test_a_moved_surface_stands_out_from_the_noise() -> None:
    vertices, faces = lumpy(3)
    moved = vertices + np.array([0, 0.3, 0])
    found = sampled_sliced_wasserstein((vertices, faces), (moved, faces), samples=4000)
    assert found.distance == pytest.approx(0.3 * 50 / 51, rel=0.05)
    assert found.distance > 5 * found.noise_floor
    back = sampled_sliced_wasserstein((moved, faces), (vertices, faces), samples=4000)
    assert back.distance == pytest.approx(found.distance, abs=found.noise_floor)


def test_what_cannot_be_computed_is_named() -> None:
    cloud = points(5)
    for name in ("projections", "evaluations", "order"):
        with pytest.raises(InputError, match=name):
            sliced_wasserstein(cloud, cloud, **{name: 0})
    with pytest.raises(InputError, match="median"):
        sliced_wasserstein(cloud, cloud, statistic="median")  # type: ignore[arg-type]
    body = icosphere(1)
    with pytest.raises(InputError, match="samples = 0"):
        sampled_sliced_wasserstein(body, body, samples=0)
    with pytest.raises(MeshError, match="no area"):
        sampled_sliced_wasserstein(body, (0 * body[0], body[1]))
