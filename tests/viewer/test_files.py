"""Meshes and projects open as layers, and surface layers are saved as meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from napari.layers import Layer

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.files.meshes import MESH_SUFFIXES, read_mesh
from napari_unwrap3d.files.project import save_project
from napari_unwrap3d.viewer.files.readers import get_mesh_reader, get_project_reader
from napari_unwrap3d.viewer.files.writers import write_surface
from napari_unwrap3d.viewer.views.layers import atlas_layers

# Twelve numbers without any symmetry: a mirrored or transposed copy differs.
VERTICES = np.array([[0, 0, 0], [1, 0.25, 0], [0, 2, 0.5], [0.125, 0, 3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def opened(path: Path) -> Layer:
    reader = get_mesh_reader(str(path))
    assert reader is not None
    (data,) = reader(str(path))
    return Layer.create(*data)


def saved(path: Path, layer: Layer) -> None:
    data, attributes, kind = layer.as_layer_data_tuple()
    assert kind == "surface"
    assert write_surface(str(path), data, attributes) == [str(path)]


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_a_mesh_comes_back_unmirrored(tmp_path: Path, suffix: str) -> None:
    um = {"units": ("µm",) * 3, "scale": (2, 1, 1), "translate": (10, 20, 30)}
    layer = Layer.create((VERTICES, FACES, np.arange(4.0)), um, "surface")
    path = tmp_path / f"chiral{suffix}"
    saved(path, layer)
    again = opened(path)
    expected = VERTICES * (2, 1, 1) + (10, 20, 30)
    corners = again.data[0][again.data[1]].reshape(-1, 3)
    assert {tuple(p) for p in np.round(corners, 4)} == {tuple(p) for p in np.round(expected, 4)}
    assert signed_volume(again.data[0], again.data[1]) == pytest.approx(
        signed_volume(expected, FACES), rel=1e-4
    )
    assert {str(unit) for unit in again.units} == {"micrometer"}
    assert again.axis_labels == ("z", "y", "x")
    assert again.name == "chiral"


@pytest.mark.parametrize("suffix", [".ply", ".vtp"])
def test_fields_go_along(tmp_path: Path, suffix: str) -> None:
    attributes = {"units": ("µm",) * 3, "features": {"height_um": [1.0, 2.0, 3.0, 4.0]}}
    layer = Layer.create((VERTICES, FACES, np.arange(4.0)), attributes, "surface")
    path = tmp_path / f"cell{suffix}"
    saved(path, layer)
    fields = read_mesh(path, repaired=False).fields
    np.testing.assert_allclose(fields["height_um"], [1, 2, 3, 4])
    np.testing.assert_allclose(fields["value"], [0, 1, 2, 3])
    assert set(opened(path).features) == {"height_um", "value"}


def test_lengths_are_written_in_micrometres(tmp_path: Path) -> None:
    layer = Layer.create((VERTICES, FACES), {"units": ("nm",) * 3}, "surface")
    saved(tmp_path / "nm.ply", layer)
    again = read_mesh(tmp_path / "nm.ply", repaired=False)
    np.testing.assert_allclose(again.vertices, VERTICES * 1e-3, rtol=1e-6)


def test_a_rotated_layer_is_refused(tmp_path: Path) -> None:
    layer = Layer.create((VERTICES, FACES), {"rotate": 10}, "surface")
    data, attributes, _ = layer.as_layer_data_tuple()
    with pytest.raises(InputError, match="rotated"):
        write_surface(str(tmp_path / "cell.ply"), data, attributes)
    assert not list(tmp_path.iterdir())


def test_a_chart_is_written_without_its_place_beside_the_cell(
    tmp_path: Path, round_cell: Atlas
) -> None:
    layers = {
        attributes["name"]: (data, attributes) for data, attributes, _ in atlas_layers(round_cell)
    }
    for name in ("surface", "sphere", "topographic surface"):
        data, attributes = layers[name]
        saved(tmp_path / "chart.ply", Layer.create(data, attributes, "surface"))
        again = read_mesh(tmp_path / "chart.ply", repaired=False)
        expected = data[0] * np.abs(attributes["scale"])
        np.testing.assert_allclose(again.vertices, expected, atol=1e-4)


def test_a_project_opens_with_all_its_charts(tmp_path: Path, round_cell: Atlas) -> None:
    path = save_project(round_cell, tmp_path / "cell.unwrap3d")
    reader = get_project_reader(str(path))
    assert reader is not None
    again, expected = reader(str(path)), atlas_layers(round_cell)
    assert [(a["name"], kind) for _, a, kind in again] == [
        (a["name"], kind) for _, a, kind in expected
    ]
    for (data, attributes, kind), (other, _, _) in zip(again, expected, strict=True):
        Layer.create(data, attributes, kind)
        first, second = (d[0] if kind == "surface" else d for d in (data, other))
        np.testing.assert_array_equal(first, second)


def test_other_files_are_left_to_others() -> None:
    assert get_mesh_reader("stack.tif") is None
    assert get_mesh_reader(["a.ply", "b.tif"]) is None
    assert get_project_reader("cell.ply") is None
    assert get_mesh_reader(["a.ply", "b.OBJ"]) is not None
