"""Movies as files: what is written is read back."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.image import imread

from movies import read_mp4 as read
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.files.movie_export import FrameWriter, write_frames

COUNT = 5


def frames(rows: int = 48, columns: int = 64) -> list[np.ndarray]:
    """A white bar that goes down, on a ramp of red."""
    ramp = np.zeros((rows, columns, 3), np.uint8)
    ramp[..., 0] = np.linspace(0, 200, columns)
    made = [ramp.copy() for _ in range(COUNT)]
    for i, image in enumerate(made):
        image[8 * i : 8 * i + 8] = 255
    return made


def test_an_mp4_holds_the_frames(tmp_path: Path) -> None:
    path = write_frames(tmp_path / "movie.mp4", frames(), fps=7, quality=10)
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == COUNT
    assert seconds == pytest.approx(COUNT / 7, abs=0.02)
    found = read(path)
    assert len(found) == COUNT
    for image, given in zip(found, frames(), strict=True):
        assert np.abs(image.astype(int) - given).mean() < 6
        assert (image[..., 1] > 128).any(axis=1).nonzero()[0].tolist() == (
            (given[..., 1] > 128).any(axis=1).nonzero()[0].tolist()
        )
    assert [entry.name for entry in tmp_path.iterdir()] == ["movie.mp4"]


def test_odd_sizes_become_even(tmp_path: Path) -> None:
    path = write_frames(tmp_path / "movie.mp4", frames(47, 63))
    assert read(path)[0].shape == (48, 64, 3)


def test_the_same_frames_give_the_same_file(tmp_path: Path) -> None:
    one, other = (write_frames(tmp_path / f"{i}.mp4", frames()) for i in range(2))
    assert one.read_bytes() == other.read_bytes()


def test_frames_as_png(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", frames(47, 63))
    names = sorted(entry.name for entry in folder.iterdir())
    assert names == [f"frame_{i:05d}.png" for i in range(COUNT)]
    for name, given in zip(names, frames(47, 63), strict=True):
        found = np.rint(255 * imread(folder / name)[..., :3]).astype(np.uint8)
        np.testing.assert_array_equal(found, given)
    write_frames(folder, frames()[:2])
    assert len(list(folder.iterdir())) == 2, "an earlier movie is replaced as a whole"


@pytest.mark.parametrize("name", ["movie.mp4", "frames"])
def test_an_error_leaves_what_was_there(tmp_path: Path, name: str) -> None:
    path = write_frames(tmp_path / name, frames()[:3])

    def failing():
        yield frames()[0]
        raise RuntimeError("the disk is on fire")

    with pytest.raises(RuntimeError, match="on fire"):
        write_frames(path, failing())
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    assert len(read(path) if path.is_file() else list(path.iterdir())) == 3
    writer = FrameWriter(path)
    writer.add(frames()[0])
    writer.abandon()
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    assert len(read(path) if path.is_file() else list(path.iterdir())) == 3


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"thesis\.txt"):
        write_frames(tmp_path, frames())
    with pytest.raises(InputError, match="is a file"):
        write_frames(tmp_path / "thesis.txt", frames())
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_bad_frames_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "movie.mp4"
    with pytest.raises(InputError, match="one size"):
        write_frames(path, [*frames(), *frames(50, 64)])
    with pytest.raises(InputError, match="RGB"):
        write_frames(path, [np.zeros((4, 4), np.uint8)])
    with pytest.raises(InputError, match="RGB"):
        write_frames(path, [np.zeros((4, 4, 3))])
    with pytest.raises(InputError, match="at least one"):
        write_frames(path, [])
    for fps, quality in ((0, 5), (-3, 5), (10, 11), (10, 0), (float("nan"), 5)):
        with pytest.raises(ParameterError):
            write_frames(path, frames(), fps, quality)
    assert not list(tmp_path.iterdir())


def test_an_encoder_that_fails_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("napari_unwrap3d.files.movie_export.count_frames", lambda path: 3)
    with pytest.raises(OSError, match="3 of 5 frames"):
        write_frames(tmp_path / "movie.mp4", frames())
    assert not list(tmp_path.iterdir())


def test_without_the_package_the_way_out_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"napari-unwrap3d\[video\]"):
        FrameWriter(tmp_path / "movie.mp4")
    write_frames(tmp_path / "frames", frames())
