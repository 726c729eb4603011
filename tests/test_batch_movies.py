"""What a batch makes of an unwrapped movie is what the commands make of it by hand."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from batches import assert_same_files, assert_same_tracked
from moving import blebbing_movie
from napari_unwrap3d import load_movie
from napari_unwrap3d.batch.inputs import Recipe
from napari_unwrap3d.batch.jobs import Exports, Job
from napari_unwrap3d.batch.movies import make
from napari_unwrap3d.cli import main
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.tracking.edits import TrackEdits


@pytest.fixture(scope="module")
def unwrapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unwrapped")
    blebbing_movie(folder)
    return folder


def copied(unwrapped: Path, folder: Path) -> Path:
    return Path(shutil.copytree(unwrapped, folder))


def job_of(folder: Path, **more: object) -> Job:
    movie = load_movie(folder)
    return Job(
        name="movie",
        label=None,
        timepoints=len(movie),
        recipe=Recipe(kind="mask", paths=("none.tif",), name="movie"),
        parameters=movie.parameters,
        folder=str(folder),
        measure=True,
        measured_folder=str(folder.parent / "measured"),
        **more,
    )


def made(job: Job, *stages: str) -> dict[str, list[bool]]:
    """What was made, timepoint by timepoint, opening the movie each time as a worker may."""
    found = {}
    for stage in stages or job.further:
        times = range(job.timepoints) if stage == "protrusions" else range(1)
        found[stage] = [make(stage, load_movie(job.folder), t, job)[0] for t in times]
    return found


def test_it_is_what_track_and_measure_make_and_is_not_made_again(
    unwrapped: Path, tmp_path: Path
) -> None:
    by_hand = copied(unwrapped, tmp_path / "hand" / "movie")
    measured = tmp_path / "hand" / "measured"
    assert main(["track", str(by_hand)]) == 0
    assert main(["measure", str(by_hand), "-o", str(measured)]) == 0
    job = job_of(copied(unwrapped, tmp_path / "batch" / "movie"))
    # From the last timepoint to the first: their order does not matter.
    assert made(job, "alike") == {"alike": [True]}
    for timepoint in reversed(range(job.timepoints)):
        done, numbers = make("protrusions", load_movie(job.folder), timepoint, job)
        assert done
        assert numbers["protrusions"] == 2
    assert made(job) == {
        "alike": [False],
        "protrusions": [False] * job.timepoints,
        "tracks": [True],
        "measurements": [True],
    }
    assert_same_tracked(Path(job.folder), by_hand, job.timepoints)
    assert_same_files(Path(job.measured_folder), measured)
    assert not any(map(any, made(job).values()))


def test_what_depends_on_a_change_is_made_again(unwrapped: Path, tmp_path: Path) -> None:
    job = job_of(copied(unwrapped, tmp_path / "movie"), exports=Exports(pictures=False))
    made(job)
    assert not list(Path(job.measured_folder).rglob("report.html"))
    # An annotation, in which tracks may be measured.
    movie = load_movie(job.folder)
    movie.common.annotations.add("front")
    movie.common.annotations.draw_vertices("front", range(100), 1)
    movie.keep_annotations()
    assert made(job) == {
        "alike": [False],
        "protrusions": [False] * 4,
        "tracks": [False],
        "measurements": [True],
    }
    # A person's work stays, and is what is measured.
    edits = TrackEdits(load_movie(job.folder).tracks("protrusions"))
    edits.delete(1)
    movie.keep_tracks("protrusions", edits.tracks)
    assert made(job, "tracks", "measurements") == {"tracks": [False], "measurements": [True]}
    assert load_movie(job.folder).tracks("protrusions").method == "edited"
    assert made(job, "measurements") == {"measurements": [False]}


def test_tracks_that_are_not_there_are_told(unwrapped: Path, tmp_path: Path) -> None:
    folder = copied(unwrapped, tmp_path / "movie")
    values = load_movie(folder).parameters.model_dump() | {"measurement": {"tracks": "mine"}}
    movie = load_movie(folder)
    manifest = movie.folder.manifest() | {"parameters": Parameters.from_dict(values).to_toml()}
    movie.folder.begin(manifest)
    job = job_of(folder)
    assert job.further == ("measurements",)
    with pytest.raises(InputError, match="no tracks named 'mine'"):
        made(job)
