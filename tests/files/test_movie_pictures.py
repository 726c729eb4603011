"""Pictures of a movie: what changes in time is the cell, and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tifffile
from matplotlib.image import imread

from movies import TIME_STEP_S, TIMEPOINTS, read_mp4
from napari_unwrap3d.cli import main
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.files.movie_export import write_frames
from napari_unwrap3d.files.movie_files import export_movie, write_kymograph, write_uv_stack
from napari_unwrap3d.files.movie_pictures import chosen_views, common_scales, movie_pictures
from napari_unwrap3d.files.stacks import read_stack
from napari_unwrap3d.files.stacks import write_image as write_stack
from napari_unwrap3d.motion.kymograph import kymograph, surface_line
from napari_unwrap3d.motion.projections import Projections

LINE = [[20.0, 40.0], [40.0, 140.0]]
CURVATURE = "mean_curvature_per_um"


@pytest.fixture(scope="module")
def line(breathing: Any) -> Any:
    return kymograph(breathing, LINE, CURVATURE, 0.3)


@pytest.fixture(scope="module")
def scales(breathing: Any) -> Any:
    return common_scales(breathing)


def test_colours_are_those_of_all_timepoints(breathing: Any, scales: Any) -> None:
    values = np.concatenate([f.surface.fields[CURVATURE] for f in breathing.frames()])
    assert scales.colours.low == -scales.colours.high
    assert np.mean(np.abs(values) > scales.colours.high) < 0.03
    assert "1/µm" in scales.colours.label
    for frame in breathing.frames():
        right, down = frame.surface.vertices[:, 2], frame.surface.vertices[:, 1]
        left, stop, bottom, top = scales.extent
        assert left < right.min()
        assert right.max() < stop
        assert top < down.min()
        assert down.max() < bottom
    fixed = common_scales(breathing, limits=(-0.5, 0.7)).colours
    assert (fixed.low, fixed.high) == (-0.5, 0.7)


@pytest.mark.parametrize("view", ["surface", "uv", "polar", "projection", "kymograph"])
def test_a_view_shows_what_happens(breathing: Any, line: Any, scales: Any, view: str) -> None:
    projections = Projections.of(breathing, 0, 0.3) if view == "projection" else None
    found = line if view == "kymograph" else None
    made = movie_pictures(breathing, view, scales=scales, projections=projections, kymograph=found)
    pictures = [image.astype(int) for image in made.pictures()]
    assert len(pictures) == TIMEPOINTS
    assert {image.shape for image in pictures} == {pictures[0].shape}
    changed = np.abs(pictures[2] - pictures[0]).max(axis=2) > 20
    assert 0 < changed.mean() < 0.5
    rows, columns = changed.shape
    # The title, the time stamp apart, and the colour bar stay as they are.
    assert not changed[: rows // 16, columns // 4 :].any()
    assert not changed[:, int(0.93 * columns) :].any()
    # At the end the cell is as in the beginning.
    stamp = (slice(0, rows // 14), slice(0, columns // 4))
    first, last = pictures[0].copy(), pictures[-1].copy()
    assert (first[stamp] != last[stamp]).any()
    if view != "kymograph":
        first[stamp] = last[stamp] = 0
        np.testing.assert_array_equal(first, last)


def test_all_views_side_by_side_in_an_mp4(breathing: Any, line: Any, tmp_path: Path) -> None:
    projections = Projections.of(breathing, "ramp", 0.3)
    made = movie_pictures(breathing, projections=projections, kymograph=line)
    assert made.views == ("surface", "uv", "polar", "projection", "kymograph")
    found = read_mp4(write_frames(tmp_path / "movie.mp4", made.pictures()))
    assert len(found) == TIMEPOINTS
    assert np.abs(found[2].astype(int) - made.picture(2)).mean() < 4


def test_the_line_is_seen_in_front_only(breathing: Any, scales: Any) -> None:
    """Seen along z one sees what lies at small z, at the south pole of this cell."""
    north, south = (surface_line(breathing.common, [[v, 10.0], [v, 50.0]]) for v in (8.0, 55.0))
    plain = movie_pictures(breathing, "surface", scales=scales).picture(0).astype(int)
    drawn = [
        movie_pictures(breathing, "surface", scales=scales, line=line).picture(0).astype(int)
        for line in (north, south)
    ]
    dark = [(np.abs(image - plain).max(axis=2) > 60).sum() for image in drawn]
    assert dark[0] == 0
    assert dark[1] > 100


def test_views_need_what_they_show(breathing: Any) -> None:
    assert chosen_views("all", False, False) == ("surface", "uv", "polar")
    for view, match in (("projection", "stack"), ("kymograph", "line"), ("side", "Views")):
        with pytest.raises(ParameterError, match=match):
            movie_pictures(breathing, view)
    with pytest.raises(ParameterError, match="height_um"):
        movie_pictures(breathing, "uv", "nothing")
    with pytest.raises(ParameterError, match="axis"):
        common_scales(breathing, axis="t")
    with pytest.raises(ParameterError, match="limit"):
        common_scales(breathing, limits=(1.0, 1.0))


# Files -------------------------------------------------------------------------------


def test_a_uv_stack_is_read_back(breathing: Any, tmp_path: Path) -> None:
    path = write_uv_stack(breathing, "height_um", tmp_path / "height.ome.tif")
    with tifffile.TiffFile(path) as tif:
        assert tif.series[0].axes == "TYX"
        found = tif.asarray()
    np.testing.assert_array_equal(found, breathing.uv("height_um").compute())
    assert 'TimeIncrement="2.0"' in tifffile.tiffcomment(path)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".ome.tif", ".png"])
def test_a_kymograph_as_a_file(line: Any, tmp_path: Path, suffix: str) -> None:
    path = write_kymograph(line, tmp_path / f"kymograph{suffix}")
    if suffix in (".csv", ".parquet"):
        table = pd.read_csv(path) if suffix == ".csv" else pd.read_parquet(path)
        assert list(table)[:3] == ["timepoint", "time_s", "position_um"]
        wide = table.pivot(index="time_s", columns="position_um", values=CURVATURE)
        np.testing.assert_allclose(wide.to_numpy(), line.values)
        np.testing.assert_allclose(wide.columns, line.positions_um)
        np.testing.assert_allclose(wide.index, line.times_s)
    elif suffix == ".ome.tif":
        np.testing.assert_allclose(tifffile.imread(path), line.values, rtol=1e-6)
        about = tifffile.tiffcomment(path)
        assert f'PhysicalSizeX="{line.line.step_um}' in about
        assert 'TimeIncrement="2.0"' in about
    else:
        assert np.ptp(imread(path)[..., :3]) > 0.5


def test_everything_in_a_folder(breathing: Any, line: Any, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    written = export_movie(breathing, folder, kymographs={"over the cell": line})
    names = {path.relative_to(folder).as_posix() for path in written}
    assert {"frames.csv", "kymographs/over the cell.csv", "uv/height_um.ome.tif"} <= names
    assert len([name for name in names if name.startswith("uv/")]) == len(breathing.fields)
    for table in ("frames.csv", "registration.csv"):
        assert len(pd.read_csv(folder / table)) == TIMEPOINTS
    with pytest.raises(InputError, match="not empty"):
        export_movie(breathing, folder)
    export_movie(breathing, folder, fields=["height_um"], overwrite=True)
    assert [entry.name for entry in (folder / "uv").iterdir()] == ["height_um.ome.tif"]
    assert not (folder / "kymographs").exists()
    with pytest.raises(ParameterError):
        export_movie(breathing, tmp_path / "other", fields=["nothing"])


# The command --------------------------------------------------------------------------


def test_the_command_makes_an_mp4_and_an_export(
    breathing: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stack = tmp_path / "stack.ome.tif"
    source = breathing.work.lapse.sources
    write_stack(
        stack,
        source.data,
        source.axes,
        sizes=dict.fromkeys("zyx", source.voxel_size[0]),
        time_step=source.time_step,
    )
    assert read_stack(stack).time_step == TIME_STEP_S
    mp4, folder = tmp_path / "movie.mp4", tmp_path / "files"
    arguments = ["movie", str(breathing.folder.path), "-o", str(mp4), "--export", str(folder)]
    line = ["--line=-6,40:20,40", "--width", "0.3", "--field", "height_um"]
    projection = ["--stack", str(stack), "--channel", "1", "--reach", "0.3"]
    assert main([*arguments, *line, *projection, "--fps", "5"]) == 0
    assert str(mp4.name) in capsys.readouterr().out.replace("\n", "")
    assert len(read_mp4(mp4)) == TIMEPOINTS
    assert (folder / "kymographs" / "height_um.png").is_file()


def test_the_command_makes_png_frames(breathing: Any, tmp_path: Path) -> None:
    path = str(breathing.folder.path)
    assert main(["movie", path, "-o", str(tmp_path / "frames"), "--view", "uv", "--quiet"]) == 0
    assert len(list((tmp_path / "frames").iterdir())) == TIMEPOINTS


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ([], "Nothing to write"),
        (["-o", "out.mp4", "--field", "nothing"], "no field"),
        (["-o", "out.mp4", "--view", "projection"], "stack"),
        (["-o", "out.mp4", "--line", "5;7"], "no corner"),
        (["-o", "out.mp4", "--fps", "0"], "frames per second"),
    ],
)
def test_the_command_says_what_is_wrong(
    breathing: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["movie", str(breathing.folder.path), *options]) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())
    assert main(["movie", "missing", "-o", "out.mp4"]) == 2
