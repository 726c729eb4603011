"""What a movie can be coloured by: the fields of a frame, and those of the common space.

A field of a frame is given on the frame's own mesh ("frame") and in uv, ``S^t(u, v)``, from
where it is carried to the charts of the common space like any other. Its colours are the same
at every timepoint: they come from a sample of the frames.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import numpy.typing as npt

from ..atlas import Atlas
from ..charts import Frame
from ..errors import ChartMissingError
from ..fields import CURVATURE, HEIGHT, SIGNAL, Colours, Field, Fields, Values, colours_of
from ..places import Place
from ..progress import Progress
from .frames import AREA
from .movie import Movie
from .shown_frames import ShownFrame

FRAME = "frame"
DEFICIT = "gaussian_curvature"
SAMPLED_FRAMES = 8
# Of each sampled frame: percentiles of a part are near enough.
SAMPLED_VALUES = 20_000

TITLES = {
    CURVATURE: ("Mean curvature", "1/µm"),
    HEIGHT: ("Height d", "µm"),
    DEFICIT: ("Gaussian curvature, integrated", "sr"),
    AREA: ("Area element dA of a pixel", "µm²"),
}


class MovieColours:
    """Colormap and limits of the fields of a movie, the same for all frames.

    Parameters
    ----------
    movie : Movie
    """

    def __init__(self, movie: Movie) -> None:
        self._movie = movie
        self._known: dict[str, Colours] = {}
        self._lock = threading.Lock()
        self._sampled = 0

    def known(self, name: str) -> bool:
        """Whether the colours are there, so that asking for them reads no file."""
        return name in self._known

    def of(self, name: str) -> Colours:
        """Colormap and limits of a field; reads a few frames when it is first called."""
        with self._lock:
            if name not in self._known:
                self._sample()
            return self._known[name]

    def renew(self) -> None:
        """Frames were made: those that count are sampled when colours are next asked for."""
        if self._sampled < SAMPLED_FRAMES:
            with self._lock:
                self._known = {}

    def _sample(self) -> None:
        folder = self._movie.folder
        made = [t for t in range(len(self._movie)) if folder.frame_key(t) is not None]
        if not made:
            raise ChartMissingError("No frame of the movie was made yet.")
        places = np.linspace(0, len(made) - 1, min(SAMPLED_FRAMES, len(made)))
        values: dict[str, list[npt.NDArray[Any]]] = {}
        for place in np.rint(places).astype(int):
            frame = folder.frame(made[place])
            for name in frame.uv:
                given = np.asarray(given_on_mesh(frame, name)).ravel()
                values.setdefault(name, []).append(given[:: len(given) // SAMPLED_VALUES + 1])
        self._sampled = len(places)
        self._known = {name: colours_of(name, np.concatenate(v)) for name, v in values.items()}


def given_on_mesh(frame: Frame, name: str) -> npt.NDArray[Any]:
    """Values per vertex; of the area element, which is one of pixels, those of the pixels."""
    on_mesh = name in frame.surface.fields and name != AREA
    return np.asarray(frame.surface.fields[name] if on_mesh else frame.uv[name])


class FrameFields(Fields):
    """The fields of one timepoint on every chart, and those of the common space beside them.

    Parameters
    ----------
    atlas : Atlas
        Of the common space.
    shown : ShownFrame
    colours : MovieColours
    channels : tuple of str
        Names of the movie's channels.
    """

    def __init__(
        self, atlas: Atlas, shown: ShownFrame, colours: MovieColours, before: Fields | None = None
    ) -> None:
        self.shown = shown
        self._movie_colours = colours
        super().__init__(atlas, None)
        if before is not None:
            self.adopt(before)

    def renew(self) -> bool:
        """See :meth:`Fields.renew`; the fields of the frames stay first."""
        changed = super().renew()
        moving = {field.name: field for field in _moving(self.shown.frame)}
        static = {n: f for n, f in self._fields.items() if n not in moving and n != _DIVIDED}
        self._fields = moving | static
        return changed

    def moves(self, name: str) -> bool:
        """Whether a field is another one at every timepoint."""
        return name in self.shown.frame.uv

    def known(self, name: str, chart: str) -> bool:
        """See :meth:`Fields.known`; what a frame holds is there with it."""
        if self.moves(name) and chart in ("uv", FRAME):
            return self._movie_colours.known(name)
        return super().known(name, "uv" if chart == FRAME else chart)

    def values(self, name: str, chart: str, progress: Progress | None = None) -> Values:
        """See :meth:`Fields.values`; on the chart "frame" one per vertex of the frame's surface."""
        if self.moves(name):
            self._movie_colours.of(name)
        key = (name, FRAME)
        if chart != FRAME:
            return super().values(name, chart, progress)
        if key not in self._values:
            frame = self.shown.frame
            if self.moves(name) and name != AREA:
                found = np.ascontiguousarray(frame.surface.fields[name], dtype=np.float32)
            else:
                found = self.shown.sampled(self.values(name, "uv", progress))
            self._values[key] = found
        return self._values[key]

    def reachable(self, name: str, chart: str) -> bool:
        """See :meth:`Fields.reachable`."""
        return super().reachable(name, "uv" if chart == FRAME else chart)

    def colours(self, name: str) -> Colours:
        """Colormap and limits, the same on every chart and at every timepoint."""
        return self._movie_colours.of(name) if self.moves(name) else super().colours(name)

    def at_place(self, name: str, place: Place) -> float | None:
        """The value at a place of the frame, as its uv image shows it."""
        if place.uv is None or not self.known(name, "uv"):
            return None
        image = self.values(name, "uv")
        v, u = np.floor(np.asarray(place.uv) + 0.5).astype(int)
        value = float(image[int(np.clip(v, 0, len(image) - 1)), u % image.shape[1]])
        return value if np.isfinite(value) else None

    def adopt(self, other: Fields) -> None:
        """Take over what does not move of another timepoint."""
        if not isinstance(other, FrameFields) or other._atlas() is not self._atlas():
            return
        self._shell = self._shell or other._shell
        for (name, chart), values in other._values.items():
            static = name in self._fields and not self.moves(name) and chart != FRAME
            if static and (not name.startswith("protrusion_") or self._found is other._found):
                self._values.setdefault((name, chart), values)

    def _at_home(self, field: Field, progress: Progress) -> npt.NDArray[Any]:
        if self.moves(field.name):
            return self.shown.frame.uv[field.name]
        return super()._at_home(field, progress)


# What the common space's own surface has in the place of the frames' DEFICIT.
_DIVIDED = "gaussian_curvature_per_um2"


def _moving(frame: Frame) -> list[Field]:
    """The fields of a frame, the most useful first."""
    names = [CURVATURE, HEIGHT, *(n for n in frame.uv if n.startswith(SIGNAL))]
    names += [n for n in frame.uv if n not in names]
    return [Field(n, *_title(n), "uv") for n in names if n in frame.uv]


def _title(name: str) -> tuple[str, str]:
    if name in TITLES:
        return TITLES[name]
    if name.startswith(SIGNAL):
        above, _, below = name.removeprefix(SIGNAL).partition("_per_")
        return (f"Signal: {above} / {below}" if below else f"Signal: {above}"), ""
    return name.replace("_", " "), ""
