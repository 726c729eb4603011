"""A new value of the progress bar is drawn with the next frame, and only once."""

from __future__ import annotations

from typing import Any

from qtpy.QtGui import QPaintEvent

from napari_unwrap3d.viewer.common.progress_bar import ProgressBar


class Watched(ProgressBar):
    """Counts how often it is drawn."""

    drawn = 0

    def paintEvent(self, event: QPaintEvent) -> None:
        self.drawn += 1
        super().paintEvent(event)


def test_values_are_drawn_with_the_next_frame(qtbot: Any) -> None:
    bar = Watched()
    bar.setRange(0, 1000)
    qtbot.addWidget(bar)
    with qtbot.waitExposed(bar):
        bar.show()
    qtbot.waitUntil(lambda: bar.drawn > 0)
    before = bar.drawn
    for value in (300, 600, 900):
        bar.setValue(value)
    assert (bar.value(), bar.drawn) == (900, before)
    qtbot.waitUntil(lambda: bar.drawn > before)
    assert bar.updatesEnabled()
