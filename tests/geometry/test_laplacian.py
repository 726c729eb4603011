"""Laplacian and mass against identities and libigl, and the solvers against their equations."""

import os
import threading
from pathlib import Path

import igl
import numpy as np
import pytest
import scipy.sparse as sparse

from napari_unwrap3d.errors import MeshError
from napari_unwrap3d.geometry.intrinsic import (
    DELAUNAY_TOLERANCE,
    LAPLACIANS,
    MOLLIFY,
    intrinsic_delaunay_laplacian,
    robust_laplacian,
)
from napari_unwrap3d.geometry.laplacian import (
    Factor,
    conjugate_gradient,
    cotangent_laplacian,
    cotangents_from_lengths,
    faces_to_vertices,
    laplacian_from_weights,
    mass_matrix,
    pinned,
    vertex_mass,
)
from napari_unwrap3d.geometry.mesh import face_areas
from shapes import icosphere, lumpy, rotation, torus_mesh

MESHES = {"lumpy": lumpy(3), "torus": torus_mesh(), "sphere": icosphere(2)}


@pytest.mark.parametrize("name", MESHES)
def test_the_laplacian_is_libigls(name: str) -> None:
    vertices, faces = MESHES[name]
    expected = sparse.csr_array(igl.cotmatrix(vertices, faces))
    difference = cotangent_laplacian(vertices, faces) - expected
    assert np.abs(difference.toarray()).max() < 1e-10


@pytest.mark.parametrize("name", MESHES)
def test_symmetric_with_rows_that_sum_to_zero_and_no_positive_energy(name: str) -> None:
    vertices, faces = MESHES[name]
    laplacian = cotangent_laplacian(vertices, faces)
    assert abs(laplacian - laplacian.T).max() < 1e-12
    assert np.abs(laplacian.sum(axis=1)).max() < 1e-11
    for seed in range(5):
        f = np.random.default_rng(seed).normal(size=len(vertices))
        assert f @ (laplacian @ f) < 0


def test_neither_rotation_nor_scale_changes_it() -> None:
    vertices, faces = MESHES["lumpy"]
    moved = 3.7 * vertices @ rotation(1).T + 5
    difference = cotangent_laplacian(moved, faces) - cotangent_laplacian(vertices, faces)
    assert abs(difference).max() < 1e-9


def test_linear_functions_are_harmonic_inside_a_flat_mesh() -> None:
    """Linear precision: on an irregular plane the Laplacian of a linear function is zero."""
    from scipy.spatial import Delaunay

    flat = np.random.default_rng(0).random((200, 2))
    faces = Delaunay(flat).simplices.astype(np.int64)
    vertices = np.column_stack([flat, np.zeros(len(flat))]) @ rotation(2).T
    values = flat @ [2.0, -3.0] + 1.0
    residual = cotangent_laplacian(vertices, faces) @ values
    border = np.unique(np.concatenate(igl.boundary_loop_all(faces)))
    inside = np.setdiff1d(np.arange(len(flat)), border)
    assert np.abs(residual[inside]).max() < 1e-9
    assert np.abs(residual[border]).max() > 0.1


def test_the_gradient_energy_of_a_coordinate_of_the_sphere() -> None:
    """∫|∇z|² over the unit sphere is 8π/3."""
    vertices, faces = icosphere(4)
    z = vertices[:, 0]
    energy = -z @ (cotangent_laplacian(vertices, faces) @ z)
    assert energy == pytest.approx(8 * np.pi / 3, rel=0.005)


def test_a_collapsed_triangle_gives_large_but_finite_weights() -> None:
    vertices, faces = icosphere(1)
    vertices[faces[0, 0]] = vertices[faces[0, 1]]
    laplacian = cotangent_laplacian(vertices, faces)
    assert np.isfinite(laplacian.data).all()
    assert np.abs(laplacian.sum(axis=1)).max() < 1e-3 * abs(laplacian).max()


def test_uniform_weights_count_the_neighbours() -> None:
    _, faces = icosphere(1)
    laplacian = laplacian_from_weights(np.full(faces.shape, 0.5), faces, faces.max() + 1)
    valence = np.bincount(faces.ravel())
    np.testing.assert_allclose(-laplacian.diagonal(), valence)
    assert set(np.unique(laplacian.toarray() - np.diag(laplacian.diagonal()))) == {0.0, 1.0}


def off_diagonal(laplacian: sparse.csr_array) -> np.ndarray:
    entries = laplacian.tocoo()
    return entries.data[entries.row != entries.col]


def sheared() -> tuple[np.ndarray, np.ndarray]:
    """A body with many obtuse triangles."""
    vertices, faces = icosphere(3)
    return vertices * [1.0, 1.0, 6.0], faces


@pytest.mark.parametrize("laplacian", [intrinsic_delaunay_laplacian, robust_laplacian])
def test_no_intrinsic_weight_is_negative(laplacian) -> None:
    vertices, faces = sheared()
    assert off_diagonal(cotangent_laplacian(vertices, faces)).min() < -0.1
    intrinsic = laplacian(vertices, faces)
    assert off_diagonal(intrinsic).min() > -DELAUNAY_TOLERANCE
    assert abs(intrinsic - intrinsic.T).max() < 1e-12
    np.testing.assert_allclose(intrinsic @ np.full(len(vertices), 7.0), 0, atol=1e-11)


@pytest.mark.parametrize("laplacian", [intrinsic_delaunay_laplacian, robust_laplacian])
def test_on_a_delaunay_mesh_it_is_the_cotangent_laplacian(laplacian) -> None:
    vertices, faces = icosphere(3)
    expected = cotangent_laplacian(vertices, faces)
    assert off_diagonal(expected).min() > 0
    assert abs(laplacian(vertices, faces) - expected).max() < 1e-10


@pytest.mark.parametrize("name", LAPLACIANS)
def test_every_laplacian_has_the_energy_of_a_coordinate(name: str) -> None:
    """∫|∇z|² over the unit sphere, however its triangles lie."""
    vertices, faces = icosphere(4)
    # Points moved along the sphere, so that triangles become obtuse.
    vertices = vertices + 0.02 * np.random.default_rng(0).normal(size=vertices.shape)
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    z = vertices[:, 0]
    energy = -z @ (LAPLACIANS[name](vertices, faces) @ z)
    assert energy == pytest.approx(8 * np.pi / 3, rel=0.01)


def test_collapsed_triangles_are_refused_or_mollified() -> None:
    vertices, faces = icosphere(3)
    vertices[faces[0, 0]] = vertices[faces[0, 1]]
    with pytest.raises(MeshError, match=r"collapsed_faces = 2.*robust") as caught:
        intrinsic_delaunay_laplacian(vertices, faces)
    assert caught.value.measured == {"collapsed_faces": 2}
    robust = robust_laplacian(vertices, faces)
    assert np.isfinite(robust.data).all()
    assert off_diagonal(robust).min() >= -DELAUNAY_TOLERANCE
    # No cotangent is larger than that of the thinnest triangle there can be.
    assert abs(robust.diagonal()).max() < 2 / MOLLIFY


@pytest.mark.parametrize("seed", range(6))
def test_the_robust_laplacian_ends_on_any_mesh(seed: int) -> None:
    """Flattened to a plate, to a line, or with a patch drawn into one point."""
    rng = np.random.default_rng(seed)
    vertices, faces = icosphere(3)
    if seed % 2:
        vertices = vertices * 10.0 ** rng.uniform(-9, 0, 3)
    else:
        vertices[: 50 * (seed + 1)] = vertices[0]
    robust = robust_laplacian(vertices, faces)
    assert np.isfinite(robust.data).all()
    assert off_diagonal(robust).min() > -DELAUNAY_TOLERANCE * abs(robust).max()


@pytest.mark.parametrize("kind", ["barycentric", "voronoi", "full"])
@pytest.mark.parametrize("name", MESHES)
def test_every_mass_sums_to_the_area(name: str, kind: str) -> None:
    vertices, faces = MESHES[name]
    mass = sparse.csr_array(mass_matrix(vertices, faces, kind))
    assert mass.sum() == pytest.approx(face_areas(vertices, faces).sum(), rel=1e-12)
    assert abs(mass - mass.T).max() == 0
    assert (mass.data >= 0).all()
    diagonal = mass.nnz == len(vertices)
    assert diagonal == (kind != "full")


def test_the_full_mass_integrates_products_of_linear_functions() -> None:
    """Over one face of area A, ∫x² = A (Σ xᵢ² + Σ xᵢ xⱼ) / 6 with the sum over i < j."""
    vertices, faces = MESHES["lumpy"]
    x = vertices[:, 2]
    mass = mass_matrix(vertices, faces, "full")
    a, b, c = x[faces].T
    squares = (a * a + b * b + c * c + a * b + b * c + c * a) / 6
    assert x @ (mass @ x) == pytest.approx(squares @ face_areas(vertices, faces))


@pytest.mark.parametrize("kind", ["barycentric", "voronoi", "full"])
def test_collapsed_vertices_get_the_least_mass(kind: str) -> None:
    vertices, faces = icosphere(2)
    around = np.unique(faces[(faces == 0).any(axis=1)])
    vertices[around] = vertices[0]
    mass = sparse.csr_array(mass_matrix(vertices, faces, kind, 1e-14))
    assert np.isfinite(mass.data).all()
    assert mass.diagonal().min() == 1e-14


@pytest.mark.parametrize("name", MESHES)
def test_the_mass_sums_to_the_area(name: str) -> None:
    vertices, faces = MESHES[name]
    mass = vertex_mass(vertices, faces)
    assert mass.sum() == pytest.approx(face_areas(vertices, faces).sum(), rel=1e-12)
    expected = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).diagonal()
    np.testing.assert_allclose(mass, expected, rtol=1e-9)


def test_sums_over_faces_are_conserved_for_scalars_and_vectors() -> None:
    _, faces = MESHES["torus"]
    values = np.random.default_rng(0).normal(size=(len(faces), 4))
    n = faces.max() + 3  # two vertices without faces
    summed = faces_to_vertices(values, faces, n)
    np.testing.assert_allclose(summed.sum(axis=0), 3 * values.sum(axis=0))
    np.testing.assert_allclose(summed[:, 2], faces_to_vertices(values[:, 2], faces, n))
    assert (summed[-2:] == 0).all()


def system(delta: float = 1e-3) -> sparse.csr_array:
    vertices, faces = MESHES["lumpy"]
    mass = sparse.diags_array(vertex_mass(vertices, faces))
    return sparse.csr_array(mass - delta * cotangent_laplacian(vertices, faces))


def test_the_factor_solves_one_or_several_right_sides() -> None:
    matrix = system()
    expected = np.random.default_rng(0).normal(size=(matrix.shape[0], 3))
    factor = Factor(matrix)
    np.testing.assert_allclose(factor.solve(matrix @ expected), expected, atol=1e-9)
    np.testing.assert_allclose(factor.solve(matrix @ expected[:, 0]), expected[:, 0], atol=1e-9)


def test_an_old_factor_preconditions_a_changed_system() -> None:
    old, new = system(1e-3), system(2e-3)
    expected = np.random.default_rng(0).normal(size=(new.shape[0], 3))
    right = new @ expected
    solution, solved = conjugate_gradient(new, right, Factor(old), tolerance=1e-10, iterations=40)
    assert solved
    assert np.abs(new @ solution - right).max() < 1e-10 * np.abs(right).max()
    _, solved = conjugate_gradient(new, right, Factor(old), tolerance=1e-10, iterations=2)
    assert not solved
    exact, solved = conjugate_gradient(new, right, Factor(new), tolerance=1e-9, iterations=0)
    assert solved
    np.testing.assert_allclose(exact, expected, atol=1e-7)


def test_a_pinned_laplacian_solves_poissons_equation() -> None:
    laplacian = cotangent_laplacian(*MESHES["lumpy"])
    expected = np.random.default_rng(0).normal(size=laplacian.shape[0])
    expected -= expected[0]
    solution = Factor(pinned(laplacian)).solve(-laplacian @ expected)
    np.testing.assert_allclose(solution, expected, atol=1e-9)


def test_cotangents_of_lengths_are_those_of_the_triangles() -> None:
    vertices, faces = lumpy(3)
    ends = vertices[np.roll(faces, -1, axis=1)] - vertices[np.roll(faces, -2, axis=1)]
    weights = 0.5 * cotangents_from_lengths(np.linalg.norm(ends, axis=2))
    made = laplacian_from_weights(weights, faces, len(vertices))
    expected = cotangent_laplacian(vertices, faces)
    np.testing.assert_allclose(made.toarray(), expected.toarray(), atol=1e-8)


def test_lengths_of_no_triangle_have_finite_cotangents() -> None:
    lengths = np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 3.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    assert np.isfinite(cotangents_from_lengths(lengths)).all()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads its memory from /proc")
def test_a_factor_dropped_in_another_thread_gives_its_memory_back() -> None:
    vertices, faces = icosphere(5)
    matrix = sparse.csr_array(
        sparse.diags_array(vertex_mass(vertices, faces)) - cotangent_laplacian(vertices, faces)
    )

    def resident_mb() -> float:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    # Other tests' factors may live on in the traceback of an error.
    others = set(threading.enumerate())
    sizes = []
    for _ in range(6):
        made: list[Factor] = []
        thread = threading.Thread(target=lambda made=made: made.append(Factor(matrix)))
        thread.start()
        thread.join()
        made.clear()
        # The owner frees it; on a busy machine that takes a moment.
        for owner in set(threading.enumerate()) - others:
            if owner.name.startswith("factor"):
                owner.join(timeout=60)
        sizes.append(resident_mb())
    # One factor takes 45 MB; the first ones may still find room to grow into.
    assert sizes[-1] - sizes[1] < 60.0


def test_an_impossible_factor_raises_in_the_thread_that_asked() -> None:
    with pytest.raises(RuntimeError):
        Factor(sparse.csr_array((4, 4)))


def test_a_factor_may_be_dropped_while_work_is_handed_to_a_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The garbage collector comes at any time: it must not wait for a lock of this thread."""
    lock = threading.Lock()
    monkeypatch.setattr("concurrent.futures.thread._global_shutdown_lock", lock)
    made = [Factor(sparse.eye_array(4, format="csc"))]

    def drop() -> None:
        with lock:
            made.clear()

    thread = threading.Thread(target=drop, daemon=True)
    thread.start()
    thread.join(timeout=20)
    assert not thread.is_alive()
