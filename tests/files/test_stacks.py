"""Stacks from OME-Zarr, HDF5 and arrays: axes, sizes, values, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import dask.array as da
import h5py
import numpy as np
import pytest
import tifffile
import zarr
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import (
    AxesError,
    FileFormatError,
    InputError,
    VoxelSizeMissingError,
)
from napari_unwrap3d.files.metadata import micrometres, seconds
from napari_unwrap3d.files.stacks import read_stack, write_image

ANISOTROPIC = (0.3, 0.104, 0.105)


def numbered(*shape: int, dtype: Any = np.uint16) -> np.ndarray:
    """An array whose every element is another number."""
    return np.arange(np.prod(shape), dtype=dtype).reshape(shape)


def write_ome_zarr(path: Path, data: np.ndarray, version: str, **multiscale: Any) -> Path:
    axes = multiscale.pop(
        "axes",
        [
            {"name": "t", "type": "time", "unit": "minute"},
            {"name": "c", "type": "channel"},
            *({"name": a, "type": "space", "unit": "micrometer"} for a in "zyx"),
        ],
    )
    level = {
        "path": "0",
        "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 0.6, 0.208, 0.21]}],
    }
    image = {"axes": axes, "datasets": [level, {"path": "1"}], **multiscale}
    omero = {"channels": [{"label": "membrane"}, {"label": "actin"}]}
    old = version == "0.4"
    group = zarr.open_group(path, mode="w", zarr_format=2 if old else 3)
    array = group.create_array("0", shape=data.shape, chunks=(1, 1, 2, 5, 6), dtype=data.dtype)
    array[...] = data
    said = {"multiscales": [image], "omero": omero}
    group.attrs.update(said if old else {"ome": {"version": version, **said}})
    return path


# OME-Zarr ---------------------------------------------------------------------


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_ome_zarr_combines_the_scales(tmp_path: Path, version: str) -> None:
    data = numbered(3, 2, 4, 5, 6)
    top = {"type": "scale", "scale": [0.5, 1, 0.5, 0.5, 0.5]}
    path = write_ome_zarr(
        tmp_path / "cell.ome.zarr", data, version, coordinateTransformations=[top]
    )
    stack = read_stack(path)
    assert stack.axes == "tczyx"
    assert stack.voxel_size == pytest.approx(ANISOTROPIC)
    assert stack.time_step == pytest.approx(30.0)
    assert stack.channels == ("membrane", "actin")
    assert isinstance(stack.data, da.Array)
    assert np.array_equal(np.asarray(stack.data), data)


def test_ome_zarr_without_units_is_asked_about(tmp_path: Path) -> None:
    axes = [{"name": a} for a in "tczyx"]
    path = write_ome_zarr(tmp_path / "cell.zarr", numbered(1, 1, 4, 5, 6), "0.4", axes=axes)
    with pytest.raises(VoxelSizeMissingError, match=r"z = 0.6 \(no unit\)"):
        read_stack(path)
    assert read_stack(path, ANISOTROPIC).axes == "zyx"


def test_zarr_arrays_groups_and_label_images(tmp_path: Path) -> None:
    path = write_ome_zarr(tmp_path / "cell.zarr", numbered(1, 1, 4, 5, 6), "0.5")
    labels = zarr.open_group(path, mode="a").create_array(
        "labels/cells", shape=(4, 5, 6), dtype=np.uint16
    )
    labels[...] = numbered(4, 5, 6)
    assert read_stack(path, (1, 1, 1), dataset="labels/cells").shape == (4, 5, 6)
    with pytest.raises(FileFormatError, match=r"no member 'nothing'.*labels"):
        read_stack(path, (1, 1, 1), dataset="nothing")
    with pytest.raises(FileFormatError, match=r"no OME-Zarr image.*cells.*dataset='cells'"):
        read_stack(path / "labels", (1, 1, 1))


def test_a_damaged_zarr_is_named(tmp_path: Path) -> None:
    path = write_ome_zarr(tmp_path / "cell.zarr", numbered(1, 1, 4, 5, 6), "0.5")
    (path / "zarr.json").write_text((path / "zarr.json").read_text()[:100])
    with pytest.raises(FileFormatError, match=r"cell\.zarr"):
        read_stack(path)
    (path / "zarr.json").unlink()
    with pytest.raises(FileFormatError, match=r"cell\.zarr"):
        read_stack(path)


# HDF5 -------------------------------------------------------------------------


def write_hdf5(path: Path, **datasets: np.ndarray) -> Path:
    with h5py.File(path, "w") as file:
        for name, data in datasets.items():
            item = file.create_dataset(name, data=data, chunks=True, compression="gzip")
            item.attrs["element_size_um"] = ANISOTROPIC
    return path


def test_hdf5_takes_raw_or_the_only_dataset_or_the_given_one(tmp_path: Path) -> None:
    data = numbered(4, 5, 6)
    both = write_hdf5(tmp_path / "both.h5", raw=data, label=data + 1)
    assert np.array_equal(np.asarray(read_stack(both).data), data)
    assert np.array_equal(np.asarray(read_stack(both, dataset="/label").data), data + 1)
    one = write_hdf5(tmp_path / "one.h5", volume=data)
    assert read_stack(one).voxel_size == pytest.approx(ANISOTROPIC)
    unclear = write_hdf5(tmp_path / "unclear.h5", a=data, b=data)
    with pytest.raises(FileFormatError, match=r"a \(4, 5, 6\), b \(4, 5, 6\).*dataset='a'"):
        read_stack(unclear)
    with pytest.raises(FileFormatError, match="no dataset 'c'"):
        read_stack(unclear, dataset="c")
    with pytest.raises(FileFormatError, match="holds no image"):
        read_stack(write_hdf5(tmp_path / "empty.h5"))


def test_hdf5_axes_from_ilastik_or_labels_or_asked(tmp_path: Path) -> None:
    path = write_hdf5(tmp_path / "cell.h5", raw=numbered(4, 5, 6, 2))
    with pytest.raises(AxesError, match="not known"):
        read_stack(path)
    with h5py.File(path, "a") as file:
        tags = {"axes": [{"key": key} for key in "zyxc"]}
        file["raw"].attrs["axistags"] = json.dumps(tags)
    stack = read_stack(path)
    assert (stack.axes, stack.shape) == ("czyx", (2, 4, 5, 6))
    assert np.array_equal(np.asarray(stack.data), numbered(4, 5, 6, 2).transpose(3, 0, 1, 2))
    with h5py.File(path, "a") as file:
        del file["raw"].attrs["axistags"]
        for dimension, label in zip(file["raw"].dims, "tzyx", strict=True):
            dimension.label = label
    assert read_stack(path).axes == "tzyx"


def test_hdf5_is_lazy_and_can_be_written_afterwards(tmp_path: Path) -> None:
    path = write_hdf5(tmp_path / "cell.h5", raw=numbered(4, 5, 6))
    stack = read_stack(path)
    with h5py.File(path, "a") as file:
        file["raw"][0, 0, 0] = 99
    assert int(np.asarray(stack.data)[0, 0, 0]) == 99
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(FileFormatError, match=r"cell\.h5"):
        np.asarray(stack.data)
    with pytest.raises(FileFormatError, match=r"cell\.h5"):
        read_stack(path)


def test_hdf5_without_a_voxel_size_is_asked_about(tmp_path: Path) -> None:
    path = write_hdf5(tmp_path / "cell.h5", raw=numbered(4, 5, 6))
    with h5py.File(path, "a") as file:
        del file["raw"].attrs["element_size_um"]
    with pytest.raises(VoxelSizeMissingError, match="element_size_um"):
        read_stack(path)


# Arrays -----------------------------------------------------------------------


def test_arrays_stay_what_they_are() -> None:
    data = numbered(4, 5, 6)
    assert read_stack(data, (1, 1, 1)).data is data
    lazy = da.from_array(data)
    assert read_stack(lazy, (1, 1, 1)).data is lazy


@given(order=st.permutations("tczyx"), t=st.integers(1, 3), c=st.integers(1, 3))
def test_axes_come_out_in_order(order: list[str], t: int, c: int) -> None:
    lengths = {"t": t, "c": c, "z": 4, "y": 5, "x": 6}
    data = numbered(*(lengths[a] for a in order))
    stack = read_stack(data, (1, 2, 3), 5.0, axes="".join(order))
    expected = data.transpose([order.index(a) for a in "tczyx"])
    assert stack.axes == ("t" if t > 1 else "") + ("c" if c > 1 else "") + "zyx"
    assert np.array_equal(stack.data, expected.reshape(stack.shape))
    assert stack.time_step == (5.0 if t > 1 else None)
    assert len(stack.channels) == (c if c > 1 else 0)


def test_wrong_numbers_of_axes_are_refused() -> None:
    with pytest.raises(VoxelSizeMissingError):
        read_stack(numbered(4, 5, 6))
    for shape in ((5, 6), (1, 5, 6), (7,), ()):
        with pytest.raises(AxesError, match="not a stack of volumes"):
            read_stack(numbered(*shape), (1, 1, 1))
    with pytest.raises(AxesError, match="axes='tzyx'"):
        read_stack(numbered(2, 4, 5, 6), (1, 1, 1))
    with pytest.raises(AxesError, match="does not fit"):
        read_stack(numbered(4, 5, 6), (1, 1, 1), axes="tzyx")
    for axes in ("zyy", "zyq"):
        with pytest.raises(AxesError, match="letters of 'tczyx'"):
            read_stack(numbered(4, 5, 6), (1, 1, 1), axes=axes)
    with pytest.raises(AxesError, match="three numbers"):
        read_stack(numbered(4, 5, 6), (1, 1))
    with pytest.raises(InputError, match="positive"):
        read_stack(numbered(4, 5, 6), (1, 0, 1))
    with pytest.raises(InputError, match="time step"):
        read_stack(numbered(2, 4, 5, 6), (1, 1, 1), -1.0, axes="tzyx")
    with pytest.raises(AxesError, match="channel names"):
        read_stack(numbered(2, 4, 5, 6), (1, 1, 1), axes="czyx", channels=["one"])


def test_a_two_dimensional_file_is_refused(tmp_path: Path) -> None:
    path = write_image(tmp_path / "flat.ome.tif", numbered(5, 6), "yx", sizes={"y": 1, "x": 1})
    with pytest.raises(AxesError, match=r"flat\.ome\.tif is not a stack of volumes"):
        read_stack(path)


# Units ------------------------------------------------------------------------


def test_units() -> None:
    assert micrometres(104, "nm") == pytest.approx(0.104)
    assert micrometres("0.3", " Micron ") == pytest.approx(0.3)
    assert micrometres(-1.5, "μm") == 1.5
    for value, unit in ((1, "pixel"), (1, ""), (1, None), (0, "µm"), (np.nan, "µm"), (None, "µm")):
        assert micrometres(value, unit) is None
    assert seconds(2, "min") == 120.0
    assert seconds(0) is None


# Real stacks ------------------------------------------------------------------


def test_real_stacks(shared_data: Path) -> None:
    folder = shared_data / "stacks"
    movie = read_stack(folder / "ExampleTifSequence.tif", (1, 1, 1), 3.0)
    assert (movie.axes, movie.shape, movie.time_step) == ("tzyx", (21, 16, 30, 31), 3.0)
    embryo = folder / "Drosophila_CAAX-mCherry-tiny.tif"
    with pytest.raises(VoxelSizeMissingError):
        read_stack(embryo)
    assert read_stack(embryo, (1, 1, 1)).shape == (48, 128, 47)
    organoid = read_stack(folder / "Neural_tube_organoid_DAPI_betaCat-small.tif")
    assert (organoid.axes, organoid.shape) == ("czyx", (2, 31, 114, 114))
    assert organoid.voxel_size == pytest.approx((3.341, 3.4125, 3.4125), abs=1e-3)
    raw = tifffile.imread(folder / "Neural_tube_organoid_DAPI_betaCat-small.tif")
    assert np.array_equal(np.asarray(organoid.volume(0, 1)), raw[:, 1])
    ovule = read_stack(folder / "plantseg_sample_ovule.h5", dataset="label")
    assert ovule.voxel_size == pytest.approx((0.235, 0.15, 0.15))
    assert len(np.unique(np.asarray(ovule.data))) == 51
    foam = read_stack(folder / "limeseg_Dub-WilliamMohler-Tp33-Half.zip", (1, 1, 1))
    assert (foam.axes, foam.shape) == ("zyx", (33, 256, 384))
