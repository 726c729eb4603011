"""What was drawn on single timepoints of a movie: written, read, and never trusted."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from moving import blebbing_movie
from napari_unwrap3d import Movie, load_movie
from napari_unwrap3d.errors import FileFormatError, Unwrap3DError
from napari_unwrap3d.files.movie_annotations import keep_timed, read_timed

PIXELS = np.array([10, 11]), np.array([20, 21])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


@pytest.fixture
def movie(made: Movie, tmp_path: Path) -> Movie:
    """A copy with something drawn on two timepoints."""
    copy = Movie.open(shutil.copytree(made.folder.path, tmp_path / "copy"))
    annotations = copy.common.annotations
    annotations.add("ruffle")
    annotations.times.show(0)
    annotations.times.set_one_by_one("ruffle", True)
    annotations.set_colours("ruffle", {1: (1.0, 0.0, 0.0, 1.0)})
    annotations.draw("ruffle", "uv", PIXELS, 1)
    annotations.times.show(2)
    annotations.draw("ruffle", "uv", PIXELS, 2)
    copy.keep_annotations()
    return copy


def drawn_on(movie: Movie) -> list[str]:
    return sorted(path.name for path in (movie.folder.path / "annotations").glob("*.zip"))


def test_the_folder_has_a_file_for_each_timepoint_that_was_drawn_on(movie: Movie) -> None:
    assert drawn_on(movie) == ["00000.zip", "00002.zip"]
    there = Movie.open(movie.folder.path).common.annotations
    assert there.times.drawn("ruffle") == (0, 2)
    assert there.colours("ruffle") == {1: (1.0, 0.0, 0.0, 1.0)}
    for timepoint, label in ((0, 1), (1, 0), (2, 2)):
        assert (there.times.image("ruffle", timepoint)[PIXELS] == label).all()


def test_only_what_changed_is_written_again(movie: Movie) -> None:
    place = movie.folder.path / "annotations"
    before = {name: (place / name).stat().st_mtime_ns for name in drawn_on(movie)}
    annotations = movie.common.annotations
    annotations.draw("ruffle", "uv", (np.array([3]), np.array([3])), 1)
    movie.keep_annotations()
    after = {name: (place / name).stat().st_mtime_ns for name in drawn_on(movie)}
    assert after["00000.zip"] == before["00000.zip"]
    assert after["00002.zip"] != before["00002.zip"]
    annotations.remove("ruffle")
    movie.keep_annotations()
    assert drawn_on(movie) == []
    assert Movie.open(movie.folder.path).common.annotations.names == ()


def test_one_file_holds_it_too(movie: Movie, tmp_path: Path) -> None:
    there = load_movie(movie.save(tmp_path / "saved")).common.annotations
    assert there.times.drawn("ruffle") == (0, 2)


def test_it_does_not_belong_to_another_common_space(movie: Movie) -> None:
    record = movie.folder.common()
    assert record is not None
    movie.folder.keep_common(record | {"key": "another"})
    assert read_timed(movie.folder, movie.common) == ()


@pytest.mark.parametrize("damage", ["list", "name", "missing", "labels"])
def test_damaged_files_are_told(movie: Movie, damage: str) -> None:
    place = movie.folder.path / "annotations"
    about = json.loads((place / "timed.json").read_text("utf-8"))
    if damage == "list":
        about["annotations"] = [{"colours": []}]
    elif damage == "name":
        about["annotations"][0]["name"] = ""
    elif damage == "missing":
        (place / "00002.zip").unlink()
    else:
        (place / "00002.zip").write_bytes(b"no labels")
    (place / "timed.json").write_text(json.dumps(about), "utf-8")
    kind = FileFormatError if damage in ("list", "name") else Unwrap3DError
    with pytest.raises(kind):
        read_timed(movie.folder, movie.common)


def test_without_anything_drawn_there_is_no_folder(made: Movie) -> None:
    keep_timed(made.folder, ())
    assert not (made.folder.path / "annotations").exists()
