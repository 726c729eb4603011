"""The surface as it is, and the sealed surface."""

import numpy as np
import pytest
from scipy import ndimage

from napari_unwrap3d.charts import Mask, Surface
from napari_unwrap3d.errors import EmptyMaskError, TooSmallError
from napari_unwrap3d.geometry.mesh import (
    connected_components,
    euler_characteristic,
    is_watertight,
    signed_volume,
)
from napari_unwrap3d.geometry.topology import euler_characteristic as solid_euler
from napari_unwrap3d.geometry.topology import is_well_composed
from napari_unwrap3d.parameters import SealedParameters, SurfaceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.solid import mask_of_mesh
from napari_unwrap3d.unwrapping.surface import sealed_surface, smooth_solid, surface
from shapes import ball, grid, icosphere, torus

EDGE = 0.2
ORIGIN = (5.0, -3.0, 1.0)


def mask_of(solid: np.ndarray) -> Mask:
    return Mask(solid, (EDGE,) * 3, ORIGIN)


def made(solid: np.ndarray, **changes: float) -> Surface:
    return surface(mask_of(solid), SurfaceParameters(**changes), None, silent())


def sealed(solid: np.ndarray, handles: str = "seal"):
    closing = SealedParameters(handles=handles)
    return sealed_surface(mask_of(solid), made(solid), SurfaceParameters(), closing, silent())


def test_smoothing_keeps_the_largest_piece_and_drops_the_islands() -> None:
    solid = ball(9, 41)
    solid[2:5, 2:5, 2:5] = True
    field, kept = smooth_solid(solid, 1.0)
    np.testing.assert_array_equal(field > 0, kept)
    assert ndimage.label(kept)[1] == 1
    assert not kept[3, 3, 3]
    assert (kept != ball(9, 41)).mean() < 0.01


def test_without_smoothing_the_solid_is_as_given() -> None:
    field, kept = smooth_solid(ball(9, 27), 0.0)
    np.testing.assert_array_equal(kept, ball(9, 27))
    assert set(np.unique(field)) == {-0.5, 0.5}


def test_what_smoothing_removes_or_leaves_too_small_is_an_error() -> None:
    thin = np.zeros((30, 30, 30), bool)
    thin[15] = True
    with pytest.raises(EmptyMaskError, match="smoothing_voxels = 2"):
        smooth_solid(thin, 2.0)
    with pytest.raises(TooSmallError, match="needed = 500") as caught:
        smooth_solid(ball(4, 15), 1.0)
    assert 100 < caught.value.measured["voxels"] < 500


def test_a_ball_has_the_area_volume_and_curvatures_of_a_sphere() -> None:
    radius = np.cbrt(ball(15, 45).sum() * 3 / (4 * np.pi))
    chart = made(ball(15, 45))
    report = chart.report
    # Smoothing draws a sphere of radius r in by about σ²/r.
    radius_um = (radius - 1 / radius) * EDGE
    assert report["volume_um3"] == pytest.approx(4 / 3 * np.pi * radius_um**3, rel=0.01)
    assert report["area_um2"] == pytest.approx(4 * np.pi * radius_um**2, rel=0.02)
    assert (report["genus"], report["components"], report["watertight"]) == (0, 1, True)
    centre = np.array(ORIGIN) + 22 * EDGE
    distance = np.linalg.norm(chart.vertices - centre, axis=1)
    assert np.abs(distance - radius_um).max() < 0.6 * EDGE
    curvature = chart.fields["mean_curvature_per_um"]
    assert curvature.mean() == pytest.approx(1 / radius_um, rel=0.01)
    assert chart.fields["gaussian_curvature"].sum() == pytest.approx(4 * np.pi)


def test_the_curvature_smoothing_is_a_parameter() -> None:
    rough = made(ball(12, 37), curvature_smoothing_voxels=0.8).fields["mean_curvature_per_um"]
    smooth = made(ball(12, 37), curvature_smoothing_voxels=3.0).fields["mean_curvature_per_um"]
    assert smooth.std() < 0.5 * rough.std()


def test_voxels_that_smoothing_took_are_counted() -> None:
    solid = ball(9, 41)
    solid[2:5, 2:5, 2:5] = True
    assert made(solid).report["voxels_lost_by_smoothing"] >= 27
    assert made(ball(9, 27), smoothing_voxels=0.0).report["voxels_lost_by_smoothing"] == 0


def test_a_given_mesh_is_kept_as_it_is() -> None:
    directions, faces = icosphere(3)
    vertices = 12 * EDGE * directions + np.array(ORIGIN) + 18 * EDGE
    ink = np.arange(len(vertices))
    given = Surface(vertices, faces, {"ink": ink}, report={"holes_closed": 2})
    chart = surface(mask_of(ball(12, 37)), SurfaceParameters(), given, silent())
    np.testing.assert_array_equal(chart.vertices, vertices)
    np.testing.assert_array_equal(chart.faces, faces)
    np.testing.assert_array_equal(chart.fields["ink"], ink)
    assert chart.report["holes_closed"] == 2
    assert chart.report["vertices"] == len(vertices)
    curvature = chart.fields["mean_curvature_per_um"]
    assert curvature.mean() == pytest.approx(1 / (12 * EDGE), rel=0.01)


def test_a_sphere_needs_no_sealing() -> None:
    solid = ball(10, 31)
    chart, plain = sealed(solid), made(solid)
    np.testing.assert_array_equal(chart.vertices, plain.vertices)
    np.testing.assert_array_equal(chart.faces, plain.faces)
    assert chart.sealed == ()


def assert_is_a_sphere(chart) -> None:
    assert is_watertight(chart.faces)
    assert euler_characteristic(chart.faces) == 2
    assert connected_components(chart.faces)[0].max() == 0
    assert signed_volume(chart.vertices, chart.faces) > 0
    assert solid_euler(chart.mask.data) == 1
    assert is_well_composed(chart.mask.data)


def test_a_ring_is_sealed_and_the_membrane_reported_in_space() -> None:
    solid = torus(11, 4, (17, 41, 41))
    assert made(solid).report["genus"] == 1
    chart = sealed(solid)
    assert_is_a_sphere(chart)
    _, smooth = smooth_solid(solid, 1.0)
    assert (chart.mask.data >= smooth).all()
    (part,) = chart.sealed
    assert part["kind"] == "membrane"
    centre = np.array(ORIGIN) + EDGE * np.array([8, 20, 20])
    np.testing.assert_allclose(part["position_um"], centre, atol=EDGE)
    voxels = (chart.mask.data & ~smooth).sum()
    assert part["volume_um3"] == pytest.approx(voxels * EDGE**3)


def test_a_cut_is_reported_in_space_too() -> None:
    solid = torus(11, 4, (17, 41, 41))
    chart = sealed(solid, "cut")
    assert_is_a_sphere(chart)
    _, smooth = smooth_solid(solid, 1.0)
    assert (chart.mask.data <= smooth).all()
    assert chart.membranes is None
    part = chart.sealed[0]
    assert part["kind"] == "cut"
    voxels = (smooth & ~chart.mask.data).sum()
    assert chart.cuts.data.sum() == voxels
    assert sum(p["volume_um3"] for p in chart.sealed) == pytest.approx(voxels * EDGE**3)
    ring = np.linalg.norm(np.array(part["position_um"]) - ORIGIN - EDGE * np.array([8, 20, 20]))
    assert ring == pytest.approx(11 * EDGE, abs=EDGE)


def test_a_cavity_is_sealed_too() -> None:
    """Its wall is a second sphere, so counting handles alone does not notice it."""
    solid = ball(12, 37) & ~ball(5, 37)
    assert made(solid).report["components"] == 2
    chart = sealed(solid)
    assert [part["kind"] for part in chart.sealed] == ["cavity"]
    assert_is_a_sphere(chart)
    assert chart.sealed[0]["volume_um3"] == pytest.approx(4 / 3 * np.pi * (5 * EDGE) ** 3, rel=0.2)


def test_where_nothing_was_sealed_the_mesh_is_the_surfaces() -> None:
    """Membranes change the mesh next to them only."""
    points = grid(48)
    solid = np.linalg.norm(points, axis=-1) < 13
    z, y, x = np.moveaxis(points, -1, 0)
    solid |= np.hypot(np.hypot(z, x + 14) - 6, y) < 2.6
    plain, chart = made(solid), sealed(solid)
    assert_is_a_sphere(chart)
    far = chart.vertices[chart.vertices[:, 2] > ORIGIN[2] + 20 * EDGE]
    before = plain.vertices[plain.vertices[:, 2] > ORIGIN[2] + 20 * EDGE]
    np.testing.assert_allclose(far, before)


def test_a_mesh_that_intersects_itself_is_not_the_sealed_one() -> None:
    vertices, faces = icosphere(3)
    through = vertices.copy()
    cap = through[:, 0] > 0.8
    through[cap, 0] -= 11.0 * (through[cap, 0] - 0.8)
    mask, _ = mask_of_mesh(Surface(through, faces), 0.06)
    chart = surface(mask, SurfaceParameters(), Surface(through, faces), silent())
    assert chart.report["self_intersecting_voxels"] > 30
    np.testing.assert_array_equal(chart.vertices, through)
    found = sealed_surface(mask, chart, SurfaceParameters(), SealedParameters(), silent())
    assert_is_a_sphere(found)
    volume = found.mask.data.sum() * 0.06**3
    assert signed_volume(found.vertices, found.faces) == pytest.approx(volume, rel=0.03)
    assert len(found.vertices) != len(through)
