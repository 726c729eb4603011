"""Step 5: the directions normal to the reference, where they are known."""

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask
from napari_unwrap3d.errors import TooSmallError
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.normal_field import NormalField, normal_field
from shapes import ball, directions, grid

EDGE, RADIUS = 0.2, 14.0
SHAPE = 45
CENTRE = np.array([10.0, -5.0, 3.0])
ORIGIN = CENTRE - EDGE * (SHAPE - 1) / 2


def mask_of(solid: np.ndarray) -> Mask:
    return Mask(solid, (EDGE,) * 3, tuple(ORIGIN))


@pytest.fixture(scope="module")
def field() -> NormalField:
    points = CENTRE + 22 * EDGE * directions(50)
    return normal_field(mask_of(ball(RADIUS, SHAPE)), points, silent())


def test_directions_are_unit_vectors_along_the_radius(field: NormalField) -> None:
    centre = field.distance.to_index(CENTRE)
    index = np.stack(np.indices(field.distance.shape), axis=-1) - centre
    radius = np.linalg.norm(index, axis=-1)
    outside = np.linalg.norm(index + centre - field.core, axis=-1) > field.core_radius
    length = np.linalg.norm(field.directions, axis=-1)
    np.testing.assert_allclose(length[outside], 1.0, atol=1e-4)
    cosine = np.einsum("ijkl,ijkl->ijk", index, field.directions) / np.maximum(radius, 1e-9)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    near = (radius > 8) & (radius < 22)
    assert angle[near].max() < 15
    assert angle[near].mean() < 3


def test_the_core_is_the_deepest_point(field: NormalField) -> None:
    core = field.distance.to_world(field.core)
    assert np.linalg.norm(core - CENTRE) < 1.5 * EDGE
    assert 2.5 <= field.core_radius < RADIUS / 2


@pytest.mark.parametrize("height", [-7.0, -3.0, 0.5, 4.0, 8.0])
def test_arc_lengths_are_heights_over_the_sphere(field: NormalField, height: float) -> None:
    points = CENTRE + (RADIUS + height) * EDGE * directions(300)
    length = field.arc_length(points)
    assert np.isfinite(length).all()
    # Smoothing the distance draws its zero in by about σ²/r.
    assert length.mean() == pytest.approx(height + 1.5**2 / RADIUS, abs=0.1)
    assert np.abs(length - length.mean()).max() < 0.7


def test_there_is_room_for_the_solid_and_all_points(field: NormalField) -> None:
    for points in (CENTRE + 22 * EDGE * directions(50), CENTRE + RADIUS * EDGE * directions(50)):
        index = field.distance.to_index(points)
        assert index.min() >= 9
        assert (np.array(field.distance.shape) - index.max(axis=0)).min() >= 9


def test_points_far_outside_of_the_mask_enlarge_the_grid() -> None:
    far = CENTRE + EDGE * np.array([[60.0, 0, 0], [0, 0, -50]])
    field = normal_field(mask_of(ball(8, SHAPE)), far, silent())
    index = field.distance.to_index(far)
    assert (index > 9).all()
    assert (index < np.array(field.distance.shape) - 9).all()
    # The solid is still where it was.
    inside = np.argwhere(field.distance.data < -4)
    np.testing.assert_allclose(field.distance.to_world(inside).mean(axis=0), CENTRE, atol=1e-6)


def test_a_solid_at_the_border_of_its_mask_is_no_problem() -> None:
    solid = ball(10.4, 21)
    assert solid[0].any()
    mask = Mask(solid, (EDGE,) * 3)
    field = normal_field(mask, mask.to_world(np.argwhere(solid)), silent())
    assert (field.distance.data < 0).sum() == pytest.approx(solid.sum(), rel=0.15)


def test_a_thin_plate_is_an_error() -> None:
    plate = np.abs(grid(SHAPE)[..., 0]) < 2
    plate[:, :8] = plate[:, -8:] = plate[:, :, :8] = plate[:, :, -8:] = False
    with pytest.raises(TooSmallError, match="depth_voxels") as caught:
        normal_field(mask_of(plate), CENTRE[None], silent())
    assert caught.value.measured["depth_voxels"] < 3
    assert "working voxel" in caught.value.hint


def test_reports_are_monotone() -> None:
    seen: list[float] = []
    progress = Progress(lambda step, fraction, text: seen.append(fraction))
    normal_field(mask_of(ball(8, SHAPE)), CENTRE[None], progress)
    assert len(seen) > 3
    assert seen == sorted(seen)
