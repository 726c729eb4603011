"""What is to be done for one cell or one movie, as a file that every worker can read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from ..files.atomic import write_text
from ..files.formats import Formats
from ..files.movie import MovieFolder
from ..motion.stages import MovieWork
from ..motion.timelapse import Source
from ..parameters import Parameters
from ..provenance import content_hash
from .inputs import Recipe

JOBS = "jobs"
Further = Literal["alike", "protrusions", "tracks", "measurements"]
# Tracks that are made of a movie; others are in it, or need not be kept.
PROTRUSIONS, MADE = "protrusions", ("protrusions", "flow")


class Exports(BaseModel):
    """What is written of single cells, beside the project, and of what is measured in movies.

    Attributes
    ----------
    formats : tuple of str
        See :class:`~napari_unwrap3d.files.formats.Formats`; of what is measured, that of tables.
    pictures : bool
        Of what is measured, whether there is a report with its figures.
    signals : tuple of str
        Channels that are sampled below the surface; those of movies are parameters of theirs.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    formats: tuple[str, ...] = ()
    pictures: bool = True
    signals: tuple[str, ...] = ()

    def chosen_formats(self) -> Formats:
        return Formats.named(self.formats)


class Job(BaseModel):
    """One cell or one movie.

    Attributes
    ----------
    name : str
        Of its folder in the output, its log and its rows.
    label : int or None
        Of a label image.
    timepoints : int or None
        Of a movie; None of a single cell.
    folder : str
        Absolute.
    track, measure : bool
        Of a movie, whether it is tracked, and whether its tracks are measured.
    measured_folder : str
        Where measurements are written; absolute.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    label: int | None
    timepoints: int | None
    recipe: Recipe
    parameters: Parameters
    folder: str
    exports: Exports = Exports()
    track: bool = False
    measure: bool = False
    measured_folder: str = ""

    @property
    def further(self) -> tuple[Further, ...]:
        """What is made of a movie once it is unwrapped, in this order.

        Its protrusions where the parameters ask for them or they are tracked: first what those of
        all timepoints have in common, then those of every timepoint.
        """
        followed = self.parameters.measurement.tracks
        tracked = (self.track or self.measure) and followed in MADE
        found: list[Further] = []
        if self.parameters.protrusions.compute or (tracked and followed == PROTRUSIONS):
            found += ["alike", "protrusions"]
        found += ["tracks"] * tracked
        return (*found, "measurements") if self.measure else tuple(found)

    def needed(self, stage: str) -> tuple[Further, ...]:
        """Without which of its own a stage after the frames cannot be done."""
        follows = self.parameters.measurement.tracks == PROTRUSIONS
        needs: dict[str, tuple[Further, ...]] = {
            "protrusions": ("alike",),
            "tracks": ("protrusions",) if follows else (),
            "measurements": ("tracks",),
        }
        return needs.get(stage, ())

    @property
    def file(self) -> str:
        """What the user gave; of several files, the first."""
        return self.recipe.name if self.recipe.kind == "record" else self.recipe.paths[0]

    def source(self) -> Source:
        """The source of a single cell."""
        return self.recipe.single(self.parameters.stack)

    def movie(self) -> MovieWork:
        """The work on a movie."""
        lapse = self.recipe.lapse(self.parameters.stack)
        return MovieWork(lapse, self.parameters, MovieFolder(Path(self.folder)))

    def save(self, output: Path) -> tuple[str, str]:
        """Write the job beside the results; its path and a hash of it."""
        text = self.model_dump_json(indent=1)
        path = output / JOBS / f"{self.name}.job.json"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            write_text(path, text)
        return str(path), content_hash(text)

    @classmethod
    def load(cls, path: str) -> Job:
        """The job that :meth:`save` wrote."""
        return cls.model_validate_json(Path(path).read_text(encoding="utf-8"))


def with_label(parameters: Parameters, label: int | None) -> Parameters:
    """The parameters for one label of a label image."""
    if label is None:
        return parameters
    stack = parameters.stack.model_copy(update={"label": label})
    return parameters.model_copy(update={"stack": stack})


def unique_names(names: Sequence[str]) -> list[str]:
    """Names of folders, each once: a number is appended to those that occur before."""
    taken: set[str] = set()
    found = []
    for name in names:
        number, unique = 1, name
        while unique.lower() in taken:  # file systems may not tell a from A
            number += 1
            unique = f"{name}-{number}"
        taken.add(unique.lower())
        found.append(unique)
    return found
