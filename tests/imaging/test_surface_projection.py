"""Surface-limited projections of a ball whose shell, inside and outside are known."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.files.rendering import VIEWS as MESH_VIEWS
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging.surface_projection import VIEWS, box_around, surface_projection
from shapes import grid, rotation

SIZE, RADIUS, EDGE = 48, 14.0, 0.2
CENTRE = EDGE * (SIZE - 1) / 2


@pytest.fixture(scope="module")
def cell() -> Mask:
    return Mask(np.linalg.norm(grid(SIZE), axis=-1) < RADIUS, (EDGE,) * 3)


def from_middle() -> np.ndarray:
    return np.linalg.norm(grid(SIZE), axis=-1)


def test_only_what_is_near_the_surface_is_seen(cell: Mask) -> None:
    r = from_middle()
    volume = np.where(r < RADIUS - 5, 900.0, np.where(r > RADIUS + 5, 800.0, 10.0))
    found = surface_projection(volume, cell.voxel_size, cell, 0.4)
    seen = np.isfinite(found.image)
    assert found.pixel_um == EDGE
    np.testing.assert_allclose(found.image[seen], 10.0)
    # A disc of the ball's radius and the reach.
    area = seen.sum() * EDGE**2
    assert area == pytest.approx(np.pi * (RADIUS * EDGE + 0.4) ** 2, rel=0.02)
    assert found.extent[1] - found.extent[0] == pytest.approx(found.image.shape[1] * EDGE)


@pytest.mark.parametrize("statistic", ["max", "mean"])
def test_the_statistic_of_a_ramp_in_depth(cell: Mask, statistic: str) -> None:
    """In the middle the rays meet both poles of the ball, within the reach."""
    z = np.broadcast_to(np.arange(SIZE, dtype=float)[:, None, None], (SIZE,) * 3)
    found = surface_projection(z, cell.voxel_size, cell, 0.4, statistic=statistic)
    row, column = (n // 2 for n in found.image.shape)
    middle = (SIZE - 1) / 2
    expected = middle + RADIUS + 2 if statistic == "max" else middle
    assert found.image[row, column] == pytest.approx(expected, abs=1.0)


@pytest.mark.parametrize("axis", ["z", "y", "x"])
def test_a_spot_is_where_the_pictures_of_meshes_show_it(cell: Mask, axis: str) -> None:
    place = np.array([0.5, -0.3, 0.8])
    place *= RADIUS / np.linalg.norm(place)
    volume = np.exp(-np.sum((grid(SIZE) - place) ** 2, axis=-1) / 4)
    found = surface_projection(volume, cell.voxel_size, cell, 0.6, axis)
    row, column = np.unravel_index(np.nanargmax(found.image), found.image.shape)
    left, _, _, top = found.extent
    seen = top + (row + 0.5) * EDGE, left + (column + 0.5) * EDGE
    _, down, right = MESH_VIEWS[axis] @ (CENTRE + EDGE * place)
    np.testing.assert_allclose(seen, [down, right], atol=EDGE)


def test_the_views_are_those_of_the_meshes() -> None:
    for name, (axes, signs) in VIEWS.items():
        np.testing.assert_array_equal(np.eye(3)[list(axes)] * np.c_[list(signs)], MESH_VIEWS[name])


def test_smaller_pixels_show_the_same(cell: Mask) -> None:
    volume = np.random.default_rng(0).random((SIZE,) * 3)
    z = np.broadcast_to(np.arange(SIZE)[:, None, None], volume.shape).astype(float)
    coarse = surface_projection(z, cell.voxel_size, cell, 0.4)
    fine = surface_projection(z, cell.voxel_size, cell, 0.4, pixel_um=EDGE / 2)
    assert fine.image.shape[0] == pytest.approx(2 * coarse.image.shape[0], abs=2)
    middle = [tuple(n // 2 for n in p.image.shape) for p in (coarse, fine)]
    assert fine.image[middle[1]] == pytest.approx(coarse.image[middle[0]], abs=0.6)


def test_a_moved_image_gives_the_same_projection(cell: Mask) -> None:
    """The image's world is turned and shifted against the cell's: it is read once, from there."""
    turn = rotation(3)
    pose = Rigid.about((CENTRE,) * 3, turn, (0.13, -0.21, 0.08))
    place = np.array([0.2, 0.6, 0.5])
    place *= RADIUS * EDGE / np.linalg.norm(place)

    def spot(world: np.ndarray) -> np.ndarray:
        return np.exp(-np.sum((world - CENTRE - place) ** 2, axis=-1) / 3.0)

    own = EDGE * np.stack(np.indices((SIZE,) * 3), axis=-1)
    moved = spot(pose.apply(own.reshape(-1, 3)).reshape(own.shape))
    still = surface_projection(spot(own), cell.voxel_size, cell, 0.4)
    found = surface_projection(moved, cell.voxel_size, cell, 0.4, pose=pose)
    both = np.isfinite(still.image) & np.isfinite(found.image)
    assert both.sum() > 0.95 * np.isfinite(still.image).sum()
    np.testing.assert_allclose(found.image[both], still.image[both], atol=0.02)


def test_an_anisotropic_image_is_read_in_its_own_voxels(cell: Mask) -> None:
    volume = np.broadcast_to(np.arange(SIZE // 2, dtype=float)[:, None, None], (24, SIZE, SIZE))
    found = surface_projection(volume, (2 * EDGE, EDGE, EDGE), cell, 0.4)
    row, column = (n // 2 for n in found.image.shape)
    assert found.image[row, column] == pytest.approx((SIZE / 2 + RADIUS + 2) / 2, abs=0.6)


def test_a_box_keeps_the_pixels_in_place(cell: Mask) -> None:
    volume = np.random.default_rng(0).random((SIZE,) * 3)
    small = surface_projection(volume, cell.voxel_size, cell, 0.4)
    box = box_around(cell, 0.4) + np.array([[-1.0], [1.0]])
    large = surface_projection(volume, cell.voxel_size, cell, 0.4, box=box)
    border = [(a - b) // 2 for a, b in zip(large.image.shape, small.image.shape, strict=True)]
    inner = large.image[border[0] : -border[0], border[1] : -border[1]]
    np.testing.assert_array_equal(inner, small.image)


def test_bad_input_is_refused(cell: Mask) -> None:
    volume = np.zeros((SIZE,) * 3)
    for wrong in (
        {"reach_um": 0.0},
        {"reach_um": np.nan},
        {"pixel_um": -1.0},
        {"axis": "t"},
        {"statistic": "sum"},
        {"pixel_um": 1e-4},
    ):
        with pytest.raises(ParameterError):
            surface_projection(volume, cell.voxel_size, cell, **wrong)
    far = Rigid(translation=np.array([100.0, 0, 0]))
    with pytest.raises(InputError, match="outside"):
        surface_projection(volume, cell.voxel_size, cell, pose=far)
