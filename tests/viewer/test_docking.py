"""Our docks share the height of a side as tabs."""

from __future__ import annotations

from typing import Any

from napari_unwrap3d.viewer.annotations.widget import AnnotationWidget
from napari_unwrap3d.viewer.common.docking import dock_of
from napari_unwrap3d.viewer.wizard import Wizard


def test_a_second_dock_of_ours_is_a_tab_before_the_first(
    make_napari_viewer: Any, qtbot: Any
) -> None:
    viewer = make_napari_viewer(show=True)
    window = viewer.window._qt_window
    wizard, drawing, left = Wizard(viewer), AnnotationWidget(viewer), AnnotationWidget(viewer)
    first = viewer.window.add_dock_widget(wizard, area="right")
    qtbot.waitUntil(lambda: wizard._joined)
    second = viewer.window.add_dock_widget(drawing, area="right")
    qtbot.waitUntil(lambda: second in window.tabifiedDockWidgets(first))
    qtbot.waitUntil(lambda: not drawing.visibleRegion().isEmpty())
    assert wizard.visibleRegion().isEmpty()
    assert dock_of(drawing) is second
    # Where a person put a dock elsewhere, it stays alone.
    third = viewer.window.add_dock_widget(left, area="left")
    qtbot.waitUntil(lambda: not left.visibleRegion().isEmpty())
    assert not {first, second} & set(window.tabifiedDockWidgets(third))
