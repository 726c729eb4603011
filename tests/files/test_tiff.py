"""TIFF stacks of every kind, plain and zipped, read and written."""

from __future__ import annotations

import gc
import pickle
import warnings
import zipfile
from pathlib import Path
from typing import Any

import dask.array as da
import numpy as np
import pytest
import tifffile

from napari_unwrap3d.errors import (
    AxesError,
    FileFormatError,
    InputError,
    VoxelSizeMissingError,
)
from napari_unwrap3d.files.stacks import read_stack, write_image

ANISOTROPIC = (0.3, 0.104, 0.105)


def numbered(*shape: int, dtype: Any = np.uint16) -> np.ndarray:
    """An array whose every element is another number."""
    return np.arange(np.prod(shape), dtype=dtype).reshape(shape)


def physical(z: float, y: float, x: float, unit: str) -> dict[str, Any]:
    sizes = {"Z": z, "Y": y, "X": x}
    return {
        **{f"PhysicalSize{a}": s for a, s in sizes.items()},
        **{f"PhysicalSize{a}Unit": unit for a in sizes},
    }


def write_imagej(path: Path, data: np.ndarray, axes: str, **metadata: Any) -> Path:
    x, y = metadata.pop("resolution", (1 / 0.105, 1 / 0.104))
    said = {"axes": axes, **metadata}
    tifffile.imwrite(path, data, imagej=True, resolution=(x or 1, y or 1), metadata=said)
    if not x:
        with tifffile.TiffFile(path, mode="r+") as tif:
            for tag in ("XResolution", "YResolution"):
                tif.pages.first.tags[tag].overwrite((0, 1))
    return path


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("µm", 1.0), (r"\u00B5m", 1.0), ("um", 1.0), ("nm", 1000.0), ("mm", 0.001)],
)
def test_ome_tiff_in_any_unit(tmp_path: Path, unit: str, factor: float) -> None:
    data = numbered(3, 2, 4, 5, 6)
    metadata = {
        "axes": "TCZYX",
        **physical(*(s * factor for s in ANISOTROPIC), unit),
        "TimeIncrement": 2500,
        "TimeIncrementUnit": "ms",
        "Channel": {"Name": ["membrane", "actin"]},
    }
    path = tmp_path / "cell.ome.tif"
    tifffile.imwrite(path, data, photometric="minisblack", metadata=metadata)
    if unit.startswith("\\"):
        assert b"\\u00B5m" in path.read_bytes()
    stack = read_stack(path)
    assert stack.axes == "tczyx"
    assert stack.voxel_size == pytest.approx(ANISOTROPIC)
    assert stack.time_step == pytest.approx(2.5)
    assert stack.channels == ("membrane", "actin")
    assert stack.name == "cell.ome.tif"
    assert np.array_equal(np.asarray(stack.data), data)
    assert np.array_equal(np.asarray(stack.volume(2, 1)), data[2, 1])


@pytest.mark.parametrize("unit", ["micron", "microns", r"\u00B5m", "um"])
def test_imagej_tiff(tmp_path: Path, unit: str) -> None:
    data = numbered(3, 4, 2, 5, 6)
    path = write_imagej(
        tmp_path / "cell.tif", data, "TZCYX", unit=unit, spacing=0.3, finterval=2.5, tunit="sec"
    )
    stack = read_stack(path)
    assert stack.axes == "tczyx"
    assert stack.voxel_size == pytest.approx(ANISOTROPIC, rel=1e-5)
    assert stack.time_step == pytest.approx(2.5)
    assert stack.channels == ("channel 0", "channel 1")
    assert np.array_equal(np.asarray(stack.data), data.transpose(0, 2, 1, 3, 4))


@pytest.mark.parametrize(
    ("metadata", "axes", "said"),
    [
        ({"spacing": 0.3}, "z, y, x", "missing"),
        ({"spacing": 0.3, "unit": "pixel"}, "z, y, x", "pixel"),
        ({"unit": "micron"}, "along z.", "micron"),
        ({"unit": "micron", "spacing": 0.3, "resolution": (0, 0)}, "along y, x.", "z = 0.3"),
    ],
)
def test_imagej_without_a_full_voxel_size_is_asked_about(
    tmp_path: Path, metadata: dict[str, Any], axes: str, said: str
) -> None:
    path = write_imagej(tmp_path / "cell.tif", numbered(4, 5, 6), "ZYX", **metadata)
    with pytest.raises(VoxelSizeMissingError) as raised:
        read_stack(path)
    for words in ("cell.tif", axes, said, "voxel_size=(z, y, x)", "--voxel-size"):
        assert words in str(raised.value)
    assert read_stack(path, ANISOTROPIC).voxel_size == ANISOTROPIC


def test_ome_tiff_without_z_size_is_asked_about(tmp_path: Path) -> None:
    path = write_image(tmp_path / "cell.ome.tif", numbered(4, 5, 6), sizes={"y": 0.1, "x": 0.1})
    with pytest.raises(VoxelSizeMissingError, match=r"along z\..*y = 0.1 µm"):
        read_stack(path)


def test_plain_tiff_pages_are_slices(tmp_path: Path) -> None:
    data = numbered(4, 5, 6)
    path = tmp_path / "cell.tif"
    tifffile.imwrite(path, data, photometric="minisblack")
    with pytest.raises(VoxelSizeMissingError, match="plain TIFF"):
        read_stack(path)
    stack = read_stack(path, (2, 1, 1), name="mine")
    assert (stack.axes, stack.name) == ("zyx", "mine")
    assert np.array_equal(np.asarray(stack.data), data)


def test_big_endian_and_compressed_pages(tmp_path: Path) -> None:
    data = numbered(4, 5, 6)
    for name, options in {"big": {"byteorder": ">"}, "zip": {"compression": "zlib"}}.items():
        path = tmp_path / f"{name}.tif"
        tifffile.imwrite(path, data, photometric="minisblack", **options)
        stack = read_stack(path, (1, 1, 1))
        assert np.array_equal(np.asarray(stack.data), data), name
        assert stack.data.dtype.isnative


def test_time_that_is_really_z_is_explained(tmp_path: Path) -> None:
    path = write_imagej(tmp_path / "cell.tif", numbered(4, 5, 6), "TYX", unit="micron", spacing=1)
    with pytest.raises(AxesError, match="axes='zyx'"):
        read_stack(path)
    assert read_stack(path, (1, 1, 1), axes="zyx").shape == (4, 5, 6)


def test_several_images_in_one_file_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "two.ome.tif"
    with tifffile.TiffWriter(path) as writer:
        for depth in (4, 7):
            writer.write(numbered(depth, 5, 6), photometric="minisblack", metadata={"axes": "ZYX"})
    with pytest.raises(FileFormatError, match=r"two\.ome\.tif holds several images.*dataset=0"):
        read_stack(path, (1, 1, 1))
    stack = read_stack(path, (1, 1, 1), dataset=1)
    assert np.array_equal(np.asarray(stack.data), numbered(7, 5, 6))
    with pytest.raises(InputError, match="no number"):
        read_stack(path, (1, 1, 1), dataset="raw")


def test_reading_is_lazy_and_leaves_no_file_open(tmp_path: Path) -> None:
    data = numbered(3, 2, 40, 50, 60, dtype=np.uint32)
    for options in ({}, {"compression": "zlib"}):
        path = tmp_path / "cell.ome.tif"
        metadata = {"axes": "TCZYX", **physical(1, 1, 1, "µm")}
        tifffile.imwrite(path, data, ome=True, metadata=metadata, **options)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            stack = read_stack(path)
            assert isinstance(stack.data, da.Array)
            assert stack.volume(1, 1).chunksize[-2:] == (50, 60)
            box = np.asarray(stack.volume(1, 1)[3:9, 10:20, 30:50])
            sent = pickle.loads(pickle.dumps(stack.volume(1, 1)))
            assert np.array_equal(np.asarray(sent), data[1, 1])
            del stack, sent
            gc.collect()
        assert np.array_equal(box, data[1, 1, 3:9, 10:20, 30:50])
        assert [w for w in caught if w.category is ResourceWarning] == []
        path.unlink()


def test_a_file_that_changes_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "cell.tif"
    for offset in (0, 7):
        tifffile.imwrite(path, numbered(4, 5, 6) + offset, photometric="minisblack")
        stack = read_stack(path, (1, 1, 1))
        assert int(np.asarray(stack.data).min()) == offset


@pytest.mark.parametrize("kind", ["ome", "imagej", "plain", "zlib"])
@pytest.mark.parametrize("kept", [0.0, 0.003, 0.3, 0.7, 0.97])
def test_truncated_tiffs_are_named(tmp_path: Path, kind: str, kept: float) -> None:
    data = np.random.default_rng(0).integers(0, 9999, (12, 40, 50), dtype=np.uint16)
    path = tmp_path / "cell.tif"
    metadata = {"axes": "ZYX"}
    options: dict[str, Any] = {
        "ome": {"ome": True, "metadata": {**metadata, **physical(1, 1, 1, "µm")}},
        "imagej": {"imagej": True, "metadata": {**metadata, "unit": "um", "spacing": 1}},
        "plain": {"photometric": "minisblack"},
        "zlib": {"ome": True, "compression": "zlib", "metadata": metadata},
    }[kind]
    tifffile.imwrite(path, data, **options)
    content = path.read_bytes()
    assert read_stack(path, (1, 1, 1)).shape == data.shape
    path.write_bytes(content[: int(kept * len(content))])
    if kind == "imagej" and kept > 0.9:
        # ImageJ's own page table stands in front of the pixels; what is cut off is a copy.
        assert np.array_equal(np.asarray(read_stack(path, (1, 1, 1)).data), data)
        return
    with pytest.raises(FileFormatError, match=r"cell\.tif.*truncated"):
        read_stack(path, (1, 1, 1))


def test_a_tiff_damaged_after_opening_is_named(tmp_path: Path) -> None:
    path = tmp_path / "cell.tif"
    tifffile.imwrite(path, numbered(4, 5, 6), photometric="minisblack", compression="zlib")
    stack = read_stack(path, (1, 1, 1))
    path.write_bytes(b"nothing")
    with pytest.raises(FileFormatError, match=r"cell\.tif"):
        np.asarray(stack.data)


def test_other_content_is_refused(tmp_path: Path) -> None:
    for name in ("cell.tif", "cell.h5", "cell.zip"):
        (tmp_path / name).write_bytes(bytes(range(256)))
        with pytest.raises(FileFormatError, match=name):
            read_stack(tmp_path / name)
    (tmp_path / "cell.doc").write_text("")
    with pytest.raises(FileFormatError, match=r"cell\.doc.*Known"):
        read_stack(tmp_path / "cell.doc")
    with pytest.raises(FileFormatError, match="no file"):
        read_stack(tmp_path / "missing.tif")


# Zip --------------------------------------------------------------------------


def test_a_zip_with_one_tiff_is_read(tmp_path: Path) -> None:
    inner = write_imagej(
        tmp_path / "cell.tif", numbered(4, 5, 6), "ZYX", unit="micron", spacing=0.3
    )
    path = tmp_path / "cell.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(inner, "folder/cell.tif")
        archive.writestr("__MACOSX/folder/._cell.tif", b"rubbish")
        archive.writestr("readme.txt", "about")
    stack = read_stack(path)
    assert stack.voxel_size == pytest.approx(ANISOTROPIC, rel=1e-5)
    assert np.array_equal(np.asarray(stack.data), numbered(4, 5, 6))
    with zipfile.ZipFile(path, "a") as archive:
        archive.write(inner, "other.tiff")
    with pytest.raises(FileFormatError, match=r"exactly one TIFF.*tiff_files = 2"):
        read_stack(path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(FileFormatError, match=r"cell\.zip"):
        read_stack(path)


# Writing ----------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32])
@pytest.mark.parametrize("axes", ["zyx", "czyx", "tzyx", "tczyx"])
def test_written_images_come_back(tmp_path: Path, axes: str, dtype: Any) -> None:
    shape = [{"t": 2, "c": 3, "z": 4, "y": 5, "x": 6}[a] for a in axes]
    data = numbered(*shape).astype(dtype)
    names = ["a", "b", "c"] if "c" in axes else []
    path = write_image(
        tmp_path / "cell.ome.tif",
        data,
        axes,
        sizes=dict(zip("zyx", ANISOTROPIC, strict=True)),
        time_step=2.5 if "t" in axes else None,
        channels=names,
    )
    stack = read_stack(path)
    assert stack.axes == axes
    assert stack.voxel_size == pytest.approx(ANISOTROPIC)
    assert stack.time_step == (2.5 if "t" in axes else None)
    assert list(stack.channels) == names
    assert stack.data.dtype == dtype
    assert np.array_equal(np.asarray(stack.data), data)


def test_a_uv_image_with_fields_is_written(tmp_path: Path) -> None:
    fields = np.random.default_rng(0).random((3, 32, 64))
    names = ["conformal_error", "area_distortion", "area_um2"]
    path = write_image(tmp_path / "uv.ome.tif", fields, "cyx", channels=names)
    with tifffile.TiffFile(path) as tif:
        assert tif.is_ome
        assert tif.series[0].axes == "CYX"
        assert tif.asarray() == pytest.approx(fields, abs=1e-6)
        assert all(name in (tif.ome_metadata or "") for name in names)
    mask = write_image(tmp_path / "mask.ome.tif", fields[0] > 0.5, "yx")
    assert np.array_equal(tifffile.imread(mask), fields[0] > 0.5)


def test_what_cannot_be_written_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "cell.ome.tif"
    with pytest.raises(AxesError, match="dimensions = 3"):
        write_image(path, numbered(4, 5, 6), "yx")
    with pytest.raises(AxesError, match="in this order"):
        write_image(path, numbered(4, 5, 6), "xyz")
    with pytest.raises(AxesError, match="channel names"):
        write_image(path, numbered(4, 5, 6), "cyx", channels=["a"])
    with pytest.raises(InputError, match="32 bits"):
        write_image(path, numbered(4, 5, 6, dtype=np.int64) + 2**40)
    with pytest.raises(InputError, match="numbers"):
        write_image(path, np.full((4, 5, 6), "text"))
    assert list(tmp_path.iterdir()) == []
