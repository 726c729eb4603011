"""Step 2: angles are kept, nothing is flipped, and NaN cannot pass."""

import numpy as np
import pytest

from napari_unwrap3d.errors import Cancelled, FlippedFacesError, NotGenusZeroError
from napari_unwrap3d.geometry.distortion import (
    conformal_error,
    flipped_faces,
    mean_conformal_error,
)
from napari_unwrap3d.geometry.laplacian import (
    ReusedFactor,
    conjugate_gradient,
    cotangent_laplacian,
    pinned,
    vertex_mass,
)
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping import conformal
from napari_unwrap3d.unwrapping.conformal import (
    _inverse_stereographic,
    _invert,
    _most_conformal,
    _stereographic,
    conformal_sphere,
    mobius_centered,
)
from shapes import directions, icosphere, lumpy, rotation, torus_mesh


def cross_ratio(points: np.ndarray) -> np.ndarray:
    """|AC||BD| / |AD||BC| (k,) of four points each (k, 4, 3): Möbius maps keep it."""
    a, b, c, d = points.transpose(1, 0, 2)
    return (
        np.linalg.norm(a - c, axis=1)
        * np.linalg.norm(b - d, axis=1)
        / (np.linalg.norm(a - d, axis=1) * np.linalg.norm(b - c, axis=1))
    )


def quadruples(count: int, vertices: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.array([rng.choice(vertices, 4, replace=False) for _ in range(count)])


def aligned(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """`first` rotated onto `second` as well as possible (Kabsch)."""
    u, _, vt = np.linalg.svd(first.T @ second)
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    return first @ (u @ sign @ vt)


def test_a_sphere_is_mapped_to_itself_up_to_a_mobius_map() -> None:
    vertices, faces = icosphere(4)
    found = conformal_sphere(5 * vertices + 2, faces, silent())
    assert flipped_faces(found, faces) == 0
    assert mean_conformal_error(vertices, found, faces) < 1.001
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    four = quadruples(300, len(vertices))
    np.testing.assert_allclose(cross_ratio(found[four]), cross_ratio(vertices[four]), rtol=0.02)
    # Both have their mean at the centre, so that a rotation is all that is left.
    assert np.abs(aligned(found, vertices) - vertices).max() < 0.01


@pytest.mark.parametrize("axes", [(1, 1.5, 2), (0.5, 1, 1)])
def test_ellipsoids_keep_their_angles_the_better_the_finer_their_mesh(
    axes: tuple[float, float, float],
) -> None:
    errors = []
    for subdivisions in (3, 4):
        vertices, faces = icosphere(subdivisions)
        found = conformal_sphere(vertices * axes, faces, silent())
        assert flipped_faces(found, faces) == 0
        errors.append(mean_conformal_error(vertices * axes, found, faces) - 1)
    assert errors[1] < 0.02
    assert errors[1] < 0.55 * errors[0]  # what is left comes from the flat triangles


def test_a_lumpy_body_keeps_its_angles() -> None:
    vertices, faces = lumpy(5, size=0.4)
    found = conformal_sphere(vertices, faces, silent())
    assert flipped_faces(found, faces) == 0
    assert mean_conformal_error(vertices, found, faces) < 1.01


def test_neither_rotation_size_nor_place_matter() -> None:
    vertices, faces = lumpy(3)
    turn = rotation(3)
    plain = conformal_sphere(vertices, faces, silent())
    moved = conformal_sphere(30 * vertices @ turn.T - 100, faces, silent())
    assert np.abs(aligned(moved, plain) - plain).max() < 1e-6


def test_a_mirrored_body_has_the_mirrored_map() -> None:
    vertices, faces = lumpy(3)
    plain = conformal_sphere(vertices, faces, silent())
    mirrored = conformal_sphere(vertices * [1, 1, -1], faces[:, ::-1], silent())
    assert flipped_faces(mirrored, faces[:, ::-1]) == 0
    assert np.abs(aligned(mirrored * [1, 1, -1], plain) - plain).max() < 0.02


def test_the_map_of_the_body_is_centred() -> None:
    vertices, faces = lumpy(3, size=0.6)
    found = conformal_sphere(vertices, faces, silent())
    mass = vertex_mass(vertices, faces)
    assert np.linalg.norm(mass @ found) / mass.sum() < 1e-6


def test_the_same_input_gives_the_same_map_bit_for_bit() -> None:
    vertices, faces = lumpy(3)
    first = conformal_sphere(vertices, faces, silent())
    np.testing.assert_array_equal(first, conformal_sphere(vertices, faces, silent()))


def test_a_body_with_a_handle_is_refused() -> None:
    with pytest.raises(NotGenusZeroError) as caught:
        conformal_sphere(*torus_mesh(), silent())
    assert caught.value.hint


def test_the_hierarchical_embedding_is_the_last_resort(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = lumpy(3)
    usual = conformal_sphere(vertices, faces, silent())
    monkeypatch.setattr(conformal, "_laplacians", lambda *args: ())
    found = conformal_sphere(vertices, faces, silent())
    assert flipped_faces(found, faces) == 0
    assert mean_conformal_error(vertices, found, faces) == pytest.approx(
        mean_conformal_error(vertices, usual, faces), abs=0.01
    )


def with_nan(directions: np.ndarray) -> np.ndarray:
    broken = directions.copy()
    broken[3, 1] = np.nan
    return broken


def test_nan_positions_are_an_error_and_never_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = lumpy(2)
    original = conformal._alternate
    monkeypatch.setattr(conformal, "_alternate", lambda *args: with_nan(original(*args)))
    with pytest.raises(FlippedFacesError):
        conformal_sphere(vertices, faces, silent())


def test_a_correction_that_gives_nan_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = lumpy(2)
    original = conformal._solve_hemisphere
    monkeypatch.setattr(conformal, "_solve_hemisphere", lambda *args: with_nan(original(*args)))
    found = conformal_sphere(vertices, faces, silent())
    assert np.isfinite(found).all()
    assert flipped_faces(found, faces) == 0


def test_corrections_never_make_the_map_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = lumpy(3, size=0.5)
    best = conformal_sphere(vertices, faces, silent())
    monkeypatch.setattr(conformal, "ALTERNATIONS", 0)
    first = conformal_sphere(vertices, faces, silent())
    assert mean_conformal_error(vertices, best, faces) <= mean_conformal_error(
        vertices, first, faces
    )


def test_a_stretched_map_is_made_as_conformal_as_it_was() -> None:
    vertices, faces = icosphere(4)
    plane = _stereographic(vertices)
    stretched = plane + (0.2 - 0.3j) * np.conj(plane)
    found = _most_conformal(stretched, vertices, faces)
    # The pole opposite to that of the projection is at 0.
    ratio = found[plane != 0] / plane[plane != 0]
    np.testing.assert_allclose(ratio, ratio[0], rtol=3e-3)


def test_the_factor_left_behind_preconditions_the_laplacian_of_the_map() -> None:
    vertices, faces = lumpy(5, size=0.4)
    solver = ReusedFactor()
    found = conformal_sphere(vertices, faces, silent(), solver)
    assert solver.factor is not None
    matrix = pinned(cotangent_laplacian(found, faces))
    right = matrix @ np.random.default_rng(0).normal(size=(len(vertices), 1))
    _, solved = conjugate_gradient(matrix, right, solver.factor, tolerance=1e-8, iterations=12)
    assert solved


def test_obtuse_triangles_fall_back_to_positive_weights() -> None:
    """Random diagonals on a stretched grid: many negative cotangents, still no flip."""
    vertices, faces = icosphere(3)
    rng = np.random.default_rng(0)
    shaken = vertices + 0.12 * rng.normal(size=vertices.shape)
    found = conformal_sphere(shaken * [1, 1, 3], faces, silent())
    assert flipped_faces(found, faces) == 0


def test_it_reports_and_can_be_cancelled() -> None:
    vertices, faces = lumpy(2)
    seen: list[float] = []
    conformal_sphere(vertices, faces, Progress(lambda step, fraction, text: seen.append(fraction)))
    assert seen
    assert seen == sorted(seen)
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        conformal_sphere(vertices, faces, progress)


@pytest.mark.parametrize("pole", [1, -1])
def test_stereographic_projections_are_inverse_and_keep_the_orientation(pole: int) -> None:
    where = directions(500)
    plane = _stereographic(where, pole)
    np.testing.assert_allclose(_inverse_stereographic(plane, pole), where, atol=1e-9)
    vertices, faces = icosphere(3)
    # Only the faces around the pole of the projection are turned inside out.
    flat = _stereographic(vertices, pole)[faces]
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = a.real * b.imag - a.imag * b.real
    away = pole * vertices[faces][:, :, 0].max(axis=1) < 0.8
    signs = np.sign(area[away])
    assert abs(signs.sum()) == len(signs)


def test_both_projections_have_the_same_orientation() -> None:
    """Otherwise alternating between the poles would mirror the map."""
    vertices, faces = icosphere(3)
    equator = np.abs(vertices[faces][:, :, 0]).max(axis=1) < 0.5
    signs = []
    for pole in (1, -1):
        flat = _stereographic(vertices, pole)[faces[equator]]
        a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        signs.append(np.sign(a.real * b.imag - a.imag * b.real))
    np.testing.assert_array_equal(signs[0], signs[1])


def test_mobius_maps_keep_cross_ratios_and_the_sphere() -> None:
    where = directions(400)
    moved = _invert(where, np.array([0.3, -0.5, 0.2]))
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1.0)
    four = np.arange(400).reshape(100, 4)
    np.testing.assert_allclose(cross_ratio(moved[four]), cross_ratio(where[four]), rtol=1e-9)
    np.testing.assert_allclose(_invert(where, np.zeros(3)), where, atol=1e-12)


def test_centring_undoes_a_mobius_map() -> None:
    vertices, faces = icosphere(3)
    weights = vertex_mass(vertices, faces)
    squeezed = _invert(vertices, np.array([0.0, 0.6, -0.3]))
    assert np.linalg.norm(weights @ squeezed) / weights.sum() > 0.3
    centred = mobius_centered(squeezed, weights, faces)
    assert np.linalg.norm(weights @ centred) / weights.sum() < 1e-9
    assert flipped_faces(centred, faces) == 0
    assert np.abs(aligned(centred, vertices) - vertices).max() < 1e-6
    assert conformal_error(vertices, centred, faces).max() < 1.001
