"""Projects in the window: what comes back, and that nothing drawn is ever lost."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import napari
import numpy as np
import pytest
from qtpy.QtCore import QStandardPaths, Qt
from qtpy.QtTest import QTest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.files.project import load_source, save_project
from napari_unwrap3d.pipeline import STEP_NAMES
from napari_unwrap3d.viewer.files import autosave
from napari_unwrap3d.viewer.files.autosave import left_behind
from napari_unwrap3d.viewer.files.project import autosave_of, open_project, saving, source_layer
from napari_unwrap3d.viewer.files.readers import read_projects
from napari_unwrap3d.viewer.session import Session, session_of
from napari_unwrap3d.viewer.views.canvas import canvas_of
from napari_unwrap3d.viewer.wizard import Wizard, open_wizard
from viewer.opened import SECONDS, open_atlas, ramp_stack, settle

NAME = "cell bottom"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Cells that are left behind are kept in a folder of the test."""
    place = tmp_path / "unsaved"
    monkeypatch.setattr(autosave, "unsaved_folder", lambda: place)
    monkeypatch.setattr("napari_unwrap3d.viewer.files.project.unsaved_folder", lambda: place)
    QStandardPaths.setTestModeEnabled(True)
    yield place
    QStandardPaths.setTestModeEnabled(False)


def draw(atlas: Atlas) -> np.ndarray:
    """A patch drawn in uv; the labels that it gives the surface."""
    atlas.annotations.add(NAME)
    rows, columns = np.mgrid[2:8, 10:20]
    atlas.annotations.draw(NAME, "uv", (rows.ravel(), columns.ravel()), 3)
    return np.array(atlas.annotations.labels(NAME))


def wait(session: Session, qtbot: Any) -> Atlas:
    qtbot.waitUntil(lambda: session.atlas is not None, timeout=SECONDS)
    qtbot.waitUntil(lambda: not session.turns.busy, timeout=SECONDS)
    assert session.atlas is not None
    return session.atlas


def save(viewer: Any, path: Path) -> Path:
    session = session_of(viewer)
    return saving(session, viewer, path)()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the project is kept that the first test with it makes."""
    return tmp_path_factory.mktemp("project") / "cell.unwrap3d"


@pytest.fixture
def project(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas, kept: Path, tmp_path: Path
) -> Path:
    """A copy of a cell as somebody left it: drawn on, and looked at in his own way."""
    if not kept.exists():
        leave(make_napari_viewer(), qtbot, small_atlas, kept)
    return Path(shutil.copy(kept, tmp_path))


def leave(viewer: Any, qtbot: Any, small_atlas: Atlas, path: Path) -> None:
    """Draw on the small cell, look at it in an own way, and save it."""
    stack = ramp_stack(small_atlas)
    viewer.add_layer(napari.layers.Layer.create(*source_layer(stack, "two ramps")))
    atlas = small_atlas.replaced()
    canvas = open_atlas(viewer, atlas, qtbot, stack)
    session_of(viewer).set_source(viewer.layers["two ramps"])
    draw(atlas)
    canvas.show_chart("topography")
    canvas.colouring.set_field("height_um")
    settle(canvas, qtbot)
    canvas.colouring.set_colormap("magma")
    canvas.colouring.set_limits(-1.5, 2.5)
    canvas.depth_bar.slider.setValue(1)
    viewer.layers["surface"].opacity = 0.5
    viewer.scene.camera.angles = (10.0, 20.0, 30.0)
    save(viewer, path)


def test_a_project_comes_back_as_it_was_left_and_goes_on(
    make_napari_viewer: Any, qtbot: Any, project: Path, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer()
    open_project(viewer, project)
    session = session_of(viewer)
    atlas = wait(session, qtbot)
    canvas = canvas_of(viewer)
    settle(canvas, qtbot)
    assert {step.state for name, step in session.steps.items() if name in STEP_NAMES} == {"done"}
    for step in STEP_NAMES:
        assert getattr(session.parameters, step) == getattr(small_atlas.parameters, step)
    assert session.source is viewer.layers["two ramps"]
    assert session.project_path == project
    assert (atlas.annotations.labels(NAME) == draw(small_atlas.replaced())).all()
    assert canvas.chart == "topography"
    assert canvas.colouring.field == "height_um"
    assert canvas.colouring.colormap.name == "magma"
    assert canvas.colouring.limits == (-1.5, 2.5)
    assert canvas.depth_bar.slider.value() == 1
    assert viewer.layers["surface"].opacity == 0.5
    assert viewer.layers["surface"].visible
    np.testing.assert_allclose(viewer.scene.camera.angles, (10.0, 20.0, 30.0), atol=1e-6)
    assert viewer.window._qt_window.findChildren(Wizard)
    # It goes on where it was.
    session.update_automatically = False
    session.set_values("sphere", {"blend": 0.5})
    states = {name: step.state for name, step in session.steps.items() if name in STEP_NAMES}
    stale = [name for name, state in states.items() if state == "stale"]
    assert stale == ["sphere", "uv", "topography"]


def test_the_reader_opens_a_project_in_which_drawing_is_saved_by_itself(
    make_napari_viewer: Any, qtbot: Any, project: Path
) -> None:
    viewer = make_napari_viewer()
    assert read_projects(str(project)) == [(None,)]
    atlas = wait(session_of(viewer), qtbot)
    assert viewer.layers["surface"].visible
    # What is drawn is saved by itself in the project.
    keeper = autosave_of(viewer)
    keeper._timer.setInterval(1)
    atlas.annotations.add("out of focus")
    atlas.annotations.draw_vertices("out of focus", [0, 1, 2], 1)
    assert keeper.dirty
    qtbot.waitUntil(lambda: not keeper.dirty and keeper._task is None, timeout=SECONDS)
    again = unwrap3d.load(project)
    assert again.annotations.labels("out of focus").nonzero()[0].tolist() == [0, 1, 2]
    assert load_source(project) is not None, "the rest of the project stays"


def test_a_damaged_project_is_said_and_leaves_the_window_as_it_is(
    make_napari_viewer: Any, qtbot: Any, project: Path, errors: list[str]
) -> None:
    content = project.read_bytes()
    project.write_bytes(content[: len(content) // 2])
    viewer = make_napari_viewer()
    open_project(viewer, project)
    qtbot.waitUntil(lambda: bool(errors), timeout=SECONDS)
    assert project.name in errors[0]
    assert len(viewer.layers) == 0


def test_a_nonsensical_view_is_no_obstacle(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas, tmp_path: Path
) -> None:
    view = {
        "camera": {"center": [float("nan")] * 3, "zoom": -1, "angles": 3, "perspective": 0},
        "layers": {"surface": "visible"},
        "canvas": {"chart": "nowhere"},
        "colouring": {"field": "none", "colormap": "none", "limits": [0, 1]},
        "depth": {"range": 5},
        "ndisplay": 7,
        "source": {"origin_um": ["a"]},
    }
    path = save_project(small_atlas, tmp_path / "odd.unwrap3d", view=view)
    viewer = make_napari_viewer()
    open_project(viewer, path)
    wait(session_of(viewer), qtbot)
    assert viewer.dims.ndisplay == 3
    assert np.isfinite(viewer.scene.camera.center).all()


def test_what_was_never_saved_is_offered_at_the_next_start(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas, folder: Path
) -> None:
    viewer = make_napari_viewer()
    open_wizard(viewer)
    atlas = small_atlas.replaced()
    open_atlas(viewer, atlas, qtbot)
    expected = draw(atlas)
    viewer.close()
    (kept,) = folder.glob("*.unwrap3d")
    assert left_behind() == [kept]

    other = make_napari_viewer()
    wizard = open_wizard(other)
    assert wizard.left.isVisibleTo(wizard)
    QTest.mouseClick(wizard.left.open_button, Qt.MouseButton.LeftButton)
    found = wait(session_of(other), qtbot)
    assert (found.annotations.labels(NAME) == expected).all()
    assert session_of(other).project_path is None
    assert left_behind() == [], "it is in use"


def test_saving_forgets_what_was_kept_for_the_next_start(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas, folder: Path, tmp_path: Path
) -> None:
    viewer = make_napari_viewer()
    wizard = open_wizard(viewer)
    atlas = small_atlas.replaced()
    open_atlas(viewer, atlas, qtbot)
    draw(atlas)
    keeper = autosave_of(viewer)
    keeper.save()
    qtbot.waitUntil(lambda: keeper._task is None, timeout=SECONDS)
    assert list(folder.glob("*.unwrap3d"))
    wizard.save(tmp_path / "mine")
    qtbot.waitUntil(lambda: wizard._saving is None, timeout=SECONDS)
    assert (tmp_path / "mine.unwrap3d").is_file()
    assert not list(folder.iterdir())
