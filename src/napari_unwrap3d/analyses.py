"""A whole analysis from one TOML file: from a recording to tracks, measurements and a report.

``napari-unwrap3d analyse FILE.toml -o FOLDER`` does what the commands ``batch``, ``track`` and
``measure`` do one after the other, and draws regions by a rule where nobody draws them by hand.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from .charts import Floats, Mask, Stack, Tracks
from .errors import InputError, ParameterError
from .parameters import Parameters
from .progress import Progress
from .tracking.relations import EDITED

if TYPE_CHECKING:
    from .measuring.measurements import Measurements
    from .motion.movie import Movie

MOVIE_FOLDER, ANALYSIS = "movie", "analysis.toml"
# Groups of parameters that tracks depend on.
TRACKED = ("tracking", "boxes", "flow")
SIMULATED_VOXEL_UM = (0.3, 0.15, 0.15)
Size3 = tuple[float, float, float]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Source(_Table):
    """What is analysed: a recording, a movie that was unwrapped, or a simulation.

    Attributes
    ----------
    stack : path, optional
        A stack over time; relative to the TOML file.
    mask : bool
        The stack is a mask: not 0 is cell.
    movie : path, optional
        A folder or ``*.unwrap3d`` of a movie that was unwrapped.
    simulated : str, optional
        The kind of a simulated movie: "blebs", "ruffles", "filopodia".
    seed, timepoints, size : int
        Of the simulation.
    voxel_size : (z, y, x) in µm, optional
        Of the stack, where the file does not tell, or of the simulation.
    time_step : float, optional
        Seconds between two timepoints, where the file does not tell.
    axes, dataset : str, optional
        As of ``read_stack``.
    """

    stack: Path | None = None
    mask: bool = False
    movie: Path | None = None
    simulated: str | None = None
    seed: int = 0
    timepoints: int = 40
    size: int = 112
    voxel_size: Size3 | None = None
    time_step: float | None = None
    axes: str | None = None
    dataset: str | None = None

    @model_validator(mode="after")
    def _one_of_three(self) -> Source:
        named = [self.stack, self.movie, self.simulated]
        if sum(each is not None for each in named) != 1:
            raise ValueError("name one of stack, movie and simulated")
        return self


class Region(_Table):
    """An annotation that is drawn by a rule: what looks one way, and lies far that way.

    Attributes
    ----------
    name : str
    label : int
    facing : (z, y, x)
        The direction.
    within_deg : float
        Largest angle between it and the surface's normal.
    depth_um : float, optional
        How far below the farthest point along it; without limit unless given.
    """

    name: str
    label: int = Field(1, ge=1)
    facing: Size3
    within_deg: float = Field(30.0, gt=0, le=180)
    depth_um: float | None = Field(None, gt=0)


class Analysis(_Table):
    """A whole analysis.

    Attributes
    ----------
    title : str
        Of the report.
    source : Source
    preset : str, optional
        The paper's values for a kind of protrusion.
    parameters : mapping
        Groups of parameters, over those of the preset.
    regions : list of Region
        Drawn unless the movie has an annotation of that name.
    measure : list of mapping
        What is measured, each a group ``measurement`` over that of `parameters`, whose ``tracks``
        say what is tracked, too. In it there may be groups ``tracking``, ``boxes`` and ``flow``
        for these tracks, and a ``name``, under which they are kept and the results are written.
    formats : list of str
        Suffixes of the files that the tracks are written to.
    tables : "csv" or "parquet"
    folder : path
        Where relative paths begin.
    text : str
        The file as it was read.
    """

    title: str = ""
    source: Source
    preset: str | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)
    regions: list[Region] = Field(default_factory=list)
    measure: tuple[dict[str, Any], ...] = ({},)
    formats: tuple[Literal[".geff", ".csv", ".parquet", ".xml"], ...] = (".geff", ".csv", ".xml")
    tables: Literal["csv", "parquet"] = "csv"
    folder: Path = Path()
    text: str = ""

    @classmethod
    def from_toml(cls, path: str | Path) -> Analysis:
        """Read a file.

        Raises
        ------
        ParameterError
            It is no TOML, or something in it is not known or wrong.
        """
        path = Path(path)
        try:
            text = path.read_text(encoding="utf-8")
            read = cls(**{**tomllib.loads(text), "folder": path.parent, "text": text})
        except tomllib.TOMLDecodeError as error:
            raise ParameterError(f"{path.name!r} is not valid TOML: {error}.") from None
        except ValidationError as error:
            problems = "; ".join(
                f"{'.'.join(map(str, item['loc'])) or 'source'}: {item['msg']}"
                for item in error.errors()
            )
            raise ParameterError(
                f"{path.name!r} is no analysis: {problems}.",
                hint="docs/tracks_files.md tells what such a file holds.",
            ) from None
        read.chosen()
        return read

    def chosen(self) -> tuple[Parameters, list[Wanted]]:
        """Parameters of the movie, and everything that is measured.

        Raises
        ------
        ParameterError
            One is not known or not valid, or two results have the same name.
        """
        base = Parameters.preset(self.preset) if self.preset else Parameters()
        base = over(base, self.parameters)
        wanted = [_wanted(base, entry) for entry in self.measure]
        names = [one.name for one in wanted if one.name]
        if len(set(names)) < len(names):
            raise ParameterError("Two of what is measured have the same name.", names=names)
        return base, wanted


@dataclass(frozen=True)
class Wanted:
    """Something that is measured.

    Attributes
    ----------
    parameters : Parameters
        Of which ``measurement.tracks`` names the tracks.
    name : str
        Of the results, and under which the tracks are kept; that of the tracks where empty.
    """

    parameters: Parameters
    name: str = ""

    @property
    def made_from(self) -> tuple[str, ...]:
        """What its tracks depend on."""
        groups = (getattr(self.parameters, group).model_dump_json() for group in TRACKED)
        return (self.parameters.measurement.tracks, *groups)


def _wanted(base: Parameters, entry: Mapping[str, Any]) -> Wanted:
    groups = {group: entry[group] for group in TRACKED if group in entry}
    own = {key: value for key, value in entry.items() if key not in (*TRACKED, "name")}
    return Wanted(over(base, {**groups, "measurement": own}), str(entry.get("name", "")))


def over(parameters: Parameters, groups: Mapping[str, Mapping[str, Any]]) -> Parameters:
    """Parameters with other values in some groups.

    Raises
    ------
    ParameterError
        A group or a parameter is not known, or a value not valid.
    """
    values: dict[str, Any] = parameters.model_dump(exclude_unset=True)
    for step, group in groups.items():
        if not isinstance(group, Mapping):
            raise ParameterError(f"{step!r} is no group of parameters.", got=group)
        values[step] = {**values.get(step, {}), **group}
    return Parameters.from_dict(values)


# Running -------------------------------------------------------------------------

Result = TypeVar("Result")


def run_analysis(
    analysis: Analysis, output: Path, progress: Progress, *, overwrite: bool = False
) -> list[Measurements]:
    """Unwrap, track, measure, and write everything into a folder.

    Parameters
    ----------
    analysis : Analysis
    output : path
        Gets ``movie`` (the unwrapped movie, with which an analysis that was stopped goes on) and
        what :func:`~napari_unwrap3d.files.measured.write_measured` writes.
    progress : Progress
    overwrite : bool
        Replace what an earlier analysis has written.

    Returns
    -------
    list of Measurements
        One for each entry of ``analysis.measure``.
    """
    from .files.measured import check_output, write_measured

    check_output(output, overwrite)
    parameters, wanted = analysis.chosen()
    movie = unwrapped_movie(analysis, parameters, output / MOVIE_FOLDER, progress)
    draw_regions(movie, analysis.regions)
    found = measured(movie, wanted, progress, anew=True)
    write_measured(
        movie,
        found,
        output,
        names=[one.name for one in wanted],
        title=analysis.title or movie.name,
        track_suffixes=analysis.formats,
        table_suffix=f".{analysis.tables}",
        texts={ANALYSIS: analysis.text} if analysis.text else None,
        progress=progress.named("report"),
    )
    return found


def unwrapped_movie(
    analysis: Analysis, parameters: Parameters, folder: Path, progress: Progress
) -> Movie:
    """The movie of an analysis: opened, or made in a folder from what is there already."""
    from .motion.movie import load_movie, unwrap_movie

    source = analysis.source
    if source.movie is not None:
        return load_movie(_existing(analysis.folder / source.movie))
    stack = _simulated(source) if source.simulated else _recorded(analysis)
    masks = _masks(stack) if source.mask else stack
    step = stack.time_step if source.time_step is None else source.time_step
    return unwrap_movie(masks, parameters, progress, time_step=step, folder=folder).compute(
        progress
    )


def _existing(path: Path) -> Path:
    if not path.exists():
        raise InputError(f"There is no {str(path)!r}.")
    return path


def _simulated(source: Source) -> Stack:
    from .simulate.movies import MOVIES, movie

    if source.simulated not in MOVIES:
        raise ParameterError(
            f"There is no movie of kind {source.simulated!r}.", hint=f"Kinds: {', '.join(MOVIES)}."
        )
    return movie(
        source.simulated,
        source.seed,
        timepoints=source.timepoints,
        size=source.size,
        time_step=source.time_step,
        voxel_size=source.voxel_size or SIMULATED_VOXEL_UM,
    ).stack


def _recorded(analysis: Analysis) -> Stack:
    from .files.stacks import read_stack

    source = analysis.source
    assert source.stack is not None
    return read_stack(
        _existing(analysis.folder / source.stack),
        source.voxel_size,
        source.time_step,
        axes=source.axes,
        dataset=source.dataset,
    )


def _masks(stack: Stack) -> list[Mask]:
    count = stack.shape[stack.axes.index("t")] if "t" in stack.axes else 1
    return [
        Mask(np.asarray(stack.volume(timepoint, 0)) != 0, stack.voxel_size)
        for timepoint in range(count)
    ]


def draw_regions(movie: Movie, regions: list[Region]) -> None:
    """Draw regions as annotations of the common space, where there are none of their names.

    Raises
    ------
    InputError
        Nothing of the surface is in one.
    """
    drawn = movie.common.annotations
    new = [region for region in regions if region.name not in drawn.names]
    for name in dict.fromkeys(region.name for region in new):
        drawn.add(name)
    for region in new:
        drawn.draw_vertices(region.name, np.flatnonzero(_inside(movie, region)), region.label)
    if new:
        movie.keep_annotations()


def _inside(movie: Movie, region: Region) -> npt.NDArray[np.bool_]:
    from .geometry.mesh import vertex_normals

    surface = movie.common.surface
    direction: Floats = np.asarray(region.facing, np.float64)
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ParameterError(f"The region {region.name!r} faces nowhere.", facing=region.facing)
    direction = direction / length
    normals = vertex_normals(surface.vertices, surface.faces)
    inside = normals @ direction >= np.cos(np.radians(region.within_deg))
    if region.depth_um is not None:
        along = surface.vertices @ direction
        inside &= along >= along.max() - region.depth_um
    if not inside.any():
        raise InputError(
            f"Nothing of the surface is in the region {region.name!r}.",
            hint="Widen within_deg or depth_um.",
        )
    marked: npt.NDArray[np.bool_] = inside
    return marked


def measured(
    movie: Movie, wanted: list[Wanted], progress: Progress, *, anew: bool = False
) -> list[Measurements]:
    """Measure tracks; they are made where they are not there.

    Parameters
    ----------
    movie : Movie
    wanted : list of Wanted
    progress : Progress
    anew : bool
        Whether tracks that are there are made again, unless a person has edited them.
    """
    from .measuring.analysis import measure_tracks

    made: dict[tuple[str, ...], Tracks] = {}
    found = []
    for one in wanted:
        own = one.parameters.measurement.tracks
        name = one.name if one.name in movie.track_names else own
        there = name in movie.track_names
        if there and (not anew or movie.tracks(name).method == EDITED):
            tracks = movie.tracks(name)
        else:
            if one.made_from not in made:
                made[one.made_from] = tracked(movie, own, one.parameters, progress)
            tracks = made[one.made_from]
            if one.name:
                movie.keep_tracks(one.name, tracks)
        found.append(measure_tracks(movie, tracks, one.parameters, progress))
    return found


def tracked(movie: Movie, name: str, parameters: Parameters, progress: Progress) -> Tracks:
    """Tracks by their name: protrusions and flow are made, others must be in the movie."""
    from .measuring.still import STILL
    from .tracking.objects import track_protrusions
    from .tracking.regions import track_flow

    makers: dict[str, Callable[..., Tracks]] = {
        "protrusions": track_protrusions,
        "flow": track_flow,
        STILL: _still,
    }
    make = makers.get(name, partial(_kept, name))
    return make(movie, parameters, progress.named(f"tracking {name}"))


def _still(movie: Movie, parameters: Parameters, progress: Progress) -> Tracks:
    from .measuring.still import still_tracks

    return still_tracks(movie, parameters.measurement.places, progress)


def _kept(name: str, movie: Movie, parameters: Parameters, progress: Progress) -> Tracks:
    return movie.tracks(name)
