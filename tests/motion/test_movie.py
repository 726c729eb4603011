"""A movie: its pieces are made once, read lazily, saved and opened."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import napari_unwrap3d as unwrap3d
from moving import TIME_STEP_S, VOXEL_UM, blebbing, blebbing_movie, bumpy_ball, quick
from napari_unwrap3d import Movie, load_movie, unwrap_movie
from napari_unwrap3d.errors import Cancelled, EmptyMaskError, FileFormatError, InputError
from napari_unwrap3d.files.movie import MovieFolder, is_movie
from napari_unwrap3d.motion.movie import run_stages
from napari_unwrap3d.motion.stages import MovieWork
from napari_unwrap3d.motion.timelapse import Timelapse
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.progress import Progress


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


def work_on(folder: Path, parameters: Parameters | None = None) -> MovieWork:
    """The work of a movie of three timepoints; a coarse grid is quick."""
    chosen = parameters or quick(uv={"rows": 32})
    work = MovieWork(Timelapse.of(blebbing(3), TIME_STEP_S), chosen, MovieFolder(folder))
    work.begin()
    return work


def what_was_made(work: MovieWork) -> Counter[str]:
    """Run everything, and count the pieces that were not there."""
    from napari_unwrap3d.motion.stages import stages
    from napari_unwrap3d.progress import silent

    return Counter(
        stage
        for stage, timepoints in stages(len(work.lapse))
        for timepoint in timepoints
        if work.run(stage, timepoint, silent())
    )


ALL = Counter(register=3, segment=3, common=1, frame=3)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything made; copy it before changing it."""
    folder = tmp_path_factory.mktemp("done")
    assert what_was_made(work_on(folder)) == ALL
    return folder


@pytest.fixture
def copied(done: Path, tmp_path: Path) -> Path:
    import shutil

    return Path(shutil.copytree(done, tmp_path / "movie"))


def test_nothing_is_made_twice(copied: Path) -> None:
    assert what_was_made(work_on(copied)) == Counter()


@pytest.mark.parametrize(
    ("changes", "made"),
    [
        ({"movie": {"depth_um": 0.5}}, Counter(frame=3)),
        ({"movie": {"timepoint": 1}}, Counter(common=1, frame=3)),
        ({"uv": {"rows": 48}}, Counter(common=1, frame=3)),
        ({"stack": {"second_cell_fraction": 0.4}}, Counter(segment=3, common=1, frame=3)),
        ({"registration": {"method": "none", "channels": True}}, ALL),
        ({"protrusions": {"least_height_um": 0.4}}, Counter()),
    ],
)
def test_a_parameter_makes_what_depends_on_it(
    copied: Path, changes: dict[str, dict[str, object]], made: Counter[str]
) -> None:
    try:
        chosen = quick(**({"uv": {"rows": 32}} | changes))
    except unwrap3d.Unwrap3DError:
        pytest.skip("no such parameter")
    assert what_was_made(work_on(copied, chosen)) == made


def test_a_lost_piece_is_made_again_and_only_it(copied: Path) -> None:
    before = MovieFolder(copied).frame(1)
    (copied / "frames" / "00001.zip").unlink()
    assert what_was_made(work_on(copied)) == Counter(frame=1)
    after = MovieFolder(copied).frame(1)
    np.testing.assert_array_equal(before.topography, after.topography)
    for name, image in before.uv.items():
        np.testing.assert_array_equal(image, after.uv[name])


def test_a_damaged_piece_is_not_taken_for_done(copied: Path) -> None:
    path = copied / "frames" / "00002.zip"
    path.write_bytes(path.read_bytes()[:-100])
    assert what_was_made(work_on(copied)) == Counter(frame=1)


def test_a_changed_timepoint_changes_what_is_made_of_it(copied: Path) -> None:
    masks = blebbing(3)
    masks[1] = bumpy_ball([(3, 0.8)])
    chosen = quick(uv={"rows": 32})
    work = MovieWork(Timelapse.of(masks, TIME_STEP_S), chosen, MovieFolder(copied))
    assert what_was_made(work) == Counter(register=1, segment=1, common=1, frame=3)


def test_cancelling_keeps_what_was_made(tmp_path: Path) -> None:
    work = work_on(tmp_path)
    progress = Progress()

    def stop(stage: str, fraction: float, message: str) -> None:
        if stage == "segment" and fraction > 0.5:
            progress.cancel()

    progress.callback = stop
    with pytest.raises(Cancelled):
        run_stages(work, progress, until="frame")
    made = sorted(path.name for path in (tmp_path / "masks").iterdir())
    assert "00000.zip" in made
    assert not [name for name in made if name.endswith("partial")]
    again = what_was_made(work_on(tmp_path))
    assert again["segment"] == 3 - len(made)
    assert again["register"] == 0


def test_a_timepoint_without_a_cell_is_an_error_that_keeps_the_others(tmp_path: Path) -> None:
    masks = blebbing(3)
    masks[2] = unwrap3d.Mask(np.zeros((48,) * 3, bool), (VOXEL_UM,) * 3)
    with pytest.raises(EmptyMaskError):
        unwrap_movie(masks, quick(uv={"rows": 32}), time_step=1.0, folder=tmp_path)
    assert len(list((tmp_path / "masks").iterdir())) == 2


def test_frames_are_made_when_they_are_asked_for(tmp_path: Path) -> None:
    chosen = quick(uv={"rows": 32})
    movie = unwrap_movie(blebbing(3), chosen, time_step=1.0, folder=tmp_path)
    assert [movie.has_frame(t) for t in range(3)] == [False] * 3
    assert movie.frame(1).timepoint == 1
    assert [movie.has_frame(t) for t in range(3)] == [False, True, False]


def test_a_uv_stack_is_that_of_the_frames(movie: Movie) -> None:
    stack = movie.uv("height_um")
    assert stack.shape == (4, 64, 128)
    assert stack.dtype == np.float32
    assert stack.chunks[0] == (1, 1, 1, 1)
    for timepoint, frame in enumerate(movie.frames()):
        np.testing.assert_array_equal(stack[timepoint].compute(), frame.uv["height_um"])
    with pytest.raises(InputError, match="no field 'colour'"):
        movie.uv("colour")


def test_a_movie_without_folder_takes_its_own_away(tmp_path: Path) -> None:
    movie = unwrap_movie(blebbing(2), quick(uv={"rows": 32}), time_step=1.0)
    folder = movie.folder.path
    assert folder.is_dir()
    del movie
    assert not folder.exists()


def test_a_saved_movie_is_the_same(movie: Movie, tmp_path: Path) -> None:
    path = movie.save(tmp_path / "cell")
    assert path.name == "cell.unwrap3d"
    assert is_movie(path)
    assert is_movie(movie.folder.path)
    again = load_movie(path)
    assert len(again) == len(movie)
    assert (again.name, again.time_step_s) == (movie.name, movie.time_step_s)
    assert again.parameters == movie.parameters
    assert again.record == movie.record
    np.testing.assert_array_equal(again.common.topography.nodes, movie.common.topography.nodes)
    for timepoint in range(len(movie)):
        one, other = movie.frame(timepoint), again.frame(timepoint)
        np.testing.assert_array_equal(one.surface.vertices, other.surface.vertices)
        np.testing.assert_array_equal(one.surface.faces, other.surface.faces)
        np.testing.assert_array_equal(one.mask.data, other.mask.data)
        assert dict(one.numbers) == dict(other.numbers)
    assert again.check_table().equals(movie.check_table())


def test_a_saved_movie_makes_no_new_frames(movie: Movie, tmp_path: Path) -> None:
    again = load_movie(movie.save(tmp_path / "cell"))
    (again.folder.path / "frames" / "00001.zip").unlink()
    with pytest.raises(InputError, match="was not made"):
        again.frame(1)
    with pytest.raises(InputError, match="source"):
        again.compute()
    with pytest.raises(InputError, match="no timepoint 4"):
        again.frame(4)


def test_what_is_no_movie_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no movie"):
        load_movie(tmp_path)
    (tmp_path / "movie.json").write_text('{"format": "napari-unwrap3d movie"}')
    with pytest.raises(FileFormatError, match="another version"):
        load_movie(tmp_path)


def test_a_single_cell_is_no_movie(movie: Movie) -> None:
    path = movie.folder.common_path
    assert not is_movie(path)
    with pytest.raises(FileFormatError):
        load_movie(path)


@pytest.mark.parametrize("name", ["../outside.txt", "/tmp/outside.txt", "frames/../../outside.txt"])
def test_a_file_that_names_other_places_is_refused(movie: Movie, tmp_path: Path, name: str) -> None:
    import zipfile

    path = movie.save(tmp_path / "cell")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, "written")
    with pytest.raises(FileFormatError, match="must not"):
        load_movie(path)
    assert not (tmp_path.parent / "outside.txt").exists()


def test_a_movie_opened_as_a_cell_says_so(movie: Movie, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="load_movie"):
        unwrap3d.load(movie.save(tmp_path / "cell"))


def test_the_table_has_a_row_for_each_timepoint(movie: Movie) -> None:
    table = movie.check_table()
    assert list(table.timepoint) == [0, 1, 2, 3]
    assert list(table.time_s) == [0, 2, 4, 6]
    assert table.made.all()
    assert (table.outside_fraction == 0).all()
    assert movie.proposal() == ""


def test_the_third_way_is_proposed_where_the_surface_leaves_the_space(tmp_path: Path) -> None:
    still = bumpy_ball([])
    far = unwrap3d.Mask(still.data, still.voxel_size, (0, 6.0, 0))
    chosen = quick(uv={"rows": 32}, movie={"common": "timepoint"})
    movie = unwrap_movie([still, still, far], chosen, time_step=1.0, folder=tmp_path).compute()
    assert movie.record["method"] == "timepoint"
    assert movie.record["recommendation"]["method"] == "each"
    text = movie.proposal()
    assert "At timepoint 2" in text
    table = movie.check_table()
    assert (table.empty_fraction[:2] < 0.02).all()
    assert table.empty_fraction[2] > 0.5
    assert 'movie.common = "each"' in text


def test_info_tells_what_a_movie_is_of(
    movie: Movie, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from napari_unwrap3d.cli import main

    for path in (movie.folder.path, movie.save(tmp_path / "cell")):
        assert main(["info", str(path)]) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert "4, 2 s apart, 6 s in all" in said
        assert "4 of 4" in said
        assert "mean" in said
