"""Point location: on spheres exactly, on surfaces against closed formulas."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.errors import NotLocatedError
from napari_unwrap3d.geometry import compiled
from napari_unwrap3d.geometry.locate import (
    LabelInterpolator,
    SphericalLocator,
    SurfaceLocator,
    barycentric,
    interpolate,
)
from shapes import directions, icosphere, lumpy, rotation


def uneven_sphere(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A sphere with triangles of very different sizes, none flipped."""
    vertices, faces = icosphere(3)
    squeezed = vertices @ rotation(seed).T * [1.0, 1.0, 4.0] + [0, 0, 1.5]
    return squeezed / np.linalg.norm(squeezed, axis=1, keepdims=True), faces


def assert_located(
    locator: SphericalLocator, vertices: np.ndarray, faces: np.ndarray, where: np.ndarray
) -> None:
    face, weights = locator.locate(where)
    assert (weights > -1e-11).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    point = interpolate(vertices, faces, face, weights)
    point /= np.linalg.norm(point, axis=1, keepdims=True)
    assert np.abs(point - where).max() < 1e-12


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_random_directions_are_reconstructed(seed: int) -> None:
    vertices, faces = uneven_sphere(seed)
    assert_located(SphericalLocator(vertices, faces), vertices, faces, directions(2000, seed))


def test_poles_vertices_edges_and_centres() -> None:
    vertices, faces = uneven_sphere()
    locator = SphericalLocator(vertices, faces)
    corners = vertices[faces]
    middles = 0.3 * corners[:, 0] + 0.7 * corners[:, 1]
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    for where in (axes, vertices, middles, corners.mean(axis=1)):
        unit = where / np.linalg.norm(where, axis=1, keepdims=True)
        assert_located(locator, vertices, faces, unit)
    face, _ = locator.locate(corners.mean(axis=1))
    np.testing.assert_array_equal(face, np.arange(len(faces)))
    face, weights = locator.locate(vertices)
    np.testing.assert_array_equal(faces[face, weights.argmax(axis=1)], np.arange(len(vertices)))


def test_a_vertex_exactly_at_the_pole_of_the_axes() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    octahedron = np.array(
        [[0, 1, 2], [0, 2, 4], [0, 4, 5], [0, 5, 1], [3, 2, 1], [3, 4, 2], [3, 5, 4], [3, 1, 5]]
    )
    locator = SphericalLocator(axes, octahedron)
    assert_located(locator, axes, octahedron, axes)
    assert_located(locator, axes, octahedron, directions(500))


def test_the_order_and_number_of_queries_do_not_matter() -> None:
    vertices, faces = uneven_sphere()
    locator = SphericalLocator(vertices, faces)
    where = directions(300)
    face, weights = locator.locate(where)
    back, _ = locator.locate(where[::-1])
    np.testing.assert_array_equal(back[::-1], face)
    one, alone = locator.locate(where[17:18])
    assert one[0] == face[17]
    np.testing.assert_array_equal(alone[0], weights[17])
    none, empty = locator.locate(np.zeros((0, 3)))
    assert none.shape == (0,)
    assert empty.shape == (0, 3)


def test_nan_is_not_located() -> None:
    locator = SphericalLocator(*icosphere(1))
    where = directions(5)
    where[2, 1] = np.nan
    with pytest.raises(NotLocatedError, match="NaN") as caught:
        locator.locate(where)
    assert caught.value.measured["count"] == 1


def test_a_sphere_folded_onto_a_half_has_no_face_on_the_other() -> None:
    vertices, faces = icosphere(2)
    folded = vertices * [1, 1, 1]
    folded[:, 0] = np.abs(folded[:, 0]) + 0.1
    folded /= np.linalg.norm(folded, axis=1, keepdims=True)
    with pytest.raises(NotLocatedError, match="no face"), np.errstate(all="ignore"):
        SphericalLocator(folded, faces).locate(np.array([[-1.0, 0, 0]]))


def test_closest_points_on_a_sphere() -> None:
    vertices, faces = icosphere(4)
    where = directions(500) * np.random.default_rng(1).uniform(0.3, 3, (500, 1))
    face, weights, distance = SurfaceLocator(vertices, faces).closest(where)
    assert np.abs(distance - np.abs(np.linalg.norm(where, axis=1) - 1)).max() < 0.003
    found = interpolate(vertices, faces, face, weights)
    np.testing.assert_allclose(np.linalg.norm(found - where, axis=1), distance, atol=1e-9)
    assert weights.min() > -1e-9
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)


def test_points_on_a_surface_are_their_own_closest_points() -> None:
    vertices, faces = lumpy(3)
    rng = np.random.default_rng(0)
    face = rng.integers(0, len(faces), 400)
    weights = rng.dirichlet([1, 1, 1], 400)
    points = interpolate(vertices, faces, face, weights)
    found, place, distance = SurfaceLocator(vertices, faces).closest(points)
    assert distance.max() < 1e-9
    np.testing.assert_allclose(interpolate(vertices, faces, found, place), points, atol=1e-9)
    assert (found == face).mean() > 0.99
    assert [len(part) for part in SurfaceLocator(vertices, faces).closest(np.zeros((0, 3)))] == [
        0,
        0,
        0,
    ]


def test_a_segment_hits_the_first_face_between_its_ends() -> None:
    vertices, faces = icosphere(3)
    locator = SurfaceLocator(vertices, faces)
    way = directions(200, 1)
    outside, middle = 2.0 * way, np.zeros_like(way)
    face, weights = locator.first_hit(outside, -outside)
    assert (face >= 0).all()
    hit = interpolate(vertices, faces, face, weights)
    # The nearer of the two crossings, on the line.
    assert (np.einsum("ij,ij->i", hit, way) > 0.97).all()
    assert np.linalg.norm(np.cross(hit, way), axis=1).max() < 1e-6
    inner, _ = locator.first_hit(middle, outside)
    np.testing.assert_array_equal(inner, face)


def test_segments_that_end_too_early_or_point_away_hit_nothing() -> None:
    locator = SurfaceLocator(*icosphere(3))
    way = directions(100, 2)
    for start, end in ((2 * way, 1.1 * way), (2 * way, 3 * way), (0 * way, 0.9 * way)):
        face, _ = locator.first_hit(start, end)
        assert (face == -1).all()


class ForgetfulTree:
    """A tree that leaves what was in the memory where nothing is hit, as libigl's does."""

    def intersect_ray_first(self, vertices: Any, faces: Any, origin: Any, along: Any) -> Any:
        count = len(origin)
        return np.full(count, -1), np.full(count, np.nan), np.full((count, 2), 1.7e308)


def test_a_miss_has_finite_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    locator = SurfaceLocator(*icosphere(1))
    monkeypatch.setattr(locator._tree._blocks[0], "_tree", ForgetfulTree())
    way = directions(3)
    face, weights = locator.first_hit(2 * way, 3 * way)
    assert (face == -1).all()
    np.testing.assert_array_equal(weights, [[1, 0, 0]] * 3)


class CountedTree:
    """A tree that tells how many points it was asked for at a time."""

    def __init__(self, tree: Any) -> None:
        self._tree, self.asked = tree, list[int]()

    def squared_distance(self, vertices: Any, faces: Any, points: Any) -> Any:
        self.asked.append(len(points))
        return self._tree.squared_distance(vertices, faces, points)

    def intersect_ray_first(self, vertices: Any, faces: Any, origin: Any, along: Any) -> Any:
        self.asked.append(len(origin))
        return self._tree.intersect_ray_first(vertices, faces, origin, along)


@pytest.mark.parametrize("ask", ["closest", "first_hit"])
def test_many_queries_let_other_threads_run_and_change_nothing(
    ask: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    locator = SurfaceLocator(*lumpy(3))
    points = 2.0 * directions(503)
    arguments = (points,) if ask == "closest" else (points, np.zeros_like(points))
    whole = getattr(locator, ask)(*arguments)
    monkeypatch.setattr(compiled, "QUERIES", 100)
    here = locator._tree._blocks[0]
    here._tree = tree = CountedTree(here._tree)
    for once, parts in zip(whole, getattr(locator, ask)(*arguments), strict=True):
        np.testing.assert_array_equal(parts, once)
    assert tree.asked == [100] * 5 + [3]


@pytest.mark.parametrize("ask", ["closest", "first_hit"])
def test_blocks_of_faces_find_what_the_whole_mesh_has(
    ask: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = lumpy(4)
    rng = np.random.default_rng(3)
    points = rng.normal(size=(2000, 3)) * rng.uniform(0.2, 1.5, (2000, 1))
    arguments = (points,) if ask == "closest" else (points, -points)
    expected = getattr(SurfaceLocator(*mesh), ask)(*arguments)
    monkeypatch.setattr(compiled, "FACES", 300)
    locator = SurfaceLocator(*mesh)
    parts = [block._part for block in locator._tree._blocks]
    assert len(parts) > 8
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(len(mesh[1])))
    found = getattr(locator, ask)(*arguments)
    # On an edge between two blocks either face is right.
    same = found[0] == expected[0]
    assert same.mean() > 0.95
    for one, other in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_allclose(one[same], other[same], atol=1e-12)
    hit = (expected[0] >= 0) & (found[0] >= 0)
    np.testing.assert_array_equal(expected[0] >= 0, found[0] >= 0)
    places = [
        interpolate(*mesh, face[hit], weights[hit]) for face, weights, *_ in (found, expected)
    ]
    np.testing.assert_allclose(*places, atol=1e-9)


def test_barycentric_weights_reproduce_points_of_the_plane() -> None:
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(100, 3, 3))
    expected = rng.normal(size=(100, 3))
    expected /= expected.sum(axis=1, keepdims=True)
    points = np.einsum("ijk,ij->ik", corners, expected)
    np.testing.assert_allclose(barycentric(corners, points), expected, atol=1e-8)


def test_interpolation_of_scalars_and_vectors() -> None:
    vertices, faces = icosphere(1)
    face, weights = np.array([3, 5]), np.array([[1.0, 0, 0], [0.2, 0.3, 0.5]])
    scalar = interpolate(vertices[:, 0], faces, face, weights)
    vector = interpolate(vertices, faces, face, weights)
    np.testing.assert_allclose(scalar, vector[:, 0])
    np.testing.assert_allclose(vector[0], vertices[faces[3, 0]])
    whole = interpolate(np.arange(len(vertices)), faces, face, weights)
    assert whole.dtype == np.float64


def test_labels_stay_where_they_are_and_borders_run_between() -> None:
    """A half of the sphere has label 9; the border is where it is on the sphere."""
    vertices, faces = icosphere(4)
    labels = np.where(vertices[:, 0] > 0.1, 9, 4).astype(np.uint16)
    where = directions(4000)
    face, weights = SphericalLocator(vertices, faces).locate(where)
    found = LabelInterpolator(labels, faces).at(face, weights)
    assert found.dtype == np.uint16
    edge = 0.08
    assert (found[where[:, 0] > 0.1 + edge] == 9).all()
    assert (found[where[:, 0] < 0.1 - edge] == 4).all()
    assert (found == 9).mean() == pytest.approx((where[:, 0] > 0.1).mean(), abs=0.01)


def test_a_thin_line_of_labels_is_not_lost() -> None:
    vertices, faces = icosphere(4)
    line = np.abs(vertices[:, 1]) < 0.02
    labels = np.where(line, 5, 0)
    on_line = (line[faces].sum(axis=1) >= 2).nonzero()[0]
    corner = line[faces[on_line]].argmax(axis=1)
    found = LabelInterpolator(labels, faces).at(on_line, np.eye(3)[corner])
    assert (found == 5).all()


def test_one_label_everywhere_stays_everywhere() -> None:
    vertices, faces = icosphere(2)
    face, weights = SphericalLocator(vertices, faces).locate(directions(200))
    found = LabelInterpolator(np.full(len(vertices), -3), faces).at(face, weights)
    assert set(found) == {-3}
    none = LabelInterpolator(np.zeros(len(vertices), int), faces).at(face[:0], weights[:0])
    assert len(none) == 0
