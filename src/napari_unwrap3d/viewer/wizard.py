"""The dock widget "Unwrap": all steps in order, from the layer of a cell to its charts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from magicgui.widgets import ComboBox
from qtpy.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from ..errors import Unwrap3DError
from ..files.project import SUFFIX
from ..parameters import PRESETS, Parameters
from ..pipeline import STEP_NAMES
from .common.connections import end_with_dock
from .common.docking import Docked
from .common.progress_bar import ProgressBar
from .common.section import HIGHLIGHT
from .common.threads import Task, tell
from .files.left_behind import LeftBehind
from .files.project import autosave_of, open_project, saving_task
from .movies.wizard import MoviePanel
from .protrusions.instances import instances_of
from .session import REQUESTED, session_of
from .steps.panel import WIDTH, StepPanel, scrolling
from .steps.source_chooser import SourceChooser
from .steps.states import STEPS, TITLES
from .tracks.panel import TracksPanel

if TYPE_CHECKING:
    import napari

    from ..atlas import Atlas

DEFAULTS = "defaults"
NAME = "Unwrap"
# Of the plugin and of its other docks, as the manifest has them.
PLUGIN, ANNOTATIONS, TABLE = "napari-unwrap3d", "Annotations", "Protrusions table"
DRAW = f'Next: look, <a href="{ANNOTATIONS}" style="color: {HIGHLIGHT}">draw on it</a>, or save it.'
SELECT = (
    f'Next: see the <a href="{TABLE}" style="color: {HIGHLIGHT}">table of protrusions</a>, '
    f'<a href="{ANNOTATIONS}" style="color: {HIGHLIGHT}">draw</a>, or save it.'
)
FILES = f"unwrap3d project (*{SUFFIX})"


class Wizard(Docked):
    """Runs the pipeline on a layer, step by step or all at once.

    Parameters
    ----------
    napari_viewer : napari.Viewer

    Attributes
    ----------
    panels : dict
        Step → :class:`StepPanel`, in order.
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        # napari may hand out a proxy of the viewer.
        self.viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.session = session_of(napari_viewer)
        self._saving: Task | None = None
        autosave_of(self.viewer)
        instances_of(self.viewer)
        self._build()
        self._arrange()
        self._connect()
        self._on_running(self.session.running)
        end_with_dock(self)

    # Building ----------------------------------------------------------------

    def _build(self) -> None:
        self.chooser = SourceChooser(self.session)
        self.preset_box = ComboBox(choices=[DEFAULTS, *PRESETS], value=DEFAULTS, name="preset")
        self.preset_box.tooltip = "The paper's values for a kind of protrusion."
        self.panels = {
            step: StepPanel(self.session, step, expanded=step == STEPS[0]) for step in STEPS
        }
        self.hint = QLabel()
        self.hint.setWordWrap(True)
        self.run_button = QPushButton("Run all")
        self.run_button.setToolTip("Compute every step that is missing or out of date.")
        self.cancel_button = QPushButton("Cancel")
        self.cancel_button.setToolTip("Stop; finished steps are kept.")
        self.automatic = QCheckBox("Update automatically")
        self.automatic.setToolTip(
            "After the first run: when a parameter changes, compute its step and what follows."
        )
        self.automatic.setChecked(self.session.update_automatically)
        self.progress_bar = ProgressBar()
        self.progress_bar.setRange(0, 1000)
        self.message = QLabel()
        self.message.setWordWrap(True)
        self.save_button = QPushButton("Save …")
        self.save_button.setToolTip(
            "Everything in one *.unwrap3d file: image, charts, maps, parameters, annotations, view."
        )
        self.open_button = QPushButton("Open …")
        self.open_button.setToolTip("Open a *.unwrap3d project; it may also be dropped here.")
        self.left = LeftBehind(self.viewer)
        self.pages = QTabWidget()
        self.pages.setDocumentMode(True)
        self.movie = MoviePanel(self.viewer)
        self.tracks = TracksPanel(self.viewer)

    def _arrange(self) -> None:
        presets = QHBoxLayout()
        presets.addWidget(QLabel("Preset"))
        presets.addWidget(self.preset_box.native, 1)
        presets.addWidget(self.automatic)
        steps = QWidget()
        column = QVBoxLayout(steps)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(3)
        for panel in self.panels.values():
            column.addWidget(panel)
        column.addStretch(1)
        buttons = QHBoxLayout()
        buttons.addWidget(self.run_button, 1)
        buttons.addWidget(self.cancel_button)
        buttons.addWidget(self.open_button)
        buttons.addWidget(self.save_button)
        cell = QWidget()
        layout = QVBoxLayout(cell)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addWidget(self.chooser)
        layout.addLayout(presets)
        layout.addWidget(scrolling(steps), 1)
        layout.addWidget(self.hint)
        layout.addWidget(self.progress_bar)
        layout.addWidget(self.message)
        layout.addLayout(buttons)
        self.pages.addTab(cell, "Cell")
        self.pages.addTab(self.movie, "Movie")
        self.pages.addTab(self.tracks, "Tracks")
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self.left)
        whole.addWidget(self.pages)
        self.setMinimumWidth(WIDTH)
        self._on_movie()

    def _connect(self) -> None:
        self.preset_box.changed.connect(self._on_preset)
        self.automatic.toggled.connect(self._on_automatic)
        self.run_button.clicked.connect(self.run)
        self.cancel_button.clicked.connect(self._on_cancel)
        self.hint.linkActivated.connect(self._on_link)
        self.save_button.clicked.connect(self._on_save)
        self.open_button.clicked.connect(self._on_open)
        self.session.told.connect(self._say)
        self.session.source_changed.connect(self._update_hint)
        self.session.steps_changed.connect(self._on_steps)
        self.session.progressed.connect(self._on_progress)
        self.session.running_changed.connect(self._on_running)
        self.session.finished.connect(self._on_finished)
        self.session.stopped.connect(self._on_stopped)
        self.movie.run.source_changed.connect(self._on_movie)
        self.movie.run.movie_changed.connect(self._on_movie)

    # What the user does ------------------------------------------------------

    def run(self) -> None:
        """Compute everything; what is wrong is shown as a notification."""
        try:
            self.session.run()
        except Unwrap3DError as error:
            self._say(str(error))
            tell(error)

    def _on_cancel(self) -> None:
        self._say("Cancelling …")
        self.session.cancel_by_user()

    def _on_automatic(self, automatic: bool) -> None:
        self.session.update_automatically = automatic

    def _on_preset(self, name: str) -> None:
        parameters = Parameters() if name == DEFAULTS else Parameters.preset(name)
        for panel in self.panels.values():
            panel.initial = parameters
        # What was chosen about the data and which charts are wanted is no matter of a preset.
        now = self.session.parameters
        groups = parameters.model_dump()
        groups["stack"]["label"] = now.stack.label
        for step in REQUESTED:
            groups[step]["compute"] = getattr(now, step).compute
        self.session.set_parameters(Parameters.from_dict(groups))

    def _on_link(self, name: str) -> None:
        """Open a dock of ours, or bring it to the front."""
        dock, _ = self.viewer.window.add_plugin_dock_widget(PLUGIN, name)
        dock.show()
        dock.raise_()

    def show_movie(self) -> MoviePanel:
        """Turn to the page of the movie."""
        self._turn_to(self.movie)
        return self.movie

    def show_tracks(self) -> TracksPanel:
        """Turn to the page of the tracks."""
        self._turn_to(self.tracks)
        return self.tracks

    def _turn_to(self, page: QWidget) -> None:
        index = self.pages.indexOf(page)
        self.pages.setTabVisible(index, True)
        self.pages.setCurrentIndex(index)

    # What the session says ---------------------------------------------------

    @property
    def _of_movies(self) -> tuple[QWidget, ...]:
        """Pages that a still cell has no use for."""
        return self.movie, self.tracks

    def _on_movie(self) -> None:
        """There is a page for the movie where there is a timelapse, or a movie; then tracks."""
        run, chosen = self.movie.run, self.movie.run.chosen
        there = chosen.source is not None or run.movie is not None or bool(chosen.candidates())
        for page, wanted in ((self.movie, there), (self.tracks, run.movie is not None)):
            index = self.pages.indexOf(page)
            self.pages.setTabVisible(index, wanted or self.pages.currentIndex() == index)
        several = any(self.pages.isTabVisible(self.pages.indexOf(p)) for p in self._of_movies)
        self.pages.tabBar().setVisible(several)

    def _on_running(self, running: bool) -> None:
        self.cancel_button.setEnabled(running)
        self.progress_bar.setVisible(running)
        self.progress_bar.setFormat("starting")
        self.progress_bar.setValue(0)
        if running:
            self._say("")
        self._on_steps()

    def _on_steps(self) -> None:
        running = self.session.running
        self.run_button.setEnabled(not running and not self.session.blocked())
        self.save_button.setEnabled(
            not running and self._saving is None and self.session.atlas is not None
        )
        self._update_hint()

    def _update_hint(self) -> None:
        """What to press next."""
        step = self.session.next_step()
        done = not step and self.session.atlas is not None
        if self.session.blocked() or self.session.running or not (step or done):
            self.hint.hide()
            return
        if done:
            found = self.session.atlas is not None and self.session.atlas.has("protrusions")
            self.hint.setText(SELECT if found else DRAW)
            self.hint.show()
            return
        first = "Press <b>Run all</b>, or go step by step: " if step == STEPS[0] else "Next: "
        self.hint.setText(f"{first}<b>Run</b> in <b>{TITLES[step]}</b>.")
        self.hint.show()

    def _on_progress(self, step: str, fraction: float, message: str) -> None:
        position = STEPS.index(step)
        # Steps on request come after the others, and share the end of the bar with the last.
        share = min(position, len(STEP_NAMES) - 1)
        self.progress_bar.setValue(round(1000 * (share + fraction) / len(STEP_NAMES)))
        self.progress_bar.setFormat(f"{position + 1}/{len(STEPS)} {TITLES[step]}")
        if self.session.running and message:
            self._say(message)

    def _on_finished(self, atlas: Atlas) -> None:
        seconds = sum(step.seconds or 0.0 for step in self.session.steps.values())
        repairs = atlas.provenance.get("repairs", [])
        done = f"Done in {seconds:.1f} s."
        self._say("\n".join([done, f"Repaired: {'; '.join(repairs)}."]) if repairs else done)

    def _on_stopped(self, reason: str) -> None:
        self._say(reason)

    def _say(self, message: str) -> None:
        self.message.setText(message)
        self.message.setVisible(bool(message))

    # Projects ----------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Save the cell and what the window looks like in a thread; errors become notifications."""
        if self.session.atlas is None:
            return
        self._saving = saving_task(self.viewer, path)
        self._saving.returned.connect(self._on_saved)
        self._saving.failed.connect(self._on_not_saved)
        self._saving.start()
        self._say("Saving …")
        self._on_steps()

    def _on_save(self) -> None:
        known = self.session.project_path
        start = f"cell{SUFFIX}" if known is None else str(known)
        name, _ = QFileDialog.getSaveFileName(self, "Save project", start, FILES)
        if name:
            self.save(name)

    def _on_open(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, "Open project", "", FILES)
        if name:
            try:
                open_project(self.viewer, name)
            except Unwrap3DError as error:
                tell(error)

    def _on_saved(self, path: Path) -> None:
        self._saving = None
        self._say(f"Saved {path}.")
        self._on_steps()

    def _on_not_saved(self, _: BaseException) -> None:
        self._saving = None
        self._say("")
        self._on_steps()


def open_wizard(viewer: Any) -> Wizard:
    """The wizard of a window, docked at its right side if it is not there yet."""
    viewer = getattr(viewer, "__wrapped__", viewer)
    window = viewer.window._qt_window
    wizard = next(iter(window.findChildren(Wizard)), None)
    if wizard is None:
        wizard = Wizard(viewer)
        viewer.window.add_dock_widget(wizard, name=NAME, area="right")
    return wizard
