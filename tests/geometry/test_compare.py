"""Differences between surfaces that are known."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import napari_unwrap3d
from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.compare import (
    area_difference,
    chamfer_distance,
    compare_meshes,
    volume_difference,
)
from napari_unwrap3d.progress import Progress
from shapes import icosphere, lumpy, rotation

QUICK = {"projections": 20, "evaluations": 3, "samples": 2000}


def mesh(vertices: np.ndarray, faces: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(vertices=vertices, faces=faces)


def test_a_mesh_differs_from_itself_by_nothing() -> None:
    vertices, faces = lumpy(3)
    assert chamfer_distance(vertices, vertices) == 0.0
    assert area_difference(vertices, faces, vertices, faces) == 0.0
    assert volume_difference(vertices, faces, vertices, faces) == 0.0


def test_chamfer_is_the_sum_of_both_mean_distances() -> None:
    first = np.array([[0.0, 0, 0], [10, 0, 0]])
    second = np.array([[0.0, 3, 0], [10, 0, 0], [10, 0, 1], [10, 1, 0]])
    expected = (3 + 0) / 2 + (3 + 0 + 1 + 1) / 4
    assert chamfer_distance(first, second) == pytest.approx(expected)
    assert chamfer_distance(second, first) == pytest.approx(expected)


def test_chamfer_grows_with_the_distance_and_ignores_common_motion() -> None:
    vertices, _ = icosphere(4)
    shells = [chamfer_distance(vertices, scale * vertices) for scale in (1.0, 1.05, 1.2)]
    assert shells[0] < shells[1] < shells[2]
    assert shells[2] == pytest.approx(0.4, rel=0.05)
    turn = rotation(0)
    moved = chamfer_distance(vertices @ turn.T + 3, 1.2 * vertices @ turn.T + 3)
    assert moved == pytest.approx(shells[2], rel=1e-9)


@pytest.mark.parametrize("scale", [0.5, 1.02, 3.0])
def test_areas_and_volumes_of_scaled_bodies(scale: float) -> None:
    vertices, faces = lumpy(2)
    area = area_difference(scale * vertices, faces, vertices, faces)
    volume = volume_difference(scale * vertices, faces, vertices, faces)
    assert area == pytest.approx(scale**2 - 1)
    assert volume == pytest.approx(scale**3 - 1)


# All of them ---------------------------------------------------------------------


def test_all_measures_of_a_mesh_against_itself() -> None:
    found = compare_meshes(mesh(*lumpy(3)), mesh(*lumpy(3)), **QUICK)
    names = [name for name in found if found[name] == 0]
    assert names == [
        "chamfer_um",
        "hausdorff_um",
        "sliced_wasserstein_vertices_um",
        "area_difference",
        "area_difference_um2",
        "volume_difference",
        "volume_difference_um3",
    ]
    floor = found["sliced_wasserstein_area_noise_floor_um"]
    assert found["sliced_wasserstein_area_um"] == pytest.approx(floor, rel=0.3)
    assert found["notes"] == []
    assert json.loads(json.dumps(found)) == found


@pytest.mark.parametrize(("r", "R"), [(1.0, 1.1), (3.0, 2.0)])
def test_two_spheres(r: float, R: float) -> None:
    directions, faces = icosphere(4)
    found = compare_meshes(mesh(r * directions, faces), mesh(R * directions, faces), **QUICK)
    assert found["area_difference"] == pytest.approx((r / R) ** 2 - 1)
    assert found["volume_difference"] == pytest.approx((r / R) ** 3 - 1)
    assert found["area_difference_um2"] == pytest.approx(4 * np.pi * (r**2 - R**2), rel=0.01)
    assert found["volume_difference_um3"] == pytest.approx(4 / 3 * np.pi * (r**3 - R**3), rel=0.02)
    assert found["volume_um3"]["second"] == pytest.approx(4 / 3 * np.pi * R**3, rel=0.01)
    assert found["hausdorff_um"] == pytest.approx(abs(R - r), rel=0.1)
    # Projected onto a line a sphere is uniform over ±r, so that W1 is |R - r| / 2.
    expected = abs(R - r) / 2
    assert found["sliced_wasserstein_vertices_um"] == pytest.approx(expected, rel=0.03)
    floor = found["sliced_wasserstein_area_noise_floor_um"]
    assert found["sliced_wasserstein_area_um"] == pytest.approx(expected, abs=floor)


def test_doubled_and_unused_vertices_do_not_count() -> None:
    vertices, faces = lumpy(2)
    soup = np.concatenate([vertices[faces].reshape(-1, 3), [[99.0, 0, 0]]])
    loose = mesh(soup, np.arange(3 * len(faces)).reshape(-1, 3))
    found = compare_meshes(loose, mesh(vertices, faces), **QUICK)
    assert found["hausdorff_um"] == 0
    assert found["sliced_wasserstein_vertices_um"] == pytest.approx(0, abs=1e-12)
    assert found["volume_difference"] == pytest.approx(0, abs=1e-12)
    assert found["notes"] == []


def test_a_mesh_without_inside_has_no_volume() -> None:
    vertices, faces = lumpy(2)
    turned = faces.copy()
    turned[0] = turned[0, ::-1]
    for broken, why in ((faces[:-1], "is open"), (turned, "wound both ways")):
        found = compare_meshes(mesh(vertices, broken), mesh(vertices, faces), **QUICK)
        assert found["volume_difference"] is None
        assert found["volume_difference_um3"] is None
        assert found["volume_um3"]["first"] is None
        assert found["volume_um3"]["second"] > 0
        (note,) = found["notes"]
        assert "first" in note
        assert why in note
    inward = compare_meshes(mesh(vertices, faces[:, ::-1]), mesh(vertices, faces), **QUICK)
    assert inward["volume_difference"] == pytest.approx(0, abs=1e-12)


def test_it_is_public_repeatable_and_can_be_stopped() -> None:
    one, other = mesh(*lumpy(2)), mesh(*icosphere(2))
    found = napari_unwrap3d.compare_meshes(one, other, **QUICK)
    assert found == compare_meshes(one, other, **QUICK)
    assert found != compare_meshes(one, other, **QUICK, seed=1)
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        compare_meshes(one, other, progress=progress)


def test_what_a_file_reader_gives_is_a_mesh() -> None:
    box = trimesh.creation.box()
    found = compare_meshes(box, napari_unwrap3d.Surface(2 * box.vertices, box.faces), **QUICK)
    assert found["volume_difference"] == pytest.approx(1 / 8 - 1)
