"""What is written as OME-Zarr comes back, with its sizes, and is what the standard asks for."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest
import zarr

from napari_unwrap3d.errors import AxesError, InputError
from napari_unwrap3d.files.ome_zarr import write_ome_zarr
from napari_unwrap3d.files.stacks import read_stack


def numbered(*shape: int) -> np.ndarray:
    return np.arange(np.prod(shape), dtype=np.uint16).reshape(shape)


def test_a_movie_comes_back_with_sizes_times_and_names(tmp_path: Path) -> None:
    data = numbered(2, 3, 4, 5, 6)
    path = write_ome_zarr(
        tmp_path / "cell.ome.zarr",
        data,
        "tczyx",
        sizes={"z": 0.3, "y": 0.1, "x": 0.2},
        time_step=2.5,
        channels=("membrane", "actin", "µ"),
    )
    stack = read_stack(path)
    assert (stack.axes, stack.voxel_size, stack.time_step) == ("tczyx", (0.3, 0.1, 0.2), 2.5)
    assert stack.channels == ("membrane", "actin", "µ")
    np.testing.assert_array_equal(np.asarray(stack.data), data)
    assert stack.data.dtype == np.uint16


def test_the_description_is_that_of_the_standard(tmp_path: Path) -> None:
    path = write_ome_zarr(
        tmp_path / "topography.ome.zarr",
        numbered(2, 4, 5, 10),
        "czyx",
        sizes={"z": 0.05},
        origin={"z": -1.5},
        channels=("mask", "actin"),
    )
    node = json.loads((path / "zarr.json").read_text())
    assert (node["zarr_format"], node["node_type"]) == (3, "group")
    ome = node["attributes"]["ome"]
    assert ome["version"] == "0.5"
    (image,) = ome["multiscales"]
    assert image["axes"] == [
        {"name": "c", "type": "channel"},
        {"name": "z", "type": "space", "unit": "micrometer"},
        {"name": "y", "type": "space"},
        {"name": "x", "type": "space"},
    ]
    (level,) = image["datasets"]
    assert level["coordinateTransformations"] == [
        {"type": "scale", "scale": [1.0, 0.05, 1.0, 1.0]},
        {"type": "translation", "translation": [0.0, -1.5, 0.0, 0.0]},
    ]
    array = zarr.open_array(str(path / level["path"]), mode="r")
    assert array.metadata.dimension_names == tuple("czyx")
    assert array.chunks == (1, 4, 5, 10)
    labels = [channel["label"] for channel in ome["omero"]["channels"]]
    assert labels == ["mask", "actin"]
    assert ome["omero"]["channels"][0]["window"] == {"min": 0, "max": 199, "start": 0, "end": 199}


def test_truth_values_and_long_floats_are_stored_short(tmp_path: Path) -> None:
    for data, stored in ((numbered(3, 4) > 5, np.uint8), (numbered(3, 4) / 7, np.float32)):
        path = write_ome_zarr(tmp_path / "a.ome.zarr", data, "yx")
        array = zarr.open_array(str(path / "0"), mode="r")
        assert array.dtype == stored
        np.testing.assert_allclose(array[:], data, rtol=1e-6)


def test_values_that_are_not_finite_leave_the_window_finite(tmp_path: Path) -> None:
    data = np.array([[[np.nan, 1], [2, np.inf]], np.full((2, 2), np.nan)])
    path = write_ome_zarr(tmp_path / "a.ome.zarr", data, "cyx", channels=("a", "b"))
    text = (path / "zarr.json").read_text()
    channels = json.loads(text)["attributes"]["ome"]["omero"]["channels"]
    assert [(c["window"]["min"], c["window"]["max"]) for c in channels] == [(1, 2), (0, 1)]
    assert "NaN" not in text


def test_an_image_replaces_the_one_before_or_leaves_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_ome_zarr(tmp_path / "a.ome.zarr", numbered(3, 4, 5))
    write_ome_zarr(path, numbered(2, 4, 5), "zyx")
    assert zarr.open_array(str(path / "0"), mode="r").shape == (2, 4, 5)

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_ome_zarr(path, numbered(9, 4, 5))
    assert zarr.open_array(str(path / "0"), mode="r").shape == (2, 4, 5)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_what_does_not_fit_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.ome.zarr"
    with pytest.raises(AxesError, match="dimensions = 2"):
        write_ome_zarr(path, numbered(3, 4))
    with pytest.raises(AxesError, match="names = 1"):
        write_ome_zarr(path, numbered(3, 4, 5), "cyx", channels=("a",))
    with pytest.raises(InputError, match="complex"):
        write_ome_zarr(path, numbered(3, 4, 5) * 1j)
    assert not list(tmp_path.iterdir())
