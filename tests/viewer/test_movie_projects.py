"""Movies opened and saved in the window; nothing that is drawn is lost."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d import load_movie
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.files.project import load_project
from napari_unwrap3d.viewer.files.autosave import left_behind
from napari_unwrap3d.viewer.files.project import autosave_of
from napari_unwrap3d.viewer.files.readers import get_project_reader
from napari_unwrap3d.viewer.wizard import Wizard
from viewer.directing import Director, add_stack

NAME = "front"


@pytest.fixture(autouse=True)
def unsaved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Movies that are left behind are kept in a folder of the test."""
    place = tmp_path / "unsaved"
    for module in ("files.autosave", "files.project", "movies.folders"):
        monkeypatch.setattr(f"napari_unwrap3d.viewer.{module}.unsaved_folder", lambda: place)
    return place


@pytest.fixture
def folder(movie_folder: Path, tmp_path: Path) -> Path:
    """A copy of the small movie."""
    return shutil.copytree(movie_folder, tmp_path / "movie")


@pytest.fixture
def direct(make_napari_viewer: Any, qtbot: Any) -> Callable[[], Director]:
    return lambda: Director(make_napari_viewer(show=True), qtbot)


def draw(director: Director) -> np.ndarray:
    """A patch drawn in uv; the labels that it gives the common surface."""
    atlas = director.session.atlas
    assert atlas is not None
    atlas.annotations.add(NAME)
    rows, columns = np.mgrid[20:30, 40:60]
    atlas.annotations.draw(NAME, "uv", (rows.ravel(), columns.ravel()), 3)
    return np.array(atlas.annotations.labels(NAME))


def share(atlas: Atlas) -> float:
    """Which share of the surface is drawn on."""
    return float((atlas.annotations.labels(NAME) == 3).mean())


def test_a_saved_movie_opens_by_drop_with_what_was_drawn(
    direct: Callable[[], Director], folder: Path, tmp_path: Path
) -> None:
    director = direct()
    director.open(folder)
    labels = draw(director)
    saved = tmp_path / "saved.unwrap3d"
    director.panel.save(saved)
    director.wait(lambda: "Saved" in director.panel.message.text())
    reader = get_project_reader(str(saved))
    assert reader is not None
    another = direct()
    assert reader(str(saved)) == [(None,)]
    another.wait(lambda: another.movies.movie is not None)
    another.settle()
    assert another.session.atlas is not None
    assert another.session.atlas is another.movies.movie.common
    np.testing.assert_array_equal(another.session.atlas.annotations.labels(NAME), labels)
    assert len(another.movies.movie) == len(load_movie(folder))
    assert another.panel.sections["frame"].seconds.text() == "5 of 5"
    np.testing.assert_array_equal(load_movie(saved).common.annotations.labels(NAME), labels)


def test_a_movie_is_known_as_a_file_as_a_folder_and_by_its_manifest(
    folder: Path, tmp_path: Path
) -> None:
    load_movie(folder).save(tmp_path / "movie")
    for path in (tmp_path / "movie.unwrap3d", folder, folder / "movie.json"):
        assert get_project_reader(str(path)) is not None
    for path in (tmp_path, tmp_path / "other.json"):
        assert get_project_reader(str(path)) is None


def test_what_is_drawn_is_saved_by_itself_into_the_folder(
    direct: Callable[[], Director], folder: Path
) -> None:
    director = direct()
    director.open(folder)
    labels = draw(director)
    autosave = autosave_of(director.viewer)
    assert autosave.dirty
    autosave.close()
    kept = load_project(folder / "common.unwrap3d")
    np.testing.assert_array_equal(kept.annotations.labels(NAME), labels)


def test_what_is_drawn_stays_when_the_common_space_is_made_anew(
    make_napari_viewer: Any, qtbot: Any, folder: Path
) -> None:
    director = Director(make_napari_viewer(), qtbot)
    add_stack(director.viewer)
    director.open(folder)
    draw(director)
    before = director.session.atlas
    assert before is not None
    space = director.panel.sections["common"]
    space.form.entries["movie.common"].widget.value = "timepoint"
    director.settle()
    director.click(space.run_button)
    director.wait(lambda: director.run.running)
    director.end()
    after = director.session.atlas
    assert after is not None
    assert after is not before
    assert len(after.surface.vertices) != len(before.surface.vertices)
    assert share(after) == pytest.approx(share(before), rel=0.25)


def test_a_movie_that_was_not_saved_is_offered_again(
    make_napari_viewer: Any, qtbot: Any, folder: Path, unsaved: Path
) -> None:
    unsaved.mkdir()
    kept = unsaved / "movie-1.unwrap3d"
    shutil.move(folder, kept)
    viewer = make_napari_viewer(show=True)
    wizard = Wizard(viewer)
    viewer.window.add_dock_widget(wizard, name="Unwrap")
    assert wizard.left.isVisibleTo(wizard)
    assert "movie" in wizard.left.text.text()
    wizard.left.open_button.click()
    run = wizard.movie.run
    qtbot.waitUntil(lambda: run.movie is not None, timeout=30_000)
    qtbot.waitUntil(lambda: not run.session.turns.busy, timeout=30_000)
    assert run.working is not None
    assert run.working.path == kept
    assert not left_behind(), "it is in use"
    viewer.close()
    assert left_behind() == [kept], "it was never saved"


def test_a_folder_without_a_common_space_says_what_to_do(
    direct: Callable[[], Director], folder: Path, errors: list[str]
) -> None:
    (folder / "common.json").unlink()
    director = direct()
    director.panel.open(folder)
    director.wait(lambda: bool(errors))
    assert "no common space" in errors[0]
    assert director.movies.movie is None
    assert not director.run.busy_with
