"""A place is the same in every chart, and found again from any of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.places import Places


@pytest.fixture(scope="module")
def places(plane_atlas: Atlas) -> Places:
    plane_atlas.direct  # noqa: B018 (computes it)
    return Places(plane_atlas).prepare()


def apart(one: Any, other: Any, columns: int) -> float:
    """Distance of two (…, v, u) in pixels, around the image."""
    difference = np.asarray(one, dtype=float)[-2:] - np.asarray(other, dtype=float)[-2:]
    difference[1] = (difference[1] + columns / 2) % columns - columns / 2
    return float(np.hypot(*difference))


@pytest.mark.parametrize("pixel", [(20, 40), (32, 0), (33, 127), (0, 5), (63, 90)])
def test_a_uv_pixel_is_where_the_maps_put_it(places: Places, pixel: tuple[int, int]) -> None:
    atlas = places.atlas
    place = places.at_pixel("uv", pixel)
    for chart, found in (
        ("surface", place.position),
        ("reference", place.reference),
        ("sphere", place.sphere),
    ):
        expected, _ = atlas.map([pixel], "uv", chart)
        tolerance = atlas.voxel_um if chart == "surface" else 1e-2
        np.testing.assert_allclose(found, expected[0], atol=tolerance, err_msg=chart)
    corners = atlas.surface.vertices[place.corners]
    np.testing.assert_allclose(place.weights @ corners, place.position)
    again = places.on_mesh("surface", place.corners, place.weights)
    assert again.direct is not None
    assert again.plane is not None
    if 1 <= pixel[0] < 62:
        assert apart(again.uv, pixel, 128) < 1.5


@pytest.mark.parametrize("chart", ["direct", "plane"])
@pytest.mark.parametrize("row", [15, 40])
@pytest.mark.parametrize("column", [0.0, 61.3, 127.4])
def test_images_one_to_one_are_found_again(
    places: Places, chart: str, row: int, column: float
) -> None:
    columns = getattr(places.atlas, chart).shape[1]
    point = np.array([row, column * columns / 128])
    place = places.at_pixel(chart, point)
    assert place.corners is not None
    expected, _ = places.atlas.map([point], chart, "surface")
    assert np.linalg.norm(place.position - expected[0]) < 2 * places.atlas.voxel_um
    again = places.on_mesh("surface", place.corners, place.weights)
    assert apart(getattr(again, chart), point, columns) < 1.0


def test_faces_over_the_seam_are_at_one_side(places: Places) -> None:
    atlas = places.atlas
    u = atlas.topography.surface[atlas.surface.faces][..., 2]
    v = atlas.topography.surface[atlas.surface.faces][..., 1]
    over = np.flatnonzero((np.ptp(u, axis=1) > 100) & (np.abs(v - 32) < 15).all(axis=1))
    assert len(over)
    for face in over[:20]:
        place = places.on_mesh("surface", atlas.surface.faces[face], np.ones(3) / 3)
        assert min(place.uv[1] + 0.5, 127.5 - place.uv[1]) < 6
        assert -0.5 <= place.uv[1] < 127.5


def test_a_node_of_the_topography_is_in_space(places: Places) -> None:
    chart = places.atlas.topography
    top = len(chart.d_um) - 1
    place = places.at_pixel("topography", (top, 20.2, 40.1))
    np.testing.assert_allclose(place.position, chart.positions[top, 20, 40], atol=1e-5)
    assert place.corners is None, "far from the surface"
    assert place.topography[0] == pytest.approx(chart.d_um[-1])
    height = places.at_pixel("uv", (20, 40)).topography[0]
    near = places.at_pixel("topography", (np.abs(chart.d_um - height).argmin(), 20, 40))
    assert near.corners is not None


def test_the_reference_and_the_sphere_lead_to_the_same_place(places: Places) -> None:
    atlas = places.atlas
    corners, weights = atlas.reference.faces[100], np.array([0.5, 0.3, 0.2])
    one, other = (places.on_mesh(chart, corners, weights) for chart in ("reference", "sphere"))
    np.testing.assert_allclose(one.reference, weights @ atlas.reference.vertices[corners])
    np.testing.assert_array_equal(one.position, other.position)
    expected, _ = atlas.map([one.reference], "reference", "uv")
    assert apart(one.uv, expected[0], 128) < 0.1


def test_another_sealed_surface_leads_to_the_nearest_place(places: Places) -> None:
    atlas = places.atlas
    moved = replace(atlas.sealed, vertices=atlas.sealed.vertices + 0.2 * atlas.voxel_um)
    other = Places(atlas.replaced(sealed=moved))
    corners, weights = atlas.surface.faces[50], np.ones(3) / 3
    place = other.on_mesh("sealed", corners, weights)
    np.testing.assert_allclose(place.position, weights @ moved.vertices[corners])
    on_surface = place.weights @ atlas.surface.vertices[place.corners]
    assert np.linalg.norm(on_surface - place.position) < atlas.voxel_um


def test_outside_of_an_image_is_no_place(places: Places) -> None:
    for point in ((-1, 4), (64, 4), (3, -0.6), (3, 127.6)):
        assert places.at_pixel("uv", point) is None
    assert places.at_pixel("topography", (-1, 3, 3)) is None
