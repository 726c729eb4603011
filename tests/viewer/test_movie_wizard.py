"""The dock Movie with a real, small timelapse: from a layer to frames that are shown."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import napari
import numpy as np
import pytest

from napari_unwrap3d.errors import InputError
from napari_unwrap3d.motion.movie import Movie
from napari_unwrap3d.motion.stages import MovieWork
from napari_unwrap3d.viewer.common.threads import THREAD_NAME
from napari_unwrap3d.viewer.files.autosave import left_behind
from napari_unwrap3d.viewer.movies.chosen import ASK_TIME_STEP, NO_TIMELAPSE
from napari_unwrap3d.viewer.movies.run import STAGES
from napari_unwrap3d.viewer.wizard import Wizard
from viewer.directing import SCALE, TIMED, TIMEPOINTS, UM, Director, add_stack, cells
from viewer.playing import TIME_STEP_S

DONE, STALE, READY = "●", "◐", "○"


@pytest.fixture(autouse=True)
def unsaved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Movies that are left behind are kept in a folder of the test."""
    place = tmp_path / "unsaved"
    for module in ("files.autosave", "files.project", "movies.folders"):
        monkeypatch.setattr(f"napari_unwrap3d.viewer.{module}.unsaved_folder", lambda: place)
    return place


@pytest.fixture
def direct(make_napari_viewer: Any, qtbot: Any) -> Callable[..., Director]:
    """A window with the dock Movie, and a timelapse of masks if it is described."""

    def make(data: np.ndarray | None = None, **layer: Any) -> Director:
        viewer = make_napari_viewer(show=True)
        if layer:
            values = cells().astype(np.uint8) if data is None else data
            viewer.add_image(values, name="cells", **layer)
        return Director(viewer, qtbot)

    return make


@pytest.fixture
def opened(make_napari_viewer: Any, qtbot: Any, movie_folder: Path, tmp_path: Path) -> Director:
    """A window with a movie that was made before, and what it was made from."""
    folder = shutil.copytree(movie_folder, tmp_path / "movie")
    viewer = make_napari_viewer(show=True)
    add_stack(viewer)
    director = Director(viewer, qtbot)
    director.open(folder)
    return director


def pieces(director: Director) -> dict[str, int]:
    """When every piece of work was written."""
    working = director.run.working
    assert working is not None
    found = working.path.rglob("*")
    return {
        str(path.relative_to(working.path)): path.stat().st_mtime_ns
        for path in found
        if path.is_file()
    }


def test_a_time_step_is_asked_for_and_run_all_makes_a_movie_that_is_shown(
    direct: Callable[..., Director],
) -> None:
    director = direct(scale=(1.0, *SCALE), units=("pixel", *UM), axis_labels=tuple("tzyx"))
    chooser = director.panel.chooser
    assert director.run.chosen.blocked() == ASK_TIME_STEP
    assert chooser.note.text() == ASK_TIME_STEP
    assert not director.panel.run_button.isEnabled()
    director.fill_in(chooser.time_step, "2.5")
    assert director.run.chosen.blocked() == ""
    director.click(director.panel.sections["register"].run_button)
    director.wait(lambda: director.run.running)
    director.end()
    assert director.states()["register"] == DONE
    assert director.states()["frame"] == READY
    layer = director.viewer.layers["cells"]
    assert layer.scale[0] == 2.5
    assert str(layer.units[0]) == "second"
    working = director.run.working
    assert working is not None
    assert Movie(working.folder).time_step_s == 2.5
    # Run all makes a movie, which is shown.
    threads = set()
    director.run.progressed.connect(lambda *_: threads.add(threading.current_thread().name))
    director.run_all()
    assert director.states() == dict.fromkeys(STAGES, DONE)
    assert director.panel.message.text() == "Done."
    assert not director.panel.failures.isVisibleTo(director.panel)
    movie = director.movies.movie
    assert movie is not None
    assert len(movie) == TIMEPOINTS
    assert all(movie.has_frame(t) for t in range(TIMEPOINTS))
    assert director.session.atlas is movie.common
    director.wait(lambda: director.movies.made == frozenset(range(TIMEPOINTS)))
    director.wait(lambda: "cell at t" in director.viewer.layers)
    # The window was never used for work.
    assert threads == {threading.main_thread().name}
    assert not any(THREAD_NAME in name for name in threads)


def test_a_window_without_a_timelapse_says_what_to_open(direct: Callable[..., Director]) -> None:
    director = direct()
    assert director.panel.chooser.note.text() == NO_TIMELAPSE
    director.viewer.add_image(cells()[0], name="one", scale=SCALE, units=UM)
    assert not director.panel.run_button.isEnabled()
    director.viewer.add_image(cells().astype(np.uint8), name="cells", **TIMED)
    assert director.panel.run_button.isEnabled()
    director.viewer.layers.remove("cells")
    assert not director.panel.run_button.isEnabled()


def test_an_opened_movie_is_gone_on_with_ages_and_can_be_cancelled(
    opened: Director, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert opened.states() == dict.fromkeys(STAGES, DONE)
    before = pieces(opened)
    opened.run_all()
    assert {name for name in before if pieces(opened)[name] != before[name]} == {"movie.json"}
    frames, space = opened.panel.sections["frame"], opened.panel.sections["common"]
    frames.form.entries["movie.normalize"].widget.value = False
    opened.settle()
    assert opened.states() == dict.fromkeys(STAGES, DONE) | {"frame": STALE}
    space.form.entries["movie.common"].widget.value = "timepoint"
    opened.settle()
    assert opened.states() == dict.fromkeys(STAGES, DONE) | {"common": STALE, "frame": STALE}
    space.form.entries["movie.common"].widget.value = "recommended"
    opened.settle()
    assert opened.states()["common"] == DONE
    common = opened.session.atlas
    opened.run_all()
    after = pieces(opened)
    assert opened.states() == dict.fromkeys(STAGES, DONE)
    anew = {Path(name).parts[0] for name in after if after[name] != before[name]}
    assert anew == {"frames", "movie.json"}
    assert opened.session.atlas is common, "the common space stays as it is shown"
    opened.wait(lambda: len(opened.movies.made) == len(opened.movies.movie or ()))
    # Cancelling keeps what was made.
    assert opened.run.working is not None
    for timepoint in (1, 2, 3):
        (opened.run.working.path / "frames" / f"{timepoint:05d}.zip").unlink()
    make_frame = MovieWork.frame

    def waiting(work: MovieWork, timepoint: int, progress: Any) -> bool:
        if timepoint == 2:
            while True:  # until it is cancelled
                progress(0.5, "waiting")
        return make_frame(work, timepoint, progress)

    monkeypatch.setattr(MovieWork, "frame", waiting)
    opened.click(opened.panel.run_button)
    frames = opened.panel.sections["frame"]
    opened.wait(lambda: frames.status.text() == "timepoint 2: waiting")
    assert "4/4 Frames" in opened.panel.progress_bar.format()
    assert frames.progress_bar.isVisible()
    opened.click(opened.panel.cancel_button)
    opened.end()
    assert "Cancelled" in opened.panel.message.text()
    assert frames.seconds.text() == "3 of 5"
    before = pieces(opened)
    monkeypatch.setattr(MovieWork, "frame", make_frame)
    opened.run_all()
    after = pieces(opened)
    made = {name for name in after if after[name] != before.get(name)}
    assert made == {"movie.json", "frames/00002.zip", "frames/00003.zip"}


def test_a_timepoint_that_fails_is_listed_and_stops_no_other(
    direct: Callable[..., Director],
) -> None:
    empty = cells().astype(np.uint8)
    empty[2] = 0
    director = direct(empty, **TIMED)
    director.run_all()
    (failure,) = director.run.failures
    assert (failure.stage, failure.timepoint) == ("segment", 2)
    item = director.panel.failures.topLevelItem(0)
    assert director.panel.failures.isVisible()
    assert item.text(0) == "2"
    assert item.text(2) == failure.reason
    assert failure.reason
    movie = director.movies.movie
    assert movie is not None
    assert [movie.has_frame(t) for t in range(TIMEPOINTS)] == [True, True, False, True]
    assert movie.record["timepoints"] == 3
    assert "1 timepoint failed" in director.panel.message.text()


def test_a_common_space_that_cannot_be_made_says_why(
    direct: Callable[..., Director], errors: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> bool:
        raise InputError("There is no space.")

    monkeypatch.setattr(MovieWork, "common", fail)
    director = direct(**TIMED)
    director.run_all()
    assert errors == ["There is no space."]
    assert "There is no space." in director.panel.message.text()
    assert director.states()["segment"] == DONE
    assert director.panel.run_button.isEnabled()


def test_one_frame_can_be_made_alone(direct: Callable[..., Director]) -> None:
    director = direct(**TIMED)
    frames = director.panel.sections["frame"]
    frames.expand(True)
    frames.timepoint.setValue(2)
    director.click(frames.one_button)
    director.wait(lambda: director.run.running)
    director.end()
    assert frames.seconds.text() == f"1 of {TIMEPOINTS}"
    movie = director.movies.movie
    assert movie is not None
    assert movie.has_frame(2)
    assert not movie.has_frame(0)


def test_several_masks_are_a_timelapse(direct: Callable[..., Director]) -> None:
    director = direct()
    for t, mask in enumerate(cells()):
        director.viewer.add_image(mask, name=f"mask {t}", scale=SCALE, units=UM)
    (candidate,) = director.run.chosen.candidates()
    assert candidate.timepoints == TIMEPOINTS
    assert director.run.chosen.source == candidate, "those that came after the second one, too"
    director.fill_in(director.panel.chooser.time_step, str(TIME_STEP_S))
    director.click(director.panel.sections["common"].run_button)
    director.wait(lambda: director.run.running)
    director.end()
    assert director.movies.movie is not None
    assert len(director.movies.movie) == TIMEPOINTS
    # The solid of the common space is no timepoint.
    assert [each.timepoints for each in director.run.chosen.candidates()] == [TIMEPOINTS]


def test_the_wizard_has_a_page_where_there_is_a_timelapse(make_napari_viewer: Any) -> None:
    viewer = make_napari_viewer()
    wizard = Wizard(viewer)
    viewer.window.add_dock_widget(wizard, name="Unwrap")
    assert not wizard.pages.isTabVisible(1)
    viewer.add_image(cells().astype(np.uint8), name="cells", **TIMED)
    assert wizard.pages.isTabVisible(1)
    viewer.layers.clear()
    assert not wizard.pages.isTabVisible(1)


def test_a_window_that_closes_leaves_no_thread_and_keeps_what_was_not_saved(
    make_napari_viewer: Any, qtbot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer: napari.Viewer = make_napari_viewer()
    viewer.add_image(cells().astype(np.uint8), name="cells", **TIMED)
    director = Director(viewer, qtbot)

    def waiting(work: MovieWork, timepoint: int, progress: Any) -> bool:
        while True:
            progress(0.5, "waiting")

    monkeypatch.setattr(MovieWork, "frame", waiting)
    run = director.run
    run.run()
    director.wait(lambda: director.movies.movie is not None)
    director.wait(lambda: not director.session.turns.busy)
    director.wait(lambda: "waiting" in director.panel.sections["frame"].status.text())
    assert not left_behind()  # it is in use
    viewer.close()
    assert not any(THREAD_NAME in thread.name for thread in threading.enumerate())
    (path,) = left_behind()
    assert path.is_dir()
