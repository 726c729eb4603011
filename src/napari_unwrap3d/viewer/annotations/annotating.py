"""Drawing on the cell of a viewer: with what, in which colours, and on which views.

One per viewer, so that closing and opening the dock loses nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject, Signal

from ...annotations import Annotations
from ...atlas import Atlas
from ...charts import Ints
from ...errors import Unwrap3DError
from ..common.per_viewer import OfViewer, PerViewer
from ..session import session_of
from ..views.canvas import canvas_of
from ..views.layers import FRAME
from ..views.placing import chart_of
from .arrows import AxisArrow
from .colours import LABELS, Colour, Colours, colour_of
from .direct import DirectForDrawing
from .drawing_layers import DrawingLayers
from .painting import LOOK, POINT, TOOLS, SurfacePainter
from .point_layers import PointLayers
from .shape_layers import ShapeLayers
from .texturing import Texturing, Watching

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer

    from ...motion.shown_frames import ShownFrame
    from ..session import Session
    from ..views.canvas import UnwrappedCanvas

KEYS = {"Control-Z": "undo", "Control-Shift-Z": "redo"}
RADIUS_SHARE = 0.03


class Annotating(OfViewer):
    """What a person draws with. Get it with :func:`annotating_of`.

    Signals
    -------
    listed()
        Annotations were added, removed or renamed, or there is another cell.
    edited()
        Labels changed, or what can be undone.
    styled()
        Colours or visibility changed.
    chosen()
        The current annotation, label, tool or radius changed.
    told(str)
        What the person should know, empty when it is over.
    """

    listed = Signal()
    edited = Signal()
    styled = Signal()
    chosen = Signal()
    told = Signal(str)

    def __init__(self, viewer: ViewerModel, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.atlas: Atlas | None = None
        self._annotations: Annotations | None = None
        self._texturing: Texturing | None = None
        self._current, self._label, self._tool = "", 1, LOOK
        self._radius_um = 1.0
        self._offset: dict[str, int] = {}
        self._stylists: dict[str, Callable[[], Colours]] = {}
        self._hidden: set[str] = set()
        self._renaming: tuple[str, str] | None = None
        self._session: Session | None = None
        self._canvas: UnwrappedCanvas | None = None
        self._frame: ShownFrame | None = None
        self._watching: Watching | None = None
        self._direct = DirectForDrawing(self)
        self._direct.told.connect(self.told)
        self._direct.computed.connect(self._on_charts)
        self.painter = SurfacePainter(viewer, self)
        self.layers = DrawingLayers(viewer, self)
        self.shapes = ShapeLayers(self)
        self.points = PointLayers(viewer, self)
        self.axis_arrow = AxisArrow(viewer, self)
        for key, what in KEYS.items():
            viewer.bind_key(key, self._undo if what == "undo" else self._redo, overwrite=True)

    # The cell ------------------------------------------------------------------------

    @property
    def annotations(self) -> Annotations:
        """Of the cell; only where there is one (:attr:`atlas`)."""
        assert self._annotations is not None
        return self._annotations

    @property
    def canvas(self) -> UnwrappedCanvas | None:
        """The second canvas that is drawn in."""
        return self._canvas

    @property
    def watching(self) -> Watching:
        """Counts who shows which chart of the annotations."""
        assert self._watching is not None
        return self._watching

    @property
    def texturing(self) -> Texturing | None:
        """What shows the annotations on the meshes."""
        return self._texturing

    def show(self, atlas: Atlas | None, annotations: Annotations | None) -> None:
        """Draw on this cell from now on."""
        if atlas is self.atlas and annotations is self._annotations:
            return
        self._leave()
        self.atlas, self._annotations = atlas, annotations
        viewer = self._viewer()
        if atlas is None or annotations is None or viewer is None:
            self._current = ""
            self.listed.emit()
            return
        watching = self._watching = Watching(annotations)
        self._texturing = Texturing(viewer, atlas, annotations, self.style, watching, self)
        for name in self.names:
            # In this order, so that each has its colours again.
            self.style(name)
        self.layers.show(annotations, watching)
        self.shapes.show(annotations)
        self.points.show(annotations)
        self.axis_arrow.show(annotations)
        annotations.listed.connect(self._on_listed)
        annotations.changed.connect(self._on_changed)
        annotations.turned.connect(self._on_changed)
        size = np.ptp(atlas.surface.vertices, axis=0).max()
        self._radius_um = float(f"{RADIUS_SHARE * size:.2g}")
        self._on_listed()
        self.chosen.emit()

    def follow(self, session: Session) -> None:
        """Draw on the cell of a session, and in its second canvas."""
        if self._session is not None:
            return
        self._session = session
        session.finished.connect(self._on_session)
        session.steps_changed.connect(self._on_session)
        self._on_session()

    def use_canvas(self, canvas: UnwrappedCanvas) -> None:
        """Draw in the second canvas, too."""
        if canvas is not self._canvas:
            self._canvas = canvas
            canvas.charts_changed.connect(self._on_charts)
            canvas.requested.changed.connect(self._direct.on_requested)
            self.layers.use_canvas(canvas)
            self.points.use_canvas(canvas)
            for key, what in KEYS.items():
                undoes = self._undo if what == "undo" else self._redo
                canvas.model.bind_key(key, undoes, overwrite=True)

    def _on_session(self, _: Any = None) -> None:
        assert self._session is not None
        atlas = self._session.atlas
        if atlas is not self.atlas:
            self.show(atlas, None if atlas is None else atlas.annotations)

    def _leave(self) -> None:
        if self._annotations is not None:
            self._annotations.listed.disconnect(self._on_listed)
            self._annotations.changed.disconnect(self._on_changed)
            self._annotations.turned.disconnect(self._on_changed)
        if self._texturing is not None:
            self._texturing.close()
            self._texturing.deleteLater()
            self._texturing = None
        self.layers.leave()
        self.shapes.leave()
        self.points.leave()
        self.axis_arrow.leave()
        self.painter.forget()

    # A timepoint of a movie ------------------------------------------------------------

    def show_frame(self, frame: ShownFrame | None) -> None:
        """Draw on the surface of this timepoint; None where no movie is shown."""
        begins_or_ends = (frame is None) != (self._frame is None)
        self._frame = frame
        self.painter.forget(FRAME)
        if begins_or_ends and self._annotations is not None:
            self.chosen.emit()

    def frame_rests(self) -> None:
        """The timepoint is looked at: get ready to draw on it, if that is what is done."""
        if self._frame is not None and self._tool != LOOK:
            self.painter.prepare()

    @property
    def frame(self) -> ShownFrame | None:
        """The timepoint that is drawn on."""
        return self._frame

    def close(self) -> None:
        """Leave the viewer as it was, and no thread."""
        if self._session is not None:
            self._session.finished.disconnect(self._on_session)
            self._session.steps_changed.disconnect(self._on_session)
            self._session = None
        self._leave()
        self.atlas = self._annotations = None
        self.painter.close()
        viewer = self._viewer()
        models = [] if self._canvas is None else [self._canvas.model]
        for model in (viewer, *models):
            if model is not None:
                for key in KEYS:
                    model.bind_key(key, None, overwrite=True)
        self._direct.close()

    def faces(self, mesh: str) -> Ints:
        """The faces of a mesh of the cell, or of the timepoint that is shown."""
        if mesh == FRAME:
            assert self._frame is not None
            return self._frame.frame.surface.faces
        assert self.atlas is not None
        faces: Ints = getattr(self.atlas, mesh).faces
        return faces

    def shows(self, layer: Layer) -> bool:
        """Whether a layer shows a mesh of this cell."""
        mesh = chart_of(layer)
        if self.atlas is None or type(layer).__name__ != "Surface":
            return False
        if not (self._frame is not None if mesh == FRAME else self.atlas.has(mesh)):
            return False
        return len(layer.data[1]) == len(self.faces(mesh))

    # What is drawn with ----------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Of the annotations."""
        return () if self._annotations is None else self._annotations.names

    @property
    def current(self) -> str:
        """The annotation that is drawn; empty when there is none."""
        return self._current

    @current.setter
    def current(self, name: str) -> None:
        if name != self._current:
            self._current = name
            self.chosen.emit()

    @property
    def label(self) -> int:
        """The label that is drawn."""
        return self._label

    @label.setter
    def label(self, label: int) -> None:
        if label != self._label:
            self._label = label
            self.chosen.emit()

    @property
    def radius_um(self) -> float:
        """Radius of the brush on the surface."""
        return self._radius_um

    @radius_um.setter
    def radius_um(self, radius: float) -> None:
        if radius != self._radius_um:
            self._radius_um = radius
            self.chosen.emit()

    @property
    def tool(self) -> str:
        """One of "look", "brush", "erase" and "lasso", on the meshes."""
        return self._tool

    @tool.setter
    def tool(self, tool: str) -> None:
        assert tool in TOOLS
        self._tool = tool
        if tool != LOOK:
            self.painter.prepare()
        self.chosen.emit()

    @property
    def slices(self) -> bool:
        """Whether slices of the stack are shown in the main canvas, to be drawn on."""
        return self.layers.slices

    @slices.setter
    def slices(self, wanted: bool) -> None:
        if wanted != self.layers.slices:
            self.layers.slices = wanted
            self.chosen.emit()

    @property
    def points_wanted(self) -> bool:
        """Whether a click sets a point."""
        return self._tool == POINT

    def undo(self) -> None:
        """Take back the last stroke, in whichever view it was drawn."""
        if self._annotations is not None:
            self._annotations.undo()
            self.edited.emit()

    def redo(self) -> None:
        """Make the last stroke again that was taken back."""
        if self._annotations is not None:
            self._annotations.redo()
            self.edited.emit()

    def _undo(self, _: Any = None) -> None:
        self.undo()

    def _redo(self, _: Any = None) -> None:
        self.redo()

    # Colours and visibility --------------------------------------------------------------

    def style_by(self, name: str, stylist: Callable[[], Colours] | None) -> None:
        """Let a function say the colours of an annotation; :meth:`restyle` asks it again."""
        if stylist is None:
            self._stylists.pop(name, None)
        else:
            self._stylists[name] = stylist

    def style(self, name: str) -> tuple[Colours, bool]:
        """The colours of an annotation's labels, and whether it is visible."""
        first = self._offset.setdefault(name, len(self._offset))
        own = self.annotations.colours(name)
        if name in self._stylists:
            given = dict(self._stylists[name]())
            # A colour that a person chose, as strong as the others are.
            given |= {n: (*c[:3], given[n][3]) for n, c in own.items() if n in given}
            return given, name not in self._hidden
        colours = {label: own.get(label, colour_of(first, label)) for label in range(1, LABELS)}
        return colours, name not in self._hidden

    def set_colour(self, name: str, label: int, colour: Colour) -> None:
        """Give a label of an annotation another colour, in every view."""
        own = self.annotations.colours(name)
        self.annotations.set_colours(name, {**own, label: colour})

    def set_visible(self, name: str, visible: bool) -> None:
        """Show or hide an annotation, in every view."""
        (self._hidden.discard if visible else self._hidden.add)(name)
        self.restyle()

    def state(self) -> dict[str, Any]:
        """Which annotations are hidden, and where their colours begin, as plain data."""
        return {
            "hidden": [name for name in self.names if name in self._hidden],
            "first_colours": {name: self._offset[name] for name in self.names},
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Show what :meth:`state` said; KeyError, TypeError or ValueError if it makes no sense."""
        there = set(self.names)
        first = {str(name): int(number) for name, number in state["first_colours"].items()}
        self._hidden = {str(name) for name in state["hidden"]} & there
        self._offset |= {name: number for name, number in first.items() if name in there}
        self.restyle()

    def restyle(self) -> None:
        """Show the colours as they are now, in every view."""
        if self._texturing is not None:
            self._texturing.update()
        self.layers.restyle()
        self.styled.emit()

    def rename(self, old: str, new: str) -> None:
        """Give an annotation another name; it keeps its colours."""
        if old == new:
            return
        current, visible = self._current, self.style(old)[1]
        first, hidden = self._offset.get(new), self._hidden
        self._offset[new] = self._offset[old]
        self._hidden = hidden - {new} if visible else hidden | {new}
        self._renaming = (old, new)
        try:
            self.annotations.rename(old, new)
        except Unwrap3DError:
            self._hidden = hidden
            if first is None:
                del self._offset[new]
            else:
                self._offset[new] = first
            raise
        finally:
            self._renaming = None
        if current == old:
            self.current = new

    @property
    def renaming(self) -> tuple[str, str] | None:
        """The old and the new name while an annotation is renamed."""
        return self._renaming

    # What the annotations tell -----------------------------------------------------------

    def _on_listed(self) -> None:
        names = self.names
        for name in names:
            self.style(name)
        if self._current not in names:
            self._current = names[-1] if names else ""
            self.chosen.emit()
        if names:
            self.painter.prepare()
            self._direct.prepare()
        self.listed.emit()
        self.layers.restyle()
        self.edited.emit()

    def _on_changed(self, _: Any = None) -> None:
        self.edited.emit()

    def _on_charts(self) -> None:
        """A chart was computed: where it is the direct one, the surface shows that."""
        if self._texturing is not None:
            self._texturing.remake()


def _begin(viewer: Any, annotating: Annotating) -> None:
    # After the session, whose threads end first when the window closes.
    annotating.use_canvas(canvas_of(viewer))
    annotating.follow(session_of(viewer))


_ANNOTATING = PerViewer(Annotating, _begin)


def open_annotating(viewer: Any) -> Annotating | None:
    """What draws on the cell of a viewer, None while nothing does."""
    return _ANNOTATING.known(viewer)


def annotating_of(viewer: Any) -> Annotating:
    """What draws on a viewer's cell (or on that of napari's proxy); made when first asked for."""
    return _ANNOTATING.of(viewer)
