"""Other views of a uv image: what is where in them, and back."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import AxesError, InputError, ParameterError
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from napari_unwrap3d.unwrapping.uv_views import (
    aspect_ratio,
    chessboard,
    pixel_to_polar,
    polar_to_pixel,
    polar_to_uv,
    stitch,
    to_aspect,
    to_polar,
    unstitch,
    uv_to_polar,
)

POLES = ("north", "south")


def image(seed: int = 0, rows: int = 16) -> np.ndarray:
    return np.random.default_rng(seed).random((rows, 2 * rows))


def unit_vectors(rows: int) -> np.ndarray:
    return uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows).reshape(rows, 2 * rows, 3)


def test_the_views_are_public() -> None:
    assert unwrap3d.uv_views.chessboard is chessboard


# Stitched ------------------------------------------------------------------------------


@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_stitched_image_repeats_its_first_column(channels: tuple) -> None:
    plain = np.random.default_rng(0).random((8, 16, *channels))
    plain[2, 0] = np.nan
    stitched = stitch(plain)
    assert stitched.shape == (8, 17, *channels)
    np.testing.assert_array_equal(stitched[:, 16], plain[:, 0])
    np.testing.assert_array_equal(unstitch(stitched), plain)


def test_labels_keep_their_type_when_stitched() -> None:
    labels = chessboard(8, 2)
    assert unstitch(stitch(labels)).dtype == labels.dtype


def test_wrong_images_are_errors() -> None:
    with pytest.raises(AxesError, match="N × 2N"):
        stitch(np.zeros((8, 17)))
    with pytest.raises(AxesError, match=r"2N \+ 1"):
        unstitch(np.zeros((8, 16)))
    changed = stitch(image())
    changed[[2, 5], -1] += 1
    with pytest.raises(InputError, match="pixels = 2"):
        unstitch(changed)


# Aspect ratio --------------------------------------------------------------------------


def test_the_aspect_ratio_of_ellipsoids(small_atlas: Atlas) -> None:
    """Equator over half an ellipse through the poles, from complete elliptic integrals."""
    from scipy.special import ellipe

    where = unit_vectors(64)
    for polar in (1.0, 0.5, 3.0):
        chart = replace(small_atlas.uv, positions=where * [polar, 1.0, 1.0])
        long, short = max(polar, 1.0), min(polar, 1.0)
        half_ellipse = 2 * long * ellipe(1 - (short / long) ** 2)
        expected = 2 * np.pi / half_ellipse
        assert aspect_ratio(chart) == pytest.approx(expected, rel=0.003)
    assert aspect_ratio(replace(small_atlas.uv, positions=where)) == pytest.approx(2, rel=1e-3)


def test_the_aspect_ratio_does_not_depend_on_size_or_place(small_atlas: Atlas) -> None:
    moved = replace(small_atlas.uv, positions=7 * small_atlas.uv.positions + 3)
    assert aspect_ratio(moved) == pytest.approx(aspect_ratio(small_atlas.uv))


def test_an_image_at_its_own_aspect_is_itself() -> None:
    np.testing.assert_allclose(to_aspect(image(), 2.0), image())
    labels = chessboard(16, 4)
    np.testing.assert_array_equal(to_aspect(labels, 2.0, "label"), labels)


@given(ratio=st.floats(0.5, 8))
def test_resampling_keeps_constants_rows_and_labels(ratio: float) -> None:
    rows = np.tile(np.arange(16.0)[:, None], (1, 32))
    wide = to_aspect(rows, ratio)
    assert wide.shape == (16, round(16 * ratio))
    np.testing.assert_allclose(wide, rows[:, :1] * np.ones(wide.shape), atol=1e-12)
    labels = to_aspect(chessboard(16, 4), ratio, "label")
    assert labels.dtype == np.uint8
    assert set(np.unique(labels)) <= {1, 2}


def test_resampled_columns_are_where_they_should_be() -> None:
    """A wave once around, sampled at other azimuths, over the seam as well."""
    rows = 64
    azimuth = (np.arange(2 * rows) + 0.5) * np.pi / rows
    wave = np.tile(np.cos(azimuth), (rows, 1))
    for ratio in (1.5, 3.0):
        columns = round(rows * ratio)
        expected = np.cos((np.arange(columns) + 0.5) * 2 * np.pi / columns)
        np.testing.assert_allclose(to_aspect(wave, ratio)[7], expected, atol=1e-3)


@pytest.mark.parametrize("ratio", [0.0, -1.0, np.nan, np.inf])
def test_ratios_are_positive(ratio: float) -> None:
    with pytest.raises(ParameterError, match="positive"):
        to_aspect(image(), ratio)


# Polar ---------------------------------------------------------------------------------


def test_poles_rim_and_equator_by_hand() -> None:
    points = [[-0.5, 15.5], [31.5, 47.5], [15.5, 31.5]]
    north = uv_to_polar(points, 32)
    np.testing.assert_allclose(north, [[0, -np.pi / 2], [1, np.pi / 2], [0.5, 0]], atol=1e-12)
    np.testing.assert_allclose(uv_to_polar(points, 32, "south")[:, 0], [1, 0, 0.5])
    pixels = polar_to_pixel([[0.0, 1.0], [1.0, 0.0], [1.0, np.pi / 2]], 64)
    np.testing.assert_allclose(pixels, [[31.5, 31.5], [31.5, 63.5], [-0.5, 31.5]], atol=1e-12)
    south = polar_to_pixel([[1.0, np.pi / 2]], 64, "south")
    np.testing.assert_allclose(south, [[63.5, 31.5]], atol=1e-12)


@given(seed=st.integers(0, 1000), pole=st.sampled_from(POLES), rows=st.sampled_from([32, 512]))
def test_points_come_back_from_every_view(seed: int, pole: str, rows: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.4, -0.5], [rows - 0.6, 2 * rows - 0.5001], (40, 2))
    polar = uv_to_polar(points, rows, pole)
    assert ((polar[:, 0] >= 0) & (polar[:, 0] <= 1)).all()
    np.testing.assert_allclose(polar_to_uv(polar, rows, pole), points, atol=1e-8)
    pixels = polar_to_pixel(polar, 301, pole)
    np.testing.assert_allclose(pixel_to_polar(pixels, 301, pole), polar, atol=1e-9)


@pytest.mark.parametrize("pole", POLES)
def test_no_polar_view_is_mirrored(pole: str) -> None:
    """Right and down in the view and outward in space are handed as seen from outside."""
    size, rows = 65, 64
    pixels = np.array([[28.0, 40.0], [28.0, 40.5], [28.5, 40.0], [50.0, 20.0]])
    z, y, x = uv_to_direction(polar_to_uv(pixel_to_polar(pixels, size, pole), rows, pole), rows).T
    here, right, down, _ = np.stack([x, y, z], axis=1)
    # Looking at it from outside, right × down points away from the eye, that is inwards.
    assert np.dot(np.cross(right - here, down - here), here) < 0


@pytest.mark.parametrize("pole", POLES)
def test_the_polar_view_of_smooth_functions(pole: str) -> None:
    """Each coordinate of the sphere, known at every pixel of the view."""
    rows, size = 64, 101
    view = to_polar(unit_vectors(rows), pole, size)
    assert view.shape == (101, 101, 3)
    polar = pixel_to_polar(np.indices((size, size)).reshape(2, -1).T, size, pole)
    inside = polar[:, 0] <= 1
    expected = uv_to_direction(polar_to_uv(polar[inside], rows, pole), rows)
    np.testing.assert_allclose(view.reshape(-1, 3)[inside], expected, atol=2e-3)
    assert np.isnan(view.reshape(-1, 3)[~inside]).all()
    assert view[50, 50, 0] == pytest.approx(1 if pole == "north" else -1, abs=2e-3)


def test_labels_stay_labels_in_the_polar_view() -> None:
    labels = chessboard(32, 4)
    view = to_polar(labels, "south", kind="label")
    assert view.shape == (64, 64)
    assert view.dtype == labels.dtype
    assert set(np.unique(view)) == {0, 1, 2}
    assert view[0, 0] == 0
    # Rings: the outermost is the first row of tiles, at the other pole.
    pixels = np.rint(
        polar_to_pixel(uv_to_polar([[1.0, 3.0], [30.0, 9.0]], 32, "south"), 64, "south")
    )
    found = view[tuple(pixels.astype(int).T)]
    np.testing.assert_array_equal(found, [labels[1, 3], labels[30, 9]])


def test_wrong_polar_arguments_are_named() -> None:
    with pytest.raises(ParameterError, match="'east'"):
        to_polar(image(), "east")
    with pytest.raises(ParameterError, match="size = 0"):
        to_polar(image(), size=0)
    with pytest.raises(ParameterError, match="'image'"):
        to_polar(image(), kind="image")
    with pytest.raises(AxesError, match="two coordinates"):
        uv_to_polar(np.zeros((4, 3)), 32)


# Chessboard ----------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "tiles"), [(16, 4), (32, 5), (8, 8), (12, 1)])
def test_tiles_alternate_also_over_the_seam(rows: int, tiles: int) -> None:
    board = chessboard(rows, tiles)
    assert board.shape == (rows, 2 * rows)
    assert set(np.unique(board)) == {1, 2}
    assert (board[:, 0] != board[:, -1]).all()
    changes = (np.diff(board[0].astype(int)) != 0).sum() + 1
    assert changes == 2 * tiles
    assert (np.diff(board[:, 0].astype(int)) != 0).sum() + 1 == tiles


def test_tiles_are_square_on_the_image() -> None:
    board = chessboard(32, 4)
    for v in range(0, 32, 8):
        for u in range(0, 64, 8):
            assert len(np.unique(board[v : v + 8, u : u + 8])) == 1


@pytest.mark.parametrize("tiles", [0, 33])
def test_a_board_has_tiles_of_at_least_a_pixel(tiles: int) -> None:
    with pytest.raises(ParameterError, match="tiles"):
        chessboard(32, tiles)


def test_the_board_is_carried_to_the_cell(small_atlas: Atlas) -> None:
    rows = small_atlas.uv.shape[0]
    board = chessboard(rows, 4)
    for chart in ("reference", "surface"):
        carried = small_atlas.carry(board, "uv", chart, kind="label")
        pixels, valid = small_atlas.map(getattr(small_atlas, chart).vertices, chart, "uv")
        column = np.floor(pixels[valid, 1] + 0.5).astype(int) % (2 * rows)
        row = np.clip(np.floor(pixels[valid, 0] + 0.5).astype(int), 0, rows - 1)
        assert (carried[valid] == board[row, column]).mean() > 0.99
        assert 0.4 < (carried == 1).mean() < 0.6
