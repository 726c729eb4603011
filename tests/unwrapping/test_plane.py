"""Step 7: the flattened surface covers the image once, and comes back; or it is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import Cancelled, NotCertifiedError
from napari_unwrap3d.geometry.flat import FlatSphere
from napari_unwrap3d.geometry.poles import open_at_poles
from napari_unwrap3d.parameters import PlaneParameters
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.flatten import flow, limit, stiffness
from napari_unwrap3d.unwrapping.plane import (
    certify,
    filled,
    flat_sphere,
    flattened,
    flipped_places,
)
from napari_unwrap3d.unwrapping.surface import same_mesh
from napari_unwrap3d.unwrapping.uv import direction_to_uv, uv_to_direction
from shapes import icosphere, rotation

ROWS = 64
COLUMNS = 2 * ROWS
# Where a mushroom stands, as a direction (z, y, x): at the equator, over the seam, beside a
# pole, and over a pole, so that its streamline is crossed three times.
PLACES = {
    "equator": (0.0, 0.4, 1.0),
    "seam": (0.1, 0.0, -1.0),
    "beside a pole": (1.0, 0.25, 0.1),
    "over the north pole": (1.0, 0.06, 0.03),
    "over the south pole": (-1.0, -0.05, 0.08),
}
# Its profile from the middle of its top to its foot: distance from the axis in radians, and d
# in pixels. The cap overhangs the stalk.
PROFILE = ((0.0, 14.0), (0.3, 10.0), (0.34, 7.0), (0.14, 6.0), (0.12, 2.0), (0.5, 0.0))


def ball(seed: int = 1, subdivisions: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Directions and faces of a sphere that is turned, so that nothing lies on a pole."""
    where, faces = icosphere(subdivisions)
    return where @ rotation(seed).T, faces


def on_image(where: np.ndarray, d: np.ndarray | float = 0.0) -> np.ndarray:
    """(d, v, u) in pixels of directions."""
    return np.column_stack([np.broadcast_to(d, len(where)), direction_to_uv(where, ROWS)])


def mushroom(axis: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """(d, v, u) and faces of a sphere on which a mushroom stands."""
    where, faces = ball()
    unit = np.array(axis) / np.linalg.norm(axis)
    angle = np.arccos((where @ unit).clip(-1, 1))
    side = where - (where @ unit)[:, None] * unit
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    radius, height = np.array(PROFILE).T
    place = np.linspace(0.0, radius[-1], len(radius))
    turned = np.where(angle < place[-1], np.interp(angle, place, radius), angle)
    moved = np.cos(turned)[:, None] * unit + np.sin(turned)[:, None] * side
    return on_image(moved, np.interp(angle, place, height)), faces


def flatten(image: np.ndarray, faces: np.ndarray, **values: object) -> FlatSphere:
    return flattened(image, faces, ROWS, PlaneParameters(**values), silent()).flat


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distance in pixels, the short way around."""
    step = np.abs(one - other)
    step[:, 1] = np.minimum(step[:, 1] % COLUMNS, COLUMNS - step[:, 1] % COLUMNS)
    return np.hypot(step[:, 0], step[:, 1])


def on_faces(faces: np.ndarray, count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.integers(0, len(faces), count), rng.dirichlet([1, 1, 1], count)


def test_a_bumpy_height_field_stays_where_it_is() -> None:
    """Away from the poles, where the image itself stretches faces without end."""
    where, faces = ball()
    image = on_image(where, 0.3 * np.sin(6 * where[:, 1]) * np.cos(5 * where[:, 2]))
    flat = flatten(image, faces)
    pixels = certify(flat, where)
    assert (pixels.covering == 1).all()
    away = np.abs(image[:, 1] - (ROWS - 1) / 2) < ROWS / 2 - 8
    moved = apart(flat.vertices, image[:, 1:])
    assert moved[away].max() < 0.5
    assert np.median(moved) < 0.1


@pytest.mark.parametrize("laplacian", ["automatic", "positive"])
@pytest.mark.parametrize("place", PLACES)
def test_a_mushroom_is_flattened_one_to_one(place: str, laplacian: str) -> None:
    image, faces = mushroom(PLACES[place])
    flat = flatten(image, faces, laplacian=laplacian)
    pixels = certify(flat, np.zeros((len(image), 3)))
    assert (pixels.covering == 1).all()
    assert flat.areas()[0].min() > 0
    assert flat.areas()[0].sum() == pytest.approx(2 * ROWS**2, rel=1e-9)


def test_the_overhang_covers_pixels_more_than_once_before_it_is_flattened() -> None:
    image, faces = mushroom(PLACES["equator"])
    flat = flatten(image, faces)
    before = FlatSphere(
        image[:, 1:].copy(), faces, flat.turns, flat.pole_faces, flat.pole_weights, ROWS
    )
    assert before.pixels().covering.max() >= 3
    assert len(before.flipped()) > 100


@pytest.mark.parametrize("place", ["equator", "seam", "over the north pole"])
def test_every_place_comes_back(place: str) -> None:
    image, faces = mushroom(PLACES[place])
    flat = flatten(image, faces)
    face, weights = on_faces(faces)
    there = flat.at(face, weights)
    assert there.min() >= -0.5
    assert (there < [ROWS - 0.5 + 1e-9, COLUMNS - 0.5]).all()
    again, back = flat.locate(there)
    assert (again == face).mean() > 0.999
    np.testing.assert_allclose(back[again == face], weights[again == face], atol=1e-6)
    assert apart(flat.at(again, back), there).max() < 1e-9


def test_every_pixel_comes_back_also_at_the_poles_and_the_seam() -> None:
    image, faces = mushroom(PLACES["seam"])
    flat = flatten(image, faces)
    rows, columns = np.meshgrid([-0.5, 0.0, 0.3, 31.2, 62.9, 63.5], np.linspace(-0.5, 127.4, 200))
    points = np.column_stack([rows.ravel(), columns.ravel()])
    face, weights = flat.locate(points)
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    inner = np.abs(points[:, 0] - 31.5) < 31.9
    assert apart(flat.at(face, weights), points)[inner].max() < 1e-9


def test_the_border_is_the_pole_and_one_place() -> None:
    where, faces = ball()
    flat = flatten(on_image(where), faces)
    for pole, v in enumerate((-0.5, ROWS - 0.5)):
        border = np.column_stack([np.full(50, v), np.linspace(0, COLUMNS - 1, 50)])
        face, weights = flat.locate(border)
        assert set(face) == {flat.pole_faces[pole]}
        np.testing.assert_allclose(weights, flat.pole_weights[pole][None] + np.zeros((50, 1)))
        place = weights[0] @ where[faces[face[0]]]
        assert place[0] * (1, -1)[pole] > 0.99


def test_location_agrees_with_what_covers_the_pixels() -> None:
    image, faces = mushroom(PLACES["beside a pole"])
    flat = flatten(image, faces)
    pixels = flat.pixels()
    centres = np.stack(np.indices((ROWS, COLUMNS)), axis=-1).reshape(-1, 2).astype(float)
    again = flat.at(pixels.face.ravel(), pixels.weights.reshape(-1, 3))
    assert apart(again, centres).max() < 1e-9
    face, _ = flat.locate(centres)
    assert (face == pixels.face.ravel()).mean() > 0.999


def test_a_flipped_mesh_is_refused_with_the_place() -> None:
    where, faces = ball()
    flat = flatten(on_image(where), faces)
    vertex = int(np.argmin(np.linalg.norm(where - [0.2, 0.7, 0.7], axis=1)))
    broken = flat.vertices.copy()
    broken[vertex] += [0.0, 8.0]
    bad = FlatSphere(broken, faces, flat.turns, flat.pole_faces, flat.pole_weights, ROWS)
    with pytest.raises(NotCertifiedError, match="flipped") as caught:
        certify(bad, 5.0 * where)
    error = caught.value
    assert error.measured["clusters"] == 1
    assert error.measured["flipped_faces"] == error.places[0]["faces"] > 0
    assert np.linalg.norm(error.places[0]["position_um"] - 5.0 * where[vertex]) < 0.5
    assert apart(np.array([error.places[0]["position_vu"]]), flat.vertices[[vertex]]).max() < 12
    assert "direct" in error.hint


def test_places_are_clusters_the_largest_first() -> None:
    where, faces = ball()
    flat = flatten(on_image(where), faces)
    one, other = np.flatnonzero((faces == 40).any(axis=1)), np.flatnonzero(faces[:, 0] == 900)[:1]
    places = flipped_places(flat, np.sort(np.concatenate([one, other])), where)
    assert [place["faces"] for place in places] == [len(one), 1]
    np.testing.assert_allclose(places[0]["position_um"], where[40], atol=0.05)


def test_a_mesh_that_does_not_go_around_the_poles_is_refused() -> None:
    where, faces = ball(subdivisions=3)
    image = on_image(where)
    image[:, 2] = 10.0 + 0.1 * image[:, 2]
    with pytest.raises(NotCertifiedError, match="pole"):
        flatten(image, faces)


def test_vertices_on_the_poles_and_the_seam_do_not_matter() -> None:
    """A sphere whose vertices lie exactly on both poles and along the seam."""
    where, faces = icosphere(4)
    pole = where[0]
    side = np.cross(pole, [0.3, 0.5, -0.2])
    side /= np.linalg.norm(side)
    turned = where @ np.stack([pole, side, np.cross(pole, side)]).T
    assert np.abs(turned[:, 0]).max() == pytest.approx(1.0)
    flat = flatten(on_image(turned), faces)
    assert (certify(flat, turned).covering == 1).all()


def test_the_same_input_gives_the_same_plane_bit_for_bit() -> None:
    image, faces = mushroom(PLACES["over the south pole"])
    first, second = flatten(image, faces), flatten(image, faces)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.turns, second.turns)


def test_a_turn_of_u_more_or_less_does_not_matter() -> None:
    image, faces = mushroom(PLACES["seam"])
    moved = image.copy()
    moved[::3, 2] += COLUMNS
    one, other = flatten(image, faces), flatten(moved, faces)
    face, weights = on_faces(faces, 500)
    assert apart(one.at(face, weights), other.at(face, weights)).max() < 1e-6


def test_a_smaller_step_flattens_less() -> None:
    image, faces = mushroom(PLACES["equator"])
    cylinder = open_at_poles(image, faces, ROWS)
    operator = stiffness(cylinder, ROWS, "positive")
    steep = []
    for delta in (1.0, 100.0, 1e4):
        parameters = PlaneParameters(delta=delta, iterations=3)
        points, iterations = flow(cylinder, operator, ROWS, parameters, silent())
        assert iterations == 3
        steep.append(np.ptp(points[:, 0]))
    assert 14.0 > steep[0] > steep[1] > steep[2]
    # The limit lies between the heights of the poles, which stay where they are.
    flat = limit(cylinder, operator, silent())[:, 0]
    assert flat.min() >= cylinder.points[-6:, 0].min() - 1e-9
    assert flat.max() <= cylinder.points[-6:, 0].max() + 1e-9
    assert np.ptp(flat) < 0.01


@pytest.mark.parametrize("kind", ["robust", "cotangent", "positive"])
def test_constants_feel_no_force_and_u_none_but_its_own(kind: str) -> None:
    """Rows of L_0 sum to zero, and a turn of all of u changes nothing."""
    image, faces = mushroom(PLACES["over the north pole"])
    cylinder = open_at_poles(image, faces, ROWS)
    operator = stiffness(cylinder, ROWS, kind)
    rest = operator.inner.sum(axis=1) + operator.border.sum(axis=1)
    np.testing.assert_allclose(rest, 0.0, atol=1e-7)
    asymmetry = operator.inner - operator.inner.T
    assert abs(asymmetry).max() < 1e-9


def test_flattening_a_flat_cylinder_moves_nothing() -> None:
    """Between the poles' faces a flat image is already harmonic, by exact cotangents."""
    where, faces = ball()
    image = on_image(where)
    cylinder = open_at_poles(image, faces, ROWS)
    for kind in ("robust", "cotangent"):
        operator = stiffness(cylinder, ROWS, kind)
        force = operator.inner @ cylinder.points[:-6] + operator.pull(cylinder.points[-6:])
        away = np.abs(image[:, 1] - (ROWS - 1) / 2) < ROWS / 2 - 8
        assert np.abs(force[away]).max() < 1e-8


def test_missing_images_are_filled_from_around() -> None:
    where, faces = ball()
    image = on_image(where, 2.0)
    holes = image.copy()
    cap = where @ np.array([0.1, 0.2, -1.0]) > 0.98
    holes[cap] = np.nan
    whole = filled(holes, faces, ROWS)
    np.testing.assert_array_equal(whole[~cap], image[~cap])
    np.testing.assert_allclose(whole[cap, 0], 2.0)
    turned = uv_to_direction(whole[cap, 1:], ROWS)
    assert np.linalg.norm(turned - uv_to_direction(image[cap, 1:], ROWS), axis=1).max() < 0.3


def test_flattening_can_be_cancelled() -> None:
    image, faces = mushroom(PLACES["equator"])
    progress = Progress(lambda step, fraction, message: progress.cancel())
    with pytest.raises(Cancelled):
        flattened(image, faces, ROWS, PlaneParameters(), progress)


# The cells ---------------------------------------------------------------------------


def test_the_plane_of_a_cell_is_certified(plane_atlas: Atlas) -> None:
    numbers = plane_atlas.quality["plane"]
    assert numbers["certified"] is True
    assert numbers["flipped_faces"] == 0
    assert numbers["covered_once_fraction"] == 1.0
    assert numbers["covered_area"] == pytest.approx(1.0, abs=1e-9)
    assert numbers["round_trip_fraction"] > 0.999
    assert numbers["unmapped_fraction"] == 0.0
    assert not plane_atlas.plane.of_sealed
    assert same_mesh(plane_atlas.sealed, plane_atlas.surface)


def test_of_a_cell_with_a_handle_the_sealed_surface_is_flattened(
    plane_handle_atlas: Atlas,
) -> None:
    chart, numbers = plane_handle_atlas.plane, plane_handle_atlas.quality["plane"]
    assert chart.of_sealed
    assert numbers["of_sealed_surface"] is True
    assert numbers["flipped_faces"] == 0
    assert len(chart.vertices) == len(plane_handle_atlas.sealed.vertices)
    assert numbers["unmapped_fraction"] < 0.02


def test_pixels_lie_where_the_chart_says(plane_atlas: Atlas) -> None:
    chart = plane_atlas.plane
    corners = plane_atlas.sealed.vertices[plane_atlas.sealed.faces[chart.face]]
    np.testing.assert_allclose(
        chart.positions, np.einsum("ijkl,ijk->ijl", corners, chart.weights), atol=1e-12
    )
    assert set(chart.fields) == {"conformal_error", "area_distortion", "area_um2"}
    area = chart.fields["area_um2"].sum()
    assert 0.3 < area / plane_atlas.quality["surface"]["area_um2"] < 1.1


def test_the_sheet_under_a_pixel_is_near_where_uv_shows_it(plane_atlas: Atlas) -> None:
    """Flattening moves the cortex little: both images show the same cell."""
    chart = plane_atlas.plane
    flat = flat_sphere(chart, plane_atlas.sealed.faces)
    topographic = plane_atlas.topography.surface
    cortex = np.abs(topographic[:, 0]) < 0.1
    turned = [
        uv_to_direction(points[cortex], chart.shape[0])
        for points in (topographic[:, 1:], flat.vertices)
    ]
    assert np.median(np.linalg.norm(turned[0] - turned[1], axis=1)) < 0.25


def test_a_chart_knows_its_size(plane_atlas: Atlas) -> None:
    chart = plane_atlas.plane
    assert chart.shape == plane_atlas.uv.shape
    with pytest.raises(ValueError, match="N × 2N"):
        dataclasses.replace(chart, face=chart.face[:, :-1])
