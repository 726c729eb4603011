"""A movie: the common space, and every timepoint in it, made when it is asked for."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..atlas import Atlas
from ..charts import Floats, Frame, FrameProtrusions, Stack, Tracks
from ..errors import InputError, Unwrap3DError
from ..files.movie import MovieFolder, is_movie, unpack
from ..parameters import Parameters
from ..pipeline import ProgressLike
from ..progress import Progress
from .common import EACH
from .stages import MovieWork, stages
from .tables import check_table, proposal, registration_table
from .timelapse import Source, Timelapse
from .views import atlas_in, own_atlas

if TYPE_CHECKING:
    import dask.array
    import pandas as pd

    from ..annotations import State

FRAMES_IN_MEMORY = 4
ATLASES_IN_MEMORY = 2


@dataclass(eq=False)
class Movie:
    """One cell over time in a common space, in which a place on it keeps its (u, v).

    Frames are read from the movie's folder when they are asked for, and made first where the
    source of the movie is known and they are not there. Memory is that of a few frames.

    Attributes
    ----------
    folder : MovieFolder
    work : MovieWork or None
        Makes what is not there yet; None for a movie that was opened without its source.
    """

    folder: MovieFolder
    work: MovieWork | None = None

    def __post_init__(self) -> None:
        self._manifest = self.folder.manifest()
        self._frames = lru_cache(FRAMES_IN_MEMORY)(self.folder.frame)
        self._atlases: dict[int, tuple[str | None, Atlas]] = {}

    @classmethod
    def open(cls, path: str | Path, work: MovieWork | None = None) -> Movie:
        """A movie from its folder, or from the one file that it was saved in.

        Raises
        ------
        FileFormatError
            It is no movie, damaged, or of another version.
        """
        path = Path(path)
        if path.is_dir() or not is_movie(path):
            return cls(MovieFolder(path), work)
        folder = _temporary_folder()
        try:
            return cls(unpack(path, folder), work)._owning()
        except Unwrap3DError:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def _owning(self) -> Movie:
        """The movie, whose folder goes with it."""
        weakref.finalize(self, shutil.rmtree, self.folder.path, ignore_errors=True)
        return self

    def go_on_with(self, work: MovieWork) -> None:
        """Its frames are those of other parameters now; the common space stays."""
        self.work, self._manifest = work, self.folder.manifest()
        self.__dict__.pop("parameters", None)
        self._frames.cache_clear()

    # What it is of -----------------------------------------------------------------

    def __len__(self) -> int:
        return int(self._manifest["timepoints"])

    @property
    def name(self) -> str:
        return str(self._manifest["name"])

    @property
    def time_step_s(self) -> float:
        """Seconds between two timepoints."""
        return float(self._manifest["time_step_s"])

    @property
    def times_s(self) -> Floats:
        """Seconds (T,) since the first timepoint."""
        return np.arange(len(self), dtype=np.float64) * self.time_step_s

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(self._manifest["channels"])

    @cached_property
    def parameters(self) -> Parameters:
        return Parameters.from_toml(str(self._manifest["parameters"]))

    # The common space --------------------------------------------------------------

    @cached_property
    def common(self) -> Atlas:
        """The atlas of the common space: of the temporal mean, or of one timepoint.

        What was drawn on it is in its annotations; what was drawn on single timepoints is in
        their :class:`~napari_unwrap3d.annotations.times.Times`.
        """
        from ..files.movie_annotations import restore_timed
        from ..files.project import load_project

        if self.folder.common() is None:
            raise InputError("The movie has no common space yet.", hint="Call compute().")
        atlas = load_project(self.folder.common_path)
        restore_timed(self.folder, atlas)
        return atlas

    def has_common(self, atlas: Atlas | None) -> bool:
        """Whether an atlas is the one of its common space; nothing is read for it."""
        return atlas is not None and self.__dict__.get("common") is atlas

    def use_common(self, atlas: Atlas) -> None:
        """Take an atlas that was read from its folder already: what is drawn on it is its own."""
        self.__dict__["common"] = atlas

    @property
    def record(self) -> dict[str, Any]:
        """How the common space was chosen: ``method``, ``timepoint``, ``recommendation``."""
        return self.folder.common() or {}

    # Frames ------------------------------------------------------------------------

    def has_frame(self, timepoint: int) -> bool:
        """Whether the frame of a timepoint is there, of the common space as it is."""
        if self.work is not None:
            return self.folder.has_frame(timepoint, self.work.frame_key(timepoint))
        return self.folder.frame_key(timepoint) is not None

    def is_lost(self, timepoint: int) -> bool:
        """Whether a timepoint has no frame because it could not be made (in a batch)."""
        lost = self.work is None or self.folder.failure(timepoint) is not None
        return lost and not self.has_frame(timepoint)

    def frame(self, timepoint: int, progress: Progress | None = None) -> Frame:
        """One timepoint in the common space; made first if it is not there.

        Raises
        ------
        InputError
            There is no such timepoint, or it was not made and the source is not known.
        """
        if not 0 <= timepoint < len(self):
            raise InputError(f"There is no timepoint {timepoint}.", timepoints=len(self))
        if not self.has_frame(timepoint):
            failure = self.folder.failure(timepoint)
            if failure is not None:
                raise InputError(
                    f"Timepoint {timepoint} could not be made: {failure['reason']}",
                    stage=failure["stage"],
                    hint="Run the batch again to try it once more.",
                )
            if self.work is None:
                raise InputError(
                    f"The frame of timepoint {timepoint} was not made.",
                    hint="Run `napari-unwrap3d batch` on the source to make what is missing.",
                )
            self.work.frame(timepoint, progress or Progress())
            self._frames.cache_clear()
        return self._frames(timepoint)

    def atlas(self, timepoint: int, progress: Progress | None = None) -> Atlas:
        """One timepoint as the atlas of a cell, made when it is asked for.

        In a common space its reference, sphere and (d, u, v) space are those of all timepoints;
        where every timepoint has its own, it is that one, aligned with the common one.

        Raises
        ------
        InputError
            As :meth:`frame`.
        """
        frame = self.frame(timepoint, progress)
        key = self.folder.frame_key(timepoint)
        kept = self._atlases.pop(timepoint, None)
        if kept is None or kept[0] != key:
            kept = (key, self._atlas_of(frame, progress or Progress()))
        while len(self._atlases) >= ATLASES_IN_MEMORY:
            del self._atlases[next(iter(self._atlases))]
        self._atlases[timepoint] = kept
        return kept[1]

    def _atlas_of(self, frame: Frame, progress: Progress) -> Atlas:
        from ..files.project import load_project

        source = {
            "name": f"{self.name}, timepoint {frame.timepoint}",
            "kind": "movie",
            "hash": self.folder.frame_key(frame.timepoint),
        }
        if self.record.get("method") == EACH:
            own = load_project(self.folder.atlas_path(frame.timepoint), progress)
            return own_atlas(own, frame, source)
        return atlas_in(self.common, frame, source, progress)

    def frames(self) -> Iterator[Frame]:
        """All frames in the order of time, one in memory at a time; lost ones are left out."""
        for timepoint in range(len(self)):
            if not self.is_lost(timepoint):
                yield self.frame(timepoint)

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the uv stacks."""
        return tuple(self._first().uv)

    def _first(self) -> Frame:
        """The first frame that there is."""
        found = next(self.frames(), None)
        if found is None:
            raise InputError("The movie has no frame.", timepoints=len(self))
        return found

    def uv(self, name: str) -> dask.array.Array:
        """The uv stack of a field: (t, v, u) float32, lazily, a frame at a time.

        Of lost timepoints it is NaN.
        """
        import dask.array

        first = self._first().uv
        if name not in first:
            raise InputError(f"There is no field {name!r}.", hint=f"Fields: {', '.join(first)}.")

        def image(block_info: Any = None) -> npt.NDArray[Any]:
            timepoint = block_info[None]["chunk-location"][0]
            if self.is_lost(timepoint):
                return np.full((1, *first[name].shape), np.nan, first[name].dtype)
            return self.frame(timepoint).uv[name][None]

        stacked: dask.array.Array = dask.array.map_blocks(  # type: ignore[no-untyped-call]
            image,
            chunks=((1,) * len(self), *((n,) for n in first[name].shape)),
            dtype=first[name].dtype,
            meta=np.empty((0, 0, 0), first[name].dtype),
        )
        return stacked

    def compute(self, progress: ProgressLike = None) -> Movie:
        """Make everything that is not there yet, one piece after the other.

        Raises
        ------
        Cancelled
            The user asked to stop; what was made stays.
        """
        if self.work is None:
            raise InputError(
                "The source of the movie is not known.", hint="Open it with its source."
            )
        run_stages(self.work, progress, until="frame")
        self.__dict__.pop("common", None)
        self._frames.cache_clear()
        return self

    # Protrusions and tracks --------------------------------------------------------

    def protrusions(
        self,
        timepoint: int,
        parameters: Parameters | None = None,
        progress: Progress | None = None,
    ) -> FrameProtrusions:
        """The protrusions of a timepoint; found first if they are not there.

        Parameters
        ----------
        timepoint : int
        parameters : Parameters, optional
            Those of the movie unless given.
        progress : Progress, optional

        Raises
        ------
        InputError
            As :meth:`frame`.
        """
        from ..tracking.detections import protrusions_of

        return protrusions_of(self, timepoint, parameters or self.parameters, progress)

    @property
    def track_names(self) -> tuple[str, ...]:
        """The tracks that were kept, by name."""
        return tuple(self.folder.track_names())

    def tracks(self, name: str = "protrusions") -> Tracks:
        """Tracks that were kept.

        Raises
        ------
        InputError
            There are none of this name.
        """
        found = self.folder.tracks(name)
        if found is None:
            raise InputError(
                f"The movie has no tracks named {name!r}.",
                tracks=list(self.track_names),
                hint="Make them with track_protrusions or track_flow, or `napari-unwrap3d track`.",
            )
        return found

    def keep_tracks(self, name: str, tracks: Tracks, key: str = "") -> None:
        """Keep tracks in the movie's folder, instead of others of this name.

        Parameters
        ----------
        name : str
        tracks : Tracks
        key : str
            Hash of what they were made from.
        """
        self.folder.keep_tracks(name, tracks, key)

    # Tables ------------------------------------------------------------------------

    def registration_table(self) -> pd.DataFrame:
        """A row per timepoint: how the cell has moved, and how well it was moved back.

        Returns
        -------
        DataFrame
            ``timepoint``, ``time_s``; ``shift_z_um``, ``shift_y_um``, ``shift_x_um`` and
            ``shift_um`` of the cell's middle since the first timepoint, and ``angle_deg`` by
            which the cell has turned; ``residual_before`` and ``residual``: 1 − correlation with
            the first timepoint, as recorded and registered, where the two correspond; and
            ``corresponding``, the part of the places in and around the cell that do. Of every
            channel that was registered, ``shift_z_um_0``, … ``angle_deg_0`` with its name or
            number. NaN where nothing was registered.
        """
        return registration_table(self)

    def check_table(self) -> pd.DataFrame:
        """A row per timepoint: what its surface measures, and what of it leaves the shell.

        Returns
        -------
        DataFrame
            ``timepoint``, ``time_s``, ``made`` (whether its frame was made), and of those that
            were: ``area_um2`` and ``volume_um3`` of the surface, ``outside_area_um2`` and
            ``outside_fraction`` of what of it leaves the shell, and ``empty_area_um2`` and
            ``empty_fraction`` of the part of the reference over which there is none.
        """
        return check_table(self)

    def proposal(self) -> str:
        """Why another common space is proposed, in words for the user; empty if none is.

        Where too much of a timepoint's surface leaves the mapped shell, every timepoint should
        have its own atlas (paper, "Individual blebs dynamically recruit Septins").
        """
        return proposal(self)

    # Files -------------------------------------------------------------------------

    def keep_annotations(self, state: State | None = None) -> None:
        """Write what was drawn on the common space, and on single timepoints, into the folder.

        Parameters
        ----------
        state : State, optional
            ``movie.common.annotations.state()``, where it is drawn on while this runs.
        """
        from ..files.movie_annotations import keep_annotations

        keep_annotations(self.folder, state or self.common.annotations.state())

    def save(self, path: str | Path, progress: Progress | None = None) -> Path:
        """Write everything into one ``*.unwrap3d`` file, which :func:`load_movie` opens."""
        drawn = self.__dict__["common"].annotated if "common" in self.__dict__ else None
        if drawn is not None:
            self.keep_annotations(drawn.state())
        return self.folder.pack(Path(path), progress)


def unwrap_movie(
    source: Stack | Sequence[Source],
    parameters: Parameters | None = None,
    progress: ProgressLike = None,
    *,
    time_step: float | None = None,
    folder: str | Path | None = None,
) -> Movie:
    """Unwrap a timelapse into one common space.

    The timepoints are registered and segmented, and the common space is built; frames are
    made when they are asked for, or all at once by :meth:`Movie.compute`.

    Parameters
    ----------
    source : Stack with a t axis, or sequence of Stack, Mask or Surface
    parameters : Parameters, optional
    progress : Progress, or callable(stage, fraction, message), optional
    time_step : float, optional
        Seconds between two timepoints, where the stack does not tell.
    folder : path, optional
        Where the pieces are kept: what is there already is not made again. By default a
        temporary folder that lives as long as the movie; see :meth:`Movie.save`.

    Returns
    -------
    Movie

    Raises
    ------
    InputError, AxesError
        See :meth:`Timelapse.of`.
    Unwrap3DError
        A timepoint could not be segmented, or the common space not be built.
    """
    lapse = Timelapse.of(source, time_step)
    path = _temporary_folder() if folder is None else Path(folder)
    work = MovieWork(lapse, parameters or Parameters(), MovieFolder(path))
    work.begin()
    movie = Movie(work.folder, work)
    if folder is None:
        movie._owning()
    run_stages(work, progress, until="common")
    return movie


def _temporary_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="unwrap3d-movie-"))


def load_movie(path: str | Path) -> Movie:
    """Open a saved movie: its folder, or the one file it was saved in."""
    return Movie.open(path)


def run_stages(work: MovieWork, progress: ProgressLike, until: str) -> None:
    """All pieces of work up to a stage, one after the other."""
    report = progress if isinstance(progress, Progress) else Progress(progress)
    for stage, timepoints in stages(len(work.lapse)):
        part = report.named(stage)
        for timepoint in timepoints:
            span = part.part(timepoint / len(timepoints), (timepoint + 1) / len(timepoints))
            span(0.0, f"timepoint {timepoint}" if len(timepoints) > 1 else "")
            work.run(stage, timepoint, span)
        part(1.0, "done")
        if stage == until:
            return
