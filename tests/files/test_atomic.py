"""Files and folders appear when complete, or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from napari_unwrap3d.files.atomic import replacing


def everything(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_what_is_written_beside_moves_along(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("before")
    with replacing(tmp_path / "a.obj") as partial:
        partial.write_text("mesh")
        partial.with_suffix(".mtl").write_text("material")
        assert everything(tmp_path)["a.mtl"] == "before"
    assert everything(tmp_path) == {"a.obj": "mesh", "a.mtl": "material"}


def test_a_folder_replaces_a_folder(tmp_path: Path) -> None:
    target = tmp_path / "a.zarr"
    for name in ("one", "two"):
        with replacing(target) as partial:
            partial.mkdir()
            (partial / name).write_text(name)
    assert everything(tmp_path) == {"a.zarr/two": "two"}


def test_a_folder_that_cannot_move_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, move = tmp_path / "a.zarr", os.replace
    target.mkdir()
    (target / "one").write_text("one")

    def fail(source: Path, to: Path) -> None:
        if Path(source).name == target.name and Path(source).parent != tmp_path:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES))
        move(source, to)

    def write() -> None:
        with replacing(target) as partial:
            partial.mkdir()

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="denied"):
        write()
    assert everything(tmp_path) == {"a.zarr/one": "one"}


def test_a_file_system_that_cannot_flush_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cannot(descriptor: int) -> None:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(os, "fsync", cannot)
    with replacing(tmp_path / "a.txt") as partial:
        partial.write_text("a")
    assert everything(tmp_path) == {"a.txt": "a"}
