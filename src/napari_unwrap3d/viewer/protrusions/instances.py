"""The protrusions of a viewer's cell: which are selected, shown and edited, and in which colours.

One per viewer, so that closing and opening the table loses nothing. The labels are the
annotation "protrusions", which every view shows; what a person changes of it, here or with a
brush, is measured anew in a thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject, Signal

from ...errors import Unwrap3DError
from ...fields import CURVATURE, PROTRUSION
from ...protrusions.colours import instance_colour
from ...protrusions.columns import COLUMNS
from ...protrusions.editing import EDITED, NAME, ProtrusionEdits
from ..annotations.annotating import annotating_of
from ..annotations.colours import LABELS
from ..annotations.painting import BRUSH, LOOK
from ..common.per_viewer import OfViewer, PerViewer
from ..common.threads import Task, tell
from ..common.turns import soon
from ..session import session_of
from ..steps.states import RUNNING, STALE
from ..steps.texts import DELETED, FINDING, NO_CELL, NOT_FOUND, OTHERS, POINT
from ..views.canvas import canvas_of
from .annotation import PARTS, measured, parted, put_labels
from .filter import COLUMNS_FIRST, Filter, filter_from
from .look import look_at, strengths

if TYPE_CHECKING:
    from ...atlas import Atlas
    from ...charts import Protrusions
    from ..annotations.annotating import Annotating
    from ..annotations.colours import Colour
    from ..session import Session

STEP = "protrusions"
# A stroke that rests this long is measured.
REST_MS = 300
CLOSE_SECONDS = 5.0


class Instances(OfViewer):
    """The protrusions of a viewer. Get them with :func:`instances_of`.

    Attributes
    ----------
    found : Protrusions or None
        As they were measured last.
    selection : tuple of int
        Labels, in the order in which they were selected.
    filter : Filter
        Which are shown.
    columns : tuple of str
        The measures that the table shows.
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
        super().__init__(viewer, parent)
        self.session: Session = session_of(viewer)
        self.found: Protrusions | None = None
        self.selection: tuple[int, ...] = ()
        self.filter = Filter()
        self.columns: tuple[str, ...] = COLUMNS_FIRST
        self.measure = ""
        self._seeds: list[int] | None = None
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
            self._annotating.listed.connect(self._on_steps)
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
        # Projects bring our selection back, so they know this module.
        from ..files.project import autosave_of

        known = NAME in atlas.annotations.names
        same = known and np.array_equal(atlas.annotations.labels(NAME), found.labels)
        first = self._edits is None
        was_edited = self.edited and not self._discard
        self._discard = False
        self._atlas, self.found = atlas, found
        self._edits = ProtrusionEdits(atlas)
        if not (same or (known and first)):
            with autosave_of(self.viewer).ignoring():
                kept = put_labels(atlas.annotations, found, keep=known and was_edited)
            if kept:
                self.annotating.set_visible(kept, False)
        self._reason = self.reason()
        if self.annotating.tool == LOOK and NAME in self.annotating.names:
            self.annotating.current = NAME
        self._renew_fields()
        self._keep_selection()
        self.changed.emit()
        self.restyle()
        # A project may have strokes that were not measured any more.
        self._timer.start()

    def _leave(self) -> None:
        self._atlas, self._edits, self.found = None, None, None
        self._keep_selection()
        self.changed.emit()

    # Measuring -------------------------------------------------------------------------

    def _measure(self) -> None:
        """Measure what changed, in a thread."""
        edits, atlas = self._edits, self._atlas
        if self._task is not None or edits is None or atlas is None or self.found is None:
            return
        if not edits.started or np.array_equal(edits.labels, self.found.labels):
            self._on_steps()
            return
        if not self.pointing:
            self.working.emit("Measuring what changed …")
        self._task = Task(measured, edits, self.session.pipeline)
        self._task.returned.connect(self._on_measured)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_measured(self, result: tuple[ProtrusionEdits, Protrusions]) -> None:
        self._end_task()
        edits, found = result
        if edits is not self._edits:
            return
        self.found = found
        self._renew_fields()
        self._keep_selection()
        self.session.edited()
        self.changed.emit()
        self.restyle()
        self._measure()

    def _on_failed(self, error: BaseException) -> None:
        self._end_task()
        tell(error)

    def _end_task(self) -> None:
        self._task = None
        if not self.pointing:
            self.working.emit("")

    def _renew_fields(self) -> None:
        canvas_of(self.viewer).colouring.renew()

    # The selection ---------------------------------------------------------------------

    def select(self, labels: Iterable[int]) -> None:
        """Select these, everywhere; others are drawn dimmed."""
        chosen = tuple(dict.fromkeys(int(label) for label in labels))
        if chosen != self.selection:
            self.stop_pointing()
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
        """Select nothing; while a protrusion is being split, only stop that."""
        if self.pointing:
            self.stop_pointing()
        else:
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
        edits, own = self._edits, instance_colour(label)
        if edits is not None and edits.started:
            own = edits.annotations.colours(NAME).get(label, own)
        return (*own[:3], 1.0)

    def _colours(self) -> Mapping[int, Colour]:
        count = max(LABELS, *(label + 1 for label in self.labels), 0)
        return strengths(count, self.hidden, set(self.selection), bool(self.measure))

    def show(self) -> None:
        """Turn and move the 3D view to the selected protrusions."""
        if self.found is not None and self._atlas is not None:
            chosen = np.isin(self.found.labels, self.selection)
            look_at(self.viewer, self._atlas.surface.vertices, chosen)

    # Edits -----------------------------------------------------------------------------

    def merge(self) -> None:
        """Make one of those that are selected; the first gives the label."""
        chosen = self.selection
        self._edit(lambda edits: [edits.merge(chosen)])

    def split(self) -> None:
        """Make two of the one that is selected; where its peaks do not part it, by two clicks."""
        self._part(self.selection[0], None)

    def _part(self, label: int, seeds: Any) -> None:
        """Find the parts in a thread."""
        if self._edits is None or self._task is not None:
            return
        self._task = Task(parted, self._edits, label, seeds)
        self._task.returned.connect(self._on_parted)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_parted(self, result: tuple[ProtrusionEdits, Any]) -> None:
        self._end_task()
        edits, parts = result
        if edits is not self._edits:
            return
        if parts is None:
            self._seeds = []
            self.working.emit(POINT)
        else:
            self._edited(edits.take_apart(*parts))

    @property
    def pointing(self) -> bool:
        """Whether clicks say where the parts of the selected protrusion are."""
        return self._seeds is not None

    def point(self, vertex: int) -> None:
        """A vertex in one of the parts; the second one splits the protrusion."""
        (label,) = self.selection
        assert self._seeds is not None
        assert self._edits is not None
        if int(self._edits.labels[vertex]) != label:
            return
        self._seeds = [*self._seeds, vertex]
        if len(self._seeds) == PARTS:
            seeds = np.array(self._seeds)
            self.stop_pointing()
            self._part(label, seeds)

    def stop_pointing(self) -> None:
        """Clicks select again."""
        if self._seeds is not None:
            self._seeds = None
            self.working.emit("")

    def delete(self) -> None:
        """Give those that are selected back to the cortex."""
        chosen = self.selection

        def delete(edits: ProtrusionEdits) -> list[int]:
            edits.delete(chosen)
            return []

        self._edit(delete)

    def _edit(self, edit: Callable[[ProtrusionEdits], list[int]]) -> None:
        assert self._edits is not None
        try:
            chosen = edit(self._edits)
        except Unwrap3DError as error:
            tell(error)
            return
        self._edited(chosen)

    def _edited(self, chosen: list[int]) -> None:
        """The labels were edited: show what can be undone, and select what came of it."""
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

    # As a project keeps it -------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """What is selected, shown and hidden, as plain data."""
        return {
            "selection": list(self.selection),
            "columns": list(self.columns),
            "filter": self.filter.plain(),
        }

    def restore(self, known: Mapping[str, Any]) -> None:
        """Put back what :meth:`state` gave; raises what Python does where it makes no sense."""
        columns = tuple(str(name) for name in known["columns"])
        self.columns = tuple(name for name in columns if name in COLUMNS) or COLUMNS_FIRST
        self.set_filter(filter_from(known["filter"]))
        self.select(label for label in map(int, known["selection"]) if label in self.labels)
        self.changed.emit()

    # The end ---------------------------------------------------------------------------

    def close(self) -> None:
        """Listen no longer, and leave no thread."""
        self._timer.stop()
        self.session.finished.disconnect(self._on_atlas)
        self.session.steps_changed.disconnect(self._on_steps)
        if self._annotating is not None:
            self._annotating.edited.disconnect(self._timer.start)
            self._annotating.listed.disconnect(self._on_steps)
            self._annotating.style_by(NAME, None)
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)


def _begin(viewer: Any, instances: Instances) -> None:
    from .picking import InstancePicking

    InstancePicking(viewer, instances)


_INSTANCES = PerViewer(Instances, _begin)


def open_instances(viewer: Any) -> Instances | None:
    """The protrusions of a viewer's cell, if anyone asked for them before."""
    return _INSTANCES.known(viewer)


def instances_of(viewer: Any) -> Instances:
    """The protrusions of a viewer's cell; made when they are first asked for."""
    return _INSTANCES.of(viewer)
