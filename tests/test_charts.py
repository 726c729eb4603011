"""Charts refuse what they cannot be, with a named error."""

import dataclasses

import numpy as np
import pytest

from napari_unwrap3d.charts import UV, Mask, Stack, Surface, Topography, Volume, check_voxel_size
from napari_unwrap3d.errors import (
    AxesError,
    InputError,
    MeshError,
    NotFiniteError,
    Unwrap3DError,
    VoxelSizeMissingError,
)
from shapes import icosphere

ANISOTROPIC = (0.3, 0.104, 0.104)


@pytest.mark.parametrize(
    ("given", "error"),
    [
        (None, VoxelSizeMissingError),
        ((0.1, 0.1), AxesError),
        (0.1, AxesError),
        ((0.1, 0.0, 0.1), InputError),
        ((0.1, -1, 0.1), InputError),
        ((0.1, np.nan, 0.1), InputError),
        ((0.1, np.inf, 0.1), InputError),
        ("0.1 µm", InputError),
        (("a", 1, 1), InputError),
        ((1e-7,) * 3, InputError),  # metres
        ((1e7,) * 3, InputError),
        ((300, 0.1, 0.1), InputError),  # nm along z
    ],
)
def test_voxel_sizes_are_never_guessed(given: object, error: type[Unwrap3DError]) -> None:
    for make in (
        lambda: check_voxel_size(given),
        lambda: Volume(np.zeros((2, 2, 2)), given),
        lambda: Stack(np.zeros((2, 2, 2)), "zyx", given),
    ):
        with pytest.raises(error, match=r"voxel_size=\(z, y, x\)"):
            make()


def test_voxel_sizes_become_plain_numbers() -> None:
    assert check_voxel_size(np.array(ANISOTROPIC, np.float32)) == pytest.approx(ANISOTROPIC)
    assert all(type(size) is float for size in check_voxel_size([1, 2, 3]))


def test_index_and_world_are_inverse_and_anisotropic() -> None:
    volume = Volume(np.zeros((4, 5, 6)), ANISOTROPIC, (1, -2, 3))
    np.testing.assert_allclose(volume.to_world([[0, 0, 0], [1, 1, 1]])[0], [1, -2, 3])
    np.testing.assert_allclose(volume.to_world([[1, 10, 0]]), [[1.3, -0.96, 3]])
    points = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_allclose(volume.to_world(volume.to_index(points)), points)
    assert volume.shape == (4, 5, 6)


def test_a_volume_has_three_axes() -> None:
    with pytest.raises(AxesError, match="dimensions = 4"):
        Volume(np.zeros((1, 2, 2, 2)), ANISOTROPIC)


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.float32, bool])
def test_masks_of_any_two_values_become_bool(dtype: type) -> None:
    data = np.zeros((3, 3, 3), dtype)
    data[1, 1, 1] = 1
    mask = Mask(data if dtype is bool else data * dtype(200), ANISOTROPIC)
    assert mask.data.dtype == bool
    assert mask.data.sum() == 1


def test_label_images_and_intensities_are_no_masks() -> None:
    with pytest.raises(InputError, match="label image") as caught:
        Mask(np.arange(27).reshape(3, 3, 3), ANISOTROPIC)
    assert caught.value.measured == {"values": 27}
    broken = np.zeros((3, 3, 3))
    broken[0, 0, :2] = np.nan
    with pytest.raises(NotFiniteError, match="voxels = 2"):
        Mask(broken, ANISOTROPIC)


@pytest.mark.parametrize("axes", ["xyz", "yx", "ctzyx", "zyxt", "", "tzyxq", "ttzyx"])
def test_axes_in_another_order_are_an_error(axes: str) -> None:
    with pytest.raises(AxesError, match="axes"):
        Stack(np.zeros((2,) * max(len(axes), 1)), axes, ANISOTROPIC)


def test_axes_and_dimensions_must_agree() -> None:
    with pytest.raises(AxesError, match="dimensions = 3"):
        Stack(np.zeros((2, 2, 2)), "tzyx", ANISOTROPIC)


def test_volumes_of_a_stack() -> None:
    data = np.arange(2 * 3 * 4 * 5 * 6).reshape(2, 3, 4, 5, 6)
    stack = Stack(data, "tczyx", ANISOTROPIC)
    assert stack.timepoints == 2
    np.testing.assert_array_equal(stack.volume(1, 2), data[1, 2])
    np.testing.assert_array_equal(Stack(data[:, 0], "tzyx", ANISOTROPIC).volume(1), data[1, 0])
    np.testing.assert_array_equal(Stack(data[0], "czyx", ANISOTROPIC).volume(c=2), data[0, 2])
    single = Stack(data[0, 0], "zyx", ANISOTROPIC)
    assert single.timepoints == 1
    np.testing.assert_array_equal(single.volume(), data[0, 0])


def test_a_mesh_keeps_its_arrays_in_one_dtype() -> None:
    vertices, faces = icosphere(1)
    mesh = Surface(vertices.astype(np.float32).tolist(), faces.astype(np.int32))
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int64
    assert mesh.vertices.flags.c_contiguous


@pytest.mark.parametrize(
    ("vertices", "faces", "error", "words"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], MeshError, "Vertices"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]], MeshError, "Faces"),
        (np.zeros((0, 3)), np.zeros((0, 3)), MeshError, "empty"),
        (np.eye(3), np.zeros((0, 3)), MeshError, "empty"),
        (np.eye(3), [[0, 1, 3]], MeshError, "largest_index = 3"),
        (np.eye(3), [[0, 1, -1]], MeshError, "does not exist"),
        (np.eye(3) * [1, np.nan, 1], [[0, 1, 2]], NotFiniteError, "vertices = 3"),
    ],
)
def test_arrays_that_are_no_mesh(
    vertices: np.ndarray, faces: list, error: type[Unwrap3DError], words: str
) -> None:
    with pytest.raises(error, match=words):
        Surface(np.array(vertices), np.array(faces))


def test_indices_are_whole_numbers() -> None:
    vertices, faces = icosphere(1)
    assert Surface(vertices, faces.astype(float)).faces.dtype == np.int64
    broken = faces.astype(float)
    broken[0, 0], broken[3, 2] = 0.5, np.nan
    with pytest.raises(MeshError, match="not_whole = 2"):
        Surface(vertices, broken)


@pytest.mark.parametrize("dtype", [complex, object, "U8"])
def test_intensities_are_real_numbers(dtype: object) -> None:
    with pytest.raises(InputError, match=r"real numbers.*dtype"):
        Stack(np.zeros((2, 2, 2)).astype(dtype), "zyx", ANISOTROPIC)


def test_fields_have_one_value_per_vertex() -> None:
    vertices, faces = icosphere(1)
    with pytest.raises(MeshError, match=r"'height_um'.*values = 3"):
        Surface(vertices, faces, {"height_um": np.zeros(3)})


def test_charts_are_frozen_and_fields_are_added_to_a_copy() -> None:
    vertices, faces = icosphere(1)
    mesh = Surface(vertices, faces, {"a": np.zeros(len(vertices))}, report={"genus": 0})
    more = mesh.with_fields(b=np.ones(len(vertices)))
    assert set(mesh.fields) == {"a"}
    assert set(more.fields) == {"a", "b"}
    assert more.report == {"genus": 0}
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.vertices = vertices


def test_uv_images_are_twice_as_wide_as_high() -> None:
    with pytest.raises(AxesError, match="2N"):
        UV(np.eye(3), np.zeros((8, 15), int), np.zeros((8, 15, 3)), np.zeros((8, 15, 3)))


def test_topographies_have_rows_for_the_poles() -> None:
    def make(shape: tuple[int, ...], layers: int) -> Topography:
        rest = dict.fromkeys(
            (
                "first_layer",
                "last_layer",
                "mask",
                "surface",
                "cut_vertices",
                "cut_faces",
                "cut_origin",
                "meshed_vertices",
                "meshed_faces",
            ),
            np.zeros(0),
        )
        return Topography(nodes=np.zeros(shape, np.float32), d_um=np.zeros(layers), **rest)

    chart = make((5, 10, 16, 3), 5)
    assert chart.shape == (5, 8, 16)
    assert chart.positions.shape == (5, 8, 16, 3)
    for shape, layers in (((5, 8, 16, 3), 5), ((5, 10, 16, 3), 4)):
        with pytest.raises(AxesError, match=r"N \+ 2"):
            make(shape, layers)
