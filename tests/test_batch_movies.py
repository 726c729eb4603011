"""What a batch makes of an unwrapped movie is what the commands make of it by hand."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from batches import TINY, VOXEL, assert_same_files, assert_same_tracked, moving_ball
from napari_unwrap3d import load_movie, unwrap_movie
from napari_unwrap3d.batch.inputs import Recipe
from napari_unwrap3d.batch.jobs import Exports, Job
from napari_unwrap3d.batch.movies import make
from napari_unwrap3d.charts import Mask
from napari_unwrap3d.cli import main
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.tracking.edits import TrackEdits

TIMEPOINTS = 3
MOVIE, MEASURED = "movie", "measured"


def job_of(folder: Path) -> Job:
    """Everything, of the movie in a folder, without figures."""
    return Job(
        name=MOVIE,
        label=None,
        timepoints=TIMEPOINTS,
        recipe=Recipe(kind="mask", paths=("none.tif",), name=MOVIE),
        parameters=load_movie(folder / MOVIE).parameters,
        folder=str(folder / MOVIE),
        exports=Exports(pictures=False),
        measure=True,
        measured_folder=str(folder / MEASURED),
    )


def made(job: Job, *stages: str) -> dict[str, list[bool]]:
    """What was made, timepoint by timepoint; the movie is opened anew, as by another worker."""
    found = {}
    for stage in stages or job.further:
        times = range(TIMEPOINTS) if stage == "protrusions" else range(1)
        found[stage] = [make(stage, load_movie(job.folder), t, job)[0] for t in times]
    return found


NOTHING = {
    "alike": [False],
    "protrusions": [False] * TIMEPOINTS,
    "tracks": [False],
    "measurements": [False],
}


@pytest.fixture(scope="module")
def unwrapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unwrapped")
    masks = [Mask(moving_ball(t, 24), VOXEL) for t in range(TIMEPOINTS)]
    parameters = Parameters.from_dict(TINY)
    unwrap_movie(masks, parameters, time_step=2.0, folder=folder / MOVIE).compute()
    return folder


@pytest.fixture(scope="module")
def batched(unwrapped: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its protrusions from the last timepoint to the first: their order does not matter."""
    folder = Path(shutil.copytree(unwrapped, tmp_path_factory.mktemp("batched") / "all"))
    job = job_of(folder)
    assert made(job, "alike") == {"alike": [True]}
    for timepoint in reversed(range(TIMEPOINTS)):
        done, numbers = make("protrusions", load_movie(job.folder), timepoint, job)
        assert done
        assert numbers["protrusions"] == 1
    assert made(job) == {**NOTHING, "tracks": [True], "measurements": [True]}
    return folder


def test_it_is_what_track_and_measure_make(unwrapped: Path, batched: Path, tmp_path: Path) -> None:
    movie = shutil.copytree(unwrapped / MOVIE, tmp_path / MOVIE)
    assert main(["track", str(movie)]) == 0
    assert main(["measure", str(movie), "-o", str(tmp_path / MEASURED), "--no-report"]) == 0
    tracks = load_movie(movie).tracks()
    assert (len(tracks.ids), len(tracks)) == (1, TIMEPOINTS)
    assert_same_tracked(batched / MOVIE, movie, TIMEPOINTS)
    assert_same_files(batched / MEASURED, tmp_path / MEASURED)


def test_only_what_depends_on_a_change_is_made_again(batched: Path, tmp_path: Path) -> None:
    job = job_of(Path(shutil.copytree(batched, tmp_path / "copy")))
    assert made(job) == NOTHING
    # An annotation, in which tracks may be measured.
    movie = load_movie(job.folder)
    movie.common.annotations.add("front")
    movie.common.annotations.draw_vertices("front", range(100), 1)
    movie.keep_annotations()
    assert made(job) == {**NOTHING, "measurements": [True]}
    # A person's work stays, and is what is measured.
    edits = TrackEdits(load_movie(job.folder).tracks())
    edits.cut(1, 1)
    movie.keep_tracks("protrusions", edits.tracks)
    assert made(job) == {**NOTHING, "measurements": [True]}
    assert load_movie(job.folder).tracks().method == "edited"
    # Whether single cells have protrusions, too, says nothing of those of movies.
    with_chart = {**TINY, "protrusions": {"compute": True}}
    begin(job, Parameters.from_dict(with_chart))
    assert made(job) == {**NOTHING, "measurements": [True]}


def begin(job: Job, parameters: Parameters) -> None:
    """Give the movie other parameters, as another batch in the same output does."""
    folder = load_movie(job.folder).folder
    folder.begin(folder.manifest() | {"parameters": parameters.to_toml()})


def test_tracks_that_are_not_there_are_told(unwrapped: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(unwrapped, tmp_path / "copy"))
    begin(job_of(folder), Parameters.from_dict({**TINY, "measurement": {"tracks": "mine"}}))
    job = job_of(folder)
    assert job.further == ("measurements",)
    with pytest.raises(InputError, match="no tracks named 'mine'"):
        made(job)
