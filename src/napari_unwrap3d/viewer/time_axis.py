"""The timepoint of a movie and napari's own slider over t, kept in step both ways."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject

from .placing import undisturbed

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from .movie_session import MovieSession

SPATIAL = 3
KEYS = {",": "previous", ".": "next", "K": "play"}


class TimeAxis(QObject):
    """Keeps one canvas in step with a movie, and binds the keys of the timeline in it.

    Parameters
    ----------
    model : napari.components.ViewerModel
        Of the main canvas, or of the second one.
    session : MovieSession
    """

    def __init__(self, model: ViewerModel, session: MovieSession) -> None:
        super().__init__(session)
        self._model = weakref.ref(model)
        self._session = session
        self._setting = False
        model.dims.events.current_step.connect(self._on_step)
        session.frame_changed.connect(self._on_frame)
        model.layers.events.inserted.connect(self._on_frame)
        actions: dict[str, Callable[[], None]] = {
            "previous": lambda: session.step(-1),
            "next": lambda: session.step(1),
            "play": session.toggle,
        }
        for key, name in KEYS.items():
            action = actions[name]
            model.bind_key(key, lambda _, action=action: action(), overwrite=True)

    @property
    def axis(self) -> int | None:
        """The axis of the canvas that is the movie's time; None while nothing there has one."""
        model, movie = self._model(), self._session.movie
        if model is None or movie is None:
            return None
        for layer in model.layers:
            place = _time_axis(layer, len(movie))
            if place is not None:
                return int(model.dims.ndim - layer.ndim + place)
        return None

    def _on_step(self, _: Any = None) -> None:
        """The person moved napari's slider."""
        model, axis = self._model(), self.axis
        if self._setting or model is None or axis is None:
            return
        timepoint = model.dims.current_step[axis]
        if timepoint != self._session.wanted:
            self._session.set_timepoint(timepoint)

    def _on_frame(self, _: Any = None) -> None:
        """Show the same timepoint of what has a t axis, unless another one is asked for."""
        model, axis, session = self._model(), self.axis, self._session
        if model is None or axis is None or session.wanted != session.timepoint:
            return
        if model.dims.current_step[axis] != session.timepoint:
            self._setting = True
            try:
                with undisturbed(model):
                    model.dims.set_current_step(axis, session.timepoint)
            finally:
                self._setting = False

    def close(self) -> None:
        """Leave the canvas alone."""
        self._session.frame_changed.disconnect(self._on_frame)
        model = self._model()
        if model is not None:
            model.dims.events.current_step.disconnect(self._on_step)
            model.layers.events.inserted.disconnect(self._on_frame)
            for key in KEYS:
                model.bind_key(key, None, overwrite=True)


def _time_axis(layer: Any, count: int) -> int | None:
    """Which axis of a layer is the time of a movie of so many timepoints."""
    if type(layer).__name__ not in ("Image", "Labels"):
        return None
    shape = layer.data.shape[: layer.ndim]
    names = [name.lower() for name in layer.axis_labels]
    for place, name in enumerate(names):
        if name in ("t", "time") and shape[place] == count:
            return place
    nameless = all(name.lstrip("-").isdigit() for name in names)
    return 0 if nameless and len(shape) > SPATIAL and shape[0] == count else None
