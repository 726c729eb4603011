"""The direct chart: one to one, in place, and labels that come back as they went."""

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas, load
from napari_unwrap3d.errors import AxesError, ChartMissingError
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.geometry.spherical_embedding import certificate
from napari_unwrap3d.geometry.spherical_raster import coverage
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import Pipeline, unwrap
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.direct import registration, spokesmen
from napari_unwrap3d.unwrapping.surface import same_mesh
from napari_unwrap3d.unwrapping.uv import direction_to_uv, uv_to_direction
from pipelines import copy_of
from shapes import QUICK, icosphere, small_cell_mask

ROWS = 64
DIRECT = Parameters.from_dict(
    {**QUICK.model_dump(), "direct": {"rows": ROWS, "sweeps": 5, "final_sweeps": 10}}
)


@pytest.fixture(scope="module")
def atlas(small_pipeline: Pipeline) -> Atlas:
    return copy_of(small_pipeline).run(DIRECT)


@pytest.fixture(scope="module")
def sealed_atlas() -> Atlas:
    """Of a cell with a handle: the sealed surface is another mesh than the surface."""
    return unwrap(small_cell_mask(handle=True), DIRECT)


def regions(atlas: Atlas, seed: int = 0) -> np.ndarray:
    """Every vertex has the number of the nearest of some random points."""
    vertices = atlas.surface.vertices
    seeds = vertices[np.random.default_rng(seed).choice(len(vertices), 12, replace=False)]
    return np.linalg.norm(vertices[:, None] - seeds[None], axis=2).argmin(axis=1) + 1


def test_it_is_computed_when_it_is_first_read(atlas: Atlas, small_pipeline: Pipeline) -> None:
    fresh = copy_of(small_pipeline).run(DIRECT)
    assert not fresh.has("direct")
    assert "direct" not in fresh.quality
    chart = fresh.direct
    assert fresh.has("direct")
    assert fresh.quality["direct"]["certified"] is True
    assert fresh.direct is chart
    np.testing.assert_array_equal(chart.vertices, atlas.direct.vertices)
    earlier = {name: kept for name, kept in small_pipeline.kept.items() if name != "topography"}
    partial = Pipeline(small_pipeline.source, earlier).run(DIRECT, until="uv")
    with pytest.raises(ChartMissingError):
        _ = partial.direct


def test_the_pipeline_runs_it_when_asked(small_pipeline: Pipeline) -> None:
    pipeline = copy_of(small_pipeline)
    assert pipeline.run(DIRECT, until="direct").has("direct")
    assert pipeline.state(DIRECT)["direct"] == "done"
    changed = DIRECT.model_copy(update={"direct": DIRECT.direct.model_copy(update={"sweeps": 6})})
    states = pipeline.state(changed)
    assert states["direct"] == "stale"
    assert states["topography"] == "done"


@pytest.mark.parametrize("name", ["atlas", "sealed_atlas"])
def test_it_is_a_homeomorphism_of_the_sealed_surface(name, request) -> None:
    atlas = request.getfixturevalue(name)
    chart = atlas.direct
    assert chart.faces is atlas.sealed.faces
    assert certificate(chart.vertices, chart.faces).holds
    numbers = atlas.quality["direct"]
    assert numbers["flipped_faces"] == 0
    assert numbers["degree"] == pytest.approx(1.0)
    assert numbers["mean_abs_log_lambda"] < 0.6


def test_the_cortex_lies_where_the_references_image_has_it(atlas: Atlas) -> None:
    chart = atlas.direct
    image, valid = atlas.map(atlas.surface.vertices, "surface", "uv")
    there = uv_to_direction(image, atlas.uv.shape[0]) @ atlas.uv.rotation
    angle = np.arccos(np.clip((there * chart.vertices).sum(axis=1), -1, 1))
    assert chart.cortex.mean() > 0.5
    assert valid[chart.cortex].all()
    assert np.percentile(angle[chart.cortex], 95) < 0.15
    assert atlas.quality["direct"]["cortex_displacement_p95_rad"] == pytest.approx(
        np.percentile(angle[chart.cortex], 95), abs=1e-6
    )


def test_what_lies_over_others_is_not_tied(atlas: Atlas) -> None:
    places = registration(
        atlas.sealed, atlas.surface, atlas.uv, atlas.topography, atlas.voxel_um, silent()
    )
    np.testing.assert_array_equal(places.single, atlas.direct.cortex)
    norms = np.linalg.norm(places.directions[places.single], axis=1)
    np.testing.assert_allclose(norms, 1.0)


def test_every_pixel_has_its_place_and_its_owner(atlas: Atlas) -> None:
    chart = atlas.direct
    assert chart.shape == (ROWS, 2 * ROWS)
    assert (chart.weights > -1e-9).all()
    np.testing.assert_allclose(chart.weights.sum(axis=2), 1.0)
    corners = chart.faces[chart.face]
    at_corner = (corners == chart.owner[:, :, None]).any(axis=2)
    assert at_corner.mean() > 0.9
    owners = np.unique(chart.owner)
    np.testing.assert_array_equal(chart.spokesman[owners], owners)
    assert np.isin(chart.spokesman, owners).all()
    # The others own the pixel in which they lie.
    row, column = np.nonzero(~at_corner)
    places = direction_to_uv(chart.vertices @ chart.rotation.T, ROWS)[chart.owner[row, column]]
    off = np.abs(places - np.column_stack([row, column]))
    assert np.minimum(off, 2 * ROWS - off).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("name", ["atlas", "sealed_atlas"])
def test_points_come_back(name, request) -> None:
    atlas = request.getfixturevalue(name)
    pixels = np.random.default_rng(0).uniform([-0.5, -0.5], [ROWS - 0.5, 2 * ROWS - 0.5], (500, 2))
    world, valid = atlas.map(pixels, "direct", "volume")
    assert valid.all()
    image, on_surface = atlas.map(world, "volume", "direct")
    same = on_surface
    assert same.mean() > (0.999 if name == "atlas" else 0.9)
    back = uv_to_direction(image[same], ROWS)
    np.testing.assert_allclose(back, uv_to_direction(pixels[same], ROWS), atol=1e-7)
    vertices = atlas.surface.vertices
    image, valid = atlas.map(vertices, "surface", "direct")
    again, _ = atlas.map(image[valid], "direct", "surface")
    away = np.linalg.norm(again - vertices[valid], axis=1) / atlas.voxel_um
    assert valid.mean() > 0.95
    assert np.nanmax(away) < (1e-6 if name == "atlas" else 1.0)


def test_points_go_to_the_other_charts_through_space(atlas: Atlas) -> None:
    chart = atlas.direct
    pixels = direction_to_uv(chart.vertices[::50] @ chart.rotation.T, ROWS)
    image, valid = atlas.map(pixels, "direct", "topography")
    np.testing.assert_allclose(image[valid], atlas.topography.surface[::50][valid], atol=1e-3)
    direct, _ = atlas.map(image[valid], "topography", "direct")
    turned = uv_to_direction(direct, ROWS)
    np.testing.assert_allclose(turned, uv_to_direction(pixels[valid], ROWS), atol=1e-3)


def test_labels_come_back(atlas: Atlas) -> None:
    labels = regions(atlas)
    image = atlas.carry(labels, "surface", "direct", kind="label")
    assert image.shape == (ROWS, 2 * ROWS)
    back = atlas.carry(image, "direct", "surface", kind="label")
    owners = np.unique(atlas.direct.owner)
    np.testing.assert_array_equal(back[owners], labels[owners])
    assert (back == labels).mean() > 0.9


def test_labels_of_a_cell_with_a_handle_come_back(sealed_atlas: Atlas) -> None:
    assert not same_mesh(sealed_atlas.sealed, sealed_atlas.surface)
    labels = regions(sealed_atlas)
    image = sealed_atlas.carry(labels, "surface", "direct", kind="label")
    back = sealed_atlas.carry(image, "direct", "surface", kind="label")
    assert (back == labels).mean() > 0.9


def test_scalars_are_interpolated_both_ways(atlas: Atlas) -> None:
    height = atlas.surface.vertices[:, 0]
    image = atlas.carry(height, "surface", "direct")
    back = atlas.carry(image, "direct", "surface")
    spread = np.ptp(height)
    assert np.abs(back - height).mean() < 0.02 * spread
    constant = atlas.carry(np.full(len(height), 3.5), "surface", "direct")
    np.testing.assert_allclose(constant, 3.5)


def test_an_image_goes_to_uv_and_the_topography(atlas: Atlas) -> None:
    image = np.zeros((ROWS, 2 * ROWS), np.int32)
    image[: ROWS // 2] = 1
    uv = atlas.carry(image, "direct", "uv", kind="label")
    expected = np.zeros(uv.shape, int)
    expected[: uv.shape[0] // 2] = 1
    assert (uv == expected).mean() > 0.8
    with pytest.raises(AxesError, match="direct"):
        atlas.carry(image[:-1], "direct", "surface", kind="label")


def test_it_is_saved_and_opened(atlas: Atlas, tmp_path) -> None:
    _ = atlas.direct
    opened = load(atlas.save(tmp_path / "cell"))
    assert opened.has("direct")
    for name in ("vertices", "owner", "spokesman", "cortex", "face", "weights"):
        np.testing.assert_array_equal(getattr(opened.direct, name), getattr(atlas.direct, name))
    assert opened.quality["direct"] == atlas.quality["direct"]
    labels = regions(atlas)
    np.testing.assert_array_equal(
        opened.carry(labels, "surface", "direct", kind="label"),
        atlas.carry(labels, "surface", "direct", kind="label"),
    )


# The parts ----------------------------------------------------------------------------


def test_spokesmen_are_the_nearest_owners_along_the_edges() -> None:
    vertices, faces = icosphere(3)
    owners = np.array([3, 100, 400])
    found = spokesmen(vertices, faces, owners)
    np.testing.assert_array_equal(found[owners], owners)
    angle = np.arccos(np.clip(vertices @ vertices[owners].T, -1, 1))
    assert (owners[angle.argmin(axis=1)] == found).mean() > 0.95


def test_a_sphere_covers_every_pixel_once_and_two_cover_it_twice() -> None:
    vertices, faces = icosphere(3)
    count = coverage(vertices, faces, 32)
    assert (count == 1).mean() > 0.999
    assert count.sum() == pytest.approx(32 * 64, abs=4)
    twice = coverage(
        np.vstack([vertices, vertices * [1, 1, -1]]),
        np.vstack([faces, faces + len(vertices)]),
        32,
    )
    assert (twice == 2).mean() > 0.99


def test_coverage_sees_flipped_faces_poles_and_the_seam() -> None:
    """A cap of faces over each place, drawn the wrong way round."""
    for pole in (np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]), np.array([0, 0, -1.0])):
        tangent = np.eye(3)[np.abs(pole).argmin()]
        other = np.cross(pole, tangent)
        angle = 2 * np.pi * np.arange(3) / 3
        corners = pole + 0.3 * (np.cos(angle)[:, None] * tangent + np.sin(angle)[:, None] * other)
        corners /= np.linalg.norm(corners, axis=1, keepdims=True)
        for faces in (np.array([[0, 1, 2]]), np.array([[0, 2, 1]])):
            count = coverage(corners, faces, 64)
            inclination = (np.arange(64) + 0.5) * np.pi / 64
            area = (count * np.sin(inclination)[:, None]).sum() * (np.pi / 64) ** 2
            assert area == pytest.approx(face_areas(corners, faces)[0], rel=0.15)
            assert count.max() == 1
