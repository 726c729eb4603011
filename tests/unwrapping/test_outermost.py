"""From a pixel out to what lies outermost over it, also under an overhang."""

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.geometry.interpolate import sample_linear
from napari_unwrap3d.geometry.locate import interpolate
from napari_unwrap3d.unwrapping.topography import topography_to_world
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import BUMPS, VOXEL_UM, cell_centre


def pixels(atlas: Atlas, count: int = 3000) -> np.ndarray:
    rows = atlas.uv.shape[0]
    return np.random.default_rng(0).uniform(-0.5, [rows - 0.5, 2 * rows - 0.5], (count, 2))


@pytest.mark.parametrize("name", ["small_atlas", "handle_atlas"])
def test_the_crossing_lies_on_the_surface_and_on_the_streamline(
    name: str, request: pytest.FixtureRequest
) -> None:
    atlas: Atlas = request.getfixturevalue(name)
    points = pixels(atlas)
    face, weights, valid = atlas.outermost.locate(points)
    assert valid.all()
    place = interpolate(atlas.surface.vertices, atlas.surface.faces, face, weights)
    image, mapped = atlas.map(place, "volume", "topography")
    assert mapped.all()
    rows = atlas.uv.shape[0]
    turned = uv_to_direction(image[:, 1:], rows) - uv_to_direction(points, rows)
    assert np.linalg.norm(turned, axis=1).max() < 1e-3


def columns(atlas: Atlas) -> np.ndarray:
    """The smoothed mask (layers, rows, columns) in steps of a quarter of a layer."""
    from scipy import ndimage

    chart = atlas.topography
    d = np.arange(chart.d_um[0], chart.d_um[-1], 0.25 * (chart.d_um[1] - chart.d_um[0]))
    pixel = pixel_grid(chart.shape[1]).reshape(-1, 2)
    smooth = ndimage.gaussian_filter(atlas.mask.data.astype(np.float32), 1.0)
    inside = []
    for height in d:
        world, valid = topography_to_world(
            chart, np.column_stack([np.full(len(pixel), height), pixel])
        )
        values = sample_linear(smooth, atlas.mask.to_index(np.where(valid[:, None], world, 0.0)))
        inside.append(np.where(valid, values, 1.0) > 0.5)
    return np.array(inside), d


def test_nothing_of_the_cell_lies_farther_out(small_atlas: Atlas) -> None:
    """Against walking down every column of the mask; some columns enter the cell twice."""
    inside, d = columns(small_atlas)
    crossings = (inside[:-1] & ~inside[1:]).sum(axis=0)
    assert (crossings >= 2).sum() > 10, "the cell has an overhang"
    highest = d[len(d) - 1 - np.argmax(inside[::-1], axis=0)]
    rows = small_atlas.uv.shape[0]
    surface, valid = small_atlas.map(pixel_grid(rows).reshape(-1, 2), "uv", "surface")
    assert valid.all()
    image, _ = small_atlas.map(surface, "surface", "topography")
    assert np.quantile(np.abs(image[:, 0] - highest), 0.99) < 0.5 * VOXEL_UM
    # Under the overhang the lower crossings are several voxels below; none is taken, but for
    # columns that graze its edge, which the mesh and the mask see apart.
    twice = crossings >= 2
    assert (image[twice, 0] > highest[twice] - 1.0 * VOXEL_UM).mean() > 0.95


def test_the_image_of_heights_is_that_of_the_crossings(small_atlas: Atlas) -> None:
    rows = small_atlas.uv.shape[0]
    surface, _ = small_atlas.map(pixel_grid(rows).reshape(-1, 2), "uv", "surface")
    d = small_atlas.map(surface, "surface", "topography")[0][:, 0].reshape(rows, 2 * rows)
    height = small_atlas.topography.fields["height_um"]
    seen = np.isfinite(height)
    assert seen.mean() > 0.95
    assert np.quantile(np.abs(height - d)[seen], 0.98) < 0.1 * VOXEL_UM
    highest = np.nanmax(small_atlas.surface.fields["height_um"])
    assert np.nanmax(height) == pytest.approx(highest, abs=VOXEL_UM)


def test_the_image_has_a_value_at_every_pixel(small_atlas: Atlas) -> None:
    """Also in the first and the last row, whose faces hold a pole."""
    assert np.isfinite(small_atlas.topography.fields["height_um"]).all()
    assert np.isfinite(small_atlas.uv.fields["surface_height_um"]).all()
    assert np.isfinite(small_atlas.uv.fields["surface_mean_curvature_per_um"]).all()


def test_a_field_of_the_surface_is_seen_from_outside(small_atlas: Atlas) -> None:
    constant = small_atlas.outermost.image(np.full(len(small_atlas.surface.vertices), 4.0))
    np.testing.assert_allclose(constant[np.isfinite(constant)], 4.0)
    z = small_atlas.outermost.image(small_atlas.surface.vertices[:, 0])
    rows = small_atlas.uv.shape[0]
    expected, _ = small_atlas.map(pixel_grid(rows).reshape(-1, 2), "uv", "surface")
    difference = np.abs(z - expected[:, 0].reshape(z.shape))
    assert np.nanquantile(difference, 0.98) < 0.2 * VOXEL_UM


def test_over_the_mushroom_the_cap_is_met(small_atlas: Atlas) -> None:
    axis = np.array(BUMPS[3][0]) / np.linalg.norm(BUMPS[3][0])
    centre = cell_centre()
    cap = centre + (27.0 + 6.0) * VOXEL_UM * axis
    under = centre + 16.0 * VOXEL_UM * axis
    for point in (cap, under):
        pixel, valid = small_atlas.map(point[None], "volume", "uv")
        assert valid.all()
        met, valid = small_atlas.map(pixel, "uv", "surface")
        assert valid.all()
        assert (met[0] - centre) @ axis / VOXEL_UM > 27
