"""As napari's menus do it: sample data, the dock widget, opening and saving files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import npe2
import numpy as np
import pytest

import napari_unwrap3d
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.files.project import save_project
from napari_unwrap3d.viewer.annotations.widget import AnnotationWidget
from napari_unwrap3d.viewer.files import samples
from napari_unwrap3d.viewer.session import session_of
from napari_unwrap3d.viewer.views.canvas import canvas_of
from napari_unwrap3d.viewer.views.placing import chart_of
from napari_unwrap3d.viewer.wizard import Wizard

PLUGIN = "napari-unwrap3d"
MANIFEST = Path(napari_unwrap3d.__file__).parent / "napari.yaml"


@pytest.fixture
def plugin(npe2pm: Any, make_napari_viewer: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(samples, "sample", partial(samples.sample, size=80))
    with npe2pm.tmp_plugin(manifest=npe2.PluginManifest.from_file(MANIFEST)):
        yield make_napari_viewer


def test_sample_dock_widget_and_run(plugin: Any, qtbot: Any, fake_pipeline: Any) -> None:
    viewer = plugin()
    viewer.open_sample(PLUGIN, "blebs")
    _, widget = viewer.window.add_plugin_dock_widget(PLUGIN, "Unwrap")
    assert isinstance(widget, Wizard)
    assert widget.chooser.layer_box.value.name == "blebs", "the stack, not its truth"
    assert widget.run_button.isEnabled()
    with qtbot.waitSignal(widget.session.finished, timeout=60_000):
        widget.run_button.click()
    assert "surface" in {chart_of(layer) for layer in viewer.layers}


def test_every_dock_opens_from_the_menu(plugin: Any) -> None:
    viewer = plugin()
    contributed = npe2.PluginManifest.from_file(MANIFEST).contributions.widgets
    assert contributed
    for widget in contributed:
        dock, _ = viewer.window.add_plugin_dock_widget(PLUGIN, widget.display_name)
        assert not dock.isHidden(), widget.display_name


def test_the_wizard_leads_to_the_annotations(plugin: Any) -> None:
    viewer = plugin()
    _, wizard = viewer.window.add_plugin_dock_widget(PLUGIN, "Unwrap")
    wizard.hint.linkActivated.emit("Annotations")
    (drawing,) = viewer.window._qt_window.findChildren(AnnotationWidget)
    assert not drawing.isHidden()


def test_meshes_are_saved_and_opened(plugin: Any, tmp_path: Path) -> None:
    viewer = plugin()
    vertices = np.array([[0, 0, 0], [1, 0.25, 0], [0, 2, 0.5], [0.125, 0, 3]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    layer = viewer.add_surface((vertices, faces), units=("µm",) * 3)
    path = tmp_path / "cell.ply"
    assert layer.save(str(path)) == [str(path)]
    (again,) = viewer.open(str(path), plugin=PLUGIN)
    np.testing.assert_allclose(again.data[0], vertices, atol=1e-6)
    np.testing.assert_array_equal(np.sort(again.data[1]), np.sort(faces))


def test_a_project_opens_with_its_charts(
    plugin: Any, qtbot: Any, tmp_path: Path, round_cell: Atlas
) -> None:
    viewer = plugin()
    path = save_project(round_cell, tmp_path / "cell.unwrap3d")
    assert viewer.open(str(path), plugin=PLUGIN) == []
    session = session_of(viewer)
    qtbot.waitUntil(lambda: session.atlas is not None, timeout=60_000)
    layers = [*viewer.layers, *canvas_of(viewer).model.layers]
    meshes = {"mask", "surface", "sealed", "reference", "sphere"}
    assert {chart_of(layer) for layer in layers} - {""} == meshes | {"uv", "topography"}
