"""Step 1: the genus-0 reference."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from napari_unwrap3d.charts import Mask, SealedSurface
from napari_unwrap3d.errors import NotGenusZeroError
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.geometry.mesh import (
    connected_components,
    euler_characteristic,
    is_watertight,
    radius_ratio,
    signed_volume,
)
from napari_unwrap3d.geometry.topology import euler_characteristic as solid_euler
from napari_unwrap3d.parameters import ReferenceParameters, SealedParameters, SurfaceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping import reference as reference_step
from napari_unwrap3d.unwrapping.flow import curvature_flow
from napari_unwrap3d.unwrapping.reference import level_function, reference
from napari_unwrap3d.unwrapping.surface import sealed_surface, surface
from shapes import ball, bumpy, grid, icosphere, pear, torus

# As many vertices as such small solids have voxels on their boundary.
SMALL = ReferenceParameters(vertices=4000)


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
    plugged_mesh = reference_step.plugged_surface(sealed)
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
    opened, faces = reference_step.plugged_surface(cut)
    assert euler_characteristic(faces) == 2
    assert signed_volume(opened, faces) < signed_volume(cut.vertices, cut.faces)
    # The hole stays a hole: nothing of the mesh is near the middle of the ring.
    middle = np.array([1.0, 2.5, 2.5])
    assert np.linalg.norm(opened - middle, axis=1).min() > 0.9


def test_without_membranes_the_flow_starts_from_the_sealed_surface() -> None:
    sealed = sealed_of(Mask(ball(10, 33), (0.1,) * 3))
    vertices, faces = reference_step.plugged_surface(sealed)
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
    fixed = ReferenceParameters(stop="fixed", fixed_iteration=8, iterations=8)
    coarse = curvature_flow(fewer, triangles, fixed, silent())
    fine = curvature_flow(vertices, faces, fixed, silent())
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


def test_the_papers_mean_is_over_the_sealed_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    """The flow runs on a coarser mesh, whose vertices are fewer."""
    sealed = sealed_of(Mask(ball(10, 33), (0.1,) * 3))
    over: list[int] = []
    flow = reference_step.curvature_flow

    def spied(vertices, faces, *others, mean_over):
        over.extend((len(vertices), mean_over))
        return flow(vertices, faces, *others, mean_over=mean_over)

    monkeypatch.setattr(reference_step, "FLOW_VERTICES", 500)
    monkeypatch.setattr(reference_step, "curvature_flow", spied)
    reference(sealed, SMALL, silent())
    assert over[0] == pytest.approx(500, rel=0.05)
    assert over[1] == len(sealed.vertices)


def test_skipped_the_reference_is_the_sealed_surface() -> None:
    sealed = sealed_of(pear())
    chart = reference(sealed, SMALL.model_copy(update={"skip": True}), silent())
    assert (chart.iteration, chart.stopped_by) == (0, "skipped")
    assert len(chart.total_curvature) == 1
    np.testing.assert_array_equal(chart.mask.data[6:-6, 6:-6, 6:-6], sealed.mask.data)
    distance, _ = cKDTree(chart.vertices).query(sealed.vertices)
    assert distance.max() < 0.15
    assert euler_characteristic(chart.faces) == 2
    smooth = reference(sealed, SMALL.model_copy(update={"extra_iterations": 20}), silent())
    assert cKDTree(smooth.vertices).query(sealed.vertices)[0].max() > 0.15


@pytest.mark.parametrize("make", [pear, three_handles])
def test_the_mesh_can_be_the_sealed_surface_s_own(make: Callable[[], Mask]) -> None:
    sealed = sealed_of(make())
    direct = SMALL.model_copy(update={"skip": True, "keep_mesh": True, "mesh_smoothing": 5})
    chart = reference(sealed, direct, silent())
    assert (chart.iteration, chart.stopped_by) == (0, "skipped")
    np.testing.assert_array_equal(chart.vertices, sealed.vertices)
    np.testing.assert_array_equal(chart.faces, sealed.faces)
    np.testing.assert_array_equal(chart.mask.data[6:-6, 6:-6, 6:-6], sealed.mask.data)
    assert np.isfinite(chart.fields["mean_curvature_per_um"]).all()


def test_the_mesh_is_kept_only_where_nothing_is_smoothed() -> None:
    sealed = sealed_of(pear())
    plain, kept = (
        reference(sealed, SMALL.model_copy(update={"keep_mesh": keep}), silent())
        for keep in (False, True)
    )
    np.testing.assert_array_equal(kept.vertices, plain.vertices)


def test_the_volume_is_that_of_the_sealed_surface_where_it_is_kept() -> None:
    sealed = sealed_of(pear())
    volume = signed_volume(sealed.vertices, sealed.faces)
    late = {"stop": "fixed", "fixed_iteration": 30}
    kept = reference(sealed, SMALL.model_copy(update={**late, "keep_volume": True}), silent())
    assert kept.mask.data.sum() * 0.1**3 == pytest.approx(volume, rel=0.02)
    free = reference(sealed, SMALL.model_copy(update=late), silent())
    assert free.mask.data.sum() * 0.1**3 < 0.95 * volume


def test_the_mesh_can_be_smoothed_once_more() -> None:
    sealed = sealed_of(pear())
    plain = reference(sealed, SMALL, silent())
    smooth = reference(sealed, SMALL.model_copy(update={"mesh_smoothing": 15}), silent())
    np.testing.assert_array_equal(smooth.faces, plain.faces)
    moved = np.linalg.norm(smooth.vertices - plain.vertices, axis=1)
    assert 0.0 < moved.max() < 0.05  # half a voxel
    volumes = [signed_volume(chart.vertices, chart.faces) for chart in (smooth, plain)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-9)
