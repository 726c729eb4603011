"""Streamlines of a radial field: lengths and places are known exactly."""

import numpy as np
import pytest

from napari_unwrap3d.geometry.streamlines import blend_directions, trace_into, trace_to_surface
from shapes import directions, grid

SIZE = 61
CENTRE = np.full(3, 30.0)
RADIUS = 15.0


def radial_field() -> np.ndarray:
    points = grid(SIZE)
    length = np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 1e-9)
    return (points / length).astype(np.float32)


FIELD = radial_field()
DISTANCE = (np.linalg.norm(grid(SIZE), axis=-1) - RADIUS).astype(np.float32)


@pytest.mark.parametrize("sign", [1, -1])
def test_arc_length_and_landing_of_radial_lines(sign: int) -> None:
    way = directions(400)
    height = np.random.default_rng(0).uniform(0.1, 9.0, (400, 1)) * sign
    start = CENTRE + (RADIUS + height) * way
    length, landing = trace_to_surface(FIELD, DISTANCE, start, 0.5, 100.0)
    np.testing.assert_allclose(length, height[:, 0], atol=0.02)
    np.testing.assert_allclose(landing, CENTRE + RADIUS * way, atol=0.05)


def test_the_step_hardly_matters() -> None:
    start = CENTRE + 24 * directions(100)
    coarse, _ = trace_to_surface(FIELD, DISTANCE, start, 1.0, 100.0)
    fine, _ = trace_to_surface(FIELD, DISTANCE, start, 0.1, 100.0)
    np.testing.assert_allclose(coarse, fine, atol=0.01)


def test_a_point_on_the_surface_has_length_zero() -> None:
    start = CENTRE + RADIUS * directions(50)
    length, landing = trace_to_surface(FIELD, DISTANCE, start, 0.5, 100.0)
    assert np.abs(length).max() < 0.02
    np.testing.assert_allclose(landing, start, atol=0.02)


def test_what_does_not_arrive_within_the_limit_is_nan() -> None:
    start = CENTRE + (RADIUS + np.array([[2.0], [8.0]])) * directions(2)
    length, _ = trace_to_surface(FIELD, DISTANCE, start, 0.5, 4.0)
    assert length[0] == pytest.approx(2.0, abs=0.02)
    assert np.isnan(length[1])


def test_layers_are_equally_spaced_along_the_line() -> None:
    way = directions(30)
    start = (CENTRE + RADIUS * way).astype(np.float32)
    nodes = np.zeros((21, 30, 3), np.float32)
    nodes[10] = start
    out = trace_into(FIELD, start, 0.5, CENTRE, 0.0, nodes, 11, 1)
    inn = trace_into(FIELD, start, -0.5, CENTRE, 3.0, nodes, 9, -1)
    assert (out == 10).all()
    assert (inn == 10).all()
    expected = CENTRE + (RADIUS + 0.5 * np.arange(-10, 11))[:, None, None] * way
    np.testing.assert_allclose(nodes, expected, atol=0.03)


def test_lines_end_at_the_core_and_repeat_their_last_node() -> None:
    way = directions(30)
    start = (CENTRE + RADIUS * way).astype(np.float32)
    nodes = np.full((40, 30, 3), np.nan, np.float32)
    core = 5.25
    reached = trace_into(FIELD, start, -0.5, CENTRE, core, nodes, 39, -1)
    assert (np.abs(reached - (RADIUS - core) // 0.5) <= 1).all()
    assert np.isfinite(nodes).all()
    radius = np.linalg.norm(nodes - CENTRE, axis=-1)
    assert radius.min() >= core - 1e-4
    for column, count in enumerate(reached):
        assert (nodes[: 40 - count, column] == nodes[40 - count, column]).all()
        assert len(np.unique(nodes[40 - count :, column], axis=0)) == count


def test_no_layer_to_write_writes_none() -> None:
    nodes = np.full((3, 4, 3), 7.0, np.float32)
    start = (CENTRE + RADIUS * directions(4)).astype(np.float32)
    assert (trace_into(FIELD, start, 0.5, CENTRE, 0.0, nodes, 3, 1) == 0).all()
    assert (trace_into(FIELD, start, -0.5, CENTRE, 0.0, nodes, -1, -1) == 0).all()
    assert (nodes == 7.0).all()


def test_near_the_surface_the_distance_decides_and_far_away_the_harmonic_function() -> None:
    """Distance along z, outer function along y, inner function against x."""
    z, y, x = np.moveaxis(grid((31, 21, 21)), -1, 0).astype(np.float32)
    outer, inner = y[::2, ::2, ::2].copy(), -x[::2, ::2, ::2].copy()
    field = blend_directions(z, z, outer, inner, 2.0)
    assert field.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(field, axis=-1), 1.0, atol=1e-5)
    middle = field[:, 10, 10]
    np.testing.assert_allclose(middle[15], [1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(middle[30], [0, 1, 0], atol=1e-3)
    np.testing.assert_allclose(middle[0], [0, 0, 1], atol=1e-3)
    # In between the share of the harmonic direction grows steadily.
    assert (np.diff(middle[15:, 1]) > 0).all()


def test_where_the_harmonic_function_is_flat_the_distance_decides() -> None:
    z = grid((21, 11, 11))[..., 0].astype(np.float32)
    flat = np.zeros((11, 6, 6), np.float32)
    field = blend_directions(z, z, flat, flat, 0.5)
    np.testing.assert_allclose(field[..., 0], 1.0, atol=1e-6)
