"""Repairs: what comes out is one closed manifold, and the report says what was done."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from napari_unwrap3d.errors import (
    MeshError,
    NotManifoldError,
    NotWatertightError,
    SeveralCellsError,
)
from napari_unwrap3d.geometry import mesh
from napari_unwrap3d.geometry.holes import boundary_loops, fill_holes
from napari_unwrap3d.geometry.repair import repair, repair_mesh

Mesh = tuple[np.ndarray, np.ndarray]


def sphere(level: int = 3) -> Mesh:
    shape = trimesh.creation.icosphere(level)
    return np.array(shape.vertices), np.array(shape.faces, dtype=np.int64)


def torus() -> Mesh:
    shape = trimesh.creation.torus(3.0, 1.0, 40, 20)
    return np.array(shape.vertices), np.array(shape.faces, dtype=np.int64)


def together(*parts: Mesh) -> Mesh:
    offsets = np.cumsum([0] + [len(v) for v, _ in parts])
    faces = [f + offset for (_, f), offset in zip(parts, offsets[:-1], strict=True)]
    return np.concatenate([v for v, _ in parts]), np.concatenate(faces)


def counts(report: dict) -> dict[str, int]:
    """The repairs by the first words that tell them apart."""
    return {entry["what"]: entry["count"] for entry in report["repairs"]}


def voxel_surface(solid: np.ndarray) -> Mesh:
    """The sides of the voxels that lie against the outside, two triangles each."""
    padded = np.pad(solid, 1)
    quads = []
    for axis in range(3):
        for sign in (1, -1):
            bare = padded & ~np.roll(padded, -sign, axis)
            voxel = np.argwhere(bare)
            u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
            corner = voxel + (np.eye(3, dtype=int)[axis] if sign == 1 else 0)
            ring = [corner, corner + u, corner + u + v, corner + v]
            quads.append(np.stack(ring if sign == 1 else ring[::-1], axis=1))
    corners = np.concatenate(quads)
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 4)
    return vertices.astype(float), np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])


def assert_closed_manifold(vertices: np.ndarray, faces: np.ndarray, report: dict) -> None:
    assert mesh.is_watertight(faces)
    assert mesh.is_consistently_wound(faces)
    assert len(mesh.nonmanifold_vertices(faces)) == 0
    assert mesh.signed_volume(vertices, faces) > 0
    assert report["components"] == 1
    assert len(np.unique(faces)) == len(vertices)
    assert json.loads(json.dumps(report)) == report


def test_a_sound_mesh_stays_as_it_is() -> None:
    vertices, faces = torus()
    repaired = repair_mesh(vertices, faces)
    assert np.array_equal(repaired.vertices, vertices)
    assert np.array_equal(repaired.faces, faces)
    assert np.array_equal(repaired.origin, np.arange(len(vertices)))
    assert repaired.report["repairs"] == []
    assert repaired.report["genus"] == 1


def test_triangle_soup_is_merged() -> None:
    vertices, faces = torus()
    soup = vertices[faces].reshape(-1, 3)
    merged, joined, report = repair(soup, np.arange(len(soup)).reshape(-1, 3))
    assert_closed_manifold(merged, joined, report)
    assert report["genus"] == 1
    assert len(merged) == len(vertices)
    assert list(counts(report).values()) == [len(soup) - len(vertices)]
    assert report["as_given"]["components"] == len(faces)


def test_vertices_within_rounding_are_merged() -> None:
    vertices, faces = sphere()
    soup = vertices[faces].reshape(-1, 3)
    soup += np.random.default_rng(0).uniform(-1e-9, 1e-9, soup.shape)
    merged, joined, report = repair(soup, np.arange(len(soup)).reshape(-1, 3))
    assert_closed_manifold(merged, joined, report)
    assert len(merged) == len(vertices)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), removed=st.integers(1, 12))
def test_small_holes_are_closed(seed: int, removed: int) -> None:
    vertices, faces = sphere()
    keep = np.random.default_rng(seed).permutation(len(faces))[removed:]
    closed, filled, report = repair(vertices, faces[keep])
    assert_closed_manifold(closed, filled, report)
    assert report["genus"] == 0
    assert report["volume_um3"] == pytest.approx(mesh.signed_volume(vertices, faces), rel=0.02)
    assert counts(report)["holes were closed"] >= 1


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), fill=st.floats(0.4, 0.8))
def test_voxel_solids_that_touch_themselves_are_cut_apart(seed: int, fill: float) -> None:
    noise = np.random.default_rng(seed).random((6, 6, 6)) < fill
    labels, _ = ndimage.label(noise)
    solid = ndimage.binary_fill_holes(labels == np.bincount(labels[labels > 0]).argmax())
    vertices, faces = voxel_surface(solid)
    cut, manifold, report = repair(vertices, faces)
    assert_closed_manifold(cut, manifold, report)
    assert report["volume_um3"] == pytest.approx(solid.sum())
    if report["as_given"]["nonmanifold_edges"]:
        counted = counts(report)["edges with more than two faces were cut apart"]
        assert counted == report["as_given"]["nonmanifold_edges"]


def test_two_blocks_joined_by_an_edge_and_a_bridge_stay_one() -> None:
    solid = np.zeros((2, 3, 3), dtype=bool)
    solid[0] = [[1, 1, 1], [1, 0, 1], [1, 1, 0]]
    solid[1, 1:, 1:] = [[0, 0], [0, 1]]
    solid[0, 2, 2] = False
    solid[1, 2, 1] = True
    vertices, faces = voxel_surface(solid)
    cut, manifold, report = repair(vertices, faces)
    assert_closed_manifold(cut, manifold, report)
    assert report["volume_um3"] == pytest.approx(solid.sum())


def test_flaps_and_fins_are_dropped() -> None:
    vertices, faces = sphere()
    a, b = mesh.edges_with_faces(faces).vertices[0]
    n = len(vertices)
    vertices = np.concatenate([vertices, vertices[[a, b]] * 2, vertices[[a, b]] * 3])
    fin = np.array([[a, b, n], [n, b, n + 1], [n, n + 1, n + 2], [n + 2, n + 1, n + 3]])
    closed, manifold, report = repair(vertices, np.concatenate([faces, fin]))
    assert_closed_manifold(closed, manifold, report)
    assert np.array_equal(closed, sphere()[0])
    assert counts(report) == {"faces of sheets hanging on the surface were dropped": 4}


def test_doubled_and_collapsed_faces_are_dropped() -> None:
    vertices, faces = sphere()
    spoilt = np.concatenate([faces, faces[:5], [[1, 1, 2], [3, 4, 3]]])
    closed, manifold, report = repair(vertices, spoilt)
    assert_closed_manifold(closed, manifold, report)
    assert list(counts(report).values()) == [2, 5]


def test_a_folded_sheet_of_paper_on_the_surface_is_dropped() -> None:
    vertices, faces = sphere()
    a, b = mesh.edges_with_faces(faces).vertices[0]
    tip = len(vertices)
    paper = np.array([[a, b, tip], [b, a, tip]])
    closed, manifold, report = repair(
        np.concatenate([vertices, [[3.0, 0, 0]]]), np.concatenate([faces, paper])
    )
    assert_closed_manifold(closed, manifold, report)
    assert len(closed) == len(vertices)


def test_corners_in_line_are_given_area() -> None:
    vertices, faces = sphere()
    a, b, tip = faces[0]
    middle = len(vertices)
    vertices = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
    # The face is split in its edge a b, its neighbour is not: a flat face lies between.
    split = np.array([[a, middle, tip], [middle, b, tip], [a, b, middle]])
    closed, manifold, report = repair(vertices, np.concatenate([faces[1:], split]))
    assert_closed_manifold(closed, manifold, report)
    assert report["as_given"]["degenerate_faces"] == 1
    assert report["degenerate_faces"] == 0
    assert counts(report) == {"edges of faces without area were turned": 1}


def test_small_components_are_dropped_and_reported() -> None:
    vertices, faces = together(sphere(3), (sphere(1)[0] * 0.1 + 5.0, sphere(1)[1]))
    kept, manifold, report = repair(vertices, faces)
    assert np.array_equal(kept, sphere(3)[0])
    dropped = report["repairs"][0]
    assert dropped["count"] == len(sphere(1)[1])
    assert dropped["components"] == 1
    assert_closed_manifold(kept, manifold, report)


def test_two_cells_are_refused() -> None:
    vertices, faces = together(sphere(), (sphere()[0] * 0.9 + 5.0, sphere()[1]))
    with pytest.raises(SeveralCellsError, match=r"components = 2.*Save each cell"):
        repair(vertices, faces)
    _, _, report = repair(vertices, faces, second_cell_fraction=0.9)
    assert report["components"] == 1


def test_two_cells_that_touch_in_a_vertex_are_refused() -> None:
    vertices, faces = together(sphere(), (sphere()[0] + 5.0, sphere()[1]))
    faces[faces == len(vertices) // 2] = 7
    with pytest.raises(SeveralCellsError):
        repair(vertices, faces)


def test_an_inside_out_mesh_is_turned_over() -> None:
    vertices, faces = sphere()
    turned, manifold, report = repair(vertices, faces[:, ::-1])
    assert_closed_manifold(turned, manifold, report)
    assert counts(report) == {"faces were turned over to point outwards": len(faces)}


def test_a_large_hole_is_refused_with_its_size() -> None:
    vertices, faces = sphere()
    half = faces[vertices[faces].mean(axis=1)[:, 0] > 0]
    with pytest.raises(NotWatertightError, match=r"fraction_of_area = 0.5.*mesh editor"):
        repair(vertices, half)


def test_a_single_triangle_is_refused() -> None:
    with pytest.raises(NotWatertightError):
        repair(np.eye(3), [[0, 1, 2]])


def test_a_flat_mesh_is_refused() -> None:
    vertices = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1.0]])
    faces = np.array([[0, 1, 2], [1, 3, 2], [0, 3, 1], [0, 2, 3]])
    with pytest.raises(MeshError, match="encloses no volume"):
        repair(vertices, faces)


def test_faces_that_cancel_leave_nothing() -> None:
    with pytest.raises(MeshError, match="Nothing is left"):
        repair(np.eye(3), [[0, 1, 2], [2, 1, 0]] * 2)


def test_a_moebius_strip_is_refused() -> None:
    n = 40
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    rim = [
        np.stack([w * np.sin(turn / 2), (3 + w * np.cos(turn / 2)) * np.cos(turn),
                  (3 + w * np.cos(turn / 2)) * np.sin(turn)], axis=1)
        for w in (-1, 1)
    ]  # fmt: skip
    i, j = np.arange(n), (np.arange(n) + 1) % n
    low = np.where(j == 0, n, j)
    high = np.where(j == 0, 0, n + j)
    faces = np.concatenate([np.stack([i, low, n + i], 1), np.stack([low, high, n + i], 1)])
    with pytest.raises(NotManifoldError, match="one-sided"):
        repair(np.concatenate(rim), faces)


def test_filling_avoids_edges_that_exist() -> None:
    vertices = np.array([[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]], dtype=float)
    faces = np.array([[0, 1, 3], [1, 2, 3]])
    _, filled, _, _ = fill_holes(vertices, faces, 10.0)
    assert mesh.is_watertight(filled)
    assert len(mesh.edges_with_faces(filled).vertices) == 6


def test_filling_adds_a_vertex_where_every_chord_exists() -> None:
    vertices = np.array(
        [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0], [1, 0, 0], [1, 1, 1]], dtype=float
    )
    other_solid = [[0, 2, 4], [0, 5, 2], [0, 4, 5], [2, 5, 4]]
    faces = np.array([[0, 1, 3], [1, 2, 3], *other_solid])
    assert [sorted(loop.tolist()) for loop in boundary_loops(faces)] == [[0, 1, 2, 3]]
    points, filled, origin, counted = fill_holes(vertices, faces, 10.0)
    assert len(points) == 7
    assert origin.tolist()[0] in (0, 1, 2, 3)
    assert mesh.is_watertight(filled)
    assert counted["holes"] == 1


def test_a_long_rim_is_refused() -> None:
    shape = trimesh.creation.cylinder(1.0, 1.0, sections=600)
    faces = np.array(shape.faces)
    normals = mesh.face_normals(shape.vertices, faces)
    with pytest.raises(NotWatertightError, match="rim_edges = 600"):
        repair(shape.vertices, faces[np.abs(normals[:, 2]) < 0.5])


def test_gastruloid_comes_out_sound(shared_data: Path) -> None:
    loaded = trimesh.load(shared_data / "meshes" / "gastruloid.ply", process=False)
    vertices, faces, report = repair(
        np.asarray(loaded.vertices)[:, ::-1], np.asarray(loaded.faces)[:, ::-1]
    )
    assert report["as_given"]["boundary_edges"] == 2
    assert report["as_given"]["nonmanifold_edges"] == 1
    assert_closed_manifold(vertices, faces, report)
    assert report["genus"] == 0
    assert report["degenerate_faces"] == 0
    assert counts(report)["faces of sheets hanging on the surface were dropped"] == 1


@pytest.mark.parametrize(("name", "genus"), [("torus.obj", 1), ("knot.ply", 1), ("spot.obj", 0)])
def test_real_meshes_keep_their_genus(shared_data: Path, name: str, genus: int) -> None:
    loaded = trimesh.load(shared_data / "meshes" / name, process=False)
    vertices, faces, report = repair(
        np.asarray(loaded.vertices)[:, ::-1], np.asarray(loaded.faces)[:, ::-1]
    )
    assert_closed_manifold(vertices, faces, report)
    assert report["genus"] == genus


def test_vertices_without_a_face_are_dropped_and_counted() -> None:
    vertices, faces = sphere()
    kept, manifold, report = repair(np.concatenate([np.full((2, 3), 1e6), vertices]), faces + 2)
    assert_closed_manifold(kept, manifold, report)
    assert np.array_equal(kept, vertices)
    assert report["vertices"] == len(vertices)
    assert counts(report) == {"vertices without a face were dropped": 2}


def test_every_turned_face_of_an_open_mesh_is_counted() -> None:
    vertices, faces = sphere()
    faces = faces[1:].copy()
    faces[10:20] = faces[10:20, ::-1]
    closed, manifold, report = repair(vertices, faces)
    assert_closed_manifold(closed, manifold, report)
    assert counts(report)["faces were turned over to agree with their neighbours"] == 10


@pytest.mark.parametrize("sizes", [(1.0, 0.9), (1.0, 0.95, 0.9, 0.4)])
def test_walls_of_cavities_are_no_second_cell(sizes: tuple[float, ...]) -> None:
    vertices, faces = sphere()
    walls = [(s * vertices, faces[:, :: 1 - 2 * (i % 2)]) for i, s in enumerate(sizes)]
    kept, manifold, report = repair(*together(*walls[::-1]))
    assert_closed_manifold(kept, manifold, report)
    assert np.array_equal(kept, vertices)
    dropped = counts(report)["faces of walls inside the cell, as of a cavity, were dropped"]
    assert dropped == (len(sizes) - 1) * len(faces)


def test_a_cell_that_reaches_into_another_is_no_cavity() -> None:
    vertices, faces = sphere()
    with pytest.raises(SeveralCellsError):
        repair(*together((vertices, faces), (0.9 * vertices + [0, 0, 0.5], faces)))
