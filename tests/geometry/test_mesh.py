"""Measures of meshes against closed formulas and identities."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.errors import MeshError, NotManifoldError, NotWatertightError
from napari_unwrap3d.geometry import mesh

TETRAHEDRON = (
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)


def solid(name: str) -> tuple[np.ndarray, np.ndarray]:
    shapes = {
        "box": lambda: trimesh.creation.box((2.0, 3.0, 4.0)),
        "sphere": lambda: trimesh.creation.icosphere(3),
        "torus": lambda: trimesh.creation.torus(3.0, 1.0, 60, 40),
    }
    shape = shapes[name]()
    return np.array(shape.vertices), np.array(shape.faces, dtype=np.int64)


def beside(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Several meshes in one, far apart."""
    vertices, faces, offset = [], [], 0
    for i, (v, f) in enumerate(parts):
        vertices.append(v + np.array([0, 0, 100.0 * i]))
        faces.append(f + offset)
        offset += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def klein_bottle(n: int = 8) -> np.ndarray:
    """Faces of a closed one-sided surface: a grid glued with one side reversed."""
    index = np.arange(n * n).reshape(n, n)
    right = np.roll(index, -1, axis=1)
    below = np.concatenate([index[1:], (-np.arange(n) % n)[None]])
    below_right = np.roll(below, -1, axis=1)
    corners = np.stack([index, right, below, below_right], axis=-1).reshape(-1, 4)
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [1, 3, 2]]])


def test_tetrahedron_by_hand() -> None:
    vertices, faces = TETRAHEDRON
    assert mesh.signed_volume(vertices, faces) == pytest.approx(1 / 6)
    assert mesh.face_areas(vertices, faces) == pytest.approx([0.5, 0.5, 0.5, np.sqrt(3) / 2])
    assert mesh.face_normals(vertices, faces)[3] == pytest.approx(np.ones(3) / np.sqrt(3))
    assert mesh.euler_characteristic(faces) == 2
    across = mesh.face_neighbors(faces)
    for f, k in np.ndindex(4, 3):
        shared = set(faces[f]) - {faces[f, k]}
        assert shared <= set(faces[across[f, k]])
        assert across[f, k] != f


def test_box_volume_and_area() -> None:
    vertices, faces = solid("box")
    assert mesh.signed_volume(vertices + 1e6, faces) == pytest.approx(24.0)
    assert mesh.signed_volume(vertices, faces[:, ::-1]) == pytest.approx(-24.0)
    assert mesh.face_areas(vertices, faces).sum() == pytest.approx(52.0)


def test_torus_area_and_volume_approach_the_formula() -> None:
    report = mesh.mesh_report(*solid("torus"))
    assert report["area_um2"] == pytest.approx(4 * np.pi**2 * 3, rel=0.01)
    assert report["volume_um3"] == pytest.approx(2 * np.pi**2 * 3, rel=0.015)
    assert report["genus"] == 1


def test_normals_of_a_sphere_point_along_the_radius() -> None:
    vertices, faces = solid("sphere")
    along = np.einsum("ij,ij->i", mesh.vertex_normals(vertices, faces), vertices)
    assert along.min() > 0.999
    centres = vertices[faces].mean(axis=1)
    assert (np.einsum("ij,ij->i", mesh.face_normals(vertices, faces), centres) > 0).all()


def test_closed_mesh_has_no_net_area_vector() -> None:
    vertices, faces = solid("torus")
    area = mesh.face_areas(vertices, faces)[:, None]
    assert (area * mesh.face_normals(vertices, faces)).sum(axis=0) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("name", "genus"), [("box", 0), ("sphere", 0), ("torus", 1)])
def test_euler_characteristic_gives_the_genus(name: str, genus: int) -> None:
    _, faces = solid(name)
    assert mesh.euler_characteristic(faces) == 2 - 2 * genus
    assert mesh.genus(faces) == genus


def test_genus_adds_up_over_components() -> None:
    vertices, faces = beside(solid("torus"), solid("sphere"), solid("torus"))
    assert mesh.genus(faces) == 2
    report = mesh.mesh_report(vertices, faces)
    assert (report["components"], report["genus"]) == (3, 2)


def test_genus_of_open_branching_and_one_sided_meshes_is_refused() -> None:
    _, faces = solid("sphere")
    with pytest.raises(NotWatertightError, match="boundary_edges = 3"):
        mesh.genus(faces[1:])
    with pytest.raises(NotManifoldError, match="nonmanifold_edges = 3"):
        mesh.genus(np.concatenate([faces, faces[:1]]))
    with pytest.raises(NotManifoldError, match="one-sided"):
        mesh.genus(klein_bottle())


def test_a_vertex_shared_by_two_solids_is_not_manifold() -> None:
    _, faces = beside(TETRAHEDRON, TETRAHEDRON)
    faces[faces == 4] = 0
    assert mesh.nonmanifold_vertices(faces).tolist() == [0]
    assert mesh.is_watertight(faces)
    with pytest.raises(NotManifoldError, match="nonmanifold_vertices = 1"):
        mesh.genus(faces)


def test_an_edge_shared_by_two_solids_is_not_manifold() -> None:
    _, faces = beside(TETRAHEDRON, TETRAHEDRON)
    faces[faces == 4] = 0
    faces[faces == 5] = 1
    assert mesh.nonmanifold_edges(faces).tolist() == [[0, 1]]
    assert mesh.nonmanifold_vertices(faces).tolist() == [0, 1]
    assert not mesh.is_watertight(faces)


def test_components_label_faces_and_vertices() -> None:
    vertices, faces = beside(TETRAHEDRON, solid("box"))
    of_face, of_vertex = mesh.connected_components(faces, len(vertices) + 1)
    assert of_face.tolist() == [0] * 4 + [1] * 12
    assert of_vertex.tolist() == [0] * 4 + [1] * 8 + [-1]


def test_boundary_of_an_opened_mesh() -> None:
    _, faces = solid("box")
    assert len(mesh.boundary_edges(faces)) == 0
    removed = faces[0]
    edges = {tuple(edge) for edge in mesh.boundary_edges(faces[1:]).tolist()}
    assert edges == {tuple(sorted(map(int, (removed[i], removed[i - 1])))) for i in range(3)}


def test_radius_ratio_of_known_triangles() -> None:
    vertices = np.array([[0, 0, 0], [0, 0, 1], [0, np.sqrt(3) / 2, 0.5], [0, 1, 0], [0, 0, 2]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 0, 1]])
    expected = [1.0, 2 * np.sqrt(2) - 2, 0.0, 0.0]
    assert mesh.radius_ratio(vertices, faces) == pytest.approx(expected, abs=1e-7)
    assert mesh.degenerate_faces(vertices, faces).tolist() == [False, False, True, True]


def test_winding_is_made_consistent_and_outward() -> None:
    vertices, faces = beside(solid("torus"), solid("box"))
    rng = np.random.default_rng(0)
    mixed = faces.copy()
    turned = rng.random(len(faces)) < 0.5
    mixed[turned] = mixed[turned][:, ::-1]
    assert not mesh.is_consistently_wound(mixed)
    oriented = mesh.orient_outward(vertices, mixed)
    assert mesh.is_consistently_wound(oriented)
    assert mesh.signed_volume(vertices, oriented) == pytest.approx(
        mesh.signed_volume(vertices, faces)
    )
    assert mesh.face_normals(vertices, oriented) == pytest.approx(
        mesh.face_normals(vertices, faces)
    )


def test_a_one_sided_mesh_is_refused() -> None:
    faces = klein_bottle()
    assert mesh.is_watertight(faces)
    with pytest.raises(NotManifoldError, match="one-sided"):
        mesh.orient_outward(np.zeros((faces.max() + 1, 3)), faces)


def test_a_missing_vertex_is_named() -> None:
    with pytest.raises(MeshError, match="largest_index = 3"):
        mesh.orient_outward(TETRAHEDRON[0][:3], TETRAHEDRON[1])


@settings(max_examples=25, deadline=None)
@given(
    name=st.sampled_from(["box", "sphere", "torus"]),
    seed=st.integers(0, 2**32 - 1),
    shift=st.tuples(*[st.floats(-50, 50)] * 3),
)
def test_measures_do_not_depend_on_numbering_or_place(
    name: str, seed: int, shift: tuple[float, float, float]
) -> None:
    vertices, faces = solid(name)
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(vertices))
    moved = np.empty_like(vertices)
    moved[order] = vertices + shift
    renamed = order[faces][rng.permutation(len(faces))]
    renamed = np.take_along_axis(
        renamed, (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3, axis=1
    )
    expected = mesh.mesh_report(vertices, faces)
    report = mesh.mesh_report(moved, renamed)
    for key, value in expected.items():
        assert report[key] == pytest.approx(value, rel=1e-9), key


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), removed=st.integers(1, 40))
def test_report_of_a_damaged_mesh_counts_instead_of_failing(seed: int, removed: int) -> None:
    vertices, faces = solid("sphere")
    keep = np.random.default_rng(seed).permutation(len(faces))[removed:]
    report = mesh.mesh_report(vertices, faces[keep])
    assert report["boundary_edges"] > 0
    assert not report["watertight"]
    assert report["genus"] is None
    assert report["volume_um3"] is None
    assert json.loads(json.dumps(report)) == report


def test_real_meshes(shared_data: Path) -> None:
    genus = {"torus.obj": 1, "knot.ply": 1, "midgut_mesh_01.ply": 0, "branchoid.ply": 0}
    for name, expected in genus.items():
        loaded = trimesh.load(shared_data / "meshes" / name, process=False)
        report = mesh.mesh_report(np.asarray(loaded.vertices), np.asarray(loaded.faces))
        assert report["genus"] == expected, name
        assert report["watertight"]
        assert report["volume_um3"] > 0
