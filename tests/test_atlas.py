"""Maps between any two charts, there and back."""

import dataclasses

import numpy as np
import pytest

from napari_unwrap3d.atlas import COORDINATES, REQUESTED, Atlas
from napari_unwrap3d.errors import AxesError, ChartMissingError
from napari_unwrap3d.geometry.locate import interpolate
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import QUICK, VOXEL_UM, cell_centre, directions

VOLUME_LIKE = ("surface", "volume", "topography")


def on_mesh(mesh, count: int = 2000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    face = rng.integers(0, len(mesh.faces), count)
    return interpolate(mesh.vertices, mesh.faces, face, rng.dirichlet([1, 1, 1], count))


def points_of(atlas: Atlas, chart: str, count: int = 2000) -> np.ndarray:
    rng = np.random.default_rng(1)
    rows = atlas.uv.shape[0]
    if chart == "surface":
        return on_mesh(atlas.surface, count)
    if chart == "reference":
        return on_mesh(atlas.reference, count)
    if chart == "sphere":
        return directions(count)
    high = [rows - 0.5, 2 * rows - 0.5]
    pixels = rng.uniform([-0.5, -0.5], high, (count, 2))
    if chart == "uv":
        return pixels
    topographic = np.column_stack([rng.uniform(-0.8, atlas.topography.d_um[-1], count), pixels])
    if chart == "topography":
        return topographic
    return atlas.map(topographic, "topography", "volume")[0]


def distance(atlas: Atlas, chart: str, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """In voxels of the working grid, about, whatever the chart."""
    rows = atlas.uv.shape[0]
    if chart in ("uv", "topography"):
        turned = uv_to_direction(first[:, -2:], rows) - uv_to_direction(second[:, -2:], rows)
        apart = 20 * np.linalg.norm(turned, axis=1)
        if chart == "topography":
            apart += np.abs(first[:, 0] - second[:, 0]) / VOXEL_UM
        return apart
    scale = 20.0 if chart == "sphere" else 1 / VOXEL_UM
    return scale * np.linalg.norm(first - second, axis=1)


ROUND_TRIPS = [
    ("surface", "topography", 0.01),
    ("surface", "volume", 0.01),
    ("volume", "topography", 0.01),
    ("topography", "volume", 0.01),
    ("reference", "sphere", 1e-9),
    ("reference", "uv", 1e-9),
    ("sphere", "reference", 1e-5),
    ("sphere", "uv", 1e-9),
    ("uv", "sphere", 1e-9),
    ("uv", "reference", 1e-5),
    ("uv", "topography", 1e-9),
    ("uv", "surface", 0.02),
    ("sphere", "surface", 0.02),
    ("reference", "surface", 0.02),
]


@pytest.mark.parametrize(("source", "target", "tolerance"), ROUND_TRIPS)
def test_there_and_back(small_atlas: Atlas, source: str, target: str, tolerance: float) -> None:
    points = points_of(small_atlas, source)
    there, valid = small_atlas.map(points, source, target)
    assert valid.mean() > 0.999
    back, found = small_atlas.map(there[valid], target, source)
    assert found.mean() > 0.999
    miss = distance(small_atlas, source, points[valid][found], back[found])
    assert np.quantile(miss, 0.999) <= tolerance


def test_reference_to_uv_and_back_is_exact_for_every_one_of_many_points(
    small_atlas: Atlas,
) -> None:
    points = on_mesh(small_atlas.reference, 100_000)
    there, valid = small_atlas.map(points, "reference", "uv")
    back, found = small_atlas.map(there, "uv", "reference")
    assert valid.all()
    assert found.all()
    assert np.linalg.norm(back - points, axis=1).max() <= 1e-9 * VOXEL_UM


@pytest.mark.parametrize("source", COORDINATES)
@pytest.mark.parametrize("target", COORDINATES)
def test_any_chart_to_any_chart(handle_atlas: Atlas, source: str, target: str) -> None:
    points = points_of(handle_atlas, source, 300)
    before = points.copy()
    mapped, valid = handle_atlas.map(points, source, target)
    np.testing.assert_array_equal(points, before)
    assert mapped.shape == (300, COORDINATES[target])
    assert valid.dtype == bool
    assert np.isfinite(mapped[valid]).all()
    assert np.isnan(mapped[~valid]).all()
    if (source, target) not in {("volume", "surface"), ("topography", "surface")}:
        assert valid.mean() > 0.99
    if source == target:
        np.testing.assert_array_equal(mapped, points)


@pytest.mark.parametrize("way", [("uv", "sphere", "reference"), ("volume", "topography", "uv")])
def test_maps_compose(small_atlas: Atlas, way: tuple[str, str, str]) -> None:
    first, middle, last = way
    points = points_of(small_atlas, first, 500)
    direct, valid = small_atlas.map(points, first, last)
    halfway, good = small_atlas.map(points, first, middle)
    composed, rest = small_atlas.map(halfway[good], middle, last)
    np.testing.assert_array_equal(valid[good], rest)
    np.testing.assert_allclose(direct[good], composed, atol=1e-9)


def test_pixels_are_mapped_to_the_positions_of_the_chart(small_atlas: Atlas) -> None:
    rows = small_atlas.uv.shape[0]
    mapped, valid = small_atlas.map(pixel_grid(rows).reshape(-1, 2), "uv", "reference")
    assert valid.all()
    np.testing.assert_allclose(mapped, small_atlas.uv.positions.reshape(-1, 3), atol=1e-9)


def test_vertices_are_mapped_to_the_vertices_of_the_sphere(small_atlas: Atlas) -> None:
    mapped, _ = small_atlas.map(small_atlas.reference.vertices, "reference", "sphere")
    np.testing.assert_allclose(mapped, small_atlas.sphere.vertices, atol=1e-7)


def test_uv_to_topography_is_the_reference_itself(small_atlas: Atlas) -> None:
    points = points_of(small_atlas, "uv", 200)
    mapped, _ = small_atlas.map(points, "uv", "topography")
    np.testing.assert_array_equal(mapped[:, 0], 0.0)
    in_space, _ = small_atlas.map(mapped, "topography", "volume")
    reference, _ = small_atlas.map(points, "uv", "reference")
    # Between pixels the space is trilinear and the reference a mesh.
    assert np.linalg.norm(in_space - reference, axis=1).max() < 0.5 * VOXEL_UM


def test_coordinates_beyond_the_image_are_wrapped(small_atlas: Atlas) -> None:
    rows = small_atlas.uv.shape[0]
    points = points_of(small_atlas, "uv", 200)
    around, _ = small_atlas.map(points + np.array([0, 2 * rows]), "uv", "reference")
    mirrored = np.column_stack([-1 - points[:, 0], points[:, 1] + rows])
    over, _ = small_atlas.map(mirrored, "uv", "sphere")
    plain, _ = small_atlas.map(points, "uv", "reference")
    sphere, _ = small_atlas.map(points, "uv", "sphere")
    np.testing.assert_allclose(around, plain, atol=1e-9)
    np.testing.assert_allclose(over, sphere, atol=1e-9)


def test_uv_to_surface_lands_on_the_surface(small_atlas: Atlas) -> None:
    points = points_of(small_atlas, "uv")
    mapped, valid = small_atlas.map(points, "uv", "surface")
    assert valid.all()
    again, on_surface = small_atlas.map(mapped, "volume", "surface")
    assert on_surface.all()
    _, _, apart = small_atlas._surface_locator.closest(again)
    assert apart.max() < 1e-6


def test_points_away_from_the_surface_have_no_image_on_it(small_atlas: Atlas) -> None:
    vertices = small_atlas.surface.vertices[::10]
    out = vertices - cell_centre()
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    _, near = small_atlas.map(vertices + 0.3 * VOXEL_UM * out, "volume", "surface")
    assert near.all()
    mapped, far = small_atlas.map(cell_centre() + 5.0 * out, "volume", "surface")
    assert not far.any()
    assert np.isnan(mapped).all()


def test_points_outside_of_the_shell_are_flagged(small_atlas: Atlas) -> None:
    outside = np.array([[100.0, 100, 100], cell_centre(), [np.nan, 0, 0], [np.inf, 0, 0]])
    for target in ("topography", "uv", "sphere", "reference"):
        mapped, valid = small_atlas.map(outside, "volume", target)
        assert valid.tolist() == [False] * 4
        assert np.isnan(mapped).all()
    deep = np.array([[small_atlas.topography.d_um[0] - 1, 20, 20], [99.0, 20, 20]])
    assert not small_atlas.map(deep, "topography", "volume")[1].any()


def test_one_bad_point_does_not_disturb_the_others(small_atlas: Atlas) -> None:
    points = points_of(small_atlas, "reference", 50)
    broken = points.copy()
    broken[7] = np.nan
    mapped, valid = small_atlas.map(broken, "reference", "uv")
    plain, _ = small_atlas.map(points, "reference", "uv")
    others = np.arange(50) != 7
    np.testing.assert_array_equal(valid, others)
    np.testing.assert_array_equal(mapped[others], plain[others])


def test_no_points_give_no_points(small_atlas: Atlas) -> None:
    for source, k in COORDINATES.items():
        for target, width in COORDINATES.items():
            mapped, valid = small_atlas.map(np.zeros((0, k)), source, target)
            assert mapped.shape == (0, width)
            assert valid.shape == (0,)


@pytest.mark.parametrize(
    ("points", "source"),
    [
        (np.zeros((5, 2)), "surface"),
        (np.zeros((5, 3)), "uv"),
        (np.zeros(3), "volume"),
        (np.zeros((2, 3, 3)), "topography"),
        (3.0, "sphere"),
    ],
)
def test_wrong_shapes_are_an_error(small_atlas: Atlas, points: object, source: str) -> None:
    with pytest.raises(AxesError, match=f"{source} have {COORDINATES[source]}") as caught:
        small_atlas.map(points, source, "reference")
    assert "shape" in caught.value.measured


@pytest.mark.parametrize("wrong", ["UV", "plain", ""])
def test_unknown_charts_are_an_error(small_atlas: Atlas, wrong: str) -> None:
    with pytest.raises(ChartMissingError, match="topography, uv"):
        small_atlas.map(np.zeros((1, 3)), wrong, "uv")
    with pytest.raises(ChartMissingError, match="Charts"):
        small_atlas.map(np.zeros((1, 3)), "volume", wrong)


def test_charts_that_were_not_computed_are_an_error(small_pipeline: Pipeline) -> None:
    part = small_pipeline.run(QUICK, until="sphere")
    assert part.has("sphere")
    assert not part.has("uv")
    with pytest.raises(ChartMissingError, match="step 'uv'"):
        _ = part.uv
    with pytest.raises(ChartMissingError, match="topography"):
        part.map(np.zeros((1, 3)), "volume", "uv")
    mapped, valid = part.map(part.reference.vertices[:5], "reference", "sphere")
    assert valid.all()
    np.testing.assert_allclose(mapped, part.sphere.vertices[:5], atol=1e-7)


def test_an_atlas_is_frozen_and_knows_its_voxel(small_atlas: Atlas) -> None:
    assert small_atlas.voxel_um == VOXEL_UM
    with pytest.raises(dataclasses.FrozenInstanceError):
        small_atlas.uv = None


def test_the_map_is_continuous_over_the_seam_and_the_poles(small_atlas: Atlas) -> None:
    """Neighbours on the surface are neighbours on the sphere, all the way round."""
    rows = small_atlas.uv.shape[0]
    for v in (0.0, 10.0, 31.5, rows - 1.0):
        ring = np.column_stack([np.full(1000, v), np.linspace(-0.5, 2 * rows - 0.5, 1000)])
        mapped, _ = small_atlas.map(ring, "uv", "reference")
        step = np.linalg.norm(np.diff(np.concatenate([mapped, mapped[:1]]), axis=0), axis=1)
        assert step.max() < 0.5 * VOXEL_UM
    meridian = np.column_stack([np.linspace(-3, rows + 2, 2000), np.full(2000, 20.0)])
    mapped, _ = small_atlas.map(meridian, "uv", "reference")
    assert np.linalg.norm(np.diff(mapped, axis=0), axis=1).max() < 0.5 * VOXEL_UM


# The plane, which is computed on request ---------------------------------------------


def test_charts_on_request_are_computed_when_first_read(small_pipeline: Pipeline) -> None:
    atlas = small_pipeline.run(QUICK)
    assert not atlas.has("plane")
    copy = dataclasses.replace(atlas, mask=atlas.mask)
    _, valid = atlas.map(atlas.surface.vertices[:5], "surface", "plane")
    assert valid.all()
    assert atlas.has("plane")
    assert atlas.quality["plane"]["certified"]
    assert not copy.has("plane")
    part = small_pipeline.run(QUICK, until="uv")
    for name in REQUESTED:
        with pytest.raises(ChartMissingError, match=name):
            getattr(part, name)


def test_plane_and_surface_are_one_to_one(plane_atlas: Atlas) -> None:
    points = on_mesh(plane_atlas.surface)
    there, valid = plane_atlas.map(points, "surface", "plane")
    assert valid.all()
    back, found = plane_atlas.map(there, "plane", "surface")
    assert found.all()
    assert np.linalg.norm(back - points, axis=1).max() < 1e-6 * VOXEL_UM
    rows = plane_atlas.plane.shape[0]
    pixels = np.random.default_rng(3).uniform(-0.5, [rows - 0.5, 2 * rows - 0.5], (2000, 2))
    on_surface, valid = plane_atlas.map(pixels, "plane", "surface")
    assert valid.all()
    again, _ = plane_atlas.map(on_surface, "surface", "plane")
    assert np.quantile(distance(plane_atlas, "uv", pixels, again), 0.999) < 1e-6


def test_vertices_are_mapped_to_the_vertices_of_the_plane(plane_atlas: Atlas) -> None:
    mapped, valid = plane_atlas.map(plane_atlas.surface.vertices, "surface", "plane")
    assert valid.all()
    columns = plane_atlas.plane.shape[1]
    miss = np.abs(mapped - plane_atlas.plane.vertices) % columns
    assert np.minimum(miss, columns - miss).max() < 1e-9


@pytest.mark.parametrize("other", COORDINATES)
def test_any_chart_to_the_plane_and_back(plane_handle_atlas: Atlas, other: str) -> None:
    atlas = plane_handle_atlas
    if other in ("volume", "topography"):
        points = atlas.map(on_mesh(atlas.surface, 300), "surface", other)[0]
    else:
        points = points_of(atlas, other, 300)
    there, valid = atlas.map(points, other, "plane")
    assert there.shape == (300, 2)
    assert valid.mean() > 0.98
    back, found = atlas.map(there[valid], "plane", other)
    assert back.shape == (valid.sum(), COORDINATES[other])
    assert found.mean() > 0.98
    miss = distance(atlas, other, points[valid][found], back[found])
    assert np.quantile(miss, 0.98) < 0.5


def test_what_was_sealed_has_no_image_on_the_surface(plane_handle_atlas: Atlas) -> None:
    """Pixels over a membrane, farther than a voxel from the surface."""
    atlas = plane_handle_atlas
    rows = atlas.plane.shape[0]
    pixels = pixel_grid(rows).reshape(-1, 2)
    mapped, valid = atlas.map(pixels, "plane", "surface")
    assert np.isnan(mapped[~valid]).all()
    _, _, apart = atlas._surface_locator.closest(atlas.plane.positions.reshape(-1, 3))
    np.testing.assert_array_equal(valid, apart <= VOXEL_UM)
    assert valid.mean() > 0.95
    np.testing.assert_allclose(
        mapped[valid], atlas.plane.positions.reshape(-1, 3)[valid], atol=1e-9
    )


def test_a_refused_plane_says_why(small_atlas: Atlas) -> None:
    quality = {"plane": {"certified": False, "reason": "Faces are flipped.", "hint": "Use direct."}}
    refused = dataclasses.replace(small_atlas, quality=quality, on_request={})
    assert not refused.has("plane")
    with pytest.raises(ChartMissingError, match="refused: Faces are flipped") as caught:
        refused.map(np.zeros((1, 2)), "plane", "surface")
    assert caught.value.hint == "Use direct."
