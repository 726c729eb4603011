"""The protrusions of a cell as files hold what was measured, where it is."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import tifffile
import zarr

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.files import pictures
from napari_unwrap3d.files.export import export_atlas
from napari_unwrap3d.files.formats import Formats
from napari_unwrap3d.files.meshes import read_mesh
from napari_unwrap3d.files.pictures import write_pictures
from napari_unwrap3d.files.protrusion_pictures import face_labels, label_colours
from napari_unwrap3d.files.stacks import read_stack
from napari_unwrap3d.geometry.mesh import is_watertight, signed_volume
from napari_unwrap3d.protrusions.columns import COLUMNS
from napari_unwrap3d.protrusions.editing import ProtrusionEdits
from synthetic import make_atlas, with_protrusions


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return with_protrusions(make_atlas())


@pytest.fixture(scope="module")
def folder(atlas: Atlas, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("protrusions") / "out"
    export_atlas(atlas, folder, pictures=False)
    return folder


def test_the_table_is_that_of_the_atlas(atlas: Atlas, folder: Path) -> None:
    rows = list(csv.DictReader((folder / "protrusions.csv").read_text("utf-8").splitlines()))
    assert list(rows[0]) == list(COLUMNS)
    table = atlas.protrusions.table
    assert [int(row["label"]) for row in rows] == table["label"].tolist()
    assert [row["motif"] for row in rows] == table["motif"].tolist()
    assert [float(row["area_um2"]) for row in rows] == table["area_um2"].tolist()


def test_the_surface_and_the_images_carry_the_labels(atlas: Atlas, folder: Path) -> None:
    found = atlas.protrusions
    surface = read_mesh(folder / "meshes" / "surface.ply", repaired=False)
    np.testing.assert_array_equal(surface.fields["protrusion"], found.labels)
    np.testing.assert_allclose(surface.fields["height_over_cortex_um"], found.height_um, atol=1e-6)
    volume = read_stack(folder / "protrusions_volume.ome.tif")
    assert volume.voxel_size == pytest.approx(atlas.mask.voxel_size)
    np.testing.assert_array_equal(np.asarray(volume.data), found.volume.data)
    uv = tifffile.imread(folder / "protrusions_uv.ome.tif")
    np.testing.assert_array_equal(uv, atlas.carry(found.labels, "surface", "uv", kind="label"))
    topography = tifffile.imread(folder / "protrusions_topography.ome.tif")
    assert topography.shape == atlas.topography.shape
    assert set(np.unique(topography)) == {0, 1, 2, 3}
    assert not topography[:, :, :][atlas.topography.d_um < -0.5].any()
    assert (folder / "protrusions_direct.ome.tif").is_file()


def test_the_parts_are_closed_meshes_that_make_up_the_cell(atlas: Atlas, folder: Path) -> None:
    names = {path.name for path in (folder / "meshes" / "protrusions").iterdir()}
    assert names == {f"protrusion_{label}.ply" for label in (1, 2, 3)}
    total = 0.0
    for path in [folder / "meshes" / "cortex.ply", *(folder / "meshes" / "protrusions").iterdir()]:
        mesh = read_mesh(path, repaired=False)
        assert is_watertight(mesh.faces)
        total += signed_volume(mesh.vertices, mesh.faces)
    cell = atlas.mask.data.sum() * atlas.voxel_um**3
    assert total == pytest.approx(cell, rel=0.01)


def test_another_export_leaves_nothing_of_the_earlier_one(atlas: Atlas, tmp_path: Path) -> None:
    formats = Formats.named(["ome-zarr", "stl"])
    export_atlas(atlas, tmp_path, pictures=False, formats=formats)
    labels = zarr.open_group(tmp_path / "protrusions_volume.ome.zarr")["0"]
    np.testing.assert_array_equal(labels[:], atlas.protrusions.volume.data)
    assert (tmp_path / "meshes" / "protrusions" / "protrusion_2.stl").is_file()
    without = atlas.replaced(on_request={})
    export_atlas(without, tmp_path, pictures=False, overwrite=True)
    assert not [path for path in tmp_path.rglob("*") if "protrusion" in path.name]


@pytest.fixture
def their_picture_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the pictures, draw that of the protrusions; all are drawn in test_pictures."""
    few = {"protrusions": pictures.PICTURES["protrusions"]}
    monkeypatch.setattr(pictures, "PICTURES", few)


@pytest.mark.usefixtures("their_picture_only")
def test_no_protrusions_and_labels_with_gaps_are_written_too(atlas: Atlas, tmp_path: Path) -> None:
    for name, labels in (("gaps", [1, 2]), ("none", [3])):
        edits = ProtrusionEdits(atlas.replaced())
        if name == "none":
            edits.delete([1, 2])
        edits.delete(labels)
        edits.keep()
        export_atlas(edits._atlas, tmp_path / name, pictures=True)
        rows = (tmp_path / name / "protrusions.csv").read_text("utf-8").splitlines()
        assert len(rows) == (2 if name == "gaps" else 1)
        assert rows[0].split(",") == list(COLUMNS)
        assert (tmp_path / name / "pictures" / "protrusions.png").is_file()
        assert (tmp_path / name / "meshes" / "cortex.ply").is_file()


def test_colours_tell_labels_apart() -> None:
    colours = label_colours(30)
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=2)
    assert apart[~np.eye(31, dtype=bool)].min() > 0.05
    assert min(apart[i, i + 1] for i in range(30)) > 0.3
    faces = np.array([[0, 1, 2], [1, 2, 3], [0, 1, 3]])
    assert face_labels(np.array([5, 5, 2, 2]), faces).tolist() == [5, 2, 5]


@pytest.mark.usefixtures("their_picture_only")
def test_the_picture_is_drawn_where_there_are_protrusions(atlas: Atlas, tmp_path: Path) -> None:
    few = {"sealed": None, "reference": None, "sphere": None}
    bare = atlas.replaced(**few, on_request={"protrusions": atlas.protrusions})
    drawn = {path.stem for path in write_pictures(bare, tmp_path)}
    assert "protrusions" in drawn
    again = write_pictures(bare, tmp_path / "again")
    picture = next(path for path in again if path.stem == "protrusions")
    assert picture.read_bytes() == (tmp_path / "protrusions.png").read_bytes()
