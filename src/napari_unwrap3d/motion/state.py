"""How far a movie is: which pieces of work are done, and which belong to other parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..files.movie import MovieFolder
from ..progress import Progress, silent
from .stages import MovieWork, Stage, stages

MISSING, STALE, DONE = "missing", "stale", "done"
# Where the folder of a movie has the pieces of a stage.
PLACES: dict[Stage, str] = {"register": "registration", "segment": "masks", "frame": "frames"}


@dataclass
class MovieState:
    """Of every piece of work, whether it is there.

    Attributes
    ----------
    pieces : dict
        Stage → "missing", "stale" (made with other parameters) or "done" of every timepoint;
        the common space is one piece.
    """

    pieces: dict[Stage, list[str]] = field(default_factory=dict)

    def count(self, stage: Stage, state: str = DONE) -> int:
        """How many pieces of a stage are in a state."""
        return self.pieces.get(stage, []).count(state)

    def of(self, stage: Stage) -> str:
        """The state of a stage as a whole: done when every piece of it is."""
        found = self.pieces.get(stage, [])
        if found and all(piece == DONE for piece in found):
            return DONE
        return STALE if STALE in found else MISSING

    def set(self, stage: Stage, timepoint: int, state: str) -> None:
        """One piece was made."""
        self.pieces[stage][timepoint] = state

    @classmethod
    def missing(cls, timepoints: int) -> MovieState:
        """Of a movie of which nothing is done."""
        return cls({stage: [MISSING] * len(each) for stage, each in stages(timepoints)})


def state_of(work: MovieWork, progress: Progress | None = None) -> MovieState:
    """What of a movie is there; reads the source of every timepoint once for its key.

    Parameters
    ----------
    work : MovieWork
    progress : Progress, optional
    """
    report = progress if progress is not None else silent()
    state = MovieState.missing(len(work.lapse))
    for timepoint in range(len(work.lapse)):
        report(timepoint / len(work.lapse), "looking for what is there")
        for stage in ("register", "segment"):
            state.set(stage, timepoint, piece_state(work, stage, timepoint))
    state.set("common", 0, piece_state(work, "common", 0))
    for timepoint in range(len(work.lapse)):
        found = piece_state(work, "frame", timepoint)
        # A frame is of the space that is there, and as stale as that.
        held = found != DONE or state.of("common") == DONE
        state.set("frame", timepoint, found if held else STALE)
    report(1.0)
    return state


def piece_state(work: MovieWork, stage: Stage, timepoint: int) -> str:
    """Whether one piece of work is there, and of these parameters."""
    folder = work.folder
    if stage == "common":
        record = folder.common()
        if record is None:
            return MISSING
        return DONE if record["key"] == work.common_key() else STALE
    if stage == "register":
        done = folder.registered(timepoint, work.registration_key(timepoint)) is not None
    elif stage == "segment":
        done = folder.has_mask(timepoint, work.mask_key(timepoint))
    else:
        done = folder.has_frame(timepoint, work.frame_key(timepoint))
    if done:
        return DONE
    there = any((folder.path / PLACES[stage]).glob(f"{timepoint:05d}.*"))
    return STALE if there else MISSING


def state_in(folder: MovieFolder) -> MovieState:
    """What of a movie is there, where its source is not known: all that is there is taken as done.

    Raises
    ------
    FileFormatError
        The folder is no movie.
    """
    timepoints = int(folder.manifest()["timepoints"])
    state = MovieState.missing(timepoints)
    for stage, place in PLACES.items():
        found = {path.stem for path in (folder.path / place).glob("*")}
        for timepoint in range(timepoints):
            if f"{timepoint:05d}" in found:
                state.set(stage, timepoint, DONE)
    if folder.common() is not None:
        state.set("common", 0, DONE)
    return state
