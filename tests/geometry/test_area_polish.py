"""Areas of spherical faces, brought to given values vertex by vertex."""

import numpy as np

from napari_unwrap3d.geometry.area_polish import VertexStars, polish_areas
from napari_unwrap3d.geometry.distortion import flipped_faces
from napari_unwrap3d.geometry.mesh import face_areas
from shapes import icosphere


def shaken(seed: int = 0, size: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    where, faces = icosphere(3)
    moved = where + size * np.random.default_rng(seed).normal(size=where.shape)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    assert flipped_faces(moved, faces) == 0
    return moved, faces


def share(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    areas = face_areas(vertices, faces)
    return areas / areas.sum()


def error(vertices: np.ndarray, faces: np.ndarray, target: np.ndarray) -> float:
    return float(np.square(np.log(share(vertices, faces) / target)).sum())


def test_stars_hold_the_faces_around_each_vertex() -> None:
    _, faces = icosphere(2)
    size = faces.max() + 3  # two vertices without faces
    stars = VertexStars(faces, size)
    for vertex in range(size):
        around = stars.faces[stars.start[vertex] : stars.start[vertex + 1]]
        assert set(around) == set(np.flatnonzero((faces == vertex).any(axis=1)))


def test_areas_come_closer_at_every_sweep_and_nothing_flips() -> None:
    vertices, faces = shaken()
    target = share(*icosphere(3))
    stars = VertexStars(faces, len(vertices))
    errors = [error(vertices, faces, target)]
    for sweeps in (1, 3, 10, 30):
        found = polish_areas(vertices, faces, stars, target, sweeps)
        assert flipped_faces(found, faces) == 0
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
        errors.append(error(found, faces, target))
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.02 * errors[0]


def test_the_input_is_left_alone_and_a_perfect_map_too() -> None:
    vertices, faces = shaken()
    before = vertices.copy()
    stars = VertexStars(faces, len(vertices))
    polish_areas(vertices, faces, stars, share(*icosphere(3)), 2)
    np.testing.assert_array_equal(vertices, before)
    same = polish_areas(vertices, faces, stars, share(vertices, faces), 3)
    np.testing.assert_allclose(same, vertices, atol=1e-9)


def test_flipped_faces_do_not_become_more() -> None:
    """It starts from maps without flips; with one, the others stay sound."""
    vertices, faces = shaken(size=0.0)
    broken = vertices.copy()
    across = faces[0]
    broken[across[0]] = 1.6 * vertices[across[1:]].mean(axis=0) - 0.6 * vertices[across[0]]
    broken /= np.linalg.norm(broken, axis=1, keepdims=True)
    flips = flipped_faces(broken, faces)
    assert flips > 0
    target = share(vertices, faces)
    found = polish_areas(broken, faces, VertexStars(faces, len(broken)), target, 3)
    assert np.isfinite(found).all()
    assert flipped_faces(found, faces) <= flips
