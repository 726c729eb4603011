"""Step 4: the unwrapping axis, by weights and by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.charts import Reference, Sphere, Surface
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.parameters import UVParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.axis import (
    axis_rotation,
    axis_weight,
    frame,
    rolled,
    rotation_by_hand,
    unwrapping_rotation,
    with_field_of,
)
from napari_unwrap3d.unwrapping.uv import direction_to_uv, uv
from shapes import directions, icosphere, lumpy, rotation


def charts(turn: np.ndarray | None = None, **fields: np.ndarray) -> tuple[Reference, Sphere]:
    """A lumpy reference away from the origin, over a sphere that is turned against it."""
    vertices, faces = lumpy(3)
    images = icosphere(3)[0] @ (rotation(5) if turn is None else turn).T
    curvature = {"mean_curvature_per_um": np.ones(len(vertices))}
    base = Reference(vertices - [-5.0, 2.0, -9.0], faces, {**curvature, **fields})
    return base, Sphere(images, faces, conformal=images)


def is_proper(turn: np.ndarray) -> bool:
    return bool(np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) > 0)


def test_the_axis_points_away_from_what_weighs_most() -> None:
    where = directions(4000)
    for axis in np.eye(3)[:, ::-1]:
        weight = np.exp(-20 * (where @ axis) ** 2)  # a band around this axis
        turn = unwrapping_rotation(where, weight)
        assert abs((axis @ turn.T)[0]) > 0.99
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_every_rotation_is_proper(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = unwrapping_rotation(directions(200, seed), rng.normal(size=200))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    # e1 and e2 have positive x and y components, as the paper has it.
    assert turn[2, 2] >= 0
    assert turn[1, 1] >= 0


@pytest.mark.parametrize("weights", [np.zeros(100), np.full(100, np.nan)])
def test_weights_that_say_nothing_are_an_error(weights: np.ndarray) -> None:
    with pytest.raises(InputError, match="another axis weight"):
        unwrapping_rotation(directions(100), weights)


def test_weights_follow_the_curvature_of_the_reference() -> None:
    vertices, faces = lumpy(2)
    curvature = np.linspace(-1, 2, len(vertices))
    base = Reference(vertices, faces, {"mean_curvature_per_um": curvature})
    np.testing.assert_array_equal(axis_weight(base, "mean_curvature"), curvature)
    np.testing.assert_array_equal(axis_weight(base, "absolute_curvature"), np.abs(curvature))
    np.testing.assert_array_equal(axis_weight(base, "none"), 1.0)
    positive = axis_weight(base, "positive_curvature")
    assert set(np.unique(positive)) == {0.0, 1.0}
    assert (curvature[positive == 1] > curvature[positive == 0].max()).all()
    assert 0.1 < positive.mean() < 0.6


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_the_axis_turns_with_the_cell(seed: int) -> None:
    where = icosphere(3)[0]
    weight = lumpy(3, seed)[0] @ [3.0, 1.0, 2.0]
    turn = rotation(seed)
    plain = unwrapping_rotation(where, weight)
    moved = unwrapping_rotation(where @ turn.T, weight)
    # The three axes turn with it; which of their ends is positive depends on the frame.
    np.testing.assert_allclose(np.abs(moved @ turn @ plain.T), np.eye(3), atol=1e-6)
    assert is_proper(moved)


def test_the_sign_of_the_weights_does_not_matter() -> None:
    where = directions(500)
    weight = np.random.default_rng(0).normal(size=500)
    np.testing.assert_array_equal(
        unwrapping_rotation(where, weight), unwrapping_rotation(where, -weight)
    )


# A field ------------------------------------------------------------------------------


def test_any_field_of_the_reference_weighs_the_axis() -> None:
    band = np.exp(-20 * (icosphere(3)[0] @ [0.6, 0.0, 0.8]) ** 2)
    base, ball = charts(actin=band)
    turn = axis_rotation(base, ball, UVParameters(axis_weight="field", axis_field="actin"))
    # The band lies around the equator, wherever the sphere turned it to.
    north = rotation(5) @ [0.6, 0.0, 0.8]
    assert abs((north @ turn.T)[0]) > 0.99
    np.testing.assert_array_equal(axis_weight(base, "field", "actin"), band)


def test_a_field_that_is_not_there_is_named_with_those_that_are() -> None:
    base, ball = charts(actin=np.ones(642))
    wrong = UVParameters(axis_weight="field", axis_field="actn")
    with pytest.raises(ParameterError, match=r"'actn'.*mean_curvature_per_um, actin"):
        axis_rotation(base, ball, wrong)


@pytest.mark.parametrize("values", [np.full(642, np.nan), np.ones((642, 2))])
def test_a_field_that_is_no_finite_number_per_vertex_is_an_error(values: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="one finite number per vertex"):
        axis_weight(charts(actin=values)[0], "field", "actin")


def test_a_field_of_the_surface_comes_from_its_nearest_point() -> None:
    base, _ = charts()
    cell = Surface(base.vertices * 1.001, base.faces, {"actin": base.vertices[:, 1]})
    carried = with_field_of(base, cell, "actin").fields["actin"]
    np.testing.assert_allclose(carried, base.vertices[:, 1], atol=0.02)
    assert with_field_of(base, cell, "mean_curvature_per_um") is base
    assert with_field_of(base, cell, "nothing") is base


# By hand ------------------------------------------------------------------------------


def place(turn: np.ndarray, base: Reference, ball: Sphere, towards: np.ndarray) -> np.ndarray:
    """(v, u) + ½ over (N, 2N) of the vertex of the reference that lies in a direction."""
    from napari_unwrap3d.geometry.mesh import face_areas

    area = face_areas(base.vertices, base.faces)
    arms = base.vertices - area @ base.vertices[base.faces].mean(axis=1) / area.sum()
    arms /= np.linalg.norm(arms, axis=1, keepdims=True)
    nearest = np.argmax(arms @ (towards / np.linalg.norm(towards)))
    pixel = direction_to_uv(ball.vertices[[nearest]] @ turn.T, 100)[0]
    return (pixel + 0.5) / [100, 200]


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_the_north_pole_is_where_the_hand_points(seed: int) -> None:
    base, ball = charts(rotation(seed))
    axis = np.random.default_rng(seed).normal(size=3)
    turn = rotation_by_hand(base, ball, axis)
    assert is_proper(turn)
    assert place(turn, base, ball, axis)[0] < 0.06
    np.testing.assert_allclose(rotation_by_hand(base, ball, 7 * axis), turn, atol=1e-9)


@pytest.mark.parametrize(
    ("axis", "middle"), [((1, 0, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 1)), ((0, 0, -1), (0, 1, 0))]
)
def test_the_middle_column_faces_x_or_else_y(axis: tuple, middle: tuple) -> None:
    base, ball = charts()
    turn = rotation_by_hand(base, ball, np.array(axis, float))
    assert place(turn, base, ball, np.array(middle, float))[1] == pytest.approx(0.5, abs=0.04)


def test_the_axis_by_hand_turns_with_the_cell() -> None:
    """Cell and direction turned, on the same sphere: the same pole, whatever faces +x now."""
    base, ball = charts()
    axis, turn = np.array([0.3, -0.5, 0.8]), rotation(9)
    moved = Reference(base.vertices @ turn.T + 4, base.faces, base.fields)
    one = rotation_by_hand(base, ball, axis)
    other = rotation_by_hand(moved, ball, turn @ axis)
    np.testing.assert_allclose(other[0], one[0], atol=1e-9)


def test_a_hand_wins_over_weights() -> None:
    base, ball = charts()
    parameters = UVParameters(axis_zyx=(0.0, 1.0, 0.0), axis_weight="field", axis_field="none")
    expected = rotation_by_hand(base, ball, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(axis_rotation(base, ball, parameters), expected)
    chart = uv(base, ball, parameters.model_copy(update={"rows": 32}), silent())
    top = chart.positions[0].mean(axis=0) - base.vertices.mean(axis=0)
    assert top[1] > 0.9 * np.linalg.norm(top)


@pytest.mark.parametrize("axis", [np.zeros(3), np.array([np.nan, 0, 1]), np.array([np.inf, 0, 0])])
def test_an_axis_without_direction_is_an_error(axis: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"no direction.*length"):
        rotation_by_hand(*charts(), axis)


def test_an_axis_that_misses_the_reference_is_an_error() -> None:
    """Two thin plates, which the line between them does not meet."""
    vertices, faces = icosphere(2)
    both = np.concatenate([vertices * [1, 0.1, 1] + [0, d, 0] for d in (-3, 3)])
    base = Reference(both, np.concatenate([faces, faces + len(vertices)]))
    ball = Sphere(np.tile(vertices, (2, 1)), base.faces, conformal=both)
    with pytest.raises(InputError, match="does not meet"):
        rotation_by_hand(base, ball, np.array([1.0, 0.0, 0.0]))


# Roll ---------------------------------------------------------------------------------


@given(degrees=st.floats(-180, 180), seed=st.integers(0, 100))
def test_a_roll_shifts_the_columns_only(degrees: float, seed: int) -> None:
    turn, where = rotation(seed), directions(50, seed)
    after = rolled(turn, degrees)
    assert is_proper(after)
    plain, moved = (direction_to_uv(where @ r.T, 90) for r in (turn, after))
    np.testing.assert_allclose(moved[:, 0], plain[:, 0], atol=1e-9)
    shift = (plain[:, 1] - moved[:, 1] - degrees / 2 + 90) % 180 - 90
    np.testing.assert_allclose(shift, 0, atol=1e-7)


def test_the_roll_holds_for_every_kind_of_axis() -> None:
    base, ball = charts()
    for choice in ({"axis_weight": "none"}, {"axis_zyx": (1.0, 2.0, 3.0)}):
        plain = axis_rotation(base, ball, UVParameters(**choice))
        turned = axis_rotation(base, ball, UVParameters(**choice, axis_roll_degrees=30.0))
        np.testing.assert_array_equal(turned, rolled(plain, 30.0))


@given(seed=st.integers(0, 1000))
def test_a_frame_keeps_its_axis_and_side(seed: int) -> None:
    north, side = np.random.default_rng(seed).normal(size=(2, 3))
    turn = frame(north, side)
    assert is_proper(turn)
    np.testing.assert_allclose(turn @ north, [np.linalg.norm(north), 0, 0], atol=1e-9)
    assert (turn @ side)[2] > 0
    assert (turn @ side)[1] == pytest.approx(0, abs=1e-9)
