"""Every input that should not be: refused by name, with numbers and a way out, or repaired aloud.

Each entry goes in through the public API, as a user's would. What must not come out of
any of them is a wrong result without a word: of a repaired input the volume is checked.
"""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d import errors
from napari_unwrap3d.files.meshes import MESH_SUFFIXES, write_mesh
from napari_unwrap3d.files.stacks import write_image
from napari_unwrap3d.parameters import Parameters
from properties.broken_meshes import MESHES
from properties.cages import FACES, ROUND, ROUND_UM3, VOXEL, Refused, Repaired, together, turned
from shapes import QUICK, VOXEL_UM, ball, grid

SIDE = 33
MESH_VOXEL = Parameters.from_dict({**QUICK.model_dump(), "stack": {"working_voxel_um": 0.08}})


def mask(solid: Any, voxel_size: Any = VOXEL) -> Callable[[Path], unwrap3d.Mask]:
    return lambda folder: unwrap3d.Mask(solid, voxel_size)


def stack(data: Any, voxel_size: Any = VOXEL, **said: Any) -> Callable[[Path], unwrap3d.Stack]:
    return lambda folder: unwrap3d.read_stack(data, voxel_size, **said)


# Stacks and masks --------------------------------------------------------------------


def recorded(solid: np.ndarray, seed: int = 0) -> np.ndarray:
    """A noisy recording of a solid."""
    rng = np.random.default_rng(seed)
    return rng.poisson(np.where(solid, 200, 50)).astype(np.float32)


CELL = ball(10, SIDE)
IMAGE = recorded(CELL)


def spoilt(data: np.ndarray, value: float, voxels: int) -> np.ndarray:
    result = data.astype(float)
    result[3, 4, 5 : 5 + voxels] = value
    return result


def one_voxel() -> np.ndarray:
    solid = np.zeros((SIDE,) * 3, bool)
    solid[16, 16, 16] = True
    return solid


def two_cells() -> np.ndarray:
    solid = np.zeros((SIDE, SIDE, 2 * SIDE), bool)
    solid[:, :, :SIDE], solid[:, :, SIDE:] = CELL, ball(9, SIDE)
    return solid


def nested() -> np.ndarray:
    """A shell, a cavity in it, and a core that floats in the cavity with a cavity of its own."""
    distance = np.linalg.norm(grid(45), axis=-1)
    return ((distance < 19) & (distance > 13)) | ((distance < 9) & (distance > 5))


def cubic_um(solid: np.ndarray) -> float:
    return float(solid.sum()) * VOXEL_UM**3


IMAGES: dict[str, Refused | Repaired] = {
    "NaN voxels": Refused(
        stack(spoilt(IMAGE, np.nan, 3)), errors.NotFiniteError, "NaN", {"voxels": 3}
    ),
    "infinite voxels": Refused(
        stack(spoilt(IMAGE, -np.inf, 2)), errors.NotFiniteError, "infinite", {"voxels": 2}
    ),
    "voxels beyond single precision": Refused(
        stack(spoilt(IMAGE, 1e200, 1)), errors.NotFiniteError, "3e38", {"voxels": 1}
    ),
    "NaN in a mask": Refused(
        mask(spoilt(CELL, np.nan, 1)), errors.NotFiniteError, "mask", {"voxels": 1}
    ),
    "complex voxels": Refused(
        stack(IMAGE.astype(complex)), errors.InputError, "real numbers", {"dtype": "complex128"}
    ),
    "an empty mask": Refused(mask(~np.ones_like(CELL)), errors.EmptyMaskError, "No voxel"),
    "a full mask": Refused(mask(np.ones_like(CELL)), errors.FullMaskError, "Every voxel"),
    "one intensity": Refused(
        stack(np.full((9, 9, 9), 7.0)), errors.EmptyMaskError, "one intensity", {"intensity": 7.0}
    ),
    "labels instead of a mask": Refused(
        mask(np.arange(27).reshape(3, 3, 3)), errors.InputError, "label image", {"values": 27}
    ),
    "a one-voxel mask": Refused(
        mask(one_voxel()), errors.EmptyMaskError, "after smoothing", {"voxels": 1}
    ),
    "a one-voxel stack": Refused(
        stack(200 * one_voxel().astype(np.uint8)), errors.EmptyMaskError, "smoothing", {"voxels": 1}
    ),
    "a few voxels": Refused(mask(ball(3, 15)), errors.TooSmallError, "too small", {"needed": 500}),
    "two cells in a stack": Refused(
        stack(recorded(two_cells())), errors.SeveralCellsError, "2 objects", {"components": 2}
    ),
    "two cells in a mask": Refused(
        mask(two_cells()), errors.SeveralCellsError, "2 objects", {"components": 2}
    ),
    "a crumb beside the cell": Repaired(
        mask(CELL | np.roll(one_voxel(), 15, 0)), "dropped voxels = 1", cubic_um(CELL)
    ),
    "a cell cut in half by the border": Refused(
        stack(IMAGE[16:]), errors.TouchesBorderError, "border", {"sides": 1}
    ),
    "a cell that touches the border": Repaired(
        stack(IMAGE[9:]), r"closed flat at the border of the image \(177\)", cubic_um(CELL[9:])
    ),
    "a mask of one plane": Refused(
        mask(CELL[16:17]), errors.TouchesBorderError, "larger field of view", {"sides": 2}
    ),
    "nested cavities": Repaired(
        mask(nested()), r"dropped components = 1.*sealed cavity count = 1", 4 / 3 * np.pi * 1.9**3
    ),
    "nested cavities in a stack": Repaired(
        stack(recorded(nested())), "filled cavities = 1", 4 / 3 * np.pi * 1.9**3
    ),
}


# Axes and sizes ----------------------------------------------------------------------

AXES: dict[str, Refused | Repaired] = {
    "a 2D image": Refused(stack(IMAGE[16]), errors.AxesError, "volumes", {"axes": "yx"}),
    "a 2D mask": Refused(mask(CELL[16]), errors.AxesError, "three axes", {"dimensions": 2}),
    "one slice": Refused(stack(IMAGE[16:17]), errors.AxesError, "along z"),
    "slices called time": Refused(stack(IMAGE, axes="tyx"), errors.AxesError, "along z"),
    "four unnamed axes": Refused(stack(IMAGE[None]), errors.AxesError, "not known"),
    "an axis twice": Refused(stack(IMAGE, axes="zyy"), errors.AxesError, "at most once"),
    "too few letters": Refused(stack(IMAGE, axes="yx"), errors.AxesError, "fit", {"letters": 2}),
    "a letter that is none": Refused(stack(IMAGE, axes="zyq"), errors.AxesError, "letters of"),
    "no voxel size": Refused(stack(IMAGE, None), errors.VoxelSizeMissingError, "not known"),
    "two numbers": Refused(stack(IMAGE, (1, 1)), errors.AxesError, "three", {"numbers": 2}),
    "words": Refused(stack(IMAGE, "0.1 µm"), errors.InputError, "numbers only"),
    "zero": Refused(stack(IMAGE, (0.0, 1, 1)), errors.InputError, "positive"),
    "negative": Refused(mask(CELL, (1, -1.0, 1)), errors.InputError, "positive"),
    "NaN": Refused(stack(IMAGE, (np.nan, 1, 1)), errors.InputError, "positive"),
    "infinite": Refused(stack(IMAGE, (np.inf, 1, 1)), errors.InputError, "positive"),
    "metres": Refused(stack(IMAGE, (1e-7,) * 3), errors.InputError, "lengths in µm"),
    "kilometres": Refused(mask(CELL, (1e7,) * 3), errors.InputError, "lengths in µm"),
    "slices 300 nm apart given in nm": Refused(
        stack(IMAGE, (300, 0.1, 0.1)), errors.InputError, "too long", {"ratio": 300 / 0.1}
    ),
}


# Files -------------------------------------------------------------------------------


def cut_off(path: Path, kept: float) -> Path:
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    return path


def broken(path: Path) -> Path:
    """Some bytes in the middle are lost."""
    content = bytearray(path.read_bytes())
    content[len(content) // 3 : len(content) // 2] = bytes(len(content) // 2 - len(content) // 3)
    path.write_bytes(content)
    return path


def tiff(folder: Path) -> Path:
    sizes = dict.fromkeys("zyx", VOXEL_UM)
    return write_image(folder / "cell.ome.tif", IMAGE, "zyx", sizes=sizes)


def hdf5(folder: Path) -> Path:
    import h5py

    with h5py.File(folder / "cell.h5", "w") as file:
        item = file.create_dataset("raw", data=IMAGE, compression="gzip")
        item.attrs["element_size_um"] = VOXEL
    return folder / "cell.h5"


def zarr_folder(folder: Path) -> Path:
    import zarr

    zarr.save_array(str(folder / "cell.zarr"), IMAGE)
    cut_off(folder / "cell.zarr" / "zarr.json", 0.5)
    return folder / "cell.zarr"


def off_with_nan(folder: Path) -> Path:
    path = write_mesh(folder / "cell.off", ROUND, FACES)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:4], "nan 0 0", *lines[5:]]))
    return path


def read_and_segment(path: Path) -> unwrap3d.Stack:
    return unwrap3d.read_stack(path, VOXEL)


FILES: dict[str, Refused | Repaired] = {
    "no file": Refused(
        lambda folder: read_and_segment(folder / "cell.tif"), errors.FileFormatError, "no file"
    ),
    "another kind of file": Refused(
        lambda folder: read_and_segment(write_mesh(folder / "a.ply", ROUND, FACES)),
        errors.FileFormatError,
        "read_mesh",
    ),
    "a truncated TIFF": Refused(
        lambda folder: read_and_segment(cut_off(tiff(folder), 0.6)),
        errors.FileFormatError,
        "cell.ome.tif",
    ),
    "an empty TIFF": Refused(
        lambda folder: read_and_segment(cut_off(tiff(folder), 0.0)),
        errors.FileFormatError,
        "cell.ome.tif",
    ),
    "a truncated HDF5": Refused(
        lambda folder: read_and_segment(cut_off(hdf5(folder), 0.6)),
        errors.FileFormatError,
        "cell.h5",
    ),
    "a damaged HDF5": Refused(
        lambda folder: read_and_segment(broken(hdf5(folder))), errors.FileFormatError, "cell.h5"
    ),
    "a damaged Zarr": Refused(
        lambda folder: read_and_segment(zarr_folder(folder)), errors.FileFormatError, "cell.zarr"
    ),
    "a mesh file with NaN": Refused(
        lambda folder: unwrap3d.read_mesh(off_with_nan(folder)), errors.NotFiniteError, "Vertices"
    ),
    **{
        f"a truncated {suffix} mesh": Refused(
            lambda folder, suffix=suffix: unwrap3d.read_mesh(
                cut_off(write_mesh(folder / f"cell{suffix}", ROUND, FACES), 0.7)
            ),
            # An OBJ file does not say how many faces it has: what is missing is a hole.
            errors.NotWatertightError if suffix == ".obj" else errors.FileFormatError,
            "",
        )
        for suffix in MESH_SUFFIXES
    },
}

ZOO = {
    f"{house}: {name}": entry
    for house, entries in (("image", IMAGES), ("axes", AXES), ("mesh", MESHES), ("file", FILES))
    for name, entry in entries.items()
}
REFUSED = {name: entry for name, entry in ZOO.items() if isinstance(entry, Refused)}
REPAIRED = {name: entry for name, entry in ZOO.items() if isinstance(entry, Repaired)}


def unwrapped(source: Any, until: str = "sealed") -> unwrap3d.Atlas:
    parameters = MESH_VOXEL if isinstance(source, unwrap3d.Surface) else QUICK
    return unwrap3d.Pipeline(source).run(parameters, until=until)


@pytest.mark.parametrize("name", REFUSED)
def test_refused_by_name_with_numbers_and_a_way_out(name: str, tmp_path: Path) -> None:
    entry = REFUSED[name]
    with pytest.raises(errors.Unwrap3DError) as caught:
        unwrapped(entry.make(tmp_path))
    error = caught.value
    assert type(error) is entry.error, error
    assert entry.words in str(error)
    assert error.measured or isinstance(error, errors.FileFormatError)
    assert error.hint
    for key, value in entry.measured.items():
        assert error.measured[key] == pytest.approx(value), key
        assert key in str(error)


@pytest.mark.parametrize("name", REPAIRED)
def test_repaired_and_said(name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    entry = REPAIRED[name]
    with caplog.at_level(logging.WARNING):
        atlas = unwrapped(entry.make(tmp_path))
    said = "; ".join(atlas.provenance["repairs"])
    assert re.search(entry.words, said), said
    sealed = atlas.quality["sealed"]
    assert (sealed["genus"], sealed["components"], sealed["boundary_edges"]) == (0, 1, 0)
    voxels = float(atlas.sealed.mask.data.sum()) * atlas.sealed.mask.voxel_size[0] ** 3
    assert sealed["volume_um3"] == pytest.approx(entry.volume_um3 or voxels, rel=0.05)
    assert json.dumps(atlas.provenance)


def test_a_sound_cell_is_repaired_in_nothing() -> None:
    for source in (unwrap3d.Surface(ROUND, FACES), unwrap3d.Mask(ball(12, 41), VOXEL)):
        said = unwrapped(source).provenance["repairs"]
        assert all("lost by smoothing" in sentence for sentence in said), said


def test_many_things_wrong_at_once_still_give_every_chart() -> None:
    """Inside out, in two windings, holed, doubled, with a crumb and loose vertices."""
    vertices, faces = together((ROUND * [1, 1.2, 1.5], turned(2)), (0.1 * ROUND + 3, FACES))
    faces = np.concatenate([faces[9:], faces[60:70]])
    source = unwrap3d.Surface(np.concatenate([vertices, [[50.0, 0, 0]]]), faces)
    atlas = unwrapped(source, "topography")
    said = "; ".join(atlas.provenance["repairs"])
    for words in ("doubled", "closed", "smaller components", "without a face", "turned over"):
        assert words in said
    quality = atlas.quality
    assert quality["sealed"]["volume_um3"] == pytest.approx(1.8 * ROUND_UM3, rel=0.02)
    assert quality["sphere"]["flipped_faces"] == 0
    assert quality["topography"]["folded_cells"] == 0
    assert quality["topography"]["unmapped_fraction"] == 0


# Projects ----------------------------------------------------------------------------


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.99])
def test_a_truncated_project_is_named(kept: float, tmp_path: Path) -> None:
    path = unwrapped(unwrap3d.Mask(CELL, VOXEL)).save(tmp_path / "cell.unwrap3d")
    with pytest.raises(errors.FileFormatError, match=r"cell\.unwrap3d") as caught:
        unwrap3d.load(cut_off(Path(path), kept))
    assert caught.value.hint
