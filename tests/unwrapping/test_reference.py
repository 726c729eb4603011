"""Step 1: the flow, its stops, and the genus-0 reference."""

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask, SealedSurface
from napari_unwrap3d.errors import Cancelled, NotGenusZeroError
from napari_unwrap3d.geometry.distortion import mean_conformal_error
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.geometry.mesh import (
    connected_components,
    euler_characteristic,
    face_areas,
    is_watertight,
    radius_ratio,
    signed_volume,
)
from napari_unwrap3d.geometry.topology import euler_characteristic as solid_euler
from napari_unwrap3d.parameters import ReferenceParameters, SealedParameters, SurfaceParameters
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping import reference as reference_step
from napari_unwrap3d.unwrapping.reference import (
    conformalized_flow,
    fit_to,
    is_past_elbow,
    level_function,
    reference,
    stopping_rule,
)
from napari_unwrap3d.unwrapping.surface import sealed_surface, surface
from shapes import ball, grid, icosphere, lumpy, rotation, torus

FIXED = ReferenceParameters(stop="fixed", fixed_iteration=8, iterations=8)
# As many vertices as such small solids have voxels on their boundary.
SMALL = ReferenceParameters(vertices=4000)


def bumpy() -> tuple[np.ndarray, np.ndarray]:
    """A body with narrow bumps, as blebs are."""
    directions, faces = icosphere(4)
    radius = np.ones(len(directions))
    for axis in np.random.default_rng(1).normal(size=(6, 3)):
        radius += 0.4 * np.exp(40 * (directions @ (axis / np.linalg.norm(axis)) - 1))
    return directions * radius[:, None] * [1, 1.1, 1.2], faces


def three_handles() -> Mask:
    points = grid(60)
    solid = np.linalg.norm(points, axis=-1) < 15
    for axis in range(3):
        across = np.delete(np.moveaxis(points, -1, 0), axis, axis=0)
        ring = np.hypot(points[..., axis] + 15.5, across[0])
        solid |= np.hypot(ring - 6.5, across[1]) < 2.7
    return Mask(solid, (0.1,) * 3, (1.0, 2.0, 3.0))


def sealed_of(mask: Mask) -> SealedSurface:
    parameters = SurfaceParameters()
    plain = surface(mask, parameters, None, silent())
    return sealed_surface(mask, plain, parameters, SealedParameters(handles="seal"), silent())


def test_the_flow_makes_the_body_rounder_at_every_iteration() -> None:
    vertices, faces = bumpy()
    flow = conformalized_flow(vertices, faces, FIXED, silent())
    assert flow.iteration == 8
    assert len(flow.total_curvature) == 9
    assert (np.diff(flow.total_curvature) < 0).all()
    assert flow.total_curvature[0] > 1.5
    assert flow.total_curvature[-1] == pytest.approx(1.0, abs=0.1)


def test_the_result_has_unit_area_around_the_origin() -> None:
    vertices, faces = bumpy()
    flow = conformalized_flow(50 * vertices + [1000, 2000, -500], faces, FIXED, silent())
    area = face_areas(flow.vertices, faces)
    assert area.sum() == pytest.approx(1.0)
    centroid = area @ flow.vertices[faces].mean(axis=1)
    np.testing.assert_allclose(centroid, 0, atol=1e-9)
    assert signed_volume(flow.vertices, faces) > 0


def test_size_place_and_orientation_do_not_matter() -> None:
    vertices, faces = bumpy()
    turn = rotation(0)
    plain = conformalized_flow(vertices, faces, FIXED, silent())
    moved = conformalized_flow(7 * vertices @ turn.T + 3, faces, FIXED, silent())
    np.testing.assert_allclose(moved.vertices, plain.vertices @ turn.T, atol=1e-6)
    np.testing.assert_allclose(moved.total_curvature, plain.total_curvature, atol=1e-6)


def test_a_sphere_does_not_change() -> None:
    directions, faces = icosphere(3)
    flow = conformalized_flow(directions, faces, FIXED, silent())
    radius = np.linalg.norm(flow.vertices, axis=1)
    assert np.ptp(radius) / radius.mean() < 0.01
    np.testing.assert_allclose(flow.total_curvature, 1.0, atol=1e-6)


def test_the_flow_converges_to_a_conformal_sphere() -> None:
    """Its limit is the conformal map to the sphere (Kazhdan, Solomon and Ben-Chen 2012)."""
    vertices, faces = lumpy(3)
    parameters = ReferenceParameters(stop="fixed", fixed_iteration=100, iterations=100, delta=0.1)
    flow = conformalized_flow(vertices, faces, parameters, silent())
    radius = np.linalg.norm(flow.vertices, axis=1)
    assert radius.std() / radius.mean() < 0.02
    assert mean_conformal_error(vertices, flow.vertices, faces) < 1.05


def test_a_larger_step_smooths_more() -> None:
    vertices, faces = bumpy()
    curves = [
        conformalized_flow(
            vertices, faces, FIXED.model_copy(update={"delta": delta}), silent()
        ).total_curvature[2]
        for delta in (1e-4, 5e-4, 5e-3)
    ]
    assert curves[0] > curves[1] > curves[2]


def test_the_flow_reports_and_can_be_cancelled() -> None:
    vertices, faces = bumpy()
    seen: list[float] = []
    conformalized_flow(vertices, faces, FIXED, Progress(lambda s, f, m: seen.append(f)))
    assert seen == sorted(seen)
    assert len(seen) >= 8
    progress = Progress()
    progress.callback = lambda step, fraction, message: fraction > 0.3 and progress.cancel()
    with pytest.raises(Cancelled):
        conformalized_flow(vertices, faces, FIXED, progress)


def rule(curve: list[float], **settings: object) -> str:
    return stopping_rule(np.array(curve), 1000, ReferenceParameters(**settings))


def test_total_curvature_stops_below_the_limit() -> None:
    assert rule([3.0, 2.0], curvature_limit=1.6) == ""
    assert rule([3.0, 2.0, 1.59], curvature_limit=1.6) == "total_curvature"
    assert rule([3.0, 1.59], minimum_iterations=2) == ""
    assert rule([1.0], curvature_limit=1.6) == ""  # the surface itself is no reference yet


def test_the_papers_rule_stops_when_the_mean_hardly_falls() -> None:
    per_vertex = 4 * np.pi / 1000
    threshold = 1e-3
    fast, slow = 2 * threshold / per_vertex, 0.5 * threshold / per_vertex
    paper = {"stop": "paper", "threshold": threshold}
    assert rule([3.0, 3.0 - fast], **paper) == ""
    assert rule([3.0, 3.0 - slow], **paper) == "paper"
    assert rule([3.0, 3.1], **paper) == "paper"


def test_a_fixed_iteration_stops_there_and_nowhere_else() -> None:
    fixed = {"stop": "fixed", "fixed_iteration": 3}
    assert [rule([2.0] * n, **fixed) for n in (2, 3, 4)] == ["", "", "fixed"]
    assert rule([2.0, 1.0], **fixed) == ""


def test_the_change_point_is_where_the_steep_fall_ends() -> None:
    assert not is_past_elbow(np.array([3.0, 2.0]))
    assert not is_past_elbow(np.array([3.0, 2.0, 1.5]))
    assert is_past_elbow(np.array([3.0, 2.0, 1.5, 1.45]))
    assert rule([3.0, 2.0, 1.5, 1.45], stop="change_point") == "change_point"


def test_extra_and_maximal_iterations() -> None:
    vertices, faces = bumpy()
    plain = conformalized_flow(vertices, faces, ReferenceParameters(), silent())
    assert plain.stopped_by == "total_curvature"
    assert plain.total_curvature[-1] < 1.6 <= plain.total_curvature[-2]
    more = conformalized_flow(vertices, faces, ReferenceParameters(extra_iterations=2), silent())
    assert more.iteration == plain.iteration + 2
    assert more.stopped_by == plain.stopped_by
    few = ReferenceParameters(stop="fixed", fixed_iteration=50, iterations=2)
    short = conformalized_flow(vertices, faces, few, silent())
    assert (short.iteration, short.stopped_by) == (2, "maximum iterations")


def test_scale_and_shift_are_recovered_also_when_some_vertices_went_far() -> None:
    vertices, faces = lumpy(3)
    mass = vertex_mass(vertices, faces)
    moved = (vertices - [3, -2, 5]) / 7.0
    np.testing.assert_allclose(fit_to(moved, vertices, mass), vertices, atol=1e-9)
    arms = vertices[:, 2] > np.quantile(vertices[:, 2], 0.85)
    moved[arms] *= 0.7  # protrusions that were drawn in
    fitted = fit_to(moved, vertices, mass)
    assert np.abs(fitted - vertices)[~arms].max() < 0.02


def test_the_level_function_has_the_sign_of_its_solid() -> None:
    solid = ball(8, 23)
    solid[11, 11, 19:22] = True  # a spike that smoothing alone would take
    level = level_function(solid, 1.0)
    np.testing.assert_array_equal(level > 0, solid)
    assert level.dtype == np.float32
    assert set(np.unique(level_function(solid, 0.0))) == {-0.5, 0.5}


def test_a_surface_with_three_handles_gets_a_reference_of_genus_zero() -> None:
    mask = three_handles()
    sealed = sealed_of(mask)
    chart = reference(sealed, SMALL, silent())
    assert surface(mask, SurfaceParameters(), None, silent()).report["genus"] == 3
    assert euler_characteristic(chart.faces) == 2
    assert is_watertight(chart.faces)
    assert connected_components(chart.faces)[0].max() == 0
    assert signed_volume(chart.vertices, chart.faces) > 0
    assert solid_euler(chart.mask.data) == 1
    np.testing.assert_array_equal(chart.level.data > 0, chart.mask.data)
    ratio = radius_ratio(chart.vertices, chart.faces)
    assert ratio.mean() > 0.9
    assert ratio.min() > 0.2
    # It lies where the cell's body lies, in µm.
    centre = np.array([1.0, 2.0, 3.0]) + 0.1 * 29.5
    assert np.linalg.norm(chart.vertices.mean(axis=0) - centre) < 0.25
    # Its grid is the mask's with room around it.
    shift = (np.array(mask.origin) - chart.mask.origin) / mask.voxel_size
    np.testing.assert_allclose(shift, np.full(3, 6.0))


def test_the_reference_of_a_ball_is_the_ball() -> None:
    mask = Mask(ball(14, 43), (0.1,) * 3)
    chart = reference(sealed_of(mask), SMALL, silent())
    radius = np.linalg.norm(chart.vertices - 2.1, axis=1) / 0.1
    assert radius.mean() == pytest.approx(14, abs=0.25)
    assert np.abs(radius - 14).max() < 1.0
    assert chart.fields["mean_curvature_per_um"].mean() == pytest.approx(1 / 1.4, rel=0.05)
    assert chart.total_curvature[0] < 3.0
    assert len(chart.total_curvature) == chart.iteration + 1


@pytest.mark.parametrize("vertices", [1000, 8000])
def test_the_number_of_vertices_is_a_parameter(vertices: int) -> None:
    """Fewer and more than marching cubes has: every map is as fine as this mesh."""
    mask = Mask(ball(14, 43), (0.1,) * 3)
    chart = reference(sealed_of(mask), ReferenceParameters(vertices=vertices), silent())
    assert 1000 < len(clamped_marching_cubes(chart.level.data)[0]) < 8000
    assert len(chart.vertices) == pytest.approx(vertices, rel=0.03)
    assert euler_characteristic(chart.faces) == 2
    assert is_watertight(chart.faces)
    volume = signed_volume(chart.vertices, chart.faces)
    assert volume == pytest.approx(chart.mask.data.sum() * 0.1**3, rel=0.03)


def test_a_sealed_surface_without_a_solid_is_an_error() -> None:
    vertices, faces = icosphere(2)
    with pytest.raises(NotGenusZeroError, match="mask"):
        reference(SealedSurface(vertices, faces), ReferenceParameters(), silent())


def test_a_ring_gets_a_plug_instead_of_its_membrane() -> None:
    """A sheet of one voxel would have no inside for the normals to go to."""
    mask = Mask(torus(13, 6, (25, 51, 51)), (0.1,) * 3)
    sealed = sealed_of(mask)
    middle = sealed.mask.data[:, 25, 25].sum()
    chart = reference(sealed, SMALL, silent())
    assert 1 <= middle <= 2 < chart.mask.data[:, 25, 25].sum()
    assert euler_characteristic(chart.faces) == 2
    plugged_mesh = reference_step.plugged(sealed, sealed.mask)
    assert euler_characteristic(plugged_mesh[1]) == 2
    assert signed_volume(*plugged_mesh) > signed_volume(sealed.vertices, sealed.faces)


def test_a_cut_becomes_a_gap() -> None:
    """The two ends at a slit of one voxel would grow together again."""
    mask = Mask(torus(15, 4, (21, 51, 51)), (0.1,) * 3)
    plain = surface(mask, SurfaceParameters(), None, silent())
    cut = sealed_surface(
        mask, plain, SurfaceParameters(), SealedParameters(handles="cut"), silent()
    )
    assert cut.membranes is None or cut.membranes.data.sum() <= 2
    opened, faces = reference_step.plugged(cut, cut.mask)
    assert euler_characteristic(faces) == 2
    assert signed_volume(opened, faces) < signed_volume(cut.vertices, cut.faces)
    # The hole stays a hole: nothing of the mesh is near the middle of the ring.
    middle = np.array([1.0, 2.5, 2.5])
    assert np.linalg.norm(opened - middle, axis=1).min() > 0.9


def test_without_membranes_the_flow_starts_from_the_sealed_surface() -> None:
    sealed = sealed_of(Mask(ball(10, 33), (0.1,) * 3))
    vertices, faces = reference_step.plugged(sealed, sealed.mask)
    assert vertices is sealed.vertices
    assert faces is sealed.faces


def test_a_fine_mesh_flows_on_a_coarser_one(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = bumpy()
    assert reference_step.coarsened(vertices, faces, silent())[0] is vertices
    monkeypatch.setattr(reference_step, "FLOW_VERTICES", 1000)
    fewer, triangles = reference_step.coarsened(vertices, faces, silent())
    assert len(fewer) == pytest.approx(1000, rel=0.05)
    assert euler_characteristic(triangles) == 2
    volume = signed_volume(vertices, faces)
    assert signed_volume(fewer, triangles) == pytest.approx(volume, rel=0.03)
    coarse = conformalized_flow(fewer, triangles, FIXED, silent())
    fine = conformalized_flow(vertices, faces, FIXED, silent())
    assert coarse.total_curvature[-1] == pytest.approx(fine.total_curvature[-1], abs=0.1)


def test_spikes_are_cut_and_thin_bodies_are_left() -> None:
    solid = ball(12, 41)
    spiked = solid.copy()
    spiked[20, 20, 20:40] = True
    cut = reference_step.without_spikes(spiked)
    assert not cut[20, 20, 34:].any()
    assert (cut <= spiked).all()
    assert (cut != solid).sum() < 0.02 * solid.sum()
    plate = np.zeros((30, 30, 30), bool)
    plate[14:17, 4:-4, 4:-4] = True
    np.testing.assert_array_equal(reference_step.without_spikes(plate), plate)
