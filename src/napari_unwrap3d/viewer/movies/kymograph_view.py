"""The dock "Kymograph": a field along a line that is drawn in the uv image, over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QMainWindow,
    QPushButton,
    QVBoxLayout,
)

from ...charts import Floats
from ...errors import InputError
from ...motion.kymograph import BETWEEN, Kymograph, broken_at_seam, kymograph, line_on_surface
from ...motion.kymograph import surface_line as measured
from ...motion.uv_stacks import UvStacks, field_label
from ..common.connections import end_with_dock
from ..common.notice import small_button
from ..common.threads import Task, tell
from ..views.canvas import open_canvas
from ..views.shown_colours import shown_colours
from .computing_dock import ComputingDock
from .kymograph_plot import KymographPlot
from .session import movie_session_of
from .surface_lines import LineLayers

if TYPE_CHECKING:
    import napari

    from ...charts import Frame
    from ...motion.movie import Movie

AREA = "area_um2"
HELP = (
    "Draw line, then click its corners in the uv image and double-click its end. Over the seam or "
    "a pole, draw on beyond the image. With the arrow tool its corners can be moved."
)
WAYS = {
    "straight": "as drawn",
    "great circle": "great circles",
}
FILES = "Table (*.csv);;Image (*.tif);;Picture (*.png)"
SAMPLE = 200_000
# Over the surface, in parts of the voxel, so that it is not hidden by it.
LIFT_VOXELS = 0.6


class KymographDock(ComputingDock):
    """Draw a line, and see what happens along it.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.session = movie_session_of(viewer)
        self.lines = LineLayers(viewer, self, self._later)
        self.found: Kymograph | None = None
        self._stacks: tuple[Any, str, UvStacks] | None = None
        self._writing: Task | None = None
        self._following: Any = None
        self._build()
        self._connect()
        self._on_movie(self.session.movie)
        viewer.window._qt_window.installEventFilter(self)
        end_with_dock(self)

    # Building ------------------------------------------------------------------

    def _build(self) -> None:
        self.draw_button = QPushButton("Draw line")
        self.draw_button.setToolTip(HELP)
        self.export_button = small_button("Export…", "As a table, an image or a picture.")
        self.field_box = QComboBox()
        self.field_box.setToolTip("What is shown along the line.")
        self.width_box = QDoubleSpinBox()
        self.width_box.setRange(0.0, 1000.0)
        self.width_box.setDecimals(2)
        self.width_box.setSingleStep(0.1)
        self.width_box.setSuffix(" µm")
        self.width_box.setToolTip(
            "Width of the band around the line whose mean is shown, weighted by its area."
        )
        self.way_box = QComboBox()
        for way in BETWEEN:
            self.way_box.addItem(WAYS[way], way)
        self.way_box.setToolTip(
            "as drawn: straight in the image; great circles: the shortest ways on the sphere "
            "between the corners, over seam and poles, whatever the axis."
        )
        self.plot = KymographPlot(self.session)
        self.status = QLabel()
        self.status.setWordWrap(True)
        self.status.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        row = QHBoxLayout()
        row.addWidget(self.draw_button, 1)
        row.addWidget(self.export_button)
        form = QFormLayout()
        form.addRow("Field", self.field_box)
        form.addRow("Width", self.width_box)
        form.addRow("Corners joined", self.way_box)
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addLayout(form)
        column.addWidget(self.plot, 1)
        column.addWidget(self.status)
        column.addStretch(0)

    def _connect(self) -> None:
        self.draw_button.clicked.connect(self.draw)
        self.export_button.clicked.connect(self._on_export)
        self.field_box.currentIndexChanged.connect(self._later)
        self.width_box.valueChanged.connect(self._later)
        self.way_box.currentIndexChanged.connect(self._later)
        self.plot.chosen.connect(self.session.set_timepoint)
        self.session.movie_changed.connect(self._on_movie)
        self.session.frame_changed.connect(self._on_frame)
        # The layers go with the dock; those of a window that closes are napari's to remove.
        self.destroyed.connect(self.lines.close)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes: leave its layers alone."""
        if event.type() == QEvent.Type.Close and isinstance(watched, QMainWindow):
            self.lines.forget()
        return super().eventFilter(watched, event)

    # The movie --------------------------------------------------------------------

    def _on_movie(self, movie: Movie | None) -> None:
        self._stacks, self.found = None, None
        self.field_box.clear()
        self.plot.hide()
        if movie is not None and self.session.frame is not None:
            self._list_fields(self.session.frame)
        self._later()

    def _list_fields(self, frame: Frame) -> None:
        """Offer the fields of the movie's frames; first the one that the views show."""
        for name in frame.uv:
            self.field_box.addItem(field_label(name), name)
        colouring = self._colouring()
        shown = -1 if colouring is None else self.field_box.findData(colouring.field)
        self.field_box.setCurrentIndex(max(shown, 0))

    def _on_frame(self, frame: Frame) -> None:
        if not self.field_box.count():
            self._list_fields(frame)
        self.plot.show_time(frame.time_s)
        self._show_in_space()
        if self._stacks is not None and frame.timepoint in self._stacks[2].missing:
            # It was made since the movie was read.
            self._stacks = None
            self._later()

    def _colouring(self) -> Any:
        viewer = self.session.viewer
        canvas = None if viewer is None else open_canvas(viewer)
        colouring = None if canvas is None else canvas.colouring
        if colouring is not None and self._following is not colouring:
            self._following = colouring
            colouring.changed.connect(self._recolour)
        return colouring

    # The line ---------------------------------------------------------------------

    def draw(self) -> None:
        """Let the person draw a line in the uv image."""
        if self.session.movie is None:
            tell(InputError("There is no movie.", hint="Open one, or unwrap a timelapse."))
        elif self.lines.draw() is None:
            tell(InputError("There is no uv image yet.", hint="Show the movie's common space."))

    def _compute(self) -> None:
        """Compute in a thread; what changes meanwhile is computed after it."""
        movie, corners = self.session.movie, self.lines.corners
        field = self.field_box.currentData()
        self.export_button.setEnabled(False)
        if movie is None or corners is None or not field:
            self.found = None
            self.lines.show_in_image(None)
            self.lines.show_in_space(None)
            self.plot.hide()
            self.status.setText(HELP if movie is not None else "There is no movie.")
            return
        if self._postponed():
            return
        kept = self._stacks
        stacks = kept[2] if kept is not None and kept[:2] == (movie, field) else None
        if stacks is None:
            self.status.setText("Reading the movie…")
        self._start(
            self._on_computed,
            _computed,
            movie,
            corners,
            field,
            self.width_box.value(),
            self.way_box.currentData(),
            stacks,
        )

    def _on_computed(self, result: tuple[Movie, UvStacks, Kymograph]) -> None:
        movie, stacks, found = result
        if movie is self.session.movie:
            self._stacks = (movie, found.field, stacks)
            self.found = found
            line = found.line
            self._recolour()
            self.lines.show_in_image(broken_at_seam(line.points, movie.common.uv.shape[0]))
            self._show_in_space()
            self.status.setText(
                f"{line.length_um:.2f} µm in {len(line.points)} steps of {line.step_um:.3f} µm, "
                f"{len(found.times_s)} timepoints."
            )
            self.export_button.setEnabled(True)

    # Showing -------------------------------------------------------------------------

    def _recolour(self) -> None:
        if self.found is None or self._stacks is None:
            return
        values = self._stacks[2].images[self.found.field]
        sample = values.reshape(-1)[:: max(values.size // SAMPLE, 1)]
        colours = shown_colours(self._colouring(), self.found.field, sample)
        frame = self.session.frame
        self.plot.show_time(frame.time_s if frame is not None else 0.0)
        self.plot.show_kymograph(self.found, field_label(self.found.field), colours)

    def _show_in_space(self) -> None:
        movie, frame = self.session.movie, self.session.frame
        if self.found is not None and movie is not None:
            lift = LIFT_VOXELS * movie.common.voxel_um
            self.lines.show_in_space(line_on_surface(movie.common, self.found.line, frame, lift))

    def _on_export(self) -> None:
        if self.found is None:
            return
        name, chosen = QFileDialog.getSaveFileName(self, "Export kymograph", "kymograph", FILES)
        if name:
            path = Path(name)
            if not path.suffix:
                path = path.with_suffix(chosen[chosen.index("*") + 1 : -1])
            self.export(path)

    def export(self, path: Path) -> None:
        """Write the kymograph; the suffix tells how."""
        from ...files.movie_files import write_kymograph

        self.export_button.setEnabled(False)
        self._writing = Task(write_kymograph, self.found, path)
        self._writing.returned.connect(self._on_written)
        self._writing.failed.connect(self._on_not_written)
        self._writing.start()

    def _on_written(self, path: Path) -> None:
        self.export_button.setEnabled(True)
        self.status.setText(f"Written to {path}")

    def _on_not_written(self, error: BaseException) -> None:
        self.export_button.setEnabled(True)
        tell(error)


def _computed(
    movie: Movie, corners: Floats, field: str, width_um: float, way: Any, stacks: UvStacks | None
) -> tuple[Movie, UvStacks, Kymograph]:
    """In a thread: read what is needed, and sample it along the line."""
    if stacks is None:
        stacks = UvStacks.of(movie, (field, AREA))
    line = measured(movie.common, corners, width_um, between=way)
    return movie, stacks, kymograph(movie, line, field, stacks=stacks)
