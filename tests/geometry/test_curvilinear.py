"""The curvilinear grid, on a spherical shell whose coordinates are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.geometry.curvilinear import (
    count_folded,
    evaluate,
    invert,
    node_volumes,
    repeat_ends,
    rows_from_v,
    trim_folded,
    v_from_rows,
)
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import directions

ROWS, LAYERS, INNER, STEP = 32, 11, 10.0, 0.5


def shell() -> np.ndarray:
    """Nodes (LAYERS, ROWS + 2, 2 ROWS, 3) between the radii 10 and 15."""
    around = uv_to_direction(pixel_grid(ROWS).reshape(-1, 2), ROWS).reshape(ROWS, -1, 3)
    pole = np.broadcast_to([1.0, 0.0, 0.0], (1, 2 * ROWS, 3))
    unit = np.concatenate([pole, around, -pole])
    radius = INNER + STEP * np.arange(LAYERS)
    return (radius[:, None, None, None] * unit).astype(np.float32)


NODES = shell()
ALL = np.zeros(NODES.shape[1:3], np.int64)


def grid_points(count: int, seed: int = 0) -> np.ndarray:
    high = [LAYERS - 1, ROWS + 1, 2 * ROWS]
    return np.random.default_rng(seed).uniform(0, high, (count, 3))


@given(v=st.floats(-0.5, 31.5))
def test_rows_and_pixels_are_inverse(v: float) -> None:
    row = rows_from_v(np.array([v]), 32)
    assert 0 <= row[0] <= 33
    np.testing.assert_allclose(v_from_rows(row, 32), [v], atol=1e-12)


def test_rows_by_hand() -> None:
    v = np.array([-0.5, 0, 0.5, 31, 31.5])
    np.testing.assert_allclose(rows_from_v(v, 32), [0, 1, 1.5, 32, 33])


def test_evaluation_at_nodes_is_exact() -> None:
    index = np.stack(np.indices(NODES.shape[:3]), axis=-1).reshape(-1, 3).astype(float)
    np.testing.assert_array_equal(evaluate(NODES, index), NODES.reshape(-1, 3))
    turned = index + np.array([0, 0, 2 * ROWS])
    np.testing.assert_array_equal(evaluate(NODES, turned), NODES.reshape(-1, 3))


def test_evaluation_is_close_to_the_shell_also_at_seam_and_poles() -> None:
    points = grid_points(2000)
    points[:300, 2] = np.random.default_rng(1).uniform(2 * ROWS - 1, 2 * ROWS, 300)
    points[300:600, 1] = np.random.default_rng(2).uniform(0, 1, 300)
    radius = INNER + STEP * points[:, 0]
    v = v_from_rows(points[:, 1], ROWS)
    expected = radius[:, None] * uv_to_direction(np.stack([v, points[:, 2]], axis=1), ROWS)
    assert np.linalg.norm(evaluate(NODES, points) - expected, axis=1).max() < 0.04


def test_at_the_pole_the_column_does_not_matter() -> None:
    columns = np.linspace(0, 2 * ROWS, 50)
    points = np.column_stack([np.full(50, 3.3), np.zeros(50), columns])
    assert np.ptp(evaluate(NODES, points), axis=0).max() < 1e-6


@pytest.mark.parametrize("region", ["anywhere", "seam", "north", "south"])
def test_inversion_brings_every_point_back(region: str) -> None:
    points = grid_points(3000, 1)
    rng = np.random.default_rng(3)
    if region == "seam":
        points[:, 2] = rng.uniform(-1, 1, 3000)
    if region == "north":
        points[:, 1] = rng.uniform(0, 1, 3000) ** 3
    if region == "south":
        points[:, 1] = ROWS + 1 - rng.uniform(0, 1, 3000) ** 3
    world = evaluate(NODES, points)
    start = points + rng.normal(size=points.shape) * [2, 1, 1]
    found, residual = invert(NODES, world, start, 60, 1e-10)
    arrived = residual < 1e-9
    assert arrived.mean() > 0.998  # from a single start
    np.testing.assert_allclose(evaluate(NODES, found)[arrived], world[arrived], atol=1e-9)
    # Away from the poles the coordinates themselves come back, whole turns apart.
    inside = arrived & (points[:, 1] > 0.5) & (points[:, 1] < ROWS + 0.5)
    turn = np.mod(found[inside, 2] - points[inside, 2] + ROWS, 2 * ROWS) - ROWS
    np.testing.assert_allclose(found[inside, :2], points[inside, :2], atol=1e-6)
    np.testing.assert_allclose(turn, 0.0, atol=1e-6)


def test_inversion_finds_the_pole_itself() -> None:
    world = np.array([[12.0, 0, 0], [-12.0, 0, 0]])
    start = np.array([[5.0, 1.5, 40.0], [5.0, ROWS - 0.5, 3.0]])
    found, residual = invert(NODES, world, start, 60, 1e-8)
    assert residual.max() < 1e-8
    np.testing.assert_allclose(found[:, 0], 4.0, atol=1e-6)
    np.testing.assert_allclose(found[:, 1], [0, ROWS + 1], atol=1e-5)


def test_points_outside_are_not_found_but_measured() -> None:
    world = 17.0 * directions(20)
    start = np.tile([[5.0, 16.0, 20.0]], (20, 1))
    _, residual = invert(NODES, world, start, 60, 1e-8)
    assert (residual > 1.9).all()


def test_inversion_does_not_depend_on_the_scale() -> None:
    points = grid_points(300)
    points[:100, 1] = np.random.default_rng(4).uniform(0, 1e-2, 100)
    for scale in (1e-7, 1e-3, 1e4):
        nodes = (NODES * scale).astype(np.float32)
        world = evaluate(nodes, points)
        _, residual = invert(nodes, world, points + 0.3, 60, 1e-9 * scale)
        assert residual.max() < 1e-6 * scale


def test_a_shell_has_no_folded_cell() -> None:
    folded, cells, smallest, mean = count_folded(NODES, ALL)
    assert folded == 0
    assert cells == (LAYERS - 1) * (ROWS + 1) * 2 * ROWS
    assert 0 < smallest < mean


def test_swapped_nodes_are_noticed() -> None:
    nodes = NODES.copy()
    nodes[5, [10, 11], 20] = nodes[5, [11, 10], 20]
    folded, *_ = count_folded(nodes, ALL)
    assert 2 <= folded <= 24
    layers = NODES.copy()
    layers[[4, 5], 7, 0] = layers[[5, 4], 7, 0]  # on the seam
    assert count_folded(layers, ALL)[0] >= 4


def test_a_mirrored_or_inverted_grid_is_folded_everywhere() -> None:
    folded, cells, *_ = count_folded(np.ascontiguousarray(NODES[:, :, ::-1]), ALL)
    assert folded == cells
    folded, cells, *_ = count_folded(np.ascontiguousarray(NODES[::-1]), ALL)
    assert folded == cells


def test_nan_counts_as_folded() -> None:
    nodes = NODES.copy()
    nodes[5, 10, 20] = np.nan
    assert count_folded(nodes, ALL)[0] == 8


def test_cells_below_the_end_of_a_streamline_are_none() -> None:
    nodes = NODES.copy()
    nodes[:4, 10, 20] = nodes[4, 10, 20]  # this column ends at layer 4
    assert count_folded(nodes, ALL)[0] == 4 * 4
    reached = ALL.copy()
    reached[10, 20] = 4
    folded, cells, *_ = count_folded(nodes, reached)
    assert folded == 0
    assert cells == (LAYERS - 1) * (ROWS + 1) * 2 * ROWS - 4 * 4


def folded_below(layer: int, row: int, column: int) -> np.ndarray:
    """The shell with one column crossing over its neighbour below a layer."""
    nodes = NODES.copy()
    nodes[:layer, row, column] = NODES[:layer, row, column + 3]
    return nodes


def whole(low: int, high: int) -> tuple[np.ndarray, np.ndarray]:
    """What every column needs."""
    return np.full(ALL.shape, low), np.full(ALL.shape, high)


def test_columns_end_before_they_fold() -> None:
    nodes = folded_below(4, 15, 30)
    first, last = ALL.copy(), np.full(ALL.shape, LAYERS - 1)
    assert count_folded(nodes, first, last)[0] > 0
    assert trim_folded(nodes, first, last, 7, *whole(6, 8)) == 0
    assert count_folded(nodes, first, last)[0] == 0
    assert (last == LAYERS - 1).all()
    assert first[15, 30] in (4, 5)
    # Nothing else was shortened than the columns around it.
    shortened = np.argwhere(first > 0)
    assert np.abs(shortened - [15, 31]).max() <= 4


def test_columns_end_on_the_outside_too() -> None:
    nodes = NODES.copy()
    nodes[8:, 15, 30] = NODES[8:, 15, 33]
    first, last = ALL.copy(), np.full(ALL.shape, LAYERS - 1)
    assert trim_folded(nodes, first, last, 3, *whole(2, 5)) == 0
    assert count_folded(nodes, first, last)[0] == 0
    assert (first == 0).all()
    assert last[15, 30] in (6, 7)


def test_folds_in_what_is_needed_are_counted_and_left_out_all_the_same() -> None:
    nodes = folded_below(4, 15, 30)
    first, last = ALL.copy(), np.full(ALL.shape, LAYERS - 1)
    before = count_folded(nodes, first, last)[0]
    assert 0 < trim_folded(nodes, first, last, 7, *whole(0, LAYERS - 1)) <= before
    assert count_folded(nodes, first, last)[0] == 0
    assert (last == LAYERS - 1).all()


def test_a_fold_right_at_the_start_leaves_nothing_beyond_it() -> None:
    nodes = NODES.copy()
    nodes[6, 15, 30] = NODES[6, 15, 33]
    first, last = ALL.copy(), np.full(ALL.shape, LAYERS - 1)
    assert trim_folded(nodes, first, last, 5, *whole(5, 6)) > 0
    assert count_folded(nodes, first, last)[0] == 0
    assert (first == 0).all()
    assert last[15, 30] == 5


def test_a_sound_grid_keeps_all_its_columns() -> None:
    sound = NODES.copy()
    first, last = ALL.copy(), np.full(ALL.shape, LAYERS - 1)
    assert trim_folded(sound, first, last, 5, *whole(5, 6)) == 0
    assert (first == 0).all()
    assert (last == LAYERS - 1).all()


def test_ends_are_repeated() -> None:
    nodes = NODES.copy()
    first, last = ALL.copy(), np.full(ALL.shape, LAYERS - 1)
    first[9, 5], last[9, 5], first[20, 0] = 3, 7, LAYERS - 1
    repeat_ends(nodes, first, last)
    for layer in range(LAYERS):
        np.testing.assert_array_equal(nodes[layer, 9, 5], NODES[min(max(layer, 3), 7), 9, 5])
    assert (nodes[:, 20, 0] == NODES[-1, 20, 0]).all()
    others = np.ones(ALL.shape, bool)
    others[9, 5] = others[20, 0] = False
    np.testing.assert_array_equal(nodes[:, others], NODES[:, others])


def test_cells_above_the_end_of_a_streamline_are_none() -> None:
    nodes = NODES.copy()
    nodes[7:, 10, 20] = nodes[6, 10, 20]
    last = np.full(ALL.shape, LAYERS - 1)
    assert count_folded(nodes, ALL, last)[0] == 4 * 4
    last[10, 20] = 6
    assert count_folded(nodes, ALL, last)[0] == 0


def test_volumes_of_nodes_fill_the_shell_and_change_with_it() -> None:
    last = np.full(ALL.shape, LAYERS - 1)
    volumes = node_volumes(NODES, ALL, last, silent())
    assert volumes.shape == (LAYERS, ROWS, 2 * ROWS)
    assert volumes.min() > 0
    shell_volume = 4 / 3 * np.pi * ((INNER + STEP * (LAYERS - 1)) ** 3 - INNER**3)
    assert volumes.sum(dtype=float) == pytest.approx(shell_volume, rel=0.01)
    linear = np.array([[2.0, 0.3, 0.0], [0.1, 1.5, -0.4], [0.0, 0.2, 0.8]])
    moved = (NODES @ linear.T).astype(np.float32) + np.float32(3.0)
    larger = node_volumes(moved, ALL, last, silent())
    np.testing.assert_allclose(larger, np.linalg.det(linear) * volumes, rtol=0.005)


def test_the_volumes_of_two_parts_are_those_of_the_whole() -> None:
    last = np.full(ALL.shape, LAYERS - 1)
    seen: list[float] = []
    progress = Progress(lambda step, fraction, message: seen.append(fraction))
    whole = node_volumes(NODES, ALL, last, progress)
    lower, upper = (
        node_volumes(NODES, ALL, ALL + 4, silent()),
        node_volumes(NODES, ALL + 4, last, silent()),
    )
    np.testing.assert_allclose(lower + upper, whole, rtol=1e-5)
    assert seen == sorted(seen)
    assert len(seen) == 2
