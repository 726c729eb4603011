"""Exports of annotations hold what was drawn."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import tifffile

from napari_unwrap3d.annotations import Annotations
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.files.annotation_export import column_names, export_annotations
from napari_unwrap3d.files.formats import Formats
from napari_unwrap3d.files.meshes import read_mesh
from synthetic import make_atlas


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return make_atlas(subdivisions=2, rows=16)


@pytest.fixture
def drawn(atlas: Atlas) -> Annotations:
    annotations = Annotations(atlas)
    for name, label in (("cell bottom", 1), ("cell-bottom", 300)):
        annotations.add(name)
        annotations.draw_vertices(name, np.arange(label, label + 40) % 100, label)
    annotations.points.set("tip", atlas.surface.vertices[3])
    return annotations


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_images_meshes_and_tables_hold_the_labels(drawn: Annotations, tmp_path: Path) -> None:
    written = export_annotations(drawn, tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [p.name for p in written]
    for chart in ("uv", "direct", "plane", "topography", "volume"):
        with tifffile.TiffFile(tmp_path / "out" / f"{chart}_labels.ome.tif") as tif:
            image = tif.asarray()
            assert all(name in (tif.ome_metadata or "") for name in drawn.names)
        assert image.dtype == np.uint16
        for channel, name in zip(image, drawn.names, strict=True):
            assert (channel == drawn.image(name, chart)).all()
    mesh = read_mesh(tmp_path / "out" / "surface.ply", repaired=False)
    vertices = rows_of(tmp_path / "out" / "vertices.csv")
    for name, column in column_names(drawn.names).items():
        assert (mesh.fields[column] == drawn.labels(name)).all()
        assert [int(row[column]) for row in vertices] == drawn.labels(name).tolist()
    (first, second) = rows_of(tmp_path / "out" / "labels.csv")
    assert (first["annotation"], first["label"]) == ("cell bottom", "1")
    assert (second["annotation"], second["label"]) == ("cell-bottom", "300")
    assert float(first["area_um2"]) > 0
    (point,) = rows_of(tmp_path / "out" / "points.csv")
    assert float(point["x_um"]) == pytest.approx(drawn.atlas.surface.vertices[3, 2])


def test_other_formats_and_missing_charts(drawn: Annotations, tmp_path: Path) -> None:
    without = drawn.on(drawn.atlas.replaced(on_request={}))
    formats = Formats(meshes=(".obj",), images=(".ome.zarr",), tables=(".parquet",))
    export_annotations(without, tmp_path / "out", formats=formats)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"surface.obj", "uv_labels.ome.zarr", "volume_labels.ome.zarr"} <= names
    assert "direct_labels.ome.zarr" not in names
    table = pyarrow.parquet.read_table(tmp_path / "out" / "vertices.parquet")
    assert table["cell_bottom"].to_pylist() == drawn.labels("cell bottom").tolist()


def test_an_earlier_export_is_replaced_only_when_asked(drawn: Annotations, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    export_annotations(drawn, folder)
    (folder / "mine.txt").write_text("kept")
    with pytest.raises(InputError, match="not empty"):
        export_annotations(drawn, folder)
    drawn.remove("cell-bottom")
    export_annotations(drawn, folder, overwrite=True)
    assert len(rows_of(folder / "labels.csv")) == 1
    assert (folder / "mine.txt").read_text() == "kept"
    with pytest.raises(InputError, match="no annotations"):
        export_annotations(Annotations(drawn.atlas), tmp_path / "other")


def test_names_of_columns_are_plain_and_differ() -> None:
    names = ("cell bottom", "cell-bottom", "µ", "a.b", "cell_bottom_2")
    assert len(set(column_names(names).values())) == len(names)
    assert all(
        column.isascii() and column.isidentifier() for column in column_names(names).values()
    )
