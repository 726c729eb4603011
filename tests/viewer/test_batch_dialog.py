"""The dialog of a batch, with a real process."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest
from qtpy.QtWidgets import QApplication

from batches import TINY, write_masks
from napari_unwrap3d import Parameters
from napari_unwrap3d.cli import build_parser
from napari_unwrap3d.viewer.batch.dialog import NO_INPUT, BatchDialog

SECONDS = 240_000


@pytest.fixture
def dialog(qtbot: Any, tmp_path: Path) -> BatchDialog:
    dialog = BatchDialog(Parameters.from_dict(TINY))
    qtbot.addWidget(dialog)
    dialog.show()
    return dialog


def states(dialog: BatchDialog) -> dict[str, str]:
    items = [dialog.table.topLevelItem(row) for row in range(dialog.table.topLevelItemCount())]
    return {f"{item.text(0)} {item.text(1)}".strip(): item.text(3) for item in items}


def test_it_runs_lists_what_fails_and_says_the_command(
    dialog: BatchDialog, qtbot: Any, tmp_path: Path
) -> None:
    assert dialog.message.text() == NO_INPUT
    assert not dialog.start_button.isEnabled()
    files = write_masks(tmp_path / "cell", 1)
    broken = tmp_path / "broken.tif"
    broken.write_bytes(b"no picture")
    dialog.add([str(path) for path in files] + [str(broken)])
    dialog.output.setText(str(tmp_path / "out"))
    dialog.mask.setChecked(True)
    dialog.workers.setValue(1)
    dialog.start_button.click()
    assert not dialog.start_button.isEnabled()
    qtbot.waitUntil(lambda: "GB" in dialog.note.text(), timeout=SECONDS)
    qtbot.waitUntil(lambda: dialog.process is None, timeout=SECONDS)
    found = states(dialog)
    assert found == {"t0": "done", "broken": "failed"}
    assert "1 failed" in dialog.message.text()
    assert (tmp_path / "out" / "summary.csv").is_file()
    words = shlex.split(dialog.command.text())
    arguments = build_parser().parse_args(words[1:])
    assert arguments.inputs == [str(path) for path in (*files, broken)]
    assert arguments.mask
    assert arguments.workers == 1
    assert Parameters.from_toml(arguments.params) == Parameters.from_dict(TINY)
    dialog.copy_button.click()
    clipboard = QApplication.clipboard()
    assert clipboard is not None
    assert clipboard.text() == dialog.command.text()


def test_what_is_measured_is_tracked_and_asked_for(
    dialog: BatchDialog, qtbot: Any, tmp_path: Path
) -> None:
    dialog.add([str(path) for path in write_masks(tmp_path / "cell", 2)])
    assert not dialog.protrusions.isChecked()
    dialog.track.click()
    assert "--track" in shlex.split(dialog.command.text())
    dialog.measure.click()
    assert dialog.track.isChecked()
    assert not dialog.track.isEnabled()
    words = shlex.split(dialog.command.text())
    assert "--measure" in words
    assert "--track" not in words
    assert build_parser().parse_args(words[1:]).measure
    dialog.protrusions.click()
    request = dialog.request()
    assert request.measure
    assert Parameters.from_toml(request.parameters).protrusions.compute
    dialog.timelapse.setChecked(True)
    dialog.time_step.setValue(2.0)
    dialog.plan_button.click()
    qtbot.waitUntil(lambda: dialog.process is None, timeout=SECONDS)
    assert "of movies also their protrusions, tracks and measurements" in dialog.note.text()


def test_a_check_does_nothing_and_an_error_is_told(
    dialog: BatchDialog, qtbot: Any, tmp_path: Path
) -> None:
    (path, *_) = write_masks(tmp_path / "cell", 1)
    dialog.add([str(path)])
    dialog.output.setText(str(tmp_path / "out"))
    dialog.plan_button.click()
    qtbot.waitUntil(lambda: dialog.process is None, timeout=SECONDS)
    assert "1 cell to unwrap" in dialog.note.text()
    assert not (tmp_path / "out" / "summary.csv").exists()
    path.unlink()
    dialog.plan_button.click()
    qtbot.waitUntil(lambda: dialog.process is None, timeout=SECONDS)
    assert str(path.name) in dialog.message.text()


def test_closing_it_ends_the_process(dialog: BatchDialog, qtbot: Any, tmp_path: Path) -> None:
    dialog.add([str(path) for path in write_masks(tmp_path / "cell", 2)])
    dialog.output.setText(str(tmp_path / "out"))
    dialog.start_button.click()
    process = dialog.process
    assert process is not None
    qtbot.waitUntil(lambda: process.running, timeout=SECONDS)
    dialog.close()
    assert not process.running
    assert dialog.process is None
