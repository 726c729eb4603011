"""Clamped marching cubes: the triangles are sound, and lie where the level set is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from napari_unwrap3d.errors import EmptyMaskError
from napari_unwrap3d.geometry.curvature import corner_angles
from napari_unwrap3d.geometry.marching import clamped_marching_cubes, field_with_sign
from napari_unwrap3d.geometry.mesh import (
    connected_components,
    euler_characteristic,
    face_areas,
    is_consistently_wound,
    is_watertight,
    nonmanifold_vertices,
    signed_volume,
)
from napari_unwrap3d.geometry.topology import euler_characteristic as solid_euler
from napari_unwrap3d.geometry.topology import fill_cavities, make_well_composed
from shapes import ball, grid, torus


def blobs(seed: int, smoothing: float, shape: int = 16) -> np.ndarray:
    """Smooth noise, negative on the border."""
    noise = np.random.default_rng(seed).normal(size=(shape,) * 3)
    field = ndimage.gaussian_filter(noise, smoothing)
    field /= np.abs(field).max()
    inside = np.zeros(field.shape, bool)
    inside[2:-2, 2:-2, 2:-2] = True
    return np.where(inside, field, -0.3)


def assert_sound(vertices: np.ndarray, faces: np.ndarray) -> None:
    assert is_watertight(faces)
    assert is_consistently_wound(faces)
    assert signed_volume(vertices, faces) > 0
    assert np.degrees(corner_angles(vertices, faces)).min() > 1.0
    assert face_areas(vertices, faces).min() > 1e-4


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), smoothing=st.sampled_from([0.6, 1.0, 2.0]))
def test_no_needles_in_the_mesh_of_any_smooth_field(seed: int, smoothing: float) -> None:
    assert_sound(*clamped_marching_cubes(blobs(seed, smoothing)))


def test_values_at_and_next_to_zero_make_no_degenerate_triangle() -> None:
    field = 0.5 * np.rint(8 - np.linalg.norm(grid(21), axis=-1) * 1.3)  # zero on many points
    assert (field == 0).sum() > 100
    assert_sound(*clamped_marching_cubes(field))
    tiny = np.random.default_rng(0).uniform(-1e-7, 1e-7, field.shape)
    assert_sound(*clamped_marching_cubes(field + tiny))


def test_without_the_clamp_there_would_be_needles() -> None:
    field = np.rint(8 - np.linalg.norm(grid(21), axis=-1) * 1.3) + 1e-6
    vertices, faces = clamped_marching_cubes(field, clamp=0.0)
    assert np.degrees(corner_angles(vertices, faces)).min() < 0.01


def test_sphere_and_torus_have_their_topology_and_place() -> None:
    distance = np.linalg.norm(grid(31), axis=-1)
    vertices, faces = clamped_marching_cubes(10.0 - distance)
    assert euler_characteristic(faces) == 2
    assert np.abs(np.linalg.norm(vertices - 15, axis=1) - 10).max() < 0.05
    z, y, x = np.moveaxis(grid((19, 41, 41)), -1, 0)
    vertices, faces = clamped_marching_cubes(5.0 - np.hypot(np.hypot(y, x) - 12, z))
    assert euler_characteristic(faces) == 0
    assert signed_volume(vertices, faces) == pytest.approx(2 * np.pi**2 * 12 * 25, rel=0.01)


def test_axes_are_not_exchanged() -> None:
    field = 1.0 - np.linalg.norm(grid((17, 25, 33)) / [5, 8, 12], axis=-1)
    vertices, _ = clamped_marching_cubes(field)
    np.testing.assert_allclose(vertices.max(axis=0) - [8, 12, 16], [5, 8, 12], atol=0.25)
    np.testing.assert_allclose(vertices.mean(axis=0), [8, 12, 16], atol=0.1)


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_a_field_without_a_surface_is_an_error(value: float) -> None:
    with pytest.raises(EmptyMaskError, match="does not change sign") as caught:
        clamped_marching_cubes(np.full((5, 5, 5), value))
    assert caught.value.measured["maximum"] == value


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_the_sign_decides_the_topology(seed: int) -> None:
    """A field that says something else everywhere does not change handles or components."""
    rng = np.random.default_rng(seed)
    solid = np.zeros((14,) * 3, bool)
    solid[3:-3, 3:-3, 3:-3] = rng.random((8,) * 3) < 0.45
    solid = fill_cavities(make_well_composed(np.pad(solid, 2)))
    field = field_with_sign(rng.normal(size=solid.shape) * 0.3, solid)
    np.testing.assert_array_equal(field > 0, solid)
    _, faces = clamped_marching_cubes(field)
    assert is_watertight(faces)
    assert len(nonmanifold_vertices(faces)) == 0
    # The boundary of a solid body has twice its Euler characteristic.
    assert euler_characteristic(faces) == 2 * solid_euler(solid)
    assert connected_components(faces)[0].max() + 1 == ndimage.label(solid)[1]


def test_where_sign_and_field_agree_the_field_is_kept() -> None:
    smooth = ndimage.gaussian_filter(ball(6, 19).astype(np.float32), 1.0) - np.float32(0.5)
    solid = smooth > 0
    far = np.abs(smooth) > 0.02
    np.testing.assert_array_equal(field_with_sign(smooth, solid)[far], smooth[far])
    assert not torus(4, 1.5, (9, 13, 13))[4, 6, 6]  # the hole stays open below
    ring = torus(4, 1.5, (9, 13, 13))
    closed = field_with_sign(np.ones(ring.shape), ring)
    assert (closed[~ring] < 0).all()
