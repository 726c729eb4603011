"""A project file from anywhere opens as it was saved, or is refused by a named error."""

from __future__ import annotations

import errno
import json
import os
import pickle
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.atlas import ON_REQUEST, Atlas
from napari_unwrap3d.errors import (
    FileFormatError,
    InputError,
    SchemaError,
    UnsafeFileError,
    Unwrap3DError,
)
from napari_unwrap3d.files import archive
from napari_unwrap3d.files.project import CHARTS, load_project, load_surface, save_project
from napari_unwrap3d.provenance import content_hash
from synthetic import make_atlas

VERTICES = "surface/vertices/zarr.json"
CHUNK = "surface/vertices/c/0/0"
Change = Callable[[dict[str, Any]], Any]


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return make_atlas(1, 8)


@pytest.fixture(scope="module")
def saved(atlas: Atlas, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_project(atlas, tmp_path_factory.mktemp("trust") / "cell.unwrap3d")


def contents(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as source:
        return {name: source.read(name) for name in source.namelist()}


def packed(path: Path, entries: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as target:
        for name, content in entries.items():
            target.writestr(name, content)
    return path


def changed(saved: Path, path: Path, name: str, change: Change) -> Path:
    """A copy in which one ``zarr.json`` was changed, and its checksum with it."""
    entries = contents(saved)
    node = json.loads(entries[name])
    change(node)
    return packed(path, {**entries, name: json.dumps(node).encode()})


def arrays_of(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Every array and number in an atlas as (place, hash)."""
    if isinstance(value, np.ndarray):
        yield name, content_hash(value)
    elif hasattr(value, "__dataclass_fields__"):
        for key in value.__dataclass_fields__:
            yield from arrays_of(getattr(value, key), f"{name}.{key}")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from arrays_of(item, f"{name}.{key}")
    else:
        yield name, repr(value)


# Damage --------------------------------------------------------------------------


def places(saved: Path, count: int, seed: int) -> list[int]:
    """Bytes to flip: half of them in what describes the arrays, half anywhere."""
    rng = np.random.default_rng(seed)
    size = saved.stat().st_size
    with zipfile.ZipFile(saved) as source:
        infos = source.infolist()
        directory = range(source.start_dir, size)
    headers = [info.header_offset + i for info in infos for i in range(30 + len(info.filename))]
    headers += [*directory]
    chosen = rng.choice(headers, count // 2, replace=False).tolist()
    return [*chosen, *rng.choice(size, count // 2, replace=False).tolist()]


def test_flipped_bytes_give_a_named_error_or_the_same_atlas(
    atlas: Atlas, saved: Path, tmp_path: Path
) -> None:
    truth, content = dict(arrays_of(atlas)), saved.read_bytes()
    broken = tmp_path / "broken.unwrap3d"
    outcomes = {"same": 0, "refused": 0}
    for place in places(saved, 160, seed=0):
        flipped = bytearray(content)
        flipped[place] ^= 1 << (place % 8)
        broken.write_bytes(flipped)
        try:
            loaded = load_project(broken)
        except FileFormatError:
            outcomes["refused"] += 1
        else:
            assert dict(arrays_of(loaded)) == truth, place
            outcomes["same"] += 1
    assert outcomes["refused"] > outcomes["same"] > 0


def test_cut_off_anywhere_it_is_refused(saved: Path, tmp_path: Path) -> None:
    content, broken = saved.read_bytes(), tmp_path / "broken.unwrap3d"
    for length in np.linspace(0, len(content) - 1, 25, dtype=int):
        broken.write_bytes(content[:length])
        with pytest.raises(FileFormatError, match="its end is missing"):
            load_project(broken)


@pytest.mark.parametrize("junk", [None, -1, "x", [], {}, 10**30, 1.5, [[1]], {"a": 1}, True])
def test_junk_in_the_descriptions_is_refused(
    atlas: Atlas, saved: Path, tmp_path: Path, junk: Any
) -> None:
    """Checksums are right here: the file was made so on purpose."""
    truth = dict(arrays_of(atlas.surface.fields))
    for name, where in [
        *[("zarr.json", ("attributes", key)) for key in ("format", "schema_version", "quality")],
        *[("zarr.json", ("attributes", key)) for key in ("provenance", "parameters")],
        ("zarr.json", ("attributes",)),
        *[("surface/zarr.json", ("attributes", key)) for key in ("type", "values")],
        ("surface/fields/zarr.json", ("attributes", "names")),
        *[("uv/face/zarr.json", (key,)) for key in ("shape", "data_type", "codecs", "node_type")],
        *[("uv/face/zarr.json", ("attributes", key)) for key in ("dtype", "differences")],
        ("uv/face/zarr.json", ("chunk_grid", "configuration", "chunk_shape")),
        ("uv/face/zarr.json", ("chunk_key_encoding",)),
        ("uv/face/zarr.json", ("fill_value",)),
    ]:

        def put(node: Any, where: tuple[str, ...] = where) -> None:
            for key in where[:-1]:
                node = node[key]
            node[where[-1]] = junk

        path = changed(saved, tmp_path / "junk.unwrap3d", name, put)
        with suppress(Unwrap3DError):
            loaded = load_project(path)
            assert dict(arrays_of(loaded.surface.fields)) == truth, (name, where)


# Names -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["../evil", "surface/../../evil", "/etc/evil", "C:/evil", "..\\evil", "a//b", "./a"]
)
def test_names_that_leave_the_archive_are_refused(saved: Path, tmp_path: Path, name: str) -> None:
    path = packed(tmp_path / "evil.unwrap3d", {**contents(saved), name: b"x"})
    with pytest.raises(UnsafeFileError, match="leaves the archive"):
        load_project(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["evil.unwrap3d"]


def test_links_are_refused(saved: Path, tmp_path: Path) -> None:
    path = packed(tmp_path / "evil.unwrap3d", contents(saved))
    link = zipfile.ZipInfo("surface/link")
    link.create_system, link.external_attr = 3, 0o120777 << 16
    with zipfile.ZipFile(path, "a") as target:
        target.writestr(link, "/etc/passwd")
    with pytest.raises(UnsafeFileError, match="is a link"):
        load_project(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_name_that_comes_twice_is_refused(saved: Path, tmp_path: Path) -> None:
    path = packed(tmp_path / "evil.unwrap3d", contents(saved))
    with zipfile.ZipFile(path, "a") as target:
        target.writestr(CHUNK, b"another")
    with pytest.raises(UnsafeFileError, match="twice"):
        load_project(path)


@pytest.mark.parametrize("name", ["readme.txt", "surface/vertices/c/1/0", "extra/zarr.json"])
def test_what_belongs_to_nothing_is_refused(saved: Path, tmp_path: Path, name: str) -> None:
    path = packed(tmp_path / "evil.unwrap3d", {**contents(saved), name: b"{}"})
    with pytest.raises(FileFormatError):
        load_project(path)


# Sizes -------------------------------------------------------------------------


def huge(node: dict[str, Any]) -> None:
    node["shape"] = node["chunk_grid"]["configuration"]["chunk_shape"] = [10**12, 3]


def large_chunk(node: dict[str, Any]) -> None:
    node["chunk_grid"]["configuration"]["chunk_shape"] = [10**9, 3]


def many_chunks(node: dict[str, Any]) -> None:
    node["shape"], node["chunk_grid"]["configuration"]["chunk_shape"] = [10**15, 3], [1, 3]


def twice_as_long(node: dict[str, Any]) -> None:
    node["shape"] = node["chunk_grid"]["configuration"]["chunk_shape"] = [84, 3]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (huge, "declared_bytes = 24000000"),
        (large_chunk, "cut in an unknown way"),
        (many_chunks, "more than a file of this size|missing"),
        (twice_as_long, "another size than its array"),
    ],
)
def test_declared_sizes_are_checked(
    saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Change, message: str
) -> None:
    """Before anything is allocated: no array is even opened."""
    import zarr

    path = changed(saved, tmp_path / "bomb.unwrap3d", VERTICES, change)
    monkeypatch.setattr(zarr, "open_group", None)
    for reader in (load_project, load_surface):
        with pytest.raises(FileFormatError, match=message):
            reader(path)


def test_a_chunk_that_grows_when_it_is_decoded_is_refused(saved: Path, tmp_path: Path) -> None:
    entries = contents(saved)
    chunk = bytearray(entries[CHUNK])
    struct.pack_into("<I", chunk, 4, 2**31 - 1)
    path = packed(tmp_path / "bomb.unwrap3d", {**entries, CHUNK: bytes(chunk)})
    with pytest.raises(UnsafeFileError, match="declared_bytes = 2147483647"):
        load_project(path)


def test_entries_compressed_by_the_zip_are_refused(saved: Path, tmp_path: Path) -> None:
    path = packed(tmp_path / "bomb.unwrap3d", contents(saved))
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as target:
        target.writestr("surface/bomb", bytes(10**7))
    with pytest.raises(UnsafeFileError, match="declared_bytes = 10000000"):
        load_project(path)


def test_the_whole_may_not_be_larger_than_a_file_can_hold(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "ALWAYS_ALLOWED", 0)
    monkeypatch.setattr(archive, "LARGEST_RATIO", 1)
    with pytest.raises(UnsafeFileError, match="more than a file of this size can hold"):
        load_project(saved)


# Content -------------------------------------------------------------------------


class Touch:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_nothing_is_unpickled(saved: Path, tmp_path: Path) -> None:
    """A Zarr v2 array of objects, whose filter is pickle, in the place of an array."""
    old = {
        "zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "order": "C",
        "fill_value": None, "compressor": None, "filters": [{"id": "pickle", "protocol": 5}],
    }  # fmt: skip
    kept = {n: c for n, c in contents(saved).items() if not n.startswith("surface/vertices/")}
    evil = {
        "surface/vertices/.zarray": json.dumps(old).encode(),
        "surface/vertices/0": pickle.dumps(Touch(tmp_path / "pwned")),
    }
    path = packed(tmp_path / "evil.unwrap3d", {**kept, **evil})
    with pytest.raises(FileFormatError):
        load_project(path)
    assert not (tmp_path / "pwned").exists()


def other_codec(node: dict[str, Any]) -> None:
    node["codecs"][1] = {"name": "gzip", "configuration": {"level": 1}}


def objects(node: dict[str, Any]) -> None:
    node["data_type"] = "string"


def all_at_the_root(node: dict[str, Any]) -> None:
    node["consolidated_metadata"] = {"kind": "inline", "metadata": {}}


@pytest.mark.parametrize("change", [other_codec, objects, all_at_the_root])
def test_other_ways_to_store_are_refused(saved: Path, tmp_path: Path, change: Change) -> None:
    name = "zarr.json" if change is all_at_the_root else VERTICES
    with pytest.raises(UnsafeFileError):
        load_project(changed(saved, tmp_path / "evil.unwrap3d", name, change))


@pytest.mark.parametrize("kind", ["Any", "check_voxel_size", "np", "Reference", "Stack"])
def test_only_charts_are_made(saved: Path, tmp_path: Path, kind: str) -> None:
    def put(node: dict[str, Any]) -> None:
        node["attributes"]["type"] = kind

    with pytest.raises(FileFormatError):
        load_project(changed(saved, tmp_path / "evil.unwrap3d", "surface/zarr.json", put))


def test_charts_that_do_not_fit_together_are_refused(atlas: Atlas, tmp_path: Path) -> None:
    uv, topography = atlas.uv, atlas.topography
    broken = [
        {"uv": replace(uv, face=uv.face + 10**6)},
        {"uv": replace(uv, weights=uv.weights[:-1])},
        {"topography": replace(topography, meshed_faces=topography.meshed_faces + 10**6)},
        {"topography": replace(topography, cut_origin=topography.cut_origin - 1)},
        {"topography": replace(topography, last_layer=topography.last_layer + 10**6)},
        {"topography": replace(topography, surface=topography.surface[:-1])},
        {"sphere": replace(atlas.sphere, faces=atlas.sphere.faces[::-1])},
        {"sphere": replace(atlas.sphere, conformal=atlas.sphere.conformal[:-1])},
    ]
    for parts in broken:
        path = save_project(atlas.replaced(**parts), tmp_path / "broken.unwrap3d")
        with pytest.raises(FileFormatError, match="do not belong together"):
            load_project(path)


# Schema --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("version", "error", "message"),
    [
        (99, SchemaError, "newer version.*file_schema = 99, known_schema = .*upgrade"),
        (0, SchemaError, "no longer read.*file_schema = 0, oldest_schema = 1"),
        ("1", FileFormatError, "of which schema"),
        (None, FileFormatError, "of which schema"),
        (True, FileFormatError, "of which schema"),
    ],
)
def test_the_schema_is_checked_before_the_rest(
    saved: Path, tmp_path: Path, version: Any, error: type[Exception], message: str
) -> None:
    def put(node: dict[str, Any]) -> None:
        node["attributes"]["schema_version"] = version

    path = changed(saved, tmp_path / "other.unwrap3d", "zarr.json", put)
    with zipfile.ZipFile(path, "a") as target:
        target.writestr("of/a/later/schema", b"x")
    with pytest.raises(error, match=message):
        load_project(path)


def test_the_surface_alone(atlas: Atlas, saved: Path, tmp_path: Path) -> None:
    np.testing.assert_array_equal(load_surface(saved).vertices, atlas.surface.vertices)
    always = [name for name in CHARTS if name not in ON_REQUEST]
    nothing = atlas.replaced(**dict.fromkeys(always), on_request={})
    with pytest.raises(InputError, match="has no surface"):
        load_surface(save_project(nothing, tmp_path / "nothing"))


# Saving --------------------------------------------------------------------------


@pytest.mark.parametrize("written", [0, 1, 40, 90])
def test_a_full_disk_leaves_the_old_project(
    atlas: Atlas, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    path = save_project(atlas, tmp_path / "cell.unwrap3d")
    before, write, calls = path.read_bytes(), zipfile.ZipFile.writestr, []

    def full(self: zipfile.ZipFile, *args: Any, **options: Any) -> None:
        if len(calls) == written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        calls.append(args)
        write(self, *args, **options)

    monkeypatch.setattr(zipfile.ZipFile, "writestr", full)
    with pytest.raises(OSError, match="No space left"):
        save_project(atlas, path)
    assert len(calls) == written
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_disk_that_is_full_only_when_flushed_leaves_the_old_project(
    atlas: Atlas, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "cell.unwrap3d"
    path.write_bytes(b"before")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        save_project(atlas, path)
    assert path.read_bytes() == b"before"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
