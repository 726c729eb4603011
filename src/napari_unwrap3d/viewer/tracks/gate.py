"""The gate of one viewer: only tracks that stay inside, or outside, of what is drawn; live.

Where tracks must stay is said by the parameters of measurements, so that what is seen is what is
measured. After every stroke it is found out anew, in a thread.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject, Signal

from ...charts import Tracks
from ...errors import Unwrap3DError
from ..common.per_viewer import OfViewer, PerViewer
from ..common.threads import Task, tell
from ..common.turns import soon
from ..movies.session import movie_session_of
from ..session import session_of
from .session import tracks_session_of

if TYPE_CHECKING:
    from ...annotations import Annotations
    from ...motion.movie import Movie
    from ...parameters import Parameters

# After the last change, so that a stroke does not wait for it.
REST_MS = 150
CLOSE_SECONDS = 5.0


class TrackGate(OfViewer):
    """Keeps the gate of a viewer's tracks as it is drawn. Get it with :func:`track_gate_of`.

    Attributes
    ----------
    reason : str
        Why nothing could be gated; empty if it could.
    busy : bool
        Whether it is being found out, or will be.

    Signals
    -------
    changed()
        Other tracks are kept, or it cannot be said which; or `busy`.
    listed()
        Annotations were added, removed or renamed; or there are others.
    """

    changed = Signal()
    listed = Signal()

    def __init__(self, viewer: Any, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.session = session_of(viewer)
        self.movies = movie_session_of(viewer)
        self.tracks = tracks_session_of(viewer)
        self.reason = ""
        self._annotations: Annotations | None = None
        self._task: Task | None = None
        self._again = self._closed = False
        self._now: tuple[Any, ...] = ()
        self._rest = soon(self, self._compute, REST_MS)
        self.session.parameters_changed.connect(self._on_parameters)
        self.movies.movie_changed.connect(self._on_movie)
        self.tracks.tracks_changed.connect(self._later)
        self._on_movie(self.movies.movie)

    # What it depends on -----------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Of the annotations of the movie."""
        return () if self._annotations is None else self._annotations.names

    @property
    def chosen(self) -> tuple[str, str, float]:
        """Inside, outside (empty: everywhere), and for which share of the life."""
        measurement = self.session.parameters.measurement
        return measurement.inside, measurement.outside, measurement.share

    def choose(self, **values: Any) -> None:
        """Set `inside`, `outside` or `share`."""
        self.session.set_values("measurement", values)

    @property
    def busy(self) -> bool:
        return self._task is not None or self._rest.isActive()

    def _on_movie(self, movie: Movie | None) -> None:
        self._leave()
        if movie is not None:
            self._annotations = movie.common.annotations
            for signal in _signals(self._annotations):
                signal.connect(self._later)
            self._annotations.listed.connect(self._on_listed)
        self._on_listed()
        self._later()

    def _leave(self) -> None:
        if self._annotations is not None:
            for signal in _signals(self._annotations):
                signal.disconnect(self._later)
            self._annotations.listed.disconnect(self._on_listed)
            self._annotations = None

    def _on_listed(self) -> None:
        if not self._closed:
            self.listed.emit()

    def _on_parameters(self, _: Any) -> None:
        if self._now != self.chosen:
            self._later()

    def _later(self, _: Any = None) -> None:
        if not self._closed:
            self._now = self.chosen
            self._rest.start()
            self.changed.emit()

    # Finding out ------------------------------------------------------------------------

    def _compute(self) -> None:
        movie, tracks = self.movies.movie, self.tracks.tracks
        inside, outside, _ = self.chosen
        if self._closed:
            return
        if movie is None or tracks is None or not (inside or outside):
            self._show(None, "")
        elif self._task is not None:
            self._again = True
        else:
            self._task = Task(_gated, movie, tracks, self.session.parameters)
            self._task.returned.connect(self._on_gated)
            self._task.failed.connect(self._on_failed)
            self._task.start()

    def _on_gated(self, found: tuple[Tracks, frozenset[int]]) -> None:
        self._task = None
        if self._go_on() and found[0] is self.tracks.tracks and any(self.chosen[:2]):
            self._show(found[1], "")

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        if self._go_on():
            self._show(None, str(error))
            # A name may stand for nothing yet, or no more: that is said beside the choice.
            if not isinstance(error, Unwrap3DError):
                tell(error)

    def _go_on(self) -> bool:
        """Do again what changed meanwhile; whether what was found is to be shown."""
        if self._again and not self._closed:
            self._again = False
            self._compute()
        return not self._closed

    def _show(self, kept: frozenset[int] | None, reason: str) -> None:
        self.reason = reason
        self.tracks.set_gate(kept)
        self.changed.emit()

    # The end ----------------------------------------------------------------------------

    def close(self) -> None:
        """Listen to nothing any more, and wait for the thread."""
        if self._closed:
            return
        self._closed = True
        self._rest.stop()
        self._leave()
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)


def _signals(annotations: Annotations) -> tuple[Any, ...]:
    """After which another gate may hold."""
    return annotations.changed, annotations.listed, annotations.times.edited


def _gated(movie: Movie, tracks: Tracks, parameters: Parameters) -> tuple[Tracks, frozenset[int]]:
    """In a thread."""
    from ...measuring.analysis import gated_tracks

    return tracks, frozenset(gated_tracks(movie, tracks, parameters).ids.tolist())


_GATES: PerViewer[TrackGate] = PerViewer(TrackGate, lambda viewer, gate: None)


def track_gate_of(viewer: Any) -> TrackGate:
    """The gate of a viewer (or of napari's proxy of it); made when first asked for."""
    return _GATES.of(viewer)
