"""An export holds every chart, can be read back, and is there as a whole or not at all."""

from __future__ import annotations

import csv
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
import zarr

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Stack
from napari_unwrap3d.errors import Cancelled, InputError, ParameterError
from napari_unwrap3d.files import export
from napari_unwrap3d.files.export import FILES, FOLDERS, export_atlas, replacing_folder
from napari_unwrap3d.files.formats import Formats
from napari_unwrap3d.files.meshes import read_mesh
from napari_unwrap3d.files.project import load_project
from napari_unwrap3d.files.stacks import read_stack
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.progress import Progress
from synthetic import make_atlas

SIZE = (0.5, 0.25, 0.25)


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return make_atlas()


@pytest.fixture(scope="module")
def stack() -> Stack:
    """Two channels: a ramp 1000 + 10 z + 20 y + 30 x (µm), and a constant."""
    z, y, x = np.indices((26, 52, 52)) * np.reshape(SIZE, (3, 1, 1, 1))
    ramp = 1000 + 10 * z + 20 * y + 30 * x
    data = np.stack([ramp, np.full_like(ramp, 7)]).round().astype(np.uint16)
    return Stack(data, "czyx", SIZE, channels=("membrane", "actin"))


def read_table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


@pytest.fixture(scope="module")
def folder(atlas: Atlas, stack: Stack, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "deep" / "out"
    written = export_atlas(atlas, folder, stack=stack, pictures=False)
    assert all(path.is_file() for path in written)
    return folder


def test_the_promised_files_are_there_and_nothing_else(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == {*FILES, "meshes", "direct.ome.tif"}
    assert "pictures" in FOLDERS


@pytest.mark.parametrize("name", ["surface", "sealed", "reference", "sphere"])
def test_meshes_come_back_with_their_fields(atlas: Atlas, folder: Path, name: str) -> None:
    chart = getattr(atlas, name)
    read = read_mesh(folder / "meshes" / f"{name}.ply", repaired=False)
    np.testing.assert_allclose(read.vertices, chart.vertices, atol=1e-6)
    # The winding is reversed with the axes, there and back; a face may start anywhere.
    np.testing.assert_array_equal(np.sort(read.faces), np.sort(chart.faces))
    fields = atlas.reference.fields if name == "sphere" else chart.fields
    assert set(read.fields) == set(fields)
    for field in fields:
        np.testing.assert_allclose(read.fields[field], fields[field], rtol=1e-6)


def test_the_flat_mesh_knows_which_vertex_each_one_is(atlas: Atlas, folder: Path) -> None:
    flat = read_mesh(folder / "meshes" / "topographic_surface_duv.ply", repaired=False)
    np.testing.assert_allclose(flat.vertices, atlas.topography.cut_vertices, atol=1e-5)
    np.testing.assert_array_equal(flat.fields["surface_vertex"], atlas.topography.cut_origin)


def test_uv_fields_are_named_channels(atlas: Atlas, folder: Path) -> None:
    with tifffile.TiffFile(folder / "uv.ome.tif") as tif:
        assert tif.series[0].axes == "CYX"
        images, described = tif.asarray(), tif.ome_metadata
    for image, (name, field) in zip(images, atlas.uv.fields.items(), strict=True):
        np.testing.assert_allclose(image, field, rtol=1e-6)
        assert f'Name="{name}"' in described


def test_the_stack_is_sampled_at_the_nodes(atlas: Atlas, folder: Path) -> None:
    with tifffile.TiffFile(folder / "topography.ome.tif") as tif:
        mask, ramp, constant = tif.asarray()
        described = tif.ome_metadata
    assert ramp.dtype == np.uint16
    for name in ("mask", "membrane", "actin"):
        assert f'Name="{name}"' in described
    np.testing.assert_array_equal(mask, atlas.topography.mask)
    expected = 1000 + atlas.topography.positions @ np.array([10.0, 20.0, 30.0])
    np.testing.assert_allclose(ramp, expected, atol=1.01)  # rounded in the stack and here
    assert (constant == 7).all()
    layers = read_table(folder / "topography_layers.csv")
    np.testing.assert_array_equal([float(row["d_um"]) for row in layers], atlas.topography.d_um)


def test_without_a_stack_the_topography_is_the_mask(atlas: Atlas, tmp_path: Path) -> None:
    few = atlas.replaced(uv=None, sphere=None, reference=None, sealed=None, on_request={})
    export_atlas(few, tmp_path / "out", pictures=False)
    image = tifffile.imread(tmp_path / "out" / "topography.ome.tif")
    np.testing.assert_array_equal(image.reshape(atlas.topography.shape), atlas.topography.mask)
    names = {path.name for path in (tmp_path / "out" / "meshes").iterdir()}
    assert names == {"surface.ply", "topographic_surface.ply", "topographic_surface_duv.ply"}


def test_numbers_and_parameters_come_back(atlas: Atlas, folder: Path) -> None:
    quality = json.loads((folder / "quality.json").read_text(encoding="utf-8"))
    assert quality["sphere"]["flipped_faces"] == 0
    assert quality["sphere"]["not_known"] is None  # NaN, which JSON does not have
    assert json.loads((folder / "provenance.json").read_text()) == atlas.provenance
    assert Parameters.from_toml(folder / "parameters.toml") == atlas.parameters
    rows = read_table(folder / "quality.csv")
    assert list(rows[0]) == ["chart", "quantity", "value", "mark", "reason"]
    marks = {(row["chart"], row["quantity"]): row["mark"] for row in rows}
    assert marks["sphere", "flipped_faces"] == "green"
    assert len(rows) == sum(len(numbers) for numbers in atlas.quality.values())


def test_the_project_in_it_opens(atlas: Atlas, folder: Path) -> None:
    loaded = load_project(folder / "cell.unwrap3d")
    np.testing.assert_array_equal(loaded.surface.vertices, atlas.surface.vertices)


def test_a_folder_in_use_is_kept_unless_told_otherwise(atlas: Atlas, tmp_path: Path) -> None:
    few = atlas.replaced(
        uv=None, sphere=None, reference=None, sealed=None, topography=None, on_request={}
    )
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "uv.ome.tif").write_text("of an earlier export")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "uv.png").write_text("of an earlier export")
    with pytest.raises(InputError, match="entries = 3"):
        export_atlas(few, tmp_path, pictures=False)
    export_atlas(few, tmp_path, pictures=False, overwrite=True)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "uv.ome.tif").exists()
    assert not (tmp_path / "pictures").exists()
    assert (tmp_path / "meshes" / "surface.ply").is_file()
    with pytest.raises(InputError, match="is a file"):
        export_atlas(few, tmp_path / "notes.txt", pictures=False)


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_an_interrupted_export_leaves_nothing(
    atlas: Atlas, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
) -> None:
    def fail(*args: object) -> None:
        raise error

    monkeypatch.setattr(export, "save_project", fail)
    with pytest.raises(error):
        export_atlas(atlas, tmp_path / "out", pictures=False)
    assert not list(tmp_path.iterdir())


def test_a_cancelled_export_keeps_the_earlier_one(atlas: Atlas, tmp_path: Path) -> None:
    (tmp_path / "quality.csv").write_text("earlier")
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        export_atlas(atlas, tmp_path, pictures=False, overwrite=True, progress=progress)
    assert [path.name for path in tmp_path.iterdir()] == ["quality.csv"]
    assert (tmp_path / "quality.csv").read_text() == "earlier"


def test_the_folder_one_stands_in_can_be_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with replacing_folder(Path()) as partial:
        (partial / "a.txt").write_text("a")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_other_formats_hold_the_same(atlas: Atlas, stack: Stack, tmp_path: Path) -> None:
    formats = Formats.named(["obj", "vtp", "ome-zarr"])
    export_atlas(atlas, tmp_path, stack=stack, pictures=False, formats=formats)
    names = {path.name for path in (tmp_path / "meshes").iterdir()}
    stems = {"surface", "sealed", "reference", "sphere", "sphere_conformal", "direct"}
    stems |= {"topographic_surface", "topographic_surface_duv"}
    with_texture = ("surface", "sealed", "reference", "sphere")
    textured = {f"{name}{suffix}" for name in with_texture for suffix in (".mtl", ".png")}
    assert names == {f"{stem}{suffix}" for stem in stems for suffix in (".obj", ".vtp")} | textured
    for suffix in (".obj", ".vtp"):
        read = read_mesh(tmp_path / "meshes" / f"surface{suffix}")
        np.testing.assert_allclose(
            np.sort(read.vertices, axis=0), np.sort(atlas.surface.vertices, axis=0), atol=1e-5
        )
    assert not list(tmp_path.glob("*.tif"))
    topography = read_stack(tmp_path / "topography.ome.zarr", voxel_size=(1, 1, 1))
    assert topography.channels == ("mask", "membrane", "actin")
    expected = 1000 + atlas.topography.positions @ np.array([10.0, 20.0, 30.0])
    np.testing.assert_allclose(np.asarray(topography.volume(c=1)), expected, atol=1.01)
    level = zarr.open_group(tmp_path / "topography.ome.zarr").attrs["ome"]["multiscales"][0]
    scale, shift = level["datasets"][0]["coordinateTransformations"]
    assert scale["scale"][1] == pytest.approx(atlas.topography.d_um[1] - atlas.topography.d_um[0])
    assert shift["translation"][1] == pytest.approx(atlas.topography.d_um[0])
    assert (tmp_path / "quality.csv").is_file()


def test_another_export_replaces_all_formats_of_the_earlier_one(
    atlas: Atlas, tmp_path: Path
) -> None:
    few = atlas.replaced(topography=None, on_request={})
    first = Formats.named(["ome-zarr", "obj"])
    export_atlas(few, tmp_path, pictures=False, formats=first)
    assert (tmp_path / "uv.ome.zarr").is_dir()
    export_atlas(few, tmp_path, pictures=False, overwrite=True)
    assert not (tmp_path / "uv.ome.zarr").exists()
    assert not list((tmp_path / "meshes").glob("*.obj"))


def test_formats_are_chosen_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Formats.named([]) == Formats()
    assert Formats.named(["stl", "stl"]) == Formats(meshes=(".stl",))
    both = Formats.named(["csv", "ome-tiff", "ome-zarr"])
    assert both == Formats(images=(".ome.tif", ".ome.zarr"))
    with pytest.raises(ParameterError, match=r"xlsx.*parquet"):
        Formats.named(["xlsx"])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="pyarrow"):
        Formats.named(["parquet"])
