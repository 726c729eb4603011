"""A project file gives back exactly what was saved, or says why it cannot."""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import Cancelled, ChartMissingError, FileFormatError, InputError
from napari_unwrap3d.files import arrays, project
from napari_unwrap3d.files.project import (
    SCHEMA_VERSION,
    load_project,
    read_summary,
    save_project,
)
from napari_unwrap3d.progress import Progress
from synthetic import make_atlas, with_protrusions


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return with_protrusions(make_atlas())


@pytest.fixture(scope="module")
def saved(atlas: Atlas, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_project(atlas, tmp_path_factory.mktemp("project") / "cell.unwrap3d")


def assert_same(one: Any, other: Any, where: str = "atlas") -> None:
    assert type(one) is type(other), where
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, where
        assert one.shape == other.shape, where
        assert one.tobytes() == other.tobytes(), where
    elif is_dataclass(one):
        for item in fields(one):
            assert_same(getattr(one, item.name), getattr(other, item.name), f"{where}.{item.name}")
    elif isinstance(one, dict):
        assert list(one) == list(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}[{key!r}]")
    elif isinstance(one, float) and np.isnan(one):
        assert np.isnan(other), where
    else:
        assert one == other, where


def test_every_array_and_number_comes_back_bit_for_bit(atlas: Atlas, saved: Path) -> None:
    loaded = load_project(saved)
    for name in (*project.CHARTS, "parameters", "quality", "provenance"):
        assert_same(getattr(atlas, name), getattr(loaded, name), name)


def test_a_project_of_schema_3_still_opens_and_takes_protrusions(
    tmp_path: Path, atlas: Atlas
) -> None:
    before = atlas.replaced(on_request={})
    before.annotations.add("drawn")
    before.annotations.draw_vertices("drawn", np.arange(20), 3)
    current, old = save_project(before, tmp_path / "current"), tmp_path / "old.unwrap3d"
    with zipfile.ZipFile(current) as new, zipfile.ZipFile(old, "w") as changed:
        for entry in new.infolist():
            content = new.read(entry)
            if entry.filename == "zarr.json":
                node = json.loads(content)
                node["attributes"]["schema_version"] = 3
                content = json.dumps(node).encode()
            changed.writestr(entry.filename, content)
    opened = load_project(old)
    assert not opened.has("protrusions")
    opened.keep("protrusions", atlas.protrusions, dict(atlas.protrusions.numbers))
    again = load_project(save_project(opened, old))
    assert read_summary(old)["schema_version"] == SCHEMA_VERSION
    assert_same(again.protrusions, atlas.protrusions)
    np.testing.assert_array_equal(
        again.annotations.labels("drawn"), before.annotations.labels("drawn")
    )


def test_protrusions_without_a_row_come_back(tmp_path: Path, atlas: Atlas) -> None:
    found = atlas.protrusions
    none = replace(
        found,
        labels=np.zeros_like(found.labels),
        volume=replace(found.volume, data=np.zeros_like(found.volume.data)),
        cortex=atlas.mask,
        columns={name: column[:0] for name, column in found.columns.items()},
    )
    path = save_project(atlas.replaced(on_request={"protrusions": none}), tmp_path / "none")
    assert_same(load_project(path).protrusions, none)


@pytest.mark.parametrize("wrong", ["vertex", "voxel", "row", "motif"])
def test_protrusions_that_point_at_nothing_are_refused(
    tmp_path: Path, atlas: Atlas, wrong: str
) -> None:
    found = atlas.protrusions
    changes: dict[str, Any] = {
        "vertex": {"labels": found.labels - 1},
        "voxel": {"volume": replace(found.volume, data=found.volume.data - 1)},
        "row": {"columns": {**found.columns, "label": found.columns["label"] - 1}},
        "motif": {"columns": {**found.columns, "motif": found.columns["motif"] + 3}},
    }
    bad = atlas.replaced(on_request={"protrusions": replace(found, **changes[wrong])})
    with pytest.raises(FileFormatError, match=wrong):
        load_project(save_project(bad, tmp_path / "bad"))


def test_bits_survive_whatever_the_values_are(tmp_path: Path, atlas: Atlas) -> None:
    rng = np.random.default_rng(1)
    nodes = atlas.topography.nodes
    bits = rng.integers(-(2**31), 2**31, size=nodes.shape, dtype=np.int64).astype(np.int32)
    wild = bits.view(np.float32)  # NaN with payloads, infinities, denormals, -0.0
    wild[0, 0, 0] = [np.nan, -np.inf, -0.0]
    n = len(atlas.surface.vertices)
    fields = {
        "a/b .": rng.random((n, 0)),
        "intensity": rng.integers(0, 9, (n, 2), dtype=np.uint16),
        "transposed": rng.random((4, n)).T,
        "Fläche µm²": rng.random(n) > 0.5,
    }
    changed = atlas.replaced(
        topography=replace(atlas.topography, nodes=wild),
        surface=replace(atlas.surface, fields=fields),
    )
    path = save_project(changed, tmp_path / "wild")
    assert path.name == "wild.unwrap3d"
    loaded = load_project(path)
    assert loaded.topography.nodes.tobytes() == wild.tobytes()
    assert_same(fields, dict(loaded.surface.fields))


def test_large_arrays_are_cut_into_chunks_and_come_back(
    tmp_path: Path, atlas: Atlas, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrays, "CHUNK_BYTES", 100_000)
    path = save_project(atlas, tmp_path / "cell.unwrap3d")
    with zipfile.ZipFile(path) as archive:
        chunks = [n for n in archive.namelist() if n.startswith("topography/nodes/c/")]
        assert len(chunks) > 3
        assert len(set(archive.namelist())) == len(archive.namelist())
    assert_same(atlas.topography, load_project(path).topography)


def test_smooth_positions_are_stored_small(atlas: Atlas, saved: Path) -> None:
    with zipfile.ZipFile(saved) as archive:
        stored = sum(
            info.compress_size
            for info in archive.infolist()
            if info.filename.startswith("topography/nodes")
        )
    assert stored < 0.5 * atlas.topography.nodes.nbytes


def test_the_summary_needs_no_arrays(atlas: Atlas, saved: Path) -> None:
    summary = read_summary(saved)
    assert summary["charts"] == list(project.CHARTS)
    assert summary["parameters"] == atlas.parameters.to_toml()
    assert summary["quality"]["sphere"]["flipped_faces"] == 0


def test_truncated_file(saved: Path, tmp_path: Path) -> None:
    content = saved.read_bytes()
    broken = tmp_path / "broken.unwrap3d"
    for size in (0, 10, len(content) // 2, len(content) - 5):
        broken.write_bytes(content[:size])
        with pytest.raises(FileFormatError, match=f"bytes = {size}"):
            load_project(broken)


def test_damaged_chunk(saved: Path, tmp_path: Path) -> None:
    content = bytearray(saved.read_bytes())
    with zipfile.ZipFile(saved) as archive:
        offset = archive.getinfo("surface/vertices/c/0/0").header_offset
    content[offset + 200] ^= 0xFF
    broken = tmp_path / "broken.unwrap3d"
    broken.write_bytes(content)
    with pytest.raises(FileFormatError, match="damaged"):
        load_project(broken)


def test_missing_chunk(saved: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.unwrap3d"
    with zipfile.ZipFile(saved) as source, zipfile.ZipFile(broken, "w") as target:
        for name in source.namelist():
            if name != "surface/vertices/c/0/0":
                target.writestr(name, source.read(name))
    with pytest.raises(FileFormatError, match="missing = 1"):
        load_project(broken)


def test_foreign_files(tmp_path: Path) -> None:
    text = tmp_path / "notes.unwrap3d"
    text.write_text("not a project")
    with pytest.raises(FileFormatError, match="no project"):
        load_project(text)
    other = tmp_path / "other.unwrap3d"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(FileFormatError, match="zip file, but no project"):
        load_project(other)
    with pytest.raises(FileFormatError, match="zip file, but no project"):
        read_summary(other)
    with pytest.raises(InputError, match="no file"):
        load_project(tmp_path / "absent.unwrap3d")


def test_a_newer_schema_is_refused_by_number(
    atlas: Atlas, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(project, "SCHEMA_VERSION", SCHEMA_VERSION + 1)
    path = save_project(atlas, tmp_path / "new.unwrap3d")
    monkeypatch.setattr(project, "SCHEMA_VERSION", SCHEMA_VERSION)
    with pytest.raises(
        FileFormatError,
        match=rf"file_schema = {SCHEMA_VERSION + 1}, known_schema = {SCHEMA_VERSION}",
    ):
        load_project(path)


def test_nothing_half_written_stays(atlas: Atlas, tmp_path: Path) -> None:
    path = tmp_path / "cell.unwrap3d"
    path.write_bytes(b"what was there before")

    def stop(step: str, fraction: float, message: str) -> None:
        if fraction > 0.2:
            progress.cancel()

    progress = Progress(stop)
    with pytest.raises(Cancelled):
        save_project(atlas, path, progress)
    assert [item.name for item in tmp_path.iterdir()] == ["cell.unwrap3d"]
    assert path.read_bytes() == b"what was there before"


def test_fields_that_cannot_be_kept_are_named(atlas: Atlas, tmp_path: Path) -> None:
    names = np.array(["a"] * len(atlas.surface.vertices))
    with pytest.raises(InputError, match="integer labels"):
        save_project(atlas.replaced(surface=atlas.surface.with_fields(kind=names)), tmp_path / "a")
    assert not list(tmp_path.iterdir())


def test_a_plane_that_is_missing_or_refused_stays_so(tmp_path: Path, atlas: Atlas) -> None:
    refusal = {
        "certified": False,
        "reason": "Faces are flipped.",
        "hint": "Use the direct chart.",
        "places": [{"position_um": [1.0, 2.0, 3.0], "faces": 6}],
    }
    refused = replace(atlas, on_request={}, quality={**atlas.quality, "plane": refusal})
    loaded = load_project(save_project(refused, tmp_path / "cell"))
    assert not loaded.has("plane")
    assert loaded.quality["plane"] == refusal
    with pytest.raises(ChartMissingError, match="flipped"):
        _ = loaded.plane
    assert load_project(save_project(atlas, tmp_path / "whole")).has("plane")
