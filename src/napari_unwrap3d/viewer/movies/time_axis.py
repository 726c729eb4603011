"""The timepoint of a movie and napari's own slider over t, kept in step both ways."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject

from ..views.placing import undisturbed

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from .session import MovieSession

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
        self._seen: tuple[Any, ...] = ()
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
        found = self._scale()
        return None if found is None else found.axis

    def _scale(self) -> TimeScale | None:
        model, movie = self._model(), self._session.movie
        return None if model is None or movie is None else time_scale(model, len(movie))

    @staticmethod
    def _reach(model: ViewerModel, scale: TimeScale) -> tuple[Any, ...]:
        """From where to where the slider goes; that changes with the layers only."""
        return model.dims.ndim, scale, tuple(model.dims.range[scale.axis])

    def _on_step(self, _: Any = None) -> None:
        """The person moved napari's slider."""
        model, scale = self._model(), self._scale()
        if self._setting or model is None or scale is None:
            return
        if self._reach(model, scale) != self._seen:
            # An axis that has just come, or got longer, begins somewhere: nobody moved it.
            self._on_frame()
            return
        session, timepoint = self._session, scale.timepoint(model)
        # Tracks may begin late and end early, and the slider with them.
        if timepoint != scale.nearest(model, session.wanted):
            session.set_timepoint(timepoint)

    def _on_frame(self, _: Any = None) -> None:
        """Show the same timepoint of what has a t axis, unless another one is asked for."""
        model, scale, session = self._model(), self._scale(), self._session
        if model is None or scale is None:
            return
        self._seen = self._reach(model, scale)
        if session.wanted != session.timepoint:
            return
        if scale.timepoint(model) != scale.nearest(model, session.timepoint):
            self._setting = True
            try:
                with undisturbed(model):
                    model.dims.set_point(scale.axis, scale.point(session.timepoint))
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


@dataclass(frozen=True)
class TimeScale:
    """The time of a movie in a canvas.

    Attributes
    ----------
    axis : int
        Of the canvas.
    start, step : float
        Where timepoint 0 is on it, and how far one timepoint is from the next.
    unit : str
    """

    axis: int
    start: float
    step: float
    unit: str

    def timepoint(self, model: ViewerModel) -> int:
        """That a canvas shows."""
        return round((model.dims.point[self.axis] - self.start) / self.step)

    def point(self, timepoint: int) -> float:
        """Where a timepoint is on the axis."""
        return self.start + timepoint * self.step

    def nearest(self, model: ViewerModel, timepoint: int) -> int:
        """The timepoint that the slider can show in the place of one."""
        low, high, _ = model.dims.range[self.axis]
        point = min(max(self.point(timepoint), low), high)
        return round((point - self.start) / self.step)


def time_scale(model: ViewerModel, count: int) -> TimeScale | None:
    """The time of a movie of so many timepoints in a canvas; None while nothing there has it.

    What was recorded goes before tracks, which are placed like it.
    """
    layers = sorted(model.layers, key=lambda layer: type(layer).__name__ == "Tracks")
    for layer in layers:
        place = _time_axis(layer, count)
        if place is not None:
            axis = int(model.dims.ndim - layer.ndim + place)
            start, step = float(layer.translate[place]), float(layer.scale[place])
            return TimeScale(axis, start, step, str(layer.units[place]))
    return None


def _time_axis(layer: Any, count: int) -> int | None:
    """Which axis of a layer is the time of a movie of so many timepoints."""
    if type(layer).__name__ == "Tracks":
        return 0 if layer.axis_labels[0] == "t" else None
    if type(layer).__name__ not in ("Image", "Labels"):
        return None
    shape = layer.data.shape[: layer.ndim]
    names = [name.lower() for name in layer.axis_labels]
    for place, name in enumerate(names):
        if name in ("t", "time") and shape[place] == count:
            return place
    nameless = all(name.lstrip("-").isdigit() for name in names)
    return 0 if nameless and len(shape) > SPATIAL and shape[0] == count else None
