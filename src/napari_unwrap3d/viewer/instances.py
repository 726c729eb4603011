"""The protrusions of a viewer's cell: which are selected, shown and edited, and in which colours.

One per viewer, so that closing and opening the table loses nothing. The labels are the
annotation "protrusions", which every view shows; what a person changes of it, here or with a
brush, is measured anew in a thread.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QEvent, QObject, Signal

from ..annotations.state import Drawn
from ..errors import Unwrap3DError
from ..fields import CURVATURE, PROTRUSION
from ..protrusions.colours import instance_colours
from ..protrusions.editing import EDITED, NAME, ProtrusionEdits
from .annotating import LABELS, annotating_of
from .canvas import canvas_of
from .instance_filter import Filter
from .painting import BRUSH, LOOK
from .placing import chart_of
from .session import session_of
from .step_states import RUNNING, STALE
from .threads import Task, tell
from .turns import soon

if TYPE_CHECKING:
    from ..atlas import Atlas
    from ..charts import Protrusions
    from ..pipeline import Pipeline
    from .annotating import Annotating, Colour
    from .session import Session

STEP = "protrusions"
KEPT = "protrusions, edited"
# A stroke that rests this long is measured.
REST_MS = 300
CLOSE_SECONDS = 5.0
# What those that are not selected are drawn with: a grey with a little of their colour in it.
GREY, OWN_SHARE, DIMMED = (0.5, 0.5, 0.5), 0.25, 0.85

NO_CELL = "There is no unwrapped cell yet: unwrap one, or open a project."
NOT_FOUND = "Press Run to find and measure the protrusions of this cell."
FINDING = "Finding protrusions …"
OTHERS = "These protrusions belong to other parameters: press Run."
DELETED = "The annotation “protrusions” was deleted: undo that, or segment again."
SAVED = f"What you had edited is kept as the annotation “{KEPT}”."


class Instances(QObject):
    """The protrusions of a viewer. Get them with :func:`instances_of`.

    Attributes
    ----------
    found : Protrusions or None
        As they were measured last.
    selection : tuple of int
        Labels, in the order in which they were selected.
    filter : Filter
        Which are shown.
    measure : str
        The column of the table that colours them; empty for a colour each.

    Signals
    -------
    changed()
        The table, or whether it holds (:meth:`reason`).
    selected()
        The selection.
    styled()
        Their colours, or which are hidden.
    working(str)
        What is being computed; empty when it is over.
    """

    changed = Signal()
    selected = Signal()
    styled = Signal()
    working = Signal(str)

    def __init__(self, viewer: Any, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self.session: Session = session_of(viewer)
        self.found: Protrusions | None = None
        self.selection: tuple[int, ...] = ()
        self.filter = Filter()
        self.measure = ""
        self._atlas: Atlas | None = None
        self._edits: ProtrusionEdits | None = None
        self._discard = False
        self._task: Task | None = None
        self._annotating: Annotating | None = None
        self._timer = soon(self, self._measure, REST_MS)
        self.session.finished.connect(self._on_atlas)
        self.session.steps_changed.connect(self._on_steps)
        self._reason = ""
        if self.session.atlas is not None:
            self._on_atlas(self.session.atlas)

    @property
    def viewer(self) -> Any:
        """The viewer, None once it is gone."""
        return self._viewer()

    # What there is ---------------------------------------------------------------------

    @property
    def edits(self) -> ProtrusionEdits | None:
        """What edits them; None where there are none."""
        return self._edits

    @property
    def annotating(self) -> Annotating:
        """What draws them in every view."""
        if self._annotating is None:
            self._annotating = annotating_of(self.viewer)
            self._annotating.edited.connect(self._timer.start)
            self._annotating.listed.connect(self._on_listed)
            self._annotating.style_by(NAME, self._colours)
            canvas_of(self.viewer).colouring.changed.connect(self._on_colouring)
        return self._annotating

    @property
    def labels(self) -> tuple[int, ...]:
        """Of the table, in order."""
        return () if self.found is None else tuple(int(n) for n in self.found.columns["label"])

    @property
    def edited(self) -> bool:
        """Whether a person changed what was found."""
        return self.found is not None and self.found.method == EDITED

    @property
    def busy(self) -> bool:
        """Whether something is being measured, or about to be."""
        return self._task is not None or self._timer.isActive()

    def reason(self) -> str:
        """Why the table does not hold, or there is none; empty where all is well."""
        if self.session.atlas is None:
            return NO_CELL
        state = self.session.steps[STEP].state
        if state == RUNNING:
            return FINDING
        if self._edits is None or self.found is None:
            return NOT_FOUND
        if state == STALE:
            return OTHERS
        return "" if self._edits.started else DELETED

    def _on_steps(self) -> None:
        reason = self.reason()
        if reason != self._reason:
            self._reason = reason
            self.changed.emit()

    # A run has ended -------------------------------------------------------------------

    def _on_atlas(self, atlas: Atlas) -> None:
        found = atlas.on_request.get(STEP)
        if found is None:
            self._leave()
        elif atlas is not self._atlas or found is not self.found:
            self._begin(atlas, found)
        self._on_steps()

    def _begin(self, atlas: Atlas, found: Protrusions) -> None:
        known = NAME in atlas.annotations.names
        same = known and np.array_equal(atlas.annotations.labels(NAME), found.labels)
        first = self._edits is None
        was_edited = self.edited and not self._discard
        self._discard = False
        self._atlas, self.found = atlas, found
        self._edits = ProtrusionEdits(atlas)
        if not (same or (known and first)):
            if known and was_edited:
                self._put_away(atlas)
            _put_labels(atlas, found)
        self._reason = self.reason()
        if NAME in self.annotating.names:
            self.annotating.current = NAME
        self._renew_fields()
        self._keep_selection()
        self.changed.emit()
        self.restyle()
        # A project may have strokes that were not measured any more.
        self._timer.start()

    def _put_away(self, atlas: Atlas) -> None:
        """Keep what a person edited beside what was found now."""
        names, name, number = atlas.annotations.names, KEPT, 2
        while name in names:
            name, number = f"{KEPT} ({number})", number + 1
        atlas.annotations.rename(NAME, name)
        self.working.emit(SAVED)

    def _leave(self) -> None:
        self._atlas, self._edits, self.found = None, None, None
        self._keep_selection()
        self.changed.emit()

    def _on_listed(self) -> None:
        self._on_steps()

    # Measuring -------------------------------------------------------------------------

    def _measure(self) -> None:
        """Measure what changed, in a thread."""
        edits, atlas = self._edits, self._atlas
        if self._task is not None or edits is None or atlas is None or self.found is None:
            return
        if not edits.started or np.array_equal(edits.labels, self.found.labels):
            self._on_steps()
            return
        self.working.emit("Measuring what changed …")
        self._run(_measured, self._on_measured, edits, self.session.pipeline)

    def _on_measured(self, measured: tuple[ProtrusionEdits, Protrusions]) -> None:
        edits, found = measured
        if edits is not self._edits:
            return
        self.found = found
        self._renew_fields()
        self._keep_selection()
        self.session.edited()
        self.changed.emit()
        self.restyle()
        self._measure()

    def _run(self, function: Callable[..., Any], then: Callable[[Any], None], *given: Any) -> None:
        task = self._task = Task(function, *given)

        def ended(result: Any) -> None:
            self._task = None
            self.working.emit("")
            then(result)

        task.returned.connect(ended)
        task.failed.connect(self._on_failed)
        task.start()

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self.working.emit("")
        tell(error)

    def _renew_fields(self) -> None:
        canvas_of(self.viewer).colouring.renew()

    # The selection ---------------------------------------------------------------------

    def select(self, labels: Iterable[int]) -> None:
        """Select these, everywhere; others are drawn dimmed."""
        chosen = tuple(dict.fromkeys(int(label) for label in labels))
        if chosen != self.selection:
            self.selection = chosen
            self.restyle()
            self.selected.emit()

    def toggle(self, label: int) -> None:
        """Add one to the selection, or take it away."""
        if label in self.selection:
            self.select(each for each in self.selection if each != label)
        else:
            self.select((*self.selection, label))

    def clear(self) -> None:
        """Select nothing."""
        self.select(())

    def _keep_selection(self) -> None:
        """Of what is selected, what still is there and can be seen."""
        hidden = self.hidden
        there = [label for label in self.labels if label not in hidden]
        self.select(label for label in self.selection if label in there)

    # What is shown ---------------------------------------------------------------------

    @property
    def hidden(self) -> frozenset[int]:
        """The labels that the filter leaves out."""
        return frozenset() if self.found is None else self.filter.hidden(self.found)

    def set_filter(self, wanted: Filter) -> None:
        """Show only what a filter lets through, in the table and in every view."""
        if wanted != self.filter:
            self.filter = wanted
            self._keep_selection()
            self.restyle()

    def set_measure(self, column: str) -> None:
        """Colour every view by a column of the table; by instance where it is empty."""
        if self._edits is None or column == self.measure:
            return
        colouring = canvas_of(self.viewer).colouring
        colouring.set_field(f"{PROTRUSION}{column}" if column else CURVATURE)

    def _on_colouring(self) -> None:
        """Another field colours every view: a measure of ours, or something else."""
        field = canvas_of(self.viewer).colouring.field
        measure = field.removeprefix(PROTRUSION) if field.startswith(PROTRUSION) else ""
        if measure != self.measure:
            self.measure = measure
            self.restyle()

    def restyle(self) -> None:
        """Show the colours as they are now."""
        if self._edits is not None:
            self.annotating.restyle()
        self.styled.emit()

    def colour(self, label: int) -> Colour:
        """Of a protrusion, as strong as if all were selected."""
        own = {} if self._edits is None else self._edits.annotations.colours(NAME)
        colour = own.get(label) or instance_colours([label])[label]
        return (*colour[:3], 1.0)

    def _colours(self) -> Mapping[int, Colour]:
        hidden, chosen = self.hidden, set(self.selection)
        count = max(LABELS, *(label + 1 for label in self.labels), 0)
        colours = {}
        for label, colour in instance_colours(range(1, count)).items():
            faint = bool(chosen) and label not in chosen
            if label in hidden:
                # In a measure's colours the field would be seen.
                colours[label] = (*GREY, float(bool(self.measure)))
            elif faint:
                colours[label] = (*_faded(colour), DIMMED)
            else:
                colours[label] = (*colour[:3], float(not self.measure))
        return colours

    def show(self) -> None:
        """Turn and move the views to the selected protrusions."""
        if self.found is None or self._atlas is None or not self.selection:
            return
        vertices = self._atlas.surface.vertices
        chosen = np.isin(self.found.labels, self.selection)
        layer = next((each for each in self.viewer.layers if chart_of(each) == "surface"), None)
        if layer is None or not chosen.any():
            return
        middle = vertices[chosen].mean(axis=0)
        outwards = middle - vertices.mean(axis=0)
        camera = self.viewer.scene.camera
        camera.center = tuple(middle * layer.scale[-3:] + layer.translate[-3:])
        if self.viewer.dims.ndisplay == 3 and np.linalg.norm(outwards) > 0:
            up = np.eye(3)[int(np.abs(outwards).argmin())]
            camera.set_view_direction(tuple(-outwards), tuple(up))

    # Edits -----------------------------------------------------------------------------

    def merge(self) -> None:
        """Make one of those that are selected; the first gives the label."""
        chosen = self.selection
        self._edit(lambda edits: [edits.merge(chosen)])

    def split(self) -> None:
        """Make two of the one that is selected."""
        (label,) = self.selection
        self._edit(lambda edits: edits.split(label))

    def delete(self) -> None:
        """Give those that are selected back to the cortex."""
        chosen = self.selection

        def delete(edits: ProtrusionEdits) -> list[int]:
            edits.delete(chosen)
            return []

        self._edit(delete)

    def _edit(self, edit: Callable[[ProtrusionEdits], list[int]]) -> None:
        if self._edits is None:
            return
        try:
            chosen = edit(self._edits)
        except Unwrap3DError as error:
            tell(error)
            return
        self.annotating.edited.emit()
        self.select(chosen)

    @property
    def repainting(self) -> bool:
        """Whether the brush is in hand, for these labels."""
        return (
            self._edits is not None
            and self.annotating.tool == BRUSH
            and self.annotating.current == NAME
        )

    def repaint(self, wanted: bool = True) -> None:
        """Take the brush of the selected protrusion, or lay it down."""
        annotating = self.annotating
        if wanted and self.selection:
            annotating.current, annotating.label = NAME, self.selection[0]
            annotating.tool = BRUSH
        else:
            annotating.tool = LOOK

    def segment_again(self) -> None:
        """Find the protrusions anew, and throw away what was edited."""
        pipeline = self.session.pipeline
        if pipeline is not None:
            pipeline.kept.pop(STEP, None)
        self._discard = True
        try:
            self.session.run(until=STEP)
        except Unwrap3DError as error:
            self._discard = False
            tell(error)

    # The end ---------------------------------------------------------------------------

    def close(self) -> None:
        """Listen no longer, and leave no thread."""
        self._timer.stop()
        self.session.finished.disconnect(self._on_atlas)
        self.session.steps_changed.disconnect(self._on_steps)
        if self._annotating is not None:
            self._annotating.edited.disconnect(self._timer.start)
            self._annotating.listed.disconnect(self._on_listed)
            self._annotating.style_by(NAME, None)
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes."""
        if event.type() == QEvent.Type.Close:
            self.close()
        return super().eventFilter(watched, event)


def _faded(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = (
        OWN_SHARE * part + (1 - OWN_SHARE) * grey
        for part, grey in zip(colour[:3], GREY, strict=True)
    )
    return red, green, blue


def _measured(
    edits: ProtrusionEdits, pipeline: Pipeline | None
) -> tuple[ProtrusionEdits, Protrusions]:
    return edits, edits.keep(pipeline)


def _put_labels(atlas: Atlas, found: Protrusions) -> None:
    """Make what was found the annotation; what was drawn before cannot be undone any more."""
    annotations = atlas.annotations
    if NAME in annotations.names:
        annotations.remove(NAME)
    state = annotations.state()
    drawn = Drawn(NAME, found.labels.astype(np.uint16))
    annotations.restore(replace(state, drawn=(*state.drawn, drawn)))


_INSTANCES: weakref.WeakKeyDictionary[Any, Instances] = weakref.WeakKeyDictionary()


def instances_of(viewer: Any) -> Instances:
    """The protrusions of a viewer's cell; made when they are first asked for.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the proxy of it that napari hands to plugins.
    """
    from .instance_picking import InstancePicking

    viewer = getattr(viewer, "__wrapped__", viewer)
    instances = _INSTANCES.get(viewer)
    if instances is None:
        window = viewer.window._qt_window
        instances = _INSTANCES[viewer] = Instances(viewer, window)
        window.installEventFilter(instances)
        InstancePicking(viewer, instances)
    return instances
