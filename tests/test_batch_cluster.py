"""Batches on a real dask cluster on this machine: killed workers, killed runs, resuming."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import batches
from batches import (
    SIZES,
    TINY,
    VOXEL,
    assert_same_files,
    assert_same_movie,
    assert_same_tracked,
    label_image,
    write_masks,
)
from napari_unwrap3d import Cancelled, Parameters, Progress, load, load_movie, unwrap_movie
from napari_unwrap3d.batch import Exports, Reading, cluster, driver, run_batch
from napari_unwrap3d.charts import Mask
from napari_unwrap3d.cli import main
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.files.stacks import write_image

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="kills processes by signals")

MASKS = Reading(mask=True, time_step=2.0)
PARAMETERS = Parameters.from_dict(TINY)
TIMEPOINTS = 4
WORKERS = 2


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path]:
    """The files of a movie, and the movie made from them in this process, piece by piece."""
    folder = tmp_path_factory.mktemp("undisturbed")
    files = write_masks(folder / "files", TIMEPOINTS)
    masks = [Mask(batches.moving_ball(t, TIMEPOINTS), VOXEL) for t in range(TIMEPOINTS)]
    unwrap_movie(masks, PARAMETERS, time_step=2.0, folder=folder / "movie").compute()
    return files, folder / "movie"


def pieces_done(output: Path) -> list[str]:
    """What the logs say was done, in order."""
    lines = [
        line for path in (output / "log").glob("*.log") for line in path.read_text().splitlines()
    ]
    return [line.split(":")[0] for line in lines if line.startswith("== ") and ": done in" in line]


# Killing -----------------------------------------------------------------------------


def test_a_worker_that_is_killed_in_the_middle_changes_nothing(undisturbed, tmp_path: Path) -> None:
    files, expected = undisturbed
    killed: list[int] = []

    def kill_one(stage: str, fraction: float, message: str) -> None:
        # Called while every worker has a piece of work.
        if stage == "batch" and not killed:
            killed.append(batches.worker_pids()[-1])
            os.kill(killed[0], signal.SIGKILL)

    result = run_batch(
        files, PARAMETERS, tmp_path, reading=MASKS, timelapse=True, workers=WORKERS,
        threads=1, progress=kill_one,
    )  # fmt: skip
    assert len(killed) == 1
    assert result.exit_code == 0
    assert result.counts == {"done": TIMEPOINTS + 1, "skipped": 0, "failed": 0, "left": 0}
    assert_same_movie(tmp_path / "files", expected, TIMEPOINTS)


RUN = """
import sys
from napari_unwrap3d import Parameters
from napari_unwrap3d.batch import Exports, Reading, run_batch

def tell(stage, fraction, message):
    print(f"{fraction:.3f}", flush=True)

if __name__ == "__main__":
    run_batch(
        sys.argv[2:], Parameters.from_dict(PARAMETERS), sys.argv[1],
        reading=Reading(mask=True, time_step=2.0), timelapse=True, threads=1, progress=tell,
        exports=Exports(pictures=False), **MORE,
    )
"""


def killed_run(output: Path, files: list[Path], after: float, **more: Any) -> None:
    """A run in a process that is killed once more than a part of it is done."""
    script = output.with_name("run.py")
    script.write_text(RUN.replace("PARAMETERS", repr(TINY)).replace("MORE", repr(more)))
    command = [sys.executable, str(script), str(output), *map(str, files)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as run:
        for line in run.stdout:
            if float(line) > after:
                run.kill()
                break


def test_a_run_that_is_killed_goes_on_where_it_was(undisturbed, tmp_path: Path) -> None:
    files, expected = undisturbed
    output = tmp_path / "output"
    killed_run(output, files, 0.3, workers=WORKERS)
    before = pieces_done(output)
    assert 1 < len(before) < 2 * TIMEPOINTS
    # The workers end with the run; until then they hold nothing that the next one needs.
    result = run_batch(
        files, PARAMETERS, output, reading=MASKS, timelapse=True, workers=WORKERS, threads=1
    )
    every = pieces_done(output)
    assert len(set(every)) == len(every), "a piece was done twice"
    # A worker that survives the run for a moment may finish its piece, and tell nobody.
    assert len(every) >= 2 * TIMEPOINTS + 1 - WORKERS
    assert result.exit_code == 0
    assert_same_movie(output / "files", expected, TIMEPOINTS)
    assert not list(output.rglob(".*.partial"))


def test_tracks_and_measurements_are_those_of_the_commands_whoever_was_killed(
    undisturbed, tmp_path: Path
) -> None:
    files, unwrapped = undisturbed
    by_hand = Path(shutil.copytree(unwrapped, tmp_path / "by hand" / "files"))
    folder = MovieFolder(by_hand)
    folder.begin(folder.manifest() | {"name": "files"})  # as the batch calls it
    assert main(["track", str(by_hand)]) == 0
    assert main(["measure", str(by_hand), "-o", str(tmp_path / "measured"), "--no-report"]) == 0
    output = tmp_path / "output"
    shutil.copytree(unwrapped, output / "files")  # frames that are there need not be made
    # Of 9 pieces up to the frames, 1 + 4 + 1 + 1 follow: the first of the protrusions is there.
    killed_run(output, files, 10.5 / 16, workers=1, measure=True)
    before = pieces_done(output)
    assert before[0] == "== alike"
    assert 1 < len(before) < 1 + TIMEPOINTS

    killed: list[int] = []

    def kill_one(stage: str, fraction: float, message: str) -> None:
        if stage == "batch" and fraction > 10.5 / 16 and not killed:
            killed.append(batches.worker_pids()[-1])
            os.kill(killed[0], signal.SIGKILL)

    result = run_batch(
        files, PARAMETERS, output, reading=MASKS, timelapse=True, workers=WORKERS, threads=1,
        measure=True, exports=Exports(pictures=False), progress=kill_one,
    )  # fmt: skip
    assert len(killed) == 1
    assert result.exit_code == 0, [row.reason for row in result.failed]
    every = pieces_done(output)
    assert len(set(every)) == len(every), "a piece was done twice"
    assert every[-1] == "== measurements"
    assert not list(output.rglob(".*.partial"))
    assert_same_tracked(output / "files", by_hand, TIMEPOINTS)
    assert_same_files(output / "measurements" / "files", tmp_path / "measured")
    found = {row.stage: row.tracks for row in result.rows if row.timepoint is None}
    assert found["tracks"] == found["measurements"] == TIMEPOINTS  # the bump jumps too far
    assert [row.protrusions for row in result.rows if row.timepoint is not None] == [1] * TIMEPOINTS


def test_a_batch_that_is_cancelled_tells_what_is_left_and_goes_on(
    undisturbed, tmp_path: Path
) -> None:
    files, expected = undisturbed
    progress = Progress(lambda stage, fraction, message: fraction > 0.2 and progress.cancel())
    options = {"reading": MASKS, "timelapse": True, "workers": 1, "threads": 1}
    with pytest.raises(Cancelled):
        run_batch(files, PARAMETERS, tmp_path, progress=progress, **options)
    table = pd.read_csv(tmp_path / "summary.csv")
    assert list(table.state) == ["left"] * (TIMEPOINTS + 1)
    assert 0 < len(pieces_done(tmp_path)) < 2 * TIMEPOINTS
    assert run_batch(files, PARAMETERS, tmp_path, **options).exit_code == 0
    every = pieces_done(tmp_path)
    assert len(set(every)) == len(every) >= 2 * TIMEPOINTS
    assert_same_movie(tmp_path / "files", expected, TIMEPOINTS)


COMMAND = """
import sys
from napari_unwrap3d import cli, console

class Told(console.StepProgress):
    def __call__(self, step, fraction, message=""):
        print(step, f"{fraction:.3f}", flush=True)

console.StepProgress = Told
if __name__ == "__main__":
    sys.exit(cli.main(sys.argv[1:]))
"""


def test_the_command_is_stopped_by_the_keyboard(tmp_path: Path) -> None:
    files = write_masks(tmp_path / "files", TIMEPOINTS)
    script, output = tmp_path / "command.py", tmp_path / "output"
    script.write_text(COMMAND)
    command = [sys.executable, str(script), "batch", *map(str, files), "--timelapse", "--mask",
               "--time-step", "2", "-o", str(output), "--workers", "2", "--set", "uv.rows=32",
               "--set", "registration.method=none",
               "--set", "reference.vertices=2000"]  # fmt: skip
    # As a terminal does, the signal is sent to all of the processes.
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, text=True
    ) as run:
        for line in run.stdout:
            if line.startswith("batch") and float(line.split()[1]) > 0.2:
                os.killpg(run.pid, signal.SIGINT)
                break
        _, errors = run.communicate()
    assert run.returncode == 130, errors
    assert "the same command again goes on" in errors
    assert "Traceback" not in errors
    assert set(pd.read_csv(output / "summary.csv").state) == {"left"}
    assert pieces_done(output)


def test_an_item_that_kills_its_workers_is_reported_and_the_others_are_made(
    tmp_path: Path, monkeypatch
) -> None:
    for name in ("hog", "lamb"):
        write_image(tmp_path / f"{name}.tif", batches.moving_ball(0, 1), sizes=SIZES)
    monkeypatch.setattr(driver, "run_piece", batches.dying_piece)
    result = run_batch(
        [tmp_path / "hog.tif", tmp_path / "lamb.tif"], PARAMETERS, tmp_path / "output",
        reading=Reading(mask=True), exports=Exports(pictures=False), workers=WORKERS, retries=1,
    )  # fmt: skip
    hog, lamb = result.rows
    assert hog.state == "failed"
    # Where the worker died before it had told that the other was done, it was there already.
    assert lamb.state in ("done", "skipped")
    assert (tmp_path / "output" / "lamb" / "cell.unwrap3d").is_file()
    assert "2 times" in hog.reason
    assert "memory" in hog.reason
    assert result.exit_code == 3


def test_the_workers_of_a_scheduler_do_the_work(undisturbed, tmp_path: Path) -> None:
    from distributed import LocalCluster

    files, expected = undisturbed
    options = {"reading": MASKS, "timelapse": True}
    with LocalCluster(
        n_workers=1, threads_per_worker=2, memory_limit="6GB", dashboard_address="127.0.0.1:0"
    ) as given:
        address = given.scheduler_address
        result = run_batch(files, PARAMETERS, tmp_path / "out", scheduler=address, **options)
        assert result.counts["done"] == TIMEPOINTS + 1
        assert "2 pieces of work at a time with 3.0 GB" in result.about["workers"]
        larger = Parameters.from_dict({"uv": {"rows": 1024}})
        with pytest.raises(InputError, match="not enough memory"):
            run_batch(files, larger, tmp_path / "other", scheduler=address, **options)
    assert_same_movie(tmp_path / "out" / "files", expected, TIMEPOINTS)


def test_without_a_scheduler_at_its_address_there_is_a_clear_error(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr(cluster, "WAIT_SECONDS", 0.2)
    write_image(tmp_path / "cell.tif", batches.moving_ball(0, 1), sizes=SIZES)
    with pytest.raises(InputError, match="No dask scheduler answers"):
        run_batch([tmp_path / "cell.tif"], output=tmp_path / "o", scheduler="tcp://127.0.0.1:9")


# Failing -----------------------------------------------------------------------------


def test_a_timepoint_that_fails_is_left_out_and_listed(tmp_path: Path) -> None:
    files = write_masks(tmp_path / "files", TIMEPOINTS)
    write_image(files[2], np.zeros((34,) * 3, np.uint8), sizes=SIZES)
    output = tmp_path / "output"
    options = {"reading": MASKS, "timelapse": True, "workers": 1}
    result = run_batch(files, PARAMETERS, output, **options)
    states = {row.timepoint: (row.state, row.stage) for row in result.rows}
    assert states.pop(2) == ("failed", "segment")
    assert states == {None: ("done", "common")} | dict.fromkeys((0, 1, 3), ("done", "frame"))
    assert "No voxel belongs to the cell" in result.failed[0].reason

    movie = load_movie(output / "files")
    assert [movie.has_frame(t) for t in range(TIMEPOINTS)] == [True, True, False, True]
    assert [frame.timepoint for frame in movie.frames()] == [0, 1, 3]
    assert np.isnan(movie.record["recommendation"]["outside"]["mean"][2] or np.nan)
    images = movie.uv("height_um").compute()
    assert [bool(np.isnan(image).all()) for image in images] == [False, False, True, False]
    with pytest.raises(InputError, match="No voxel"):
        movie.frame(2)

    # Mended, it joins the mean, and everything that depends on the mean is made anew.
    write_image(files[2], batches.moving_ball(2, TIMEPOINTS), sizes=SIZES)
    mended = run_batch(files, PARAMETERS, output, **options)
    assert mended.counts["done"] == TIMEPOINTS + 1
    assert load_movie(output / "files").has_frame(2)


# Labels, the command, and parameters that change -------------------------------------


def test_the_command_makes_an_atlas_of_every_label(tmp_path: Path, capsys) -> None:
    image, output = tmp_path / "cells.ome.tif", tmp_path / "output"
    write_image(image, label_image(), sizes=SIZES)
    command = ["batch", str(image), "-o", str(output), "--labels", "all", "--no-pictures",
               "--workers", "1", "--set", "uv.rows=32",
               "--set", "reference.vertices=2000"]  # fmt: skip
    assert main(command) == 3
    printed = capsys.readouterr()
    assert "1 worker × " in printed.out
    assert "GB free" in printed.out
    assert "Failed: cells_label9" in printed.err
    for label, radius in ((3, 9), (7, 10)):
        atlas = load(output / f"cells_label{label}" / "cell.unwrap3d")
        volume = atlas.quality["surface"]["volume_um3"]
        assert volume == pytest.approx(4 / 3 * np.pi * (radius * VOXEL[0]) ** 3, rel=0.1)
    table = pd.read_csv(output / "summary.csv")
    assert list(table.label) == [3, 7, 9]
    assert list(table.state) == ["done", "done", "failed"]
    assert table.reason.notna().tolist() == [False, False, True]
    assert (table.peak_memory_gb[:2] > 0.05).all()

    # Again: only what failed is tried. With another parameter: from that step on.
    assert main(command) == 3
    assert list(pd.read_csv(output / "summary.csv").state) == ["skipped", "skipped", "failed"]
    before = load(output / "cells_label3" / "cell.unwrap3d")
    assert main([*command, "--set", "topography.step_voxels=0.7"]) == 3
    after = load(output / "cells_label3" / "cell.unwrap3d")
    steps = [a.provenance["steps"] for a in (before, after)]
    changed = [name for name in steps[0] if steps[0][name] != steps[1][name]]
    assert changed == ["topography"]
