"""Shapes lie over what is painted, across the seam and the poles, and leave no trace."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.measure import points_in_poly

from napari_unwrap3d.annotations import Annotations, Shape
from napari_unwrap3d.annotations.shapes import edges_in_space, pixels_inside
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import ChartMissingError, ParameterError
from synthetic import make_atlas

ROWS = 16
SQUARE = np.array([[0.0, 0.0], [0.0, 6.0], [5.0, 6.0], [5.0, 0.0]])


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return make_atlas(rows=ROWS)


def images_of_centres(rows: int) -> np.ndarray:
    """Where the centre of every pixel comes again, (N · 2N, k, 2): over the seam, the poles."""
    v, u = np.indices((rows, 2 * rows)).reshape(2, -1)
    again = []
    for turn in (-4, -2, 0, 2, 4):
        again.append(np.stack([v, u + turn * rows], axis=1))
        again += [np.stack([w, u + (turn + 1) * rows], axis=1) for w in (-1 - v, 2 * rows - 1 - v)]
    return np.stack(again, axis=1)


@given(
    corners=st.lists(
        st.tuples(st.floats(-ROWS, 2 * ROWS - 1), st.floats(-2 * ROWS, 4 * ROWS - 1)),
        min_size=3,
        max_size=6,
    )
)
def test_a_polygon_holds_the_centres_inside(corners: list[tuple[float, float]]) -> None:
    # Centres on an edge may be in or out: corners are moved off the centres' lines.
    vertices = np.round(np.array(corners), 2) + np.array([0.003123, 0.002717])
    vertices = np.clip(vertices, [-ROWS, -2 * ROWS], [2 * ROWS - 0.01, 4 * ROWS - 0.01])
    found = np.zeros(2 * ROWS**2, bool)
    found[pixels_inside(Shape("uv", "polygon", vertices, 1), ROWS)] = True
    places = images_of_centres(ROWS)
    inside = points_in_poly(places.reshape(-1, 2), vertices).reshape(places.shape[:2])
    assert np.count_nonzero(found != inside.any(axis=1)) == 0


def test_an_ellipse_is_inside_its_rectangle() -> None:
    corners = np.array([[2.0, -4.0], [2.0, 8.0], [10.0, 8.0], [10.0, -4.0]])
    found = pixels_inside(Shape("uv", "ellipse", corners, 1), ROWS)
    v, u = np.divmod(found, 2 * ROWS)
    u = np.where(u > ROWS, u - 2 * ROWS, u)
    assert (((v - 6) / 4) ** 2 + ((u - 2) / 6) ** 2 <= 1.0).all()
    assert abs(len(found) - np.pi * 4 * 6) < 6


@pytest.mark.parametrize("chart", ["uv", "direct", "plane"])
@pytest.mark.parametrize("corner", [(4, 10), (3, -3), (3, 29), (-3, 7), (13, 20)])
def test_a_shape_overlays_and_gives_back_what_was_painted(
    atlas: Atlas, chart: str, corner: tuple[int, int]
) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, 3, atlas.uv.shape)
    annotations.draw("one", "uv", tuple(np.indices(drawn.shape).reshape(2, -1)), drawn.ravel())
    painted = annotations.labels("one").copy()
    shape = Shape(chart, "rectangle", SQUARE + corner, 9)
    annotations.add_shape("one", shape)
    inside = np.zeros(drawn.shape, bool)
    inside.ravel()[pixels_inside(shape, ROWS)] = True
    image = annotations.image("one", chart)
    assert (image[inside] == 9).all()
    marked = annotations.labels("one") == 9
    assert (annotations.labels("one")[~marked] == painted[~marked]).all()
    assert set(np.flatnonzero(marked)) == set(annotations.marked_by(shape))
    if chart == "uv":
        assert (image[~inside] == drawn[~inside]).all()
    below = np.flatnonzero(marked)[:3]
    annotations.draw_vertices("one", below, 7)  # painted under it
    assert (annotations.labels("one")[below] == 9).all()
    annotations.set_shapes("one", [])
    assert (annotations.labels("one")[below] == 7).all()
    annotations.undo()
    annotations.undo()
    annotations.set_shapes("one", [])
    assert (annotations.labels("one") == painted).all()
    assert (annotations.image("one", "uv") == drawn).all()


def test_shapes_of_one_chart_are_set_alone_and_later_ones_lie_on_top(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    told: list[str] = []
    annotations.shaped.connect(told.append)
    space = Shape("volume", "half-space", [[6, 6, 6], [0, 0, 1]], 1)
    annotations.add_shape("one", space)
    over = [Shape("uv", "rectangle", SQUARE + np.array([4, n]), n) for n in (2, 3)]
    annotations.set_shapes("one", over, chart="uv")
    assert annotations.shapes("one") == (space, *over)
    assert annotations.shapes("one", "uv") == tuple(over)
    assert annotations.image("one", "uv")[6, 7] == 3
    annotations.set_shapes("one", over[::-1], chart="uv")
    assert annotations.image("one", "uv")[6, 7] == 2
    annotations.set_shapes("one", [], chart="uv")
    assert annotations.shapes("one") == (space,)
    assert told == ["one"] * 4
    with pytest.raises(ParameterError, match="'direct'"):
        annotations.set_shapes("one", over, chart="direct")


@pytest.mark.parametrize("chart", ["uv", "direct", "plane"])
def test_a_shape_of_label_0_hides_what_is_painted(atlas: Atlas, chart: str) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    annotations.draw_vertices("one", np.arange(len(atlas.surface.vertices)), 4)
    shape = Shape(chart, "rectangle", SQUARE + 4, 0)
    assert annotations.image("one", "uv").any()
    annotations.add_shape("one", shape)
    hidden = annotations.image("one", chart).ravel() == 0
    assert hidden[pixels_inside(shape, ROWS)].all()
    assert (
        np.flatnonzero(annotations.labels("one") == 0).tolist()
        == annotations.marked_by(shape).tolist()
    )
    if chart != "uv":
        shown = annotations.owners("uv").display(annotations.labels("one"))
        assert (annotations.image("one", "uv") == shown).all()


def test_regions_in_space_mark_the_vertices_in_them(atlas: Atlas) -> None:
    annotations, vertices = Annotations(atlas), atlas.surface.vertices
    annotations.add("one")
    annotations.add_shape("one", Shape("volume", "box", [[9, 0, 12], [2, 5, 6]], 1))
    inside = ((vertices >= [2, 0, 6]) & (vertices <= [9, 5, 12])).all(axis=1)
    assert 10 < inside.sum() < len(vertices)
    assert (annotations.labels("one") == inside).all()
    annotations.set_shapes("one", [Shape("volume", "half-space", [[4, 0, 0], [-2, 0, 0]], 2)])
    assert (annotations.labels("one") == 2 * (vertices[:, 0] <= 4)).all()
    shown = annotations.owners("uv").display(annotations.labels("one"))
    assert (annotations.image("one", "uv") == shown).all()


@pytest.mark.parametrize(
    ("chart", "kind", "vertices"),
    [
        ("uv", "polygon", [[0, 0], [1, 1]]),
        ("uv", "rectangle", [[0, 0], [1, 1], [0, 1]]),
        ("uv", "box", [[0, 0, 0], [1, 1, 1]]),
        ("uv", "polygon", [[0, 0], [1, 1], [np.nan, 1]]),
        ("volume", "box", [[0, 0], [1, 1]]),
        ("volume", "polygon", [[0, 0], [1, 1], [0, 1]]),
        ("topography", "polygon", [[0, 0], [1, 1], [0, 1]]),
    ],
)
def test_what_is_no_shape_is_refused(chart: str, kind: str, vertices: list[list[float]]) -> None:
    with pytest.raises(ParameterError, match=r"vertices|There is no"):
        Shape(chart, kind, np.array(vertices), 1)


def test_a_shape_that_reaches_too_far_is_refused_and_nothing_changes(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    for corner in ((0, 60), (0, -33), (30, 0), (-17, 0)):
        with pytest.raises(ParameterError, match="too far"):
            annotations.add_shape("one", Shape("uv", "polygon", SQUARE + corner, 1))
    assert annotations.shapes("one") == ()
    without = Annotations(
        atlas.replaced(on_request={}, quality={"plane": {"reason": "flipped", "hint": ""}})
    )
    without.add("one")
    with pytest.raises(ChartMissingError, match="plane"):
        without.add_shape("one", Shape("plane", "polygon", SQUARE, 1))


# Points --------------------------------------------------------------------------


def test_points_lie_on_the_surface_and_have_their_place_on_every_chart(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    counts: list[int] = []
    annotations.points.changed.connect(lambda: counts.append(len(annotations.points.positions)))
    vertex = atlas.surface.vertices[40]
    annotations.points.set("tip", vertex)
    annotations.points.set("off", vertex + 0.3)
    assert np.allclose(annotations.points.positions["tip"], vertex)
    for chart in ("uv", "direct", "plane"):
        places, valid = annotations.points.on(chart)
        expected, _ = atlas.map(vertex[None], "surface", chart)
        assert valid.all()
        assert np.allclose(places[0], expected[0])
    annotations.points.set("tip", atlas.surface.vertices[3])
    annotations.points.remove("off")
    annotations.undo()
    annotations.undo()
    assert list(annotations.points.positions) == ["tip", "off"]
    assert np.allclose(annotations.points.positions["tip"], vertex)
    assert counts == [1, 2, 2, 1, 2, 2]
    for name, place in (("", vertex), ("x", vertex[:2]), ("x", [np.nan] * 3)):
        with pytest.raises(ParameterError):
            annotations.points.set(name, place)
    with pytest.raises(ParameterError, match="no point"):
        annotations.points.remove("nobody")
    no_points, valid = Annotations(atlas).points.on("uv")
    assert no_points.shape == (0, 2)
    assert valid.shape == (0,)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_edges_in_space_are_around_what_is_inside(axis: int, side: float) -> None:
    low, high = np.array([0.0, 1.0, 2.0]), np.array([4.0, 9.0, 6.0])
    point, inwards = np.zeros(3), np.zeros(3)
    point[axis], inwards[axis] = low[axis] + 1.0, side
    edges = edges_in_space(Shape("volume", "half-space", [point, inwards], 1), low, high)
    corners = np.unique(edges.reshape(-1, 3), axis=0)
    assert edges.shape == (12, 2, 3)
    assert len(corners) == 8
    assert (np.count_nonzero(edges[:, 0] != edges[:, 1], axis=1) == 1).all()
    assert ((corners - point)[:, axis] * side >= 0).all()
    others = [k for k in range(3) if k != axis]
    assert (corners.min(axis=0) < low)[others].all()
    assert (corners.max(axis=0) > high)[others].all()
    box = edges_in_space(Shape("volume", "box", [high, low], 1), low, high).reshape(-1, 3)
    assert (box.min(axis=0) == low).all()
    assert (box.max(axis=0) == high).all()
