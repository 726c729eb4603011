"""Annotations of one timepoint only: what each timepoint of a movie has of them.

A name of the annotations stands for one :class:`.annotation.Annotation`. Of an annotation that
is drawn per timepoint there is one for each timepoint that was drawn on, and the name stands for
that of the timepoint that is shown. Strokes know the object they were drawn on, so that they can
be taken back at any timepoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

import numpy as np
from psygnal import Signal

from ..errors import ParameterError
from .annotation import Annotation
from .edits import Setting
from .history import Edit
from .lookup import Labels
from .state import DrawnInTime

if TYPE_CHECKING:
    from .annotations import Annotations


class Group:
    """The annotations of one name, by timepoint."""

    def __init__(self) -> None:
        #: Those with something drawn.
        self.drawn: dict[int, Annotation] = {}
        # Those that somebody still has: the name that shows it, or a stroke that may come back.
        self.known: WeakValueDictionary[int, Annotation] = WeakValueDictionary()

    def put(self, timepoint: int, annotation: Annotation) -> None:
        """Make an annotation that of a timepoint."""
        annotation.group, annotation.timepoint = self, timepoint
        self.known[timepoint] = annotation
        self.note(annotation)

    def note(self, annotation: Annotation) -> None:
        """Keep it as long as something is drawn."""
        assert annotation.timepoint is not None
        if annotation.empty:
            self.drawn.pop(annotation.timepoint, None)
        else:
            self.drawn[annotation.timepoint] = annotation

    def at(self, timepoint: int, like: Annotation) -> Annotation:
        """That of a timepoint; a new one, as large as another, where nothing was drawn."""
        found = self.known.get(timepoint)
        if found is None:
            found = Annotation(len(like.surface.painted))
            found.colours = like.colours
            self.put(timepoint, found)
        return found


class Times:
    """Which annotations of a movie are of one timepoint each, and what all timepoints have.

    Parameters
    ----------
    annotations : Annotations
    do : callable
        Makes an edit, and lets it be taken back.

    Attributes
    ----------
    edited : Signal (int)
        A stroke on a timepoint that is not shown was taken back or made again.
    """

    edited = Signal(int)

    def __init__(self, annotations: Annotations, do: Callable[[Edit], None]) -> None:
        self._annotations, self._do = annotations, do
        self._timepoint: int | None = None
        self._telling = False

    @property
    def timepoint(self) -> int | None:
        """That is shown; None where there is no movie."""
        return self._timepoint

    def show(self, timepoint: int | None) -> None:
        """Show what was drawn on a timepoint; drawing goes on there."""
        if timepoint != self._timepoint:
            self._timepoint = timepoint
            self._show_all()

    def one_by_one(self, name: str) -> bool:
        """Whether an annotation is another one at every timepoint."""
        return self._annotations.annotation(name).group is not None

    def set_one_by_one(self, name: str, wanted: bool) -> None:
        """Draw an annotation on each timepoint by itself, or on all of them the same.

        What is there stays where it is seen: on the timepoint that is shown, or, back again,
        that of this timepoint on all. What the others had comes back with an undo.

        Raises
        ------
        ParameterError
            There is no movie, or no such annotation.
        """
        annotation = self._annotations.annotation(name)
        if wanted == self.one_by_one(name):
            return
        if self._timepoint is None:
            raise ParameterError("Only the annotations of a movie can be of one timepoint.")
        group = Group() if annotation.group is None else annotation.group
        put = partial(self._put, annotation, group, self._timepoint)
        self._do(Setting(put, not wanted, wanted))

    def _put(self, annotation: Annotation, group: Group, timepoint: int, inside: bool) -> None:
        shown = self._annotations.annotations()
        name = next((n for n, a in shown.items() if a is annotation or a.group is group), None)
        if inside:
            group.put(timepoint, annotation)
        else:
            annotation.group = annotation.timepoint = None
            group.drawn.pop(timepoint, None)
            group.known.pop(timepoint, None)
        if name is not None and shown[name] is not annotation:
            self._annotations.exchange(name, annotation)
        self._show_all()
        self._annotations.relist()

    def _show_all(self) -> None:
        for name, annotation in self._annotations.annotations().items():
            there = self.current(annotation)
            if there is not annotation:
                self._annotations.exchange(name, there)

    def current(self, annotation: Annotation) -> Annotation:
        """That of the timepoint that is shown, of an annotation of another one."""
        if annotation.group is None or self._timepoint is None:
            return annotation
        return annotation.group.at(self._timepoint, annotation)

    def note(self, annotation: Annotation) -> None:
        """An annotation was edited."""
        if annotation.group is None or annotation.timepoint is None:
            return
        annotation.group.note(annotation)
        shown = self._annotations.annotations().values()
        if (
            self._telling
            and annotation not in shown
            and any(a.group is annotation.group for a in shown)
        ):
            self.edited.emit(annotation.timepoint)

    @contextmanager
    def telling(self) -> Iterator[None]:
        """What is undone or done again inside is told with :attr:`edited`."""
        self._telling = True
        try:
            yield
        finally:
            self._telling = False

    @staticmethod
    def alike(annotation: Annotation) -> Iterator[Annotation]:
        """An annotation, and those of its other timepoints."""
        yield annotation
        if annotation.group is not None:
            yield from (each for each in annotation.group.known.values() if each is not annotation)

    # All timepoints ------------------------------------------------------------------

    def drawn(self, name: str) -> tuple[int, ...]:
        """The timepoints that an annotation was drawn on; none of one that is the same on all."""
        group = self._annotations.annotation(name).group
        return () if group is None else tuple(sorted(group.drawn))

    def image(self, name: str, timepoint: int) -> Labels:
        """The label image (N, 2N) uint16 of an annotation in uv at a timepoint.

        That of an annotation that is the same on all timepoints is the same here.
        """
        annotation = self._annotations.annotation(name)
        if annotation.group is None:
            return self._annotations.image(name, "uv")
        there = annotation.group.drawn.get(timepoint)
        if there is None:
            return np.zeros(self._annotations.shape("uv"), np.uint16)
        return self._annotations.uv_image(there)

    def state(self) -> tuple[DrawnInTime, ...]:
        """A copy of what was drawn on every timepoint."""
        return tuple(
            DrawnInTime(
                name,
                {
                    t: self._annotations.drawn(name, each)
                    for t, each in sorted(annotation.group.drawn.items())
                },
                dict(annotation.colours),
            )
            for name, annotation in self._annotations.annotations().items()
            if annotation.group is not None
        )

    def restored(self, given: tuple[DrawnInTime, ...]) -> Mapping[str, Annotation]:
        """Annotations of a state, by their names: those of the timepoint that is shown."""
        found = {}
        for part in given:
            group = Group()
            first = Annotation(self._annotations.size)
            first.colours = dict(part.colours)
            for timepoint, drawn in part.drawn.items():
                each = self._annotations.made(drawn)
                each.colours = first.colours
                group.put(timepoint, each)
            found[part.name] = group.at(self._timepoint or 0, first)
        return found
