"""The annotations of a cell: labels that a person drew, on whichever chart was best for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from ..charts import Ints
from ..errors import ParameterError
from .annotation import Annotation, Cover, Layer, checked_colours, checked_name
from .changes import Change
from .charts import ON_UV
from .edits import Delta, Dirty, Painting, Setting
from .history import Edit, History
from .lookup import Labels, Owners, flat_indices
from .points import Points
from .shapes import Overhang, Shape, check_label, checked_overhang
from .state import Colour, Drawn, Position, State, checked_axis, moved
from .tables import NOTHING, Tables
from .times import Times

if TYPE_CHECKING:
    from ..atlas import Atlas


class Annotations:
    """Named annotations of one cell, drawn and read on any of its charts.

    The truth is a label per vertex of the surface. Drawing in uv marks every vertex over the
    drawn pixels, the whole column of them or (`overhang`) only those on the outermost sheet,
    and the uv image keeps its pixels as drawn until what lies over them is drawn elsewhere;
    it shows what lies outermost. Drawing in any other chart marks what was touched.

    Parameters
    ----------
    atlas : Atlas
        Needs its surface; other charts when they are drawn on or read.

    Attributes
    ----------
    changed : Signal (Change)
        After every edit of labels, also in the midst of a stroke.
    listed : Signal
        After annotations were added, removed or renamed, or their colours changed.
    points : Points
        Named points on the surface.
    size : int
        Number of vertices of the surface.
    times : Times
        Of a movie: which annotations are of one timepoint only.
    shaped : Signal (str)
        After the shapes of an annotation, of that name, changed.
    turned : Signal
        After :attr:`axis` changed.
    """

    changed = Signal(Change)
    listed = Signal()
    shaped = Signal(str)
    turned = Signal()

    def __init__(self, atlas: Atlas) -> None:
        self._atlas = atlas
        self.size = len(atlas.surface.vertices)
        self._all: dict[str, Annotation] = {}
        self._overhang: Overhang = "column"
        self._axis: Position | None = None
        self._watched: list[str] = []
        self.tables = Tables(atlas)
        self._dirty = Dirty()
        self._relisted = False
        self._reshaped: list[Annotation] = []
        self.points = Points(atlas, self._do)
        self.times = Times(self, self._do)
        self._history = History(self._settle)

    @property
    def atlas(self) -> Atlas:
        """The charts."""
        return self._atlas

    # Names -------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Of the annotations, in the order in which they were added."""
        return tuple(self._all)

    def add(self, name: str) -> None:
        """Add an annotation without any label.

        Raises
        ------
        ParameterError
            The name is empty, too long or taken.
        """
        self._list({**self._all, self._free(name): Annotation(self.size)})

    def remove(self, name: str) -> None:
        """Remove an annotation with all of its labels and shapes."""
        gone = self.annotation(name)
        self._list({key: kept for key, kept in self._all.items() if kept is not gone})

    def rename(self, old: str, new: str) -> None:
        """Give an annotation another name."""
        renamed = self.annotation(old)
        if old != new:
            free = self._free(new)
            self._list({free if a is renamed else n: a for n, a in self._all.items()})

    def _free(self, name: str) -> str:
        if name in self._all:
            raise ParameterError(f"There already is an annotation {name!r}.")
        return checked_name(name)

    def annotation(self, name: str) -> Annotation:
        """What a name stands for; :class:`ParameterError` where there is none."""
        if name not in self._all:
            raise ParameterError(
                f"There is no annotation {name!r}.", hint=f"There are: {', '.join(self._all)}."
            )
        return self._all[name]

    def colours(self, name: str) -> Mapping[int, Colour]:
        """Label to (r, g, b, a), 0 to 1, of the labels that have a colour of their own."""
        return MappingProxyType(dict(self.annotation(name).colours))

    def set_colours(self, name: str, colours: Mapping[int, Colour]) -> None:
        """Give labels colours of their own, in the place of those that they had."""
        annotation, after = self.annotation(name), checked_colours(colours)
        put = partial(self._put_colours, annotation)
        self._do(Setting(put, annotation.colours, after))

    def _put_colours(self, annotation: Annotation, colours: Mapping[int, Colour]) -> None:
        self._relisted = True
        for each in self.times.alike(annotation):
            each.colours = colours

    def _list(self, after: dict[str, Annotation]) -> None:
        self._do(Setting(self._put_all, self._all, after))

    def _put_all(self, annotations: dict[str, Annotation]) -> None:
        current = self.times.current
        self._all = {name: current(each) for name, each in annotations.items()}
        self._relisted = True

    # Of one timepoint, see :class:`Times` ----------------------------------------------

    def annotations(self) -> dict[str, Annotation]:
        """What all names stand for."""
        return dict(self._all)

    def relist(self) -> None:
        """Tell :attr:`listed` with the next edit."""
        self._relisted = True

    def exchange(self, name: str, other: Annotation) -> None:
        """Let a name stand for another annotation, and tell what that changes to be seen."""
        before = self.annotation(name)
        self._all = {**self._all, name: other}
        vertices = np.flatnonzero(before.surface.shown() != other.surface.shown())
        pixels = NOTHING
        if before.image is not None or other.image is not None:
            images = self._image(before).shown(), self._image(other).shown()
            pixels = np.flatnonzero(images[0] != images[1])
        self._dirty.add(other, vertices, pixels)
        if before.shapes or other.shapes:
            self._reshaped.append(other)
        self._settle()

    def uv_image(self, annotation: Annotation) -> Labels:
        """The label image (N, 2N) in uv of what a name may stand for."""
        return self._image(annotation).shown().reshape(self.shape("uv")).copy()

    def drawn(self, name: str, annotation: Annotation) -> Drawn:
        """A copy as plain data."""
        return annotation.drawn(name, self._atlas.uv.shape if self._atlas.has("uv") else ())

    def made(self, part: Drawn) -> Annotation:
        """An annotation of plain data."""
        annotation = Annotation(self.size)
        annotation.surface.painted[:] = part.labels
        if part.image is not None:
            annotation.image = Layer(part.image.astype(np.uint16).ravel())
        annotation.colours = dict(part.colours)
        if part.shapes:
            self._put_shapes(annotation, part.shapes)
        return annotation

    # Reading -----------------------------------------------------------------------

    def labels(self, name: str) -> Labels:
        """One label per vertex of the surface, (n,) uint16: painted, overlaid by shapes."""
        shown = self.annotation(name).surface.shown().view()
        shown.setflags(write=False)
        return shown

    def image(self, name: str, chart: str) -> Labels:
        """The label image (uint16) of a chart.

        Parameters
        ----------
        name : str
        chart : str
            "uv", "direct" or "plane" (N, 2N), "topography" (D, N, 2N), "volume" (z, y, x) on
            the grid of the mask, "surface" (n,), "reference" or "sphere" (one per vertex).

        Raises
        ------
        ChartMissingError
            The atlas does not have the chart.
        """
        annotation = self.annotation(name)
        if chart == "uv" or chart in ON_UV:
            uv = self.uv_image(annotation)
            return uv if chart == "uv" else uv.ravel()[self.tables.on_uv.pixel]
        return self.owners(chart).display(annotation.surface.shown())

    def owners(self, chart: str) -> Owners:
        """The tables of a chart, built when first asked for: in a thread, if need be."""
        return self.tables.owners(chart)

    def ready(self, chart: str) -> bool:
        """Whether the tables of a chart are built, so that drawing in it is quick."""
        return self.tables.ready(chart)

    def shape(self, chart: str) -> tuple[int, ...]:
        """Of the label image of a chart."""
        return self.tables.shape(chart)

    # Drawing -----------------------------------------------------------------------

    @property
    def overhang(self) -> Overhang:
        """What drawing in uv marks: the whole "column", or the "outermost" sheet of it."""
        return self._overhang

    @overhang.setter
    def overhang(self, value: Overhang) -> None:
        self._overhang = checked_overhang(value)

    def draw(
        self, name: str, chart: str, indices: tuple[npt.ArrayLike, ...], label: npt.ArrayLike
    ) -> None:
        """Draw a label at pixels of a chart; 0 erases.

        Parameters
        ----------
        name : str
        chart : str
            As in :meth:`image`.
        indices : tuple of array-like of int
            One per axis of the chart's image, as ``np.nonzero`` gives.
        label : int, or array-like of int
            One for all pixels, or one for each.

        Raises
        ------
        AxesError, ParameterError
            Pixels lie outside of the image, or labels out of their range.
        """
        flat = flat_indices(indices, self.shape(chart))
        values = np.asarray(label)
        with self.stroke():
            for value in np.unique(values):
                chosen = flat if values.ndim == 0 else flat[values.ravel() == value]
                self._draw(self.annotation(name), chart, chosen, check_label(value))

    def _draw(self, annotation: Annotation, chart: str, pixels: Ints, label: int) -> None:
        if chart in ON_UV:
            chart, pixels = "uv", self.tables.on_uv.drawn.of(pixels)
        vertices = self.tables.touched(chart, pixels, self.overhang)
        self._paint(annotation, vertices, label, np.unique(pixels) if chart == "uv" else None)

    def draw_vertices(self, name: str, vertices: npt.ArrayLike, label: int) -> None:
        """Draw a label at exactly these vertices of the surface; 0 erases."""
        chosen = np.unique(flat_indices((vertices,), (self.size,)))
        self._paint(self.annotation(name), chosen, check_label(label))

    def _paint(
        self, annotation: Annotation, vertices: Ints, label: int, pixels: Ints | None = None
    ) -> None:
        """Paint vertices, and in uv the pixels that were drawn, or else those that show them."""
        image = None
        if pixels is not None:
            image = Delta.of(self._image(annotation), pixels, label)
        elif annotation.image is not None:
            image = Delta.of(annotation.image, self.owners("uv").owned(vertices), label)
        surface = Delta.of(annotation.surface, vertices, label)
        edit = Painting(annotation, surface, image, partial(self.owners, "uv"), self._dirty)
        if edit:
            self._do(edit)

    def _image(self, annotation: Annotation) -> Layer:
        """The image of uv, made from the surface's labels where there is none."""
        if annotation.image is None:
            annotation.image = Layer(self.owners("uv").display(annotation.surface.painted).ravel())
            annotation.image.cover = self._covers(annotation)[1]
        return annotation.image

    def _do(self, edit: Edit) -> None:
        edit.apply(forward=True)
        self._history.record(edit)
        self._settle()

    # Shapes ------------------------------------------------------------------------

    def shapes(self, name: str, chart: str | None = None) -> tuple[Shape, ...]:
        """The shapes of an annotation, or those of one chart; later ones lie on top."""
        shapes = self.annotation(name).shapes
        return tuple(shape for shape in shapes if chart in (None, shape.chart))

    def set_shapes(self, name: str, shapes: Iterable[Shape], chart: str | None = None) -> None:
        """Put shapes in the place of all that there are, or of those of one chart.

        They lie over what is painted, which shows again where they are taken away.

        Raises
        ------
        ParameterError
            A shape is of another chart, or reaches too far beyond its image.
        """
        annotation, given = self.annotation(name), tuple(shapes)
        if any(chart not in (None, shape.chart) for shape in given):
            raise ParameterError(f"All of these shapes should be in {chart!r}.")
        for shape in given:
            self.tables.inside(shape)
        others = tuple(s for s in annotation.shapes if chart not in (None, s.chart))
        put = partial(self._put_shapes, annotation)
        self._do(Setting(put, annotation.shapes, (*others, *given)))

    def add_shape(self, name: str, shape: Shape) -> None:
        """Add a shape on top of the others."""
        self.set_shapes(name, (*self.shapes(name), shape))

    def _put_shapes(self, annotation: Annotation, shapes: tuple[Shape, ...]) -> None:
        annotation.shapes = shapes
        if any(shape.chart == "uv" for shape in shapes):
            self._image(annotation)
        surface, image = self._covers(annotation)
        pixels = NOTHING
        vertices = annotation.surface.set_cover(surface)
        if annotation.image is not None:
            pixels = annotation.image.set_cover(image)
        self._dirty.add(annotation, vertices, pixels)
        self._reshaped.append(annotation)

    def _covers(self, annotation: Annotation) -> tuple[Cover | None, Cover | None]:
        """What the shapes put over the surface's labels and over those of uv's image."""
        if not annotation.shapes:
            return None, None
        surface = np.full(self.size, -1, np.int32)
        image = None
        if annotation.image is not None:
            image = np.full(len(annotation.image.painted), -1, np.int32)
        for shape in annotation.shapes:
            vertices, pixels = self.tables.inside(shape)
            surface[vertices] = shape.label
            if image is not None:
                drawn = pixels if shape.chart == "uv" else self.owners("uv").owned(vertices)
                image[drawn] = shape.label
        return surface, image

    def marked_by(self, shape: Shape) -> Ints:
        """The vertices of the surface that a shape marks."""
        return self.tables.inside(shape)[0]

    # Undoing -----------------------------------------------------------------------

    def stroke(self) -> AbstractContextManager[None]:
        """Everything inside is one step to undo; of nested strokes the outermost counts."""
        return self._history.stroke()

    def undo(self) -> None:
        """Take back the last stroke, whatever it edited."""
        with self.times.telling():
            self._history.undo()

    def redo(self) -> None:
        """Make the stroke again that was taken back last."""
        with self.times.telling():
            self._history.redo()

    @property
    def can_undo(self) -> bool:
        """Whether there is a stroke to take back, and none is being drawn."""
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        """Whether there is a stroke that was taken back."""
        return self._history.can_redo

    # The axis ----------------------------------------------------------------------

    @property
    def axis(self) -> Position | None:
        """The axis of lateral speeds, a unit vector (z, y, x), e.g. a fitted plane's normal.

        None as long as nobody chose one; setting it is a step to undo.
        """
        return self._axis

    @axis.setter
    def axis(self, direction: npt.ArrayLike | None) -> None:
        self._do(Setting(self._put_axis, self._axis, checked_axis(direction)))

    def _put_axis(self, axis: Position | None) -> None:
        self._axis = axis
        self.turned.emit()

    # As plain data -----------------------------------------------------------------

    def state(self) -> State:
        """A copy of everything that was drawn, which may be saved in a thread."""
        drawn = tuple(self.drawn(n, each) for n, each in self._all.items() if each.group is None)
        points, timed = dict(self.points.positions), self.times.state()
        return State(drawn, points, self._overhang, self._axis, timed)

    def restore(self, state: State) -> None:
        """Put a state in the place of everything; nothing before can be undone any more."""
        self._all, self._relisted = {}, True
        for part in state.drawn:
            self._all[self._free(part.name)] = self.made(part)
        for name, annotation in self.times.restored(state.timed).items():
            self._all[self._free(name)] = annotation
        self.overhang = state.overhang
        self.points.replace(state.points)
        self._put_axis(state.axis)
        self._history.clear()
        self._settle()

    def on(self, atlas: Atlas) -> Annotations:
        """The same annotations on another atlas of the same cell; see :func:`.state.moved`."""
        there = Annotations(atlas)
        there.restore(moved(self, atlas))
        return there

    # Watching ----------------------------------------------------------------------

    def watch(self, chart: str) -> None:
        """Have the pixels of a chart that change told with :attr:`changed`."""
        self.owners("uv" if chart in ON_UV else chart)
        if chart not in self._watched:
            self._watched.append(chart)

    def unwatch(self, chart: str) -> None:
        """Tell the pixels of a chart no longer."""
        if chart in self._watched:
            self._watched.remove(chart)

    def _settle(self) -> None:
        """Tell what changed."""
        names = {annotation: name for name, annotation in self._all.items()}
        if self._relisted:
            self._relisted = False
            self.listed.emit()
        for annotation, vertices, pixels in self._dirty.take():
            self.times.note(annotation)
            if annotation in names and (len(vertices) or len(pixels)):
                labels = annotation.surface.at(vertices)
                parts = self._changed_pixels(annotation, vertices, pixels)
                self.changed.emit(Change(names[annotation], vertices, labels, parts))
        reshaped, self._reshaped = self._reshaped, []
        for annotation in dict.fromkeys(reshaped):
            if annotation in names:
                self.shaped.emit(names[annotation])

    def _changed_pixels(
        self, annotation: Annotation, vertices: Ints, pixels: Ints
    ) -> dict[str, tuple[Ints, Labels]]:
        """For every watched chart; given what changed on the surface and in the image of uv."""
        parts = {}
        for chart in self._watched:
            owners = self.owners("uv" if chart in ON_UV else chart)
            if chart != "uv" and chart not in ON_UV:
                flat = owners.owned(vertices)
                parts[chart] = flat, owners.values(flat, annotation.surface.shown())
                continue
            flat = owners.owned(vertices) if annotation.image is None else pixels
            image = self._image(annotation)
            if chart == "uv":
                parts[chart] = flat, image.at(flat)
            else:
                flat = self.tables.on_uv.within.of(flat)
                parts[chart] = flat, image.at(self.tables.on_uv.pixel[flat])
        return parts
