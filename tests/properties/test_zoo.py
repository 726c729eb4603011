"""Every input that should not be: refused by name, with numbers and a way out, or repaired aloud.

Each entry goes in through the public API, as a user's would. What must not come out of
any of them is a wrong result without a word: of a repaired input the volume is checked.
"""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d import errors
from napari_unwrap3d.files.meshes import MESH_SUFFIXES, write_mesh
from napari_unwrap3d.files.stacks import write_image
from napari_unwrap3d.geometry.mesh import edges_with_faces
from napari_unwrap3d.parameters import Parameters
from shapes import QUICK, VOXEL_UM, ball, grid, icosphere

VOXEL = (VOXEL_UM,) * 3
SIDE = 33
MESH_VOXEL = Parameters.from_dict({**QUICK.model_dump(), "stack": {"working_voxel_um": 0.08}})
ROUND, FACES = icosphere(3)
# The polyhedron has less volume than its ball.
ROUND_UM3 = 4.153


@dataclass(frozen=True)
class Refused:
    """An input that ends in an error of this type, which says this and measured these."""

    make: Callable[[Path], Any]
    error: type[errors.Unwrap3DError]
    words: str
    measured: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Repaired:
    """An input of which a cell of this volume is made, and these words say how.

    Without a volume it is that of the voxels.
    """

    make: Callable[[Path], Any]
    words: str
    volume_um3: float | None = None


def together(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(v) for v, _ in parts)])
    faces = [f + start for (_, f), start in zip(parts, starts, strict=False)]
    return np.concatenate([v for v, _ in parts]), np.concatenate(faces)


def mesh(vertices: np.ndarray, faces: np.ndarray = FACES) -> Callable[[Path], unwrap3d.Surface]:
    return lambda folder: unwrap3d.Surface(vertices, faces)


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


# Meshes ------------------------------------------------------------------------------


def with_vertex(value: Any) -> np.ndarray:
    vertices = ROUND.copy()
    vertices[7, 1] = value
    return vertices


def touching(size: float) -> tuple[np.ndarray, np.ndarray]:
    """A ball and another of this size that share one vertex."""
    top, bottom = int(np.argmax(ROUND[:, 0])), int(np.argmin(ROUND[:, 0]))
    other = size * ROUND + (ROUND[top] - size * ROUND[bottom])
    vertices, faces = together((ROUND, FACES), (other, FACES))
    faces[faces == len(ROUND) + bottom] = top
    return vertices, faces


def with_fin() -> tuple[np.ndarray, np.ndarray]:
    """A face that hangs on an edge."""
    a, b = edges_with_faces(FACES).vertices[0]
    return np.concatenate([ROUND, 2 * ROUND[[a]]]), np.concatenate([FACES, [[a, b, len(ROUND)]]])


def with_flat_face() -> tuple[np.ndarray, np.ndarray]:
    """An edge is split on one side of it only: between lies a face without area."""
    a, b, tip = FACES[0]
    vertices = np.concatenate([ROUND, [(ROUND[a] + ROUND[b]) / 2]])
    middle = len(ROUND)
    split = [[a, middle, tip], [middle, b, tip], [a, b, middle]]
    return vertices, np.concatenate([FACES[1:], split])


def folded(reach: float) -> np.ndarray:
    """A cap of the ball is pushed through the other side."""
    vertices = ROUND.copy()
    cap = vertices[:, 0] > 0.8
    vertices[cap, 0] -= reach * (vertices[cap, 0] - 0.8) / 0.2
    return vertices


def crossing_lobes() -> np.ndarray:
    """A bent tube whose ends overlap, so that the mesh encloses some places twice."""
    z, y, x = ROUND.T
    turn = 3.4 * x
    around = 1.0 + 0.35 * y
    return np.stack([0.35 * z, around * np.cos(turn), around * np.sin(turn)], axis=1)


def around(vertex: int) -> np.ndarray:
    return np.equal(FACES, vertex).any(axis=1)


def turned(every: int) -> np.ndarray:
    faces = FACES.copy()
    faces[::every] = faces[::every, ::-1]
    return faces


def cavities(*sizes: float) -> tuple[np.ndarray, np.ndarray]:
    """Balls in each other, every other one wound inwards."""
    return together(*((s * ROUND, FACES[:, :: 1 - 2 * (i % 2)]) for i, s in enumerate(sizes)))


MESHES: dict[str, Refused | Repaired] = {
    "a NaN vertex": Refused(
        mesh(with_vertex(np.nan)), errors.NotFiniteError, "Vertices", {"vertices": 1}
    ),
    "an infinite vertex": Refused(
        mesh(with_vertex(np.inf)), errors.NotFiniteError, "Vertices", {"vertices": 1}
    ),
    "no faces": Refused(mesh(ROUND, np.zeros((0, 3), int)), errors.MeshError, "empty"),
    "faces of vertices that are not there": Refused(
        mesh(ROUND, FACES + 9), errors.MeshError, "does not exist", {"largest_index": 650}
    ),
    "negative indices": Refused(
        mesh(ROUND, FACES - 1), errors.MeshError, "does not exist", {"smallest_index": -1}
    ),
    "fractions for indices": Refused(
        mesh(ROUND, FACES + 0.5), errors.MeshError, "whole numbers", {"not_whole": FACES.size}
    ),
    "quads": Refused(
        mesh(ROUND, np.column_stack([FACES, FACES[:, 0]])), errors.MeshError, "triangles"
    ),
    "half a ball": Refused(
        mesh(ROUND, FACES[ROUND[FACES].mean(axis=1)[:, 0] > 0]),
        errors.NotWatertightError,
        "hole",
        {"holes": 1},
    ),
    "a hole": Repaired(mesh(ROUND, FACES[~around(5)]), "holes were closed", ROUND_UM3),
    "a face twice": Repaired(
        mesh(ROUND, np.concatenate([FACES, FACES[:5]])),
        r"doubled faces were dropped \(5\)",
        ROUND_UM3,
    ),
    "a face on an edge": Repaired(mesh(*with_fin()), "hanging on the surface", ROUND_UM3),
    "two cells touch in a vertex": Refused(
        mesh(*touching(0.95)), errors.SeveralCellsError, "two components", {"components": 2}
    ),
    "a crumb touches in a vertex": Repaired(
        mesh(*touching(0.3)), "smaller components were dropped", ROUND_UM3
    ),
    "two cells": Refused(
        mesh(*together((ROUND, FACES), (ROUND + 3, FACES))),
        errors.SeveralCellsError,
        "two components",
        {"components": 2},
    ),
    "two cells that overlap": Refused(
        mesh(*together((ROUND, FACES), (ROUND + np.array([0, 0, 1.0]), FACES))),
        errors.SeveralCellsError,
        "two components",
    ),
    "a hollow cell": Repaired(mesh(*cavities(1.0, 0.9)), "as of a cavity", ROUND_UM3),
    "nested cavities": Repaired(mesh(*cavities(1.0, 0.9, 0.85, 0.5)), "cavity", ROUND_UM3),
    "unreferenced vertices": Repaired(
        mesh(np.concatenate([ROUND, [[1e6, 0, 0], [0, 0, 0]]])),
        r"vertices without a face were dropped \(2\)",
        ROUND_UM3,
    ),
    "inside out": Repaired(
        mesh(ROUND, FACES[:, ::-1]), r"turned over to point outwards \(1280\)", ROUND_UM3
    ),
    "every third face turned": Repaired(
        mesh(ROUND, turned(3)), "turned over to point outwards", ROUND_UM3
    ),
    "a face without area": Repaired(
        mesh(*with_flat_face()), "edges of faces without area were turned", ROUND_UM3
    ),
    "a face with a vertex twice": Repaired(
        mesh(ROUND, np.concatenate([FACES, [[1, 1, 2]]])), "repeated vertex", ROUND_UM3
    ),
    "triangle soup": Repaired(
        mesh(ROUND[FACES].reshape(-1, 3), np.arange(FACES.size).reshape(-1, 3)),
        "were merged",
        ROUND_UM3,
    ),
    "a cap through the other side": Repaired(mesh(folded(2.2)), "encloses them inside out"),
    "a bent tube whose ends overlap": Repaired(mesh(crossing_lobes()), "encloses them twice"),
    "a flat mesh": Refused(mesh(ROUND * [1, 1, 0]), errors.MeshError, "Nothing is left"),
    "a mesh in metres": Refused(mesh(1e-6 * ROUND), errors.NotWatertightError, "scale=..."),
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
