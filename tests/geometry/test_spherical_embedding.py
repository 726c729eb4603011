"""The hierarchical embedding: a homeomorphism for every closed genus-0 mesh, and it proves it."""

import numpy as np
import pytest
import trimesh

from napari_unwrap3d.errors import Cancelled, NotGenusZeroError
from napari_unwrap3d.geometry.distortion import (
    area_distortion,
    mean_conformal_error,
    mean_log_area_distortion,
)
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.geometry.spherical_embedding import (
    EmbeddingWeights,
    certificate,
    embed_on_sphere,
)
from napari_unwrap3d.geometry.spherical_energy import rest_frames
from napari_unwrap3d.progress import Progress, silent
from shapes import icosphere, lumpy, outward, rotation, tube_along

QUICK = EmbeddingWeights(sweeps=5, final_sweeps=10)


def spiky() -> tuple[np.ndarray, np.ndarray]:
    """A ball with long thin spikes, that overhang when seen from its centre."""
    directions, faces = icosphere(4)
    rng = np.random.default_rng(3)
    vertices = directions.copy()
    for axis in rng.normal(size=(5, 3)):
        axis /= np.linalg.norm(axis)
        height = 3.0 * np.exp(60 * (directions @ axis - 1))
        bend = np.cross(axis, rng.normal(size=3))
        vertices += height[:, None] * axis + 0.3 * height[:, None] ** 2 * bend
    return vertices, faces


def bent_tube() -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0, 1.6 * np.pi, 400)
    curve = np.stack([12 + 0 * t, 22 + 15 * np.sin(t), 22 + 15 * np.cos(t)], axis=1)
    solid = tube_along(curve, 4.0, (25, 45, 45))
    return clamped_marching_cubes(solid.astype(np.float32) - 0.5)


def with_slivers() -> tuple[np.ndarray, np.ndarray]:
    """A sphere some of whose vertices nearly coincide."""
    vertices, faces = icosphere(3)
    rng = np.random.default_rng(0)
    for face in faces[rng.choice(len(faces), 30, replace=False)]:
        vertices[face[0]] = vertices[face[1]] + 1e-7 * rng.normal(size=3)
    return vertices, faces


@pytest.mark.parametrize(
    "make",
    [
        lambda: icosphere(3),
        lambda: lumpy(3),
        spiky,
        bent_tube,
        with_slivers,
        lambda: outward(trimesh.creation.box()),
    ],
)
def test_every_sphere_is_embedded_without_a_flip(make) -> None:
    vertices, faces = make()
    directions = embed_on_sphere(vertices, faces, silent(), weights=QUICK)
    proof = certificate(directions, faces)
    assert proof.holds
    assert proof.flipped_faces == 0
    assert proof.degree == pytest.approx(1.0, abs=1e-9)
    assert proof.smallest_determinant > 0


def test_areas_of_a_smooth_body_are_kept() -> None:
    vertices, faces = lumpy(3)
    directions = embed_on_sphere(vertices, faces, silent())
    assert mean_log_area_distortion(vertices, directions, faces) < 0.03


def test_more_weight_on_the_shape_keeps_angles_better_and_areas_worse() -> None:
    vertices, faces = lumpy(3)
    areas, angles = [], []
    for shape in (0.05, 2.0):
        x = embed_on_sphere(vertices, faces, silent(), weights=EmbeddingWeights(shape=shape))
        areas.append(mean_log_area_distortion(vertices, x, faces))
        angles.append(mean_conformal_error(vertices, x, faces))
    assert areas[0] < areas[1]
    assert angles[0] > angles[1]


def test_tied_vertices_come_to_lie_near_their_directions() -> None:
    """Also when the directions are those of a turned sphere."""
    vertices, faces = lumpy(3)
    towards = embed_on_sphere(vertices, faces, silent(), weights=QUICK) @ rotation(5).T
    trust = (np.arange(len(vertices)) % 3 == 0).astype(float)
    tied = embed_on_sphere(vertices, faces, silent(), towards=towards, confidence=trust)
    away = np.arccos(np.clip((tied * towards).sum(axis=1), -1, 1))
    assert np.percentile(away, 95) < 0.05


def test_within_the_slack_nothing_is_felt() -> None:
    vertices, faces = lumpy(3)
    free = embed_on_sphere(vertices, faces, silent())
    weights = EmbeddingWeights(slack=2.1)  # more than the diameter
    slack = embed_on_sphere(
        vertices, faces, silent(), towards=free, confidence=np.ones(len(free)), weights=weights
    )
    areas = [area_distortion(vertices, x, faces) for x in (free, slack)]
    np.testing.assert_allclose(*(np.abs(np.log(a)).mean() for a in areas), rtol=0.1)


def test_the_same_input_gives_the_same_bits() -> None:
    vertices, faces = spiky()
    first, second = (embed_on_sphere(vertices, faces, silent(), weights=QUICK) for _ in "ab")
    np.testing.assert_array_equal(first, second)


def test_a_torus_is_an_error_and_it_can_be_cancelled() -> None:
    mesh = trimesh.creation.torus(3, 1, major_sections=12, minor_sections=8)
    with pytest.raises(NotGenusZeroError):
        embed_on_sphere(*outward(mesh), silent())
    progress = Progress()
    calls = []

    def stop(step: str, fraction: float, message: str) -> None:
        calls.append(fraction)
        if len(calls) == 5:
            progress.cancel()

    progress.callback = stop
    with pytest.raises(Cancelled):
        embed_on_sphere(*spiky(), progress)
    assert calls == sorted(calls)


# The certificate ----------------------------------------------------------------------


def test_the_certificate_finds_every_defect() -> None:
    x, faces = icosphere(3)
    assert certificate(x, faces).holds
    mirrored = certificate(x * [1, 1, -1], faces)
    assert not mirrored.holds
    assert mirrored.flipped_faces == len(faces)
    assert mirrored.degree == pytest.approx(-1.0)
    moved = x.copy()
    moved[0] = x[faces[faces[:, 0] != 0][-1, 0]]
    assert certificate(moved, faces).flipped_faces > 0
    broken = x.copy()
    broken[7] = np.nan
    assert not certificate(broken, faces).holds
    assert certificate(broken, faces).flipped_faces > 0
    assert not certificate(x * 1.001, faces).holds


def test_a_sphere_covered_twice_is_no_homeomorphism() -> None:
    """Every face is positive, but going around once goes around twice."""
    angle = 2 * np.pi * np.arange(40) / 20
    ring = np.stack([np.zeros(40), np.sin(angle), np.cos(angle)], axis=1)
    x = np.vstack([ring, [1, 0, 0], [-1, 0, 0]])
    i, j = np.arange(40), (np.arange(40) + 1) % 40
    faces = np.vstack([np.stack([i, j, 0 * i + 40], 1), np.stack([j, i, 0 * i + 41], 1)])
    if certificate(x, faces).degree < 0:
        faces = faces[:, ::-1]
    proof = certificate(x, faces)
    assert proof.flipped_faces == 0
    assert proof.degree == pytest.approx(2.0)
    assert proof.euler_characteristic == 2
    assert not proof.holds


def test_rest_frames_have_the_wanted_areas_and_the_faces_own_angles() -> None:
    vertices, faces = lumpy(2)
    areas = np.full(len(faces), 0.01)
    frames = rest_frames(vertices, faces, areas)
    for corner in range(3):
        length, y = 1 / frames[:, corner, 0], 1 / frames[:, corner, 2]
        x = -frames[:, corner, 1] * length * y
        np.testing.assert_allclose(0.5 * length * y, areas)
        a, b, c = (vertices[faces[:, (corner + k) % 3]] for k in range(3))
        u, v = b - a, c - a
        cosine = (u * v).sum(1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        np.testing.assert_allclose(x / np.hypot(x, y), cosine, atol=1e-12)
    assert face_areas(vertices, faces).std() > 0
