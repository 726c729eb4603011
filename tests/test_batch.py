"""What a batch will do is known, and refused where it cannot be done, before it begins."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from batches import SIZES, TINY, VOXEL, ball, label_image, moving_ball, same, write_masks
from napari_unwrap3d import Parameters, Stack
from napari_unwrap3d.batch import Plan, Reading, plan_batch
from napari_unwrap3d.batch.inputs import Looked, expanded
from napari_unwrap3d.batch.jobs import Further, Job
from napari_unwrap3d.batch.locks import held
from napari_unwrap3d.batch.memory import GB, crew, estimate
from napari_unwrap3d.batch.result import BatchResult, Row
from napari_unwrap3d.batch.running import LOCK, run_plan
from napari_unwrap3d.batch.tasks import Failure, MovieTask, groups
from napari_unwrap3d.batch.worker import FURTHER, Done
from napari_unwrap3d.charts import Mask
from napari_unwrap3d.cli import build_parser, main
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.files.meshes import write_mesh
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.files.stacks import write_image
from synthetic import icosphere

PARAMETERS = Parameters.from_dict(TINY)
FREE = 16 * GB


def planned(inputs: list[object], output: Path, **options: object) -> Plan:
    return plan_batch(inputs, PARAMETERS, output, **options)  # type: ignore[arg-type]


# Inputs ------------------------------------------------------------------------------


def test_folders_and_patterns_are_read_in_a_persons_order(tmp_path: Path) -> None:
    for name in ("t10.tif", "t2.tif", "t1.tif", "notes.txt", ".hidden.tif"):
        (tmp_path / name).touch()
    expected = ["t1.tif", "t2.tif", "t10.tif"]
    assert [path.name for path in expanded([tmp_path])] == expected
    assert [path.name for path in expanded([str(tmp_path / "*.tif")])] == expected
    given = expanded([tmp_path / "t10.tif", tmp_path])
    assert [path.name for path in given] == ["t10.tif", "t1.tif", "t2.tif"]


@pytest.mark.parametrize("name", ["missing.tif", "nothing*.tif", "empty"])
def test_what_is_not_there_is_an_error(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError):
        expanded([tmp_path / name])


def test_every_file_is_a_cell_or_a_movie_of_its_own_name(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_image(tmp_path / folder / "cell.ome.tif", moving_ball(0, 4), sizes=SIZES)
    movie = np.stack([moving_ball(t, 3) for t in range(3)])
    write_image(tmp_path / "movie.tif", movie, "tzyx", sizes=SIZES, time_step=2.0)
    vertices, faces = icosphere(2)
    write_mesh(tmp_path / "mesh.ply", vertices, faces)
    plan = planned([tmp_path / "a", tmp_path / "b", tmp_path], tmp_path / "out")
    found = {job.name: job.timepoints for job in plan.jobs}
    assert found == {"cell": None, "cell-2": None, "movie": 3, "mesh": None}
    assert not plan.failed
    assert [job.recipe.kind for job in plan.jobs] == ["stack", "stack", "mesh", "stack"]
    # By choice one timepoint of a stack over time.
    plan = planned([tmp_path / "movie.tif"], tmp_path / "out", movies=False)
    assert [job.timepoints for job in plan.jobs] == [None]


def test_a_file_that_cannot_be_opened_fails_and_the_others_do_not(tmp_path: Path) -> None:
    (tmp_path / "broken.tif").write_bytes(b"no image")
    write_image(tmp_path / "good.tif", moving_ball(0, 4), sizes=SIZES)
    write_image(tmp_path / "unknown.tif", moving_ball(0, 4))
    plan = planned([tmp_path], tmp_path / "out")
    assert [job.name for job in plan.jobs] == ["good"]
    assert {row.name: row.state for row in plan.failed} == dict.fromkeys(
        ("broken", "unknown"), "failed"
    )
    assert "voxel size" in plan.failed[1].reason


def test_files_of_a_movie_are_of_one_kind_and_its_time_step_is_known(tmp_path: Path) -> None:
    files = write_masks(tmp_path / "files", 3)
    plan = planned(files, tmp_path / "out", timelapse=True, reading=Reading(time_step=2.0))
    assert [(job.name, job.timepoints) for job in plan.jobs] == [("files", 3)]
    assert len(plan.jobs[0].movie().lapse) == 3
    unknown = planned(files, tmp_path / "out", timelapse=True)
    assert "time between two timepoints" in unknown.failed[0].reason
    with pytest.raises(InputError, match="two or more"):
        planned(files[:1], tmp_path / "out", timelapse=True)


def test_labels_are_jobs_of_their_own(tmp_path: Path) -> None:
    labels = label_image()
    write_image(tmp_path / "cells.tif", labels, sizes=SIZES)
    write_image(
        tmp_path / "movie.tif",
        np.stack([labels, np.where(labels == 7, 8, labels)]),
        "tzyx",
        sizes=SIZES,
        time_step=1.0,
    )
    plan = planned([tmp_path / "cells.tif"], tmp_path / "out", labels="all")
    assert [job.label for job in plan.jobs] == [3, 7, 9]
    assert [job.parameters.stack.label for job in plan.jobs] == [3, 7, 9]
    assert [Path(job.folder).name for job in plan.jobs] == [f"cells_label{n}" for n in (3, 7, 9)]
    plan = planned([tmp_path / "movie.tif"], tmp_path / "out", labels="all")
    assert [(job.label, job.timepoints) for job in plan.jobs] == [(3, 2), (7, 2), (8, 2), (9, 2)]
    plan = planned([tmp_path / "cells.tif"], tmp_path / "out", labels=[7])
    assert [job.label for job in plan.jobs] == [7]


def test_sources_in_memory_are_written_once_and_read_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    stack = Stack(rng.random((3, 2, 5, 6, 7), np.float32), "tczyx", VOXEL, 2.0, ("a", "b"), "mine")
    mask = Mask(ball(12, (5, 5, 5), 4), VOXEL, (1.0, 2.0, 3.0))
    plan = planned([stack, mask], tmp_path)
    movie, cell = plan.jobs
    assert (movie.name, movie.timepoints, cell.timepoints) == ("mine", 3, None)
    lapse = movie.movie().lapse
    assert lapse.time_step_s == 2.0
    for timepoint in range(3):
        assert np.array_equal(lapse.at(timepoint).data, stack.data[timepoint])
    assert same(cell.source(), mask)
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.zip")}
    planned([stack, mask], tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.zip")} == written


def test_a_job_is_the_same_after_its_file(tmp_path: Path) -> None:
    files = write_masks(tmp_path / "files", 3)
    plan = planned(files, tmp_path, timelapse=True, reading=Reading(time_step=2.0, mask=True))
    path, digest = plan.jobs[0].save(tmp_path)
    assert Job.load(path) == plan.jobs[0]
    assert plan.jobs[0].save(tmp_path) == (path, digest)


# Memory ------------------------------------------------------------------------------


def test_workers_are_as_many_as_fit() -> None:
    one = crew(10 * GB, 100, workers=8, free=FREE)
    two = crew(5 * GB, 100, workers=8, free=FREE)
    many = crew(1 * GB, 100, workers=4, free=FREE)
    assert (one.workers, two.workers, many.workers) == (1, 2, 4)
    for found in (one, two, many):
        assert found.largest_item_bytes <= found.memory_bytes
        assert found.workers * found.memory_bytes <= FREE
    assert crew(1 * GB, 2, workers=8, free=FREE).workers == 2
    assert "2 workers × 6.8 GB, of 16.0 GB free" in str(two)


def test_too_little_memory_is_refused_with_the_numbers() -> None:
    with pytest.raises(InputError, match="not enough memory") as refused:
        crew(20 * GB, 1, free=FREE)
    assert refused.value.measured["needed_gb"] > refused.value.measured["usable_gb"]
    # Who knows better may say so.
    assert crew(20 * GB, 1, workers=1, memory_gb=5, free=FREE).memory_bytes == 5 * GB
    with pytest.raises(InputError, match="not enough memory"):
        crew(1 * GB, 1, memory_gb=20, free=FREE)


def test_larger_items_are_estimated_to_take_more() -> None:
    def size(
        edge: int,
        rows: int = 256,
        voxels: int | None = None,
        protrusions: bool = False,
        **stack: object,
    ) -> float:
        chosen = Parameters.from_dict({"uv": {"rows": rows}, "stack": stack})
        looked = Looked(1, (edge,) * 3, (0.1,) * 3, edge**3)
        return estimate(looked, chosen, voxels, protrusions)

    assert size(100) < size(200) < size(400)
    assert size(200, rows=128) < size(200, rows=512)
    assert size(400, working_voxel_um=0.2) < size(400)
    assert size(400, crop_voxels=(0, 100, 0, 100, 0, 100)) < size(400)
    assert size(400, voxels=10_000) < size(400)
    assert size(400) < size(400, protrusions=True)


def test_a_batch_that_does_not_fit_writes_nothing(tmp_path: Path, capsys) -> None:
    image = tmp_path / "huge.tif"
    write_image(image, moving_ball(0, 4), sizes=SIZES)
    command = ["batch", str(image), "-o", str(tmp_path / "out"), "--set"]
    assert main([*command, "stack.working_voxel_um=0.0005"]) == 2
    assert "not enough memory" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# The stages of a movie ---------------------------------------------------------------


def movie_task(tmp_path: Path, timepoints: int, **more: bool) -> MovieTask:
    files = write_masks(tmp_path / "files", timepoints)
    reading = Reading(time_step=2.0, mask=True)
    plan = planned(files, tmp_path / "out", timelapse=True, reading=reading, **more)
    task = MovieTask(plan.jobs[0], *plan.jobs[0].save(tmp_path / "out"))
    task.begin()
    return task


def taken(task: MovieTask) -> list[tuple[tuple[str, ...], int]]:
    found = [(piece.stages, piece.timepoint) for piece in task.ready]
    return found


def test_stages_follow_each_other_and_the_lost_are_left_out(tmp_path: Path) -> None:
    task = movie_task(tmp_path, 3)
    first = list(task.ready)
    assert [piece.timepoint for piece in first] == [0, 1, 2]
    task.ready.clear()
    for piece in first[:2]:
        task.take(piece, Done(dict.fromkeys(piece.stages, True), source_key=str(piece.timepoint)))
        assert not task.ready, "the common space waits for all timepoints"
    task.take(first[2], Failure("segment", "why"))
    common = task.ready.popleft()
    assert common.serial
    assert task.keys(common) == {0: "0", 1: "1"}
    task.take(common, Done({"common": True}))
    assert [piece.timepoint for piece in task.ready] == [0, 1]
    for piece in list(task.ready):
        task.take(piece, Done({"frame": True}))
    assert [(row.timepoint, row.state) for row in task.rows] == [
        (None, "done"), (0, "done"), (1, "done"), (2, "failed"),
    ]  # fmt: skip
    assert MovieFolder(Path(task.job.folder)).failure(2) == {"stage": "segment", "reason": "why"}


def test_without_a_common_space_every_timepoint_fails_with_its_reason(tmp_path: Path) -> None:
    task = movie_task(tmp_path, 2)
    for piece in [task.ready.popleft() for _ in range(2)]:
        task.take(piece, Done(dict.fromkeys(piece.stages, True)))
    task.take(task.ready.popleft(), Failure("common", "why"))
    assert not task.ready
    assert [row.state for row in task.rows] == ["failed"] * 3
    assert all("why" in row.reason for row in task.rows)


def test_without_any_timepoint_there_is_no_common_space(tmp_path: Path) -> None:
    task = movie_task(tmp_path, 2)
    for piece in [task.ready.popleft() for _ in range(2)]:
        task.take(piece, Failure("register", "why"))
    assert not task.ready
    assert [row.state for row in task.rows] == ["failed"] * 3


def answer(task: MovieTask, failing: dict[str, int], there: bool = False) -> list[str]:
    """Do all pieces, of which those of some stages fail at a timepoint; what was done."""
    done = []
    while task.ready:
        piece = task.ready.popleft()
        stage = piece.stages[-1]
        if failing.get(stage) == piece.timepoint:
            task.take(piece, Failure(stage, "why"))
        else:
            task.take(piece, Done(dict.fromkeys(piece.stages, not there)))
            done.append(piece.named)
    return done


def states_of(task: MovieTask) -> dict[int | str, str]:
    return {row.stage if row.timepoint is None else row.timepoint: row.state for row in task.rows}


AFTER = ["alike", "protrusions 0", "protrusions 1", "tracks", "measurements"]


def test_what_follows_the_frames_waits_for_what_it_needs(tmp_path: Path) -> None:
    task = movie_task(tmp_path, 2, measure=True)
    left = [(row.timepoint, row.stage, row.state) for row in task.new_rows()]
    assert left == [(row.timepoint, row.stage, row.state) for row in task.rows]
    assert answer(task, {})[-5:] == AFTER
    assert task.finished == task.pieces == 10
    assert set(states_of(task).values()) == {"done"}
    assert {row.stage for row in task.rows if row.timepoint is not None} == {"protrusions"}


def test_what_is_there_is_skipped(tmp_path: Path) -> None:
    task = movie_task(tmp_path, 2, measure=True)
    assert answer(task, {}, there=True)[-5:] == AFTER
    assert set(states_of(task).values()) == {"skipped"}


@pytest.mark.parametrize(
    ("stage", "timepoint", "done"),
    [("alike", 0, 0), ("protrusions", 1, 2), ("tracks", 0, 3), ("measurements", 0, 4)],
)
def test_what_needs_something_that_failed_is_not_tried_and_frames_stay(
    tmp_path: Path, stage: str, timepoint: int, done: int
) -> None:
    task = movie_task(tmp_path, 2, measure=True)
    assert answer(task, {stage: timepoint})[5:] == AFTER[:done]
    found = states_of(task)
    assert found["common"] == "done"
    assert found["measurements"] == "failed"
    assert found["alike"] == ("failed" if stage == "alike" else "done")
    assert found[0] == ("failed" if stage == "alike" else "done")
    assert found[1] == ("failed" if stage in ("alike", "protrusions") else "done")
    assert all("why" in row.reason for row in task.rows if row.state == "failed")
    assert task.finished == task.pieces
    folder = MovieFolder(Path(task.job.folder))
    assert [folder.failure(t) for t in range(2)] == [None, None]


def test_a_lost_timepoint_is_left_out_of_the_tracks(tmp_path: Path) -> None:
    task = movie_task(tmp_path, 3, track=True)
    done = answer(task, {"frame": 1})
    assert done[-4:] == ["alike", "protrusions 0", "protrusions 2", "tracks"]
    assert states_of(task) == {
        "common": "done", "alike": "done", "tracks": "done", 0: "done", 1: "failed", 2: "done",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("track", "measure", "settings", "expected"),
    [
        (False, False, {}, ()),
        (False, False, {"protrusions": {"compute": True}}, ("alike", "protrusions")),
        (True, False, {}, ("alike", "protrusions", "tracks")),
        (False, True, {}, ("alike", "protrusions", "tracks", "measurements")),
        (False, True, {"measurement": {"tracks": "flow"}}, ("tracks", "measurements")),
        (False, True, {"measurement": {"tracks": "places"}}, ("measurements",)),
    ],
)
def test_what_is_made_of_a_movie(
    tmp_path: Path, track: bool, measure: bool, settings: dict, expected: tuple[str, ...]
) -> None:
    files = write_masks(tmp_path / "files", 2)
    options = {"reading": Reading(time_step=2.0, mask=True), "timelapse": True}
    parameters = Parameters.from_dict(TINY | settings)
    plan = plan_batch(files, parameters, tmp_path / "out", track=track, measure=measure, **options)
    assert plan.jobs[0].further == expected
    assert all(stage in plan.in_words for stage in expected if stage != "alike")
    assert ("also" in plan.in_words) == bool(expected)


def test_what_cannot_be_tracked_is_refused(tmp_path: Path) -> None:
    files = write_masks(tmp_path / "files", 2)
    with pytest.raises(InputError, match="no movie"):
        planned(files, tmp_path / "out", reading=Reading(mask=True), track=True)
    places = Parameters.from_dict({"measurement": {"tracks": "places"}})
    with pytest.raises(ParameterError, match="Nothing is followed"):
        plan_batch(files, places, tmp_path / "out", timelapse=True, track=True)


def test_every_stage_is_in_one_group() -> None:
    found = list(groups(5))
    assert found[0] == (("register", "segment"), range(5))
    assert [len(timepoints) for _, timepoints in found][1] == 1
    assert found[-1] == (("frame",), range(5))
    assert list(groups(5, get_args(Further)))[3:] == [
        (("alike",), range(1)), (("protrusions",), range(5)),
        (("tracks",), range(1)), (("measurements",), range(1)),
    ]  # fmt: skip
    assert get_args(Further) == FURTHER


# The summary and the command ---------------------------------------------------------


def test_the_summary_tells_states_and_reasons(tmp_path: Path) -> None:
    rows = (Row("a", "a.tif", 3, None, "cell", "done", volume_um3=2.5), Row("b", "b.tif"))
    result = BatchResult(tmp_path, rows, {})
    assert result.exit_code == 0
    assert result.counts == {"done": 1, "skipped": 0, "failed": 0, "left": 1}
    failed = BatchResult(tmp_path, (*rows, Row("c", "c", None, 4, "frame", "failed", "why")), {})
    assert failed.exit_code == 3
    failed.write()
    table = (tmp_path / "summary.csv").read_text().splitlines()
    assert table[1].startswith("a,a.tif,3,,cell,done,")
    assert "c,c,,4,frame,failed,why" in table[3]


def test_two_batches_do_not_share_an_output(tmp_path: Path) -> None:
    write_image(tmp_path / "cell.tif", moving_ball(0, 4), sizes=SIZES)
    plan = planned([tmp_path / "cell.tif"], tmp_path / "out")
    lock = held(plan.output / LOCK)
    assert lock is not None
    with lock, pytest.raises(InputError, match="Another batch"):
        run_plan(plan)


def test_the_options_of_the_command() -> None:
    def parsed(*words: str) -> argparse.Namespace:
        return build_parser().parse_args(["batch", "a.tif", "b.tif", "-o", "out", *words])

    chosen = parsed("--labels", "1", "2", "--workers", "3", "--memory", "2.5", "--timelapse")
    assert (chosen.inputs, chosen.labels, chosen.workers) == (["a.tif", "b.tif"], ["1", "2"], 3)
    assert chosen.memory == 2.5
    assert (chosen.track, chosen.measure) == (False, False)
    assert parsed("--track").track
    assert parsed("--measure").measure
    for wrong in (("--workers", "0"), ("--memory", "-1")):
        with pytest.raises(SystemExit):
            parsed(*wrong)


@pytest.mark.parametrize("labels", ["some", "0", "-3"])
def test_labels_that_are_none_are_an_error(tmp_path: Path, capsys, labels: str) -> None:
    write_image(tmp_path / "cells.tif", label_image(), sizes=SIZES)
    assert (
        main(
            ["batch", str(tmp_path / "cells.tif"), "-o", str(tmp_path / "o"), f"--labels={labels}"]
        )
        == 2
    )
    assert "are no labels" in capsys.readouterr().err
