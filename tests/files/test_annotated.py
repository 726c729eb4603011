"""Annotations come back with the project, or the file is refused; saving them costs nothing."""

from __future__ import annotations

import errno
import json
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.annotations import Annotations, Shape
from napari_unwrap3d.annotations.state import Drawn, State
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import Cancelled, FileFormatError, InputError
from napari_unwrap3d.files.annotated import LARGEST_VIEW, read_annotations
from napari_unwrap3d.files.autosave import save_annotations
from napari_unwrap3d.files.project import CHARTS as CHARTS_KEPT
from napari_unwrap3d.files.project import (
    SCHEMA_VERSION,
    load_project,
    opened,
    read_summary,
    save_project,
)
from napari_unwrap3d.progress import Progress, silent
from synthetic import make_atlas

GROUP = "annotations/zarr.json"
CHARTS = ("surface", "uv", "direct", "plane", "reference")


def drawn_on(atlas: Atlas) -> Annotations:
    annotations = atlas.annotations
    annotations.add("out of focus")
    annotations.add("cell bottom")
    annotations.draw("out of focus", "uv", ([3, 3, 4], [0, 31, 30]), 2)
    annotations.add_shape("out of focus", Shape("direct", "ellipse", SQUARE, 3))
    annotations.add_shape("out of focus", Shape("uv", "polygon", SQUARE - 3, 5, "outermost"))
    annotations.add_shape("cell bottom", Shape("volume", "half-space", [[4, 0, 0], [-1, 0, 0]], 1))
    annotations.set_colours("cell bottom", {1: (1.0, 0.5, 0.0, 1.0)})
    annotations.points.set("tip", [10, 6, 6])
    annotations.overhang = "outermost"
    annotations.axis = [-1.0, 0.2, 0.1]
    return annotations


SQUARE = np.array([[0.0, 0.0], [0.0, 6.0], [5.0, 6.0], [5.0, 0.0]])
VIEW = {"layers": ["uv", "surface"], "camera": {"zoom": 1.5, "limit": float("inf")}}


@pytest.fixture(scope="module")
def original() -> Atlas:
    atlas = make_atlas(subdivisions=2, rows=16)
    drawn_on(atlas)
    return atlas


@pytest.fixture(scope="module")
def project(original: Atlas, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_project(original, tmp_path_factory.mktemp("p") / "cell.unwrap3d", view=VIEW)


@pytest.fixture
def saved(project: Path, tmp_path: Path) -> Path:
    (tmp_path / "saved").mkdir()
    return Path(shutil.copy(project, tmp_path / "saved"))


@pytest.fixture
def atlas(saved: Path) -> Atlas:
    return load_project(saved)


def assert_same(one: Annotations, other: Annotations) -> None:
    assert one.names == other.names
    assert one.overhang == other.overhang
    assert one.axis == other.axis
    assert dict(one.points.positions) == dict(other.points.positions)
    for name in one.names:
        assert [s.plain() for s in one.shapes(name)] == [s.plain() for s in other.shapes(name)]
        assert dict(one.colours(name)) == dict(other.colours(name))
        for chart in CHARTS:
            assert (one.image(name, chart) == other.image(name, chart)).all(), (name, chart)


def test_everything_that_was_drawn_comes_back(original: Atlas, saved: Path) -> None:
    loaded = unwrap3d.load(saved)
    assert_same(original.annotations, loaded.annotations)
    assert not loaded.annotations.can_undo
    assert read_summary(saved)["view"] == VIEW
    # What was painted lies under the shapes still.
    loaded.annotations.set_shapes("out of focus", [])
    assert loaded.annotations.image("out of focus", "uv").sum() == 6


def test_without_annotations_there_are_none(tmp_path: Path) -> None:
    path = save_project(make_atlas(2, 16), tmp_path / "plain.unwrap3d")
    loaded = load_project(path)
    assert loaded.annotations.names == ()
    assert read_summary(path)["view"] == {}


def test_a_project_of_schema_2_still_opens(tmp_path: Path) -> None:
    path = save_project(make_atlas(2, 16), tmp_path / "old.unwrap3d")

    def older(node: dict[str, Any]) -> None:
        node["attributes"]["schema_version"] = 2
        del node["attributes"]["view"]

    old = changed(path, tmp_path / "older.unwrap3d", older, "zarr.json")
    assert read_summary(old)["view"] == {}
    loaded = load_project(old)
    drawn_on(loaded)
    assert read_summary(old)["schema_version"] == 2
    save_annotations(old, loaded.annotations)
    assert read_summary(old)["schema_version"] == SCHEMA_VERSION
    assert_same(loaded.annotations, load_project(old).annotations)


def test_the_view_is_small(atlas: Atlas, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="small"):
        save_project(atlas, tmp_path / "cell", view={"x": "y" * LARGEST_VIEW})
    assert not list(tmp_path.glob("cell*"))


# Annotations alone ---------------------------------------------------------------


def test_annotations_alone_are_put_into_a_project(atlas: Atlas, saved: Path) -> None:
    before = contents(saved)
    annotations = atlas.annotations
    annotations.remove("out of focus")
    annotations.draw("cell bottom", "uv", ([8], [8]), 7)
    save_annotations(saved, annotations.state())
    after = contents(saved)
    charts = {name for name in before if not name.startswith("annotations/")} - {"zarr.json"}
    assert {name: before[name] for name in charts} == {
        name: after[name] for name in after if name in charts
    }
    assert_same(annotations, load_project(saved).annotations)
    assert read_summary(saved)["view"] == VIEW
    save_annotations(saved, annotations, view={"layers": []})
    assert read_summary(saved)["view"] == {"layers": []}


@pytest.mark.parametrize("written", [0, 1, 30])
def test_an_interrupted_save_costs_nothing(
    atlas: Atlas, saved: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    before, write, calls = saved.read_bytes(), zipfile.ZipFile.open, []

    def full(self: zipfile.ZipFile, name: Any, mode: str = "r", *args: Any, **options: Any) -> Any:
        if mode == "w":
            if len(calls) == written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            calls.append(name)
        return write(self, name, mode, *args, **options)

    monkeypatch.setattr(zipfile.ZipFile, "open", full)
    with pytest.raises(OSError, match="No space left"):
        save_annotations(saved, atlas.annotations)
    assert len(calls) == written
    assert saved.read_bytes() == before
    assert [entry.name for entry in saved.parent.iterdir()] == [saved.name]


def test_saving_can_be_cancelled(atlas: Atlas, saved: Path) -> None:
    before = saved.read_bytes()
    progress = Progress(lambda step, fraction, message: progress.cancel())
    with pytest.raises(Cancelled):
        save_annotations(saved, atlas.annotations, progress=progress)
    assert saved.read_bytes() == before
    assert [entry.name for entry in saved.parent.iterdir()] == [saved.name]


def test_annotations_of_another_surface_are_refused(saved: Path, tmp_path: Path) -> None:
    before = saved.read_bytes()
    with pytest.raises(InputError, match="another surface"):
        save_annotations(saved, State((Drawn("one", np.zeros(7, np.uint16)),)))
    with pytest.raises(InputError, match="no file"):
        save_annotations(tmp_path / "absent.unwrap3d", State())
    assert saved.read_bytes() == before


# Without trust -------------------------------------------------------------------

Change = Callable[[dict[str, Any]], None]


def contents(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def changed(source: Path, target: Path, change: Change, name: str = GROUP) -> Path:
    entries = contents(source)
    node = json.loads(entries[name])
    change(node)
    entries[name] = json.dumps(node).encode()
    with zipfile.ZipFile(target, "w") as archive:
        for key, content in entries.items():
            archive.writestr(key, content)
    return target


JUNK = [None, -1, "x", [], {}, 10**30, 1.5, [[1]], {"a": 1}, True, "", float("nan")]
PLACES: list[tuple[Any, ...]] = [
    ("annotations",),
    ("annotations", 0),
    ("annotations", 0, "name"),
    ("annotations", 0, "colours"),
    ("annotations", 1, "colours", 0),
    ("annotations", 1, "colours", 0, 1),
    ("annotations", 0, "has_image"),
    ("annotations", 0, "shapes"),
    ("annotations", 0, "shapes", 0),
    *[("annotations", 0, "shapes", 0, key) for key in ("chart", "kind", "vertices", "label")],
    ("annotations", 0, "shapes", 0, "overhang"),
    ("annotations", 0, "shapes", 0, "vertices", 0),
    ("overhang",),
    ("axis",),
    ("axis", 0),
    ("points",),
    ("points", 0, "name"),
    ("points", 0, "position_um"),
]


@pytest.mark.parametrize("where", PLACES, ids=str)
def test_junk_gives_a_named_error_or_sound_annotations(
    original: Atlas, saved: Path, tmp_path: Path, where: tuple[Any, ...]
) -> None:
    charts, refused = {name: getattr(original, name) for name in CHARTS_KEPT}, 0
    for junk in JUNK:

        def put(node: dict[str, Any], junk: Any = junk) -> None:
            part: Any = node["attributes"]
            for key in where[:-1]:
                part = part[key]
            part[where[-1]] = junk

        path = changed(saved, tmp_path / "junk.unwrap3d", put)
        annotations = Annotations(original)
        try:
            with opened(path) as root:
                state = read_annotations(root["annotations"], charts, silent())
        except FileFormatError:
            refused += 1
        else:
            annotations.restore(state)
        for name in annotations.names:
            assert annotations.image(name, "uv").shape == (16, 32)
    assert refused >= len(JUNK) - 4


def far(node: dict[str, Any]) -> None:
    node["attributes"]["annotations"][0]["shapes"][0]["vertices"][0] = [0, 1e9]


def twice(node: dict[str, Any]) -> None:
    node["attributes"]["annotations"][1]["name"] = "out of focus"


def no_image(node: dict[str, Any]) -> None:
    node["attributes"]["annotations"][0]["has_image"] = False


@pytest.mark.parametrize(
    ("change", "message"),
    [(far, "too far"), (twice, "comes twice"), (no_image, "belong to no annotation")],
)
def test_what_no_annotation_can_be_is_refused(
    saved: Path, tmp_path: Path, change: Change, message: str
) -> None:
    with pytest.raises(FileFormatError, match=message):
        load_project(changed(saved, tmp_path / "bad.unwrap3d", change))


@pytest.mark.parametrize("part", ["labels", "image"])
@pytest.mark.parametrize("dtype", [np.uint16, np.int32])
def test_labels_of_another_size_or_kind_are_refused(
    atlas: Atlas, tmp_path: Path, part: str, dtype: type
) -> None:
    n = len(atlas.surface.vertices) + (dtype is np.uint16)
    sizes = {"labels": np.zeros(n, dtype), "image": np.zeros((16, 33), dtype)}
    good = {"labels": np.zeros(len(atlas.surface.vertices), np.uint16), "image": None}
    path = save_project(
        atlas,
        tmp_path / "bad.unwrap3d",
        annotations=State((Drawn("one", **{**good, part: sizes[part]}),)),
    )
    with pytest.raises(FileFormatError, match="another size"):
        load_project(path)


def test_shapes_in_charts_that_the_file_does_not_have_are_refused(
    atlas: Atlas, tmp_path: Path
) -> None:
    state = atlas.annotations.state()
    without = atlas.replaced(on_request={})
    path = save_project(without, tmp_path / "bad.unwrap3d", annotations=state)
    with pytest.raises(FileFormatError, match="no direct for a shape"):
        load_project(path)
