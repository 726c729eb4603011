"""Areas, volumes, and means that allow for distortion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import AxesError, ChartMissingError
from napari_unwrap3d.geometry.mesh import face_areas, signed_volume
from napari_unwrap3d.unwrapping.elements import region_mean, region_means
from synthetic import CENTRE, RADIUS, VOXEL, make_atlas


def inclination(atlas: Atlas) -> np.ndarray:
    """0 at the poles and 1 at the equator, per vertex of the reference."""
    turned = atlas.sphere.vertices @ atlas.uv.rotation.T
    return np.hypot(turned[:, 1], turned[:, 2])


def test_the_mean_over_the_image_is_that_over_the_surface(small_atlas: Atlas) -> None:
    """Uncorrected, what lies at the poles counts too much."""
    field = inclination(small_atlas)
    image = small_atlas.carry(field, "reference", "uv")
    expected = small_atlas.region_mean(field, chart="reference")
    assert small_atlas.region_mean(image) == pytest.approx(expected, rel=0.01)
    assert abs(image.mean() / expected - 1) > 0.1


def test_the_mean_over_a_region_is_that_over_the_same_region(small_atlas: Atlas) -> None:
    centre = small_atlas.reference.vertices.mean(axis=0)
    field = inclination(small_atlas)
    vertices = (small_atlas.reference.vertices - centre) @ [1.0, 2.0, -1.0] > 0.5
    pixels = (small_atlas.uv.positions - centre) @ [1.0, 2.0, -1.0] > 0.5
    expected = small_atlas.region_mean(field, vertices, "reference")
    found = small_atlas.region_mean(small_atlas.carry(field, "reference", "uv"), pixels)
    assert found == pytest.approx(expected, rel=0.01)


def test_areas_and_volumes_add_up(small_atlas: Atlas, handle_atlas: Atlas) -> None:
    for atlas in (small_atlas, handle_atlas):
        for chart in ("surface", "sealed", "reference"):
            mesh = getattr(atlas, chart)
            area = face_areas(mesh.vertices, mesh.faces).sum()
            assert atlas.elements(chart).sum() == pytest.approx(area)
        area = atlas.elements("reference").sum()
        assert atlas.elements("uv").sum() == pytest.approx(area, rel=0.01)
        inside = atlas.elements("topography")[atlas.topography.mask]
        volume = signed_volume(atlas.surface.vertices, atlas.surface.faces)
        assert inside.sum(dtype=float) == pytest.approx(volume, rel=0.01)


def test_volumes_of_nodes_of_shells_around_a_ball() -> None:
    atlas = make_atlas(2, 32)
    volumes = atlas.elements("topography").astype(float)
    radii = RADIUS + atlas.topography.d_um
    low, high = radii - VOXEL / 4, radii + VOXEL / 4
    low[0], high[-1] = radii[0], radii[-1]
    layers = 4 / 3 * np.pi * (high**3 - low**3)
    np.testing.assert_allclose(volumes.sum(axis=(1, 2)), layers, rtol=0.005)
    # Rows have the shares of their zones, up to the poles.
    edges = np.cos(np.arange(33) * np.pi / 32)
    zones = (edges[:-1] - edges[1:]) / 2
    np.testing.assert_allclose(volumes[5].sum(axis=1) / volumes[5].sum(), zones, rtol=0.01)
    np.testing.assert_allclose(volumes, volumes[..., :1].repeat(64, axis=-1), rtol=1e-3)


def test_the_mean_over_the_topography_is_that_over_the_volume() -> None:
    """Of the distance from the centre over a shell: (3/4) (b⁴ − a⁴) / (b³ − a³)."""
    atlas = make_atlas(2, 32)
    positions = atlas.topography.positions - CENTRE
    field = np.linalg.norm(positions, axis=-1)
    a, b = RADIUS - 1.0, RADIUS + atlas.topography.d_um[-1]
    expected = 0.75 * (b**4 - a**4) / (b**3 - a**3)
    assert atlas.region_mean(field, None, "topography") == pytest.approx(expected, rel=1e-3)
    assert abs(field.mean() / expected - 1) > 0.02


def test_columns_that_end_early_have_no_volume_beyond() -> None:
    atlas = make_atlas(1, 32)
    chart = atlas.topography
    whole = atlas.elements("topography")
    chart.first_layer[5:9, 10:20] = 3
    shorter = make_atlas(1, 32)
    shorter.topography.first_layer[:] = chart.first_layer
    part = shorter.elements("topography")
    assert (part <= whole).all()
    assert (part[:3, 4:8, 10:20] == 0).all()
    np.testing.assert_array_equal(part[4:], whole[4:])


def test_the_sphere_has_the_areas_of_the_reference(small_atlas: Atlas) -> None:
    np.testing.assert_array_equal(small_atlas.elements("sphere"), small_atlas.elements("reference"))
    assert small_atlas.elements("topography") is small_atlas.elements("topography")


@given(seed=st.integers(0, 1000), shift=st.floats(-10, 10))
def test_means_are_linear_and_between_the_values(seed: int, shift: float) -> None:
    rng = np.random.default_rng(seed)
    values, weights = rng.normal(size=(5, 7)), rng.random((5, 7))
    region = rng.random((5, 7)) < 0.5
    region[0, 0] = True
    mean = region_mean(values, region, weights)
    assert values[region].min() <= mean <= values[region].max()
    moved = region_mean(2 * values + shift, region, weights)
    assert moved == pytest.approx(2 * mean + shift, abs=1e-9)
    assert region_mean(values, region, 3 * weights) == pytest.approx(mean)
    constant = region_mean(np.full((5, 7), shift), region, weights)
    assert constant == pytest.approx(shift, abs=1e-12)


def test_the_means_of_labels_are_those_of_their_regions() -> None:
    rng = np.random.default_rng(0)
    values, weights, labels = rng.random((6, 12)), rng.random((6, 12)), rng.integers(0, 4, (6, 12))
    labels[labels == 2] = 5
    means = region_means(values, labels, weights)
    assert len(means) == 6
    for label in (0, 1, 3, 5):
        assert means[label] == pytest.approx(region_mean(values, labels == label, weights))
    assert np.isnan(means[[2, 4]]).all()


def test_what_has_no_value_does_not_count() -> None:
    values = np.array([1.0, np.nan, 3.0])
    assert region_mean(values, None, [1.0, 5.0, 3.0]) == 2.5
    assert np.isnan(region_mean(values, [False, True, False], np.ones(3)))
    assert np.isnan(region_mean(values, np.zeros(3, bool), np.ones(3)))
    assert np.isnan(region_mean(values, [True, False, False], [0.0, 1.0, 1.0]))


def test_wrong_shapes_and_types_are_errors(small_atlas: Atlas) -> None:
    with pytest.raises(AxesError, match=r"region = \(2,\)"):
        region_mean(np.ones(3), np.ones(2, bool), np.ones(3))
    with pytest.raises(AxesError, match="labels == 3"):
        region_mean(np.ones(3), np.ones(3, int), np.ones(3))
    with pytest.raises(AxesError, match="from 0"):
        region_means(np.ones(3), np.full(3, -1), np.ones(3))
    with pytest.raises(AxesError, match="weights"):
        small_atlas.region_mean(np.ones(3))
    with pytest.raises(ChartMissingError, match="volume"):
        small_atlas.elements("volume")
