"""Steps 5 and 6: the (d, u, v) space over a sphere and over the small cell."""

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Mask, Volume
from napari_unwrap3d.geometry.curvilinear import count_folded
from napari_unwrap3d.geometry.mesh import (
    connected_components,
    euler_characteristic,
    is_watertight,
    signed_volume,
)
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import Pipeline, unwrap
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.topography import (
    TopographyLocator,
    sample_volume,
    topography_to_world,
)
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import QUICK, VOXEL_UM, ball, cell_centre, directions, torus

RADIUS = 13.0


@pytest.fixture(scope="module")
def round_cell() -> Atlas:
    """A ball, whose topography is flat."""
    rows = QUICK.model_copy(update={"uv": QUICK.uv.model_copy(update={"rows": 48})})
    return unwrap(Mask(ball(RADIUS, 41), (VOXEL_UM,) * 3), rows)


CENTRE = 20 * VOXEL_UM


def test_a_ball_is_flat(round_cell: Atlas) -> None:
    d = round_cell.topography.surface[:, 0] / VOXEL_UM
    assert np.isfinite(d).all()
    assert np.abs(d - d.mean()).max() < 0.6
    assert abs(d.mean()) < 0.4


def test_d_is_the_distance_from_the_reference_along_the_radius(round_cell: Atlas) -> None:
    reference = np.linalg.norm(round_cell.reference.vertices - CENTRE, axis=1).mean()
    for height in (-5.0, -2.0, 1.5):
        points = CENTRE + (reference + height * VOXEL_UM) * directions(300)
        image, valid = round_cell.map(points, "volume", "topography")
        assert valid.all()
        assert image[:, 0].mean() / VOXEL_UM == pytest.approx(height, abs=0.05)
        assert np.abs(image[:, 0] / VOXEL_UM - height).max() < 0.8


def test_the_mapped_mask_has_the_volume_of_the_cell(round_cell: Atlas) -> None:
    """Each node stands for the volume of its cell, in the spherical shell it lies in."""
    chart = round_cell.topography
    rows = chart.shape[1]
    radius = np.linalg.norm(chart.positions - CENTRE, axis=-1).mean(axis=(1, 2))
    sine = np.sin((np.arange(rows) + 0.5) * np.pi / rows)
    share = np.broadcast_to((sine / sine.sum() / (2 * rows))[:, None], (rows, 2 * rows))
    inside = (chart.mask * share).sum(axis=(1, 2))
    full = chart.first_layer.max()
    step = chart.d_um[1] - chart.d_um[0]
    shell = (4 * np.pi * radius**2 * step * inside)[full:].sum()
    core = 4 / 3 * np.pi * (radius[full] - 0.5 * step) ** 3
    expected = ball(RADIUS, 41).sum() * VOXEL_UM**3
    assert shell + core == pytest.approx(expected, rel=0.03)


def test_layers_are_the_steps_of_the_parameter_apart(round_cell: Atlas) -> None:
    chart = round_cell.topography
    np.testing.assert_allclose(np.diff(chart.d_um), 0.5 * VOXEL_UM)
    zero = int(np.argmin(np.abs(chart.d_um)))
    assert chart.d_um[zero] == 0.0
    # In space, too: along a column from node to node.
    step = np.linalg.norm(np.diff(chart.nodes[zero - 8 :], axis=0), axis=-1)
    np.testing.assert_allclose(step, 0.5 * VOXEL_UM, rtol=0.01)
    # The layer d = 0 is the reference.
    np.testing.assert_allclose(chart.positions[zero], round_cell.uv.positions, atol=1e-5)


def test_the_whole_surface_is_inside_of_the_space(small_atlas: Atlas) -> None:
    chart, quality = small_atlas.topography, small_atlas.quality["topography"]
    assert np.isfinite(chart.surface).all()
    assert quality["unmapped_fraction"] == 0.0
    d = chart.surface[:, 0]
    assert d.max() < chart.d_um[-1] - VOXEL_UM
    assert d.min() > chart.d_um[0] + VOXEL_UM
    assert not chart.mask[-1].any()


@pytest.mark.parametrize("name", ["small_atlas", "handle_atlas"])
def test_no_cell_is_folded_and_every_vertex_comes_back(
    name: str, request: pytest.FixtureRequest
) -> None:
    atlas: Atlas = request.getfixturevalue(name)
    chart = atlas.topography
    assert chart.folded_cells == 0
    assert count_folded(chart.nodes, chart.first_layer)[0] == 0
    back, valid = topography_to_world(chart, chart.surface)
    assert valid.all()
    miss = np.linalg.norm(back - atlas.surface.vertices, axis=1) / VOXEL_UM
    assert miss.max() < 0.01
    assert atlas.quality["topography"]["round_trip_max_voxels"] == pytest.approx(miss.max())


def test_the_jacobian_is_positive_in_the_direction_of_the_definition(small_atlas: Atlas) -> None:
    """(∂d, ∂u, ∂v) as stored (z, y, x) is right-handed at the reference."""
    chart = small_atlas.topography
    zero = int(np.argmin(np.abs(chart.d_um)))
    p = chart.positions.astype(float)
    d = (p[zero + 1] - p[zero])[1:-1, 1:-1]
    u = (p[zero, :, 2:] - p[zero, :, :-2])[1:-1]
    v = (p[zero, 2:] - p[zero, :-2])[:, 1:-1]
    assert (np.einsum("ijk,ijk->ij", d, np.cross(u, v)) > 0).all()


def test_the_poles_are_single_streamlines(small_atlas: Atlas) -> None:
    nodes = small_atlas.topography.nodes
    for row in (0, -1):
        assert np.ptp(nodes[:, row], axis=1).max() == 0.0
    distance = np.linalg.norm(nodes[:, 1] - nodes[:, 0], axis=-1)
    assert 0 < distance.max() < 10 * VOXEL_UM


def test_points_of_the_shell_come_back_also_at_seam_and_poles(small_atlas: Atlas) -> None:
    chart = small_atlas.topography
    rows = chart.shape[1]
    rng = np.random.default_rng(0)
    low, high = [-1.0, -0.5, -0.5], [chart.d_um[-1], rows - 0.5, 2 * rows - 0.5]
    points = rng.uniform(low, high, (4000, 3))
    points[:500, 2] = rng.uniform(-0.5, 0.5, 500)
    points[500:1000, 1] = rng.uniform(-0.5, 0, 500)
    points[1000:1500, 1] = rows - 0.5 - rng.uniform(0, 0.5, 500) ** 2
    world, valid = topography_to_world(chart, points)
    points, world = points[valid], world[valid]
    assert valid.mean() > 0.95
    image, found = TopographyLocator(chart.nodes, chart.d_um, VOXEL_UM).locate(world, silent())
    # Next to a pole, where columns run together, one point in about ten thousand is missed.
    assert found.mean() >= 0.9995
    points, image = points[found], image[found]
    back, _ = topography_to_world(chart, image)
    assert np.linalg.norm(back - world[found], axis=1).max() < 1e-2 * VOXEL_UM
    np.testing.assert_allclose(image[:, 0], points[:, 0], atol=1e-2 * VOXEL_UM)
    turned = uv_to_direction(image[:, 1:], rows) - uv_to_direction(points[:, 1:], rows)
    assert np.linalg.norm(turned, axis=1).max() < 0.01


def test_outside_of_the_space_there_is_no_image(small_atlas: Atlas) -> None:
    chart = small_atlas.topography
    outside = np.array([[chart.d_um[-1] + 0.2, 20, 20], [chart.d_um[0] - 0.2, 20, 20]])
    world, valid = topography_to_world(chart, outside)
    assert not valid.any()
    assert np.isnan(world).all()
    locator = TopographyLocator(chart.nodes, chart.d_um, VOXEL_UM)
    low, high = small_atlas.mask.to_world([[-30, -30, -30], [100, 100, 100]])
    image, found = locator.locate(np.array([low, high]), silent())
    assert not found.any()
    assert np.isnan(image).all()
    nothing, found = locator.locate(np.zeros((0, 3)), silent())
    assert nothing.shape == (0, 3)
    assert found.shape == (0,)


def test_a_column_below_its_end_has_no_image(small_pipeline: Pipeline) -> None:
    deep = with_topography(depth_um=4.0)
    chart = Pipeline(small_pipeline.source, dict(small_pipeline.kept)).run(deep).topography
    assert chart.first_layer.min() > 0
    row, column = 20, 30
    end = chart.d_um[chart.first_layer[row + 1, column]]
    points = np.array([[end + 0.01, row, column], [end - 0.1, row, column]])
    _, valid = topography_to_world(chart, points)
    assert valid.tolist() == [True, False]
    assert chart.folded_cells == 0


def with_topography(**changes: float) -> Parameters:
    return QUICK.model_copy(update={"topography": QUICK.topography.model_copy(update=changes)})


def test_depth_step_and_margin_are_parameters(small_pipeline: Pipeline) -> None:
    pipeline = Pipeline(small_pipeline.source, dict(small_pipeline.kept))
    default = small_pipeline.run(QUICK).topography
    assert -default.d_um[0] >= 1.0  # at least as deep as the surface goes
    deeper = pipeline.run(with_topography(depth_um=1.27)).topography
    assert -deeper.d_um[0] == pytest.approx(1.3)  # whole steps of 0.05 µm
    assert deeper.d_um[-1] == default.d_um[-1]
    coarse = pipeline.run(with_topography(step_voxels=1.0, margin_voxels=6.0)).topography
    np.testing.assert_allclose(np.diff(coarse.d_um), VOXEL_UM)
    assert coarse.d_um[-1] - default.d_um[-1] == pytest.approx(4 * VOXEL_UM, abs=VOXEL_UM)


@pytest.mark.parametrize("name", ["small_atlas", "handle_atlas"])
def test_the_topographic_surface_is_closed_and_close_to_the_cell(
    name: str, request: pytest.FixtureRequest
) -> None:
    atlas: Atlas = request.getfixturevalue(name)
    chart, quality = atlas.topography, atlas.quality["topography"]
    vertices, faces = chart.meshed_vertices, chart.meshed_faces
    assert is_watertight(faces)
    assert connected_components(faces)[0].max() == 0
    assert euler_characteristic(faces) == 2 - 2 * atlas.surface.report["genus"]
    volume = signed_volume(atlas.surface.vertices, atlas.surface.faces)
    assert signed_volume(vertices, faces) == pytest.approx(volume, rel=0.02)
    assert abs(quality["area_difference"]) < 0.04
    assert quality["chamfer_voxels"] < 1.0


def test_heights_are_where_the_bumps_are(small_atlas: Atlas) -> None:
    """The tip of every bump is higher than the cortex around."""
    centre = cell_centre()
    distance = np.linalg.norm(small_atlas.surface.vertices - centre, axis=1) / VOXEL_UM
    height = small_atlas.surface.fields["height_um"] / VOXEL_UM
    assert np.corrcoef(distance, height)[0, 1] > 0.8
    assert height[distance > 26].min() > height[distance < 18].max()
    np.testing.assert_array_equal(
        small_atlas.surface.fields["height_um"], small_atlas.topography.surface[:, 0]
    )


def test_volumes_are_sampled_where_the_nodes_are() -> None:
    z, y, x = np.indices((20, 21, 22)).astype(np.float32)
    volume = Volume(z - 2 * y + 3 * x, (0.3, 0.1, 0.2), (5.0, -1.0, 2.0))
    index = np.random.default_rng(0).uniform(0, 19, (3, 4, 5, 3))
    nodes = volume.to_world(index).astype(np.float32)
    expected = index @ [1, -2, 3]
    np.testing.assert_allclose(sample_volume(volume, nodes), expected, atol=1e-3)


def test_a_cell_far_from_the_origin_is_mapped_as_well(round_cell: Atlas) -> None:
    """Stage positions are thousands of µm; nodes are stored in single precision."""
    far = Mask(round_cell.mask.data, (VOXEL_UM,) * 3, (3000.0, -8000.0, 5000.0))
    atlas = unwrap(far, round_cell.parameters)
    near, there = round_cell.quality["topography"], atlas.quality["topography"]
    assert there["folded_cells"] == 0
    assert there["unmapped_fraction"] == 0
    assert there["round_trip_max_voxels"] < 0.01
    assert there["meshed_volume_um3"] == pytest.approx(near["meshed_volume_um3"], rel=1e-3)


def test_a_flat_ring_does_not_fold() -> None:
    """Its reference is flat: the normals meet in the middle before they are at the depth."""
    mask = Mask(torus(18, 7, (30, 66, 66)), (VOXEL_UM,) * 3)
    atlas = unwrap(
        mask, Parameters.from_dict({"uv": {"rows": 64}, "reference": {"vertices": 8000}})
    )
    chart, quality = atlas.topography, atlas.quality["topography"]
    assert atlas.surface.report["genus"] == 1
    assert count_folded(chart.nodes, chart.first_layer, chart.last_layer)[0] == 0
    assert quality["folded_fraction"] < 1e-3
    assert quality["unmapped_fraction"] < 5e-3
    assert quality["round_trip_max_voxels"] < 0.01
    # A pole is one streamline, and ends in one layer.
    for row in (0, -1):
        assert np.ptp(chart.nodes[:, row], axis=1).max() == 0
        assert np.ptp(chart.first_layer[row]) == np.ptp(chart.last_layer[row]) == 0
    # Over the hole there may be nothing outside; what is found lies on the right column.
    rows = atlas.uv.shape[0]
    pixels = pixel_grid(rows).reshape(-1, 2)
    surface, valid = atlas.map(pixels, "uv", "surface")
    image, found = atlas.map(surface[valid], "surface", "uv")
    turned = uv_to_direction(image[found], rows) - uv_to_direction(pixels[valid][found], rows)
    assert found.mean() > 0.95
    assert (np.linalg.norm(turned, axis=1) < 0.01).mean() > 0.995


def test_where_the_space_is_said_to_reach_a_step_is_a_step(small_pipeline: Pipeline) -> None:
    """Next to columns that end earlier, too: nothing is made of nodes that only repeat."""
    deep = with_topography(depth_um=4.0)
    chart = Pipeline(small_pipeline.source, dict(small_pipeline.kept)).run(deep).topography
    rows = chart.shape[1]
    rng = np.random.default_rng(0)
    pixels = rng.uniform([-0.5, -0.5], [rows - 0.5, 2 * rows - 0.5], (20_000, 2))
    step = chart.d_um[1] - chart.d_um[0]
    ends = chart.d_um[[chart.first_layer.min(), chart.first_layer.max() + 2]]
    d = rng.uniform(*ends, len(pixels))
    world, valid = topography_to_world(chart, np.column_stack([d, pixels]))
    above, _ = topography_to_world(chart, np.column_stack([d + step, pixels]))
    assert 0.1 < valid.mean() < 0.9
    length = np.linalg.norm(above - world, axis=1)[valid] / step
    assert length.min() > 0.8
    assert length.max() < 1.1
