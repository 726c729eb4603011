"""Step 1: the flow against its equations, and its stops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import Cancelled, MeshError
from napari_unwrap3d.geometry.distortion import mean_conformal_error
from napari_unwrap3d.geometry.intrinsic import LAPLACIANS
from napari_unwrap3d.geometry.laplacian import cotangent_laplacian
from napari_unwrap3d.geometry.mesh import face_areas, signed_volume
from napari_unwrap3d.parameters import ReferenceParameters
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping import flow as flow_module
from napari_unwrap3d.unwrapping.flow import (
    change_points,
    curvature_flow,
    flow_step,
    stopping_rule,
)
from shapes import bumpy, icosphere, lumpy, rotation

FIXED = ReferenceParameters(stop="fixed", fixed_iteration=8, iterations=8)
MASSES = ("barycentric", "voronoi", "full")


def fixed(**settings: object) -> ReferenceParameters:
    return FIXED.model_copy(update=settings)


def test_the_flow_makes_the_body_rounder_at_every_iteration() -> None:
    vertices, faces = bumpy()
    flow = curvature_flow(vertices, faces, FIXED, silent())
    assert flow.iteration == 8
    assert len(flow.total_curvature) == 9
    assert (np.diff(flow.total_curvature) < 0).all()
    assert flow.total_curvature[0] > 1.5
    assert flow.total_curvature[-1] == pytest.approx(1.0, abs=0.1)


def test_the_result_has_unit_area_around_the_origin() -> None:
    vertices, faces = bumpy()
    flow = curvature_flow(50 * vertices + [1000, 2000, -500], faces, FIXED, silent())
    area = face_areas(flow.vertices, faces)
    assert area.sum() == pytest.approx(1.0)
    centroid = area @ flow.vertices[faces].mean(axis=1)
    np.testing.assert_allclose(centroid, 0, atol=1e-9)
    assert signed_volume(flow.vertices, faces) > 0


def test_size_place_and_orientation_do_not_matter() -> None:
    vertices, faces = bumpy()
    turn = rotation(0)
    plain = curvature_flow(vertices, faces, FIXED, silent())
    moved = curvature_flow(7 * vertices @ turn.T + 3, faces, FIXED, silent())
    np.testing.assert_allclose(moved.vertices, plain.vertices @ turn.T, atol=1e-6)
    np.testing.assert_allclose(moved.total_curvature, plain.total_curvature, atol=1e-6)


def test_a_sphere_does_not_change() -> None:
    directions, faces = icosphere(3)
    flow = curvature_flow(directions, faces, FIXED, silent())
    radius = np.linalg.norm(flow.vertices, axis=1)
    assert np.ptp(radius) / radius.mean() < 0.01
    np.testing.assert_allclose(flow.total_curvature, 1.0, atol=1e-6)


def test_the_flow_converges_to_a_conformal_sphere() -> None:
    """Its limit is the conformal map to the sphere (Kazhdan, Solomon and Ben-Chen 2012)."""
    vertices, faces = lumpy(3)
    parameters = ReferenceParameters(stop="fixed", fixed_iteration=100, iterations=100, delta=0.1)
    flow = curvature_flow(vertices, faces, parameters, silent())
    radius = np.linalg.norm(flow.vertices, axis=1)
    assert radius.std() / radius.mean() < 0.02
    assert mean_conformal_error(vertices, flow.vertices, faces) < 1.05


def test_a_larger_step_smooths_more() -> None:
    vertices, faces = bumpy()
    curves = [
        curvature_flow(
            vertices, faces, FIXED.model_copy(update={"delta": delta}), silent()
        ).total_curvature[2]
        for delta in (1e-4, 5e-4, 5e-3)
    ]
    assert curves[0] > curves[1] > curves[2]


def test_the_flow_reports_and_can_be_cancelled() -> None:
    vertices, faces = bumpy()
    seen: list[float] = []
    curvature_flow(vertices, faces, FIXED, Progress(lambda s, f, m: seen.append(f)))
    assert seen == sorted(seen)
    assert len(seen) >= 8
    progress = Progress()
    progress.callback = lambda step, fraction, message: fraction > 0.3 and progress.cancel()
    with pytest.raises(Cancelled):
        curvature_flow(vertices, faces, FIXED, progress)


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


def test_a_rule_that_fires_early_waits_for_the_minimum() -> None:
    """The paper stops at max(t_min, t_K), not at the first t from t_min on at which it fires."""
    paper = {"stop": "paper", "threshold": 1e-3, "minimum_iterations": 3}
    step = 2 * 1e-3 / (4 * np.pi / 1000)
    curve = [9.0, 9.0 - step, 9.0 - step, 9.0 - 2 * step, 9.0 - 3 * step]
    assert [rule(curve[: n + 1], **paper) for n in range(1, 5)] == ["", "", "paper", "paper"]
    low = {"curvature_limit": 1.6, "minimum_iterations": 3}
    assert [rule([3.0, 1.5, 1.5, 1.7][:n], **low) for n in (2, 3, 4)] == ["", "", "total_curvature"]


def test_the_first_change_point_is_where_the_steep_fall_ends() -> None:
    assert change_points(np.array([3.0, 2.0])) == []
    assert change_points(np.array([3.0, 2.0, 1.5])) == []
    assert change_points(np.array([3.0, 2.0, 1.5, 1.45])) == [3]
    assert rule([3.0, 2.0, 1.5, 1.45], stop="change_point") == "change_point"


def test_later_change_points_end_later_falls() -> None:
    """Two kinds of protrusions, of two sizes, vanish one after the other."""
    steps = np.array([2.0, 1.0, 0.1, 0.1, 0.8, 0.6, 0.3, 0.05, 0.05, 0.004])
    curve = 6.0 - np.concatenate([[0.0], np.cumsum(steps)])
    assert change_points(curve) == [3, 8, 10]
    for which, iteration in enumerate([3, 8, 10], start=1):
        settings = {"stop": "change_point", "change_point": which}
        assert rule(list(curve[: iteration + 1]), **settings) == "change_point"
        assert rule(list(curve[:iteration]), **settings) == ""


@given(seed=st.integers(0, 1000), size=st.floats(0.1, 10))
def test_change_points_depend_on_the_shape_of_the_curve_only(seed: int, size: float) -> None:
    curve = np.sort(np.random.default_rng(seed).random(20))[::-1]
    assert change_points(curve) == change_points(size * curve + 3.0)
    # What comes later does not change what was found.
    assert change_points(curve[:12]) == [p for p in change_points(curve) if p < 12]


def test_extra_and_maximal_iterations() -> None:
    vertices, faces = bumpy()
    none = ReferenceParameters(extra_iterations=0)
    plain = curvature_flow(vertices, faces, none, silent())
    assert plain.stopped_by == "total_curvature"
    assert plain.total_curvature[-1] < 1.6 <= plain.total_curvature[-2]
    more = curvature_flow(vertices, faces, ReferenceParameters(extra_iterations=2), silent())
    assert more.iteration == plain.iteration + 2
    assert more.stopped_by == plain.stopped_by
    few = ReferenceParameters(stop="fixed", fixed_iteration=50, iterations=2)
    short = curvature_flow(vertices, faces, few, silent())
    assert (short.iteration, short.stopped_by) == (2, "maximum iterations")
    exact = curvature_flow(vertices, faces, fixed(fixed_iteration=3, extra_iterations=2), silent())
    assert (exact.iteration, exact.stopped_by) == (3, "fixed")


# The equations ----------------------------------------------------------------------


def mean_radius(points: np.ndarray) -> float:
    return float(np.linalg.norm(points, axis=1).mean())


@pytest.mark.parametrize("mass", MASSES)
@pytest.mark.parametrize("laplacian", LAPLACIANS)
def test_mean_curvature_flow_shrinks_a_sphere_at_two_over_r(laplacian: str, mass: str) -> None:
    """dr/dt = −2/r; the implicit step has r(t + δ) = r / (1 + 2δ / r²)."""
    points, faces = icosphere(4)
    points, delta = 3.0 * points, 0.4
    expected = 3.0
    for _ in range(4):
        stiffness = delta * LAPLACIANS[laplacian](points, faces)
        points = flow_step(points, faces, stiffness, mass, silent())
        expected /= 1 + 2 * delta / expected**2
        radius = np.linalg.norm(points, axis=1)
        assert radius.mean() == pytest.approx(expected, rel=0.003)
        assert np.ptp(radius) < 0.01 * expected
    small = 1e-4
    step = flow_step(points, faces, small * LAPLACIANS[laplacian](points, faces), mass, silent())
    speed = (mean_radius(step) - mean_radius(points)) / small
    assert speed == pytest.approx(-2 / mean_radius(points), rel=0.01)


def test_the_conformalized_flow_of_a_sphere_uses_the_laplacian_of_the_start() -> None:
    """M_t = (r / r_0)² M_0 and L_0 x = −2 / r_0² M_0 x: r(t + δ) = r³ / (r² + 2δ)."""
    points, faces = icosphere(4)
    stiffness = 0.05 * cotangent_laplacian(points, faces)
    expected = 1.0
    for _ in range(4):
        points = flow_step(points, faces, stiffness, "barycentric", silent())
        expected = expected**3 / (expected**2 + 2 * 0.05)
        assert mean_radius(points) == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("mass", MASSES)
@pytest.mark.parametrize("laplacian", LAPLACIANS)
@pytest.mark.parametrize("kind", ["cMCF", "MCF"])
def test_every_flow_rounds_the_body_and_turns_with_it(kind: str, laplacian: str, mass: str) -> None:
    vertices, faces = lumpy(3)
    parameters = fixed(flow=kind, laplacian=laplacian, mass=mass, delta=5e-3, fixed_iteration=3)
    turn = rotation(3)
    plain = curvature_flow(vertices, faces, parameters, silent())
    moved = curvature_flow(5 * vertices @ turn.T - 2, faces, parameters, silent())
    np.testing.assert_allclose(moved.vertices, plain.vertices @ turn.T, atol=1e-7)
    start, end = (
        np.linalg.norm(points - points.mean(axis=0), axis=1)
        for points in (vertices, plain.vertices)
    )
    assert end.std() / end.mean() < 0.9 * start.std() / start.mean()


def test_the_two_flows_take_the_same_first_step_and_then_part() -> None:
    vertices, faces = bumpy()
    one, two = (
        [
            curvature_flow(vertices, faces, fixed(flow=kind, fixed_iteration=n), silent()).vertices
            for kind in ("cMCF", "MCF")
        ]
        for n in (1, 2)
    )
    np.testing.assert_array_equal(*one)
    assert np.abs(two[0] - two[1]).max() > 1e-4


@pytest.mark.parametrize("kind", ["cMCF", "MCF"])
def test_the_volume_is_kept_after_every_iteration(kind: str) -> None:
    vertices, faces = bumpy()
    area = face_areas(vertices, faces).sum()
    volume = signed_volume(vertices, faces) / area**1.5
    areas = [1.0]
    for n in (1, 4, 8):
        settings = fixed(flow=kind, keep_volume=True, fixed_iteration=n, delta=1e-3)
        points = curvature_flow(vertices, faces, settings, silent()).vertices
        assert signed_volume(points, faces) == pytest.approx(volume, rel=1e-9)
        areas.append(face_areas(points, faces).sum())
    assert (np.diff(areas) < 0).all()
    # Of all bodies of its volume the ball has the smallest area.
    assert areas[-1] >= (36 * np.pi * volume**2) ** (1 / 3)


def test_a_flow_that_breaks_down_stops_before(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = lumpy(2)
    steps: list[int] = []
    step = flow_module.flow_step

    def breaking(*arguments):
        steps.append(1)
        if len(steps) == 3:
            raise RuntimeError("Factor is exactly singular")
        return step(*arguments)

    monkeypatch.setattr(flow_module, "flow_step", breaking)
    flow = curvature_flow(vertices, faces, FIXED, silent())
    assert (flow.iteration, flow.stopped_by) == (2, "breakdown")
    assert len(flow.total_curvature) == 3
    assert np.isfinite(flow.vertices).all()


def test_a_flow_that_breaks_down_at_once_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = lumpy(2)
    monkeypatch.setattr(flow_module, "flow_step", lambda *_: np.full(vertices.shape, np.nan))
    with pytest.raises(MeshError, match=r"at once.*robust Laplacian"):
        curvature_flow(vertices, faces, FIXED, silent())


def test_collapsed_triangles_need_the_robust_laplacian() -> None:
    vertices, faces = bumpy()
    vertices[faces[0, 0]] = vertices[faces[0, 1]]
    with pytest.raises(MeshError, match="robust"):
        curvature_flow(vertices, faces, fixed(laplacian="intrinsic-delaunay"), silent())
    flow = curvature_flow(vertices, faces, fixed(laplacian="robust"), silent())
    assert flow.iteration == 8
    assert flow.total_curvature[-1] < flow.total_curvature[0]
