"""One atlas per timepoint: a place keeps its (u, v) while the cell turns, stretches and bends."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from moving import quick
from napari_unwrap3d import Movie, Surface, unwrap_movie
from napari_unwrap3d.geometry.fit import rotation_of
from napari_unwrap3d.geometry.spherical_alignment import angles
from napari_unwrap3d.motion.alignment import DIRECTION, aligned, in_order
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.uv import uv_to_direction
from shapes import icosphere, rotation
from synthetic import CENTRE, RADIUS, make_atlas

ROWS = 64
TURN = np.array([0.1, 0.2, -0.15])
SIZE_UM = 3.0


def moved(points: np.ndarray, amount: float) -> np.ndarray:
    """Points turned, stretched along x and bent: where the matter of the body goes."""
    z, y, x = (points * [1 - 0.1 * amount, 1.0, 1 + 0.25 * amount]).T
    if amount:
        radius, angle = 1 / (0.25 * amount) - y, 0.25 * amount * x
        y, x = 1 / (0.25 * amount) - radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([z, y, x], axis=1) @ rotation_of(amount * TURN).T


def bumpy_body() -> tuple[np.ndarray, np.ndarray]:
    """A body longer than wide, with bumps by which its places can be told."""
    directions, faces = icosphere(5)
    radius = np.ones(len(directions))
    for axis in np.random.default_rng(3).normal(size=(14, 3)):
        radius += 0.3 * np.exp(25 * (directions @ (axis / np.linalg.norm(axis)) - 1))
    return directions * radius[:, None] * [1.0, 1.1, 1.6], faces


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    points, faces = bumpy_body()
    sources = [Surface(SIZE_UM * moved(points, amount), faces) for amount in (0.0, 0.5, 1.0)]
    parameters = quick(
        movie={"common": "each"},
        stack={"working_voxel_um": 0.2},
        reference={"stop": "fixed", "fixed_iteration": 8, "vertices": 3000},
    )
    folder = tmp_path_factory.mktemp("each")
    return unwrap_movie(sources, parameters, time_step=1.0, folder=folder)


def drift(movie: Movie, timepoint: int) -> np.ndarray:
    """Pixels between a vertex's place in the image at a timepoint and at the first one."""
    one, other = (uv_to_direction(movie.frame(t).topography[:, 1:], ROWS) for t in (0, timepoint))
    return np.linalg.norm(one - other, axis=1) * ROWS / np.pi


def test_matter_keeps_its_place_in_the_image(movie: Movie) -> None:
    for timepoint, (middle, most) in {1: (0.9, 2.0), 2: (1.5, 4.0)}.items():
        off = drift(movie, timepoint)
        assert np.isfinite(off).all()
        assert np.median(off) < middle
        assert np.percentile(off, 95) < most


def test_it_is_measured_and_nothing_flips(movie: Movie) -> None:
    for timepoint in (1, 2):
        movie.frame(timepoint)
        quality = movie.atlas(timepoint).quality
        assert quality["alignment"]["flipped_faces"] == 0
        assert quality["sphere"]["flipped_faces"] == 0
        assert quality["uv"]["unlocated_pixels"] == 0
        residuals = [quality["alignment"][f"residual_{n}_um"] for n in ("rotated", "aligned")]
        assert residuals[1] < 0.5 * residuals[0]


def test_every_timepoint_has_its_own_space_and_one_unwrapping(movie: Movie) -> None:
    first, last = movie.atlas(0), movie.atlas(2)
    assert movie.record["method"] == "each"
    np.testing.assert_array_equal(first.reference.vertices, movie.common.reference.vertices)
    np.testing.assert_array_equal(first.uv.rotation, last.uv.rotation)
    assert last.reference.vertices.shape != first.reference.vertices.shape or not np.allclose(
        last.reference.vertices, first.reference.vertices
    )
    points = last.surface.vertices[::50]
    image, valid = last.map(points, "surface", "topography")
    back, _ = last.map(image, "topography", "surface")
    assert valid.all()
    np.testing.assert_allclose(back, points, atol=0.01)
    assert "surface_height_um" in last.uv.fields


def test_a_frame_does_not_depend_on_which_were_made_before(movie: Movie, tmp_path: Path) -> None:
    assert movie.work is not None
    again = unwrap_movie(movie.work.lapse.sources, movie.parameters, time_step=1.0, folder=tmp_path)
    one, two = again.frame(2), movie.frame(2)
    np.testing.assert_array_equal(one.topography, two.topography)
    for name, image in one.uv.items():
        np.testing.assert_array_equal(image, two.uv[name])


@pytest.mark.parametrize("seed", range(2))
def test_a_sphere_that_came_turned_is_turned_back(seed: int) -> None:
    """The same reference, whose sphere came out in any position."""
    common = make_atlas(subdivisions=4)
    turn = rotation(seed)
    place = common.sphere.vertices @ turn.T
    sphere = replace(common.sphere, vertices=place, conformal=place)
    guide = Surface(*make_guide())
    sphere, numbers = aligned(common.reference, sphere, guide, common, silent())
    off = angles(sphere.vertices, common.sphere.vertices)
    assert np.degrees(off.max()) < 0.2
    assert np.degrees(numbers["angle_own_rad"]) > 20
    assert numbers["flipped_faces"] == 0
    np.testing.assert_allclose(sphere.conformal, common.sphere.conformal, atol=2e-3)


def make_guide() -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """A coarser mesh of the round reference, which knows its places."""
    directions, faces = icosphere(3)
    return CENTRE + RADIUS * directions, faces, {DIRECTION: directions}


def test_the_guide_goes_from_neighbour_to_neighbour() -> None:
    assert list(in_order(range(5), 2)) == [(3, 2), (4, 3), (1, 2), (0, 1)]
    assert list(in_order(range(3), 0)) == [(1, 0), (2, 1)]
    assert list(in_order([0, 2, 5, 6], 5)) == [(6, 5), (2, 5), (0, 2)]
