"""Step 3 as the paper does it: it relaxes, its boundary is counted, the best map is kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.distortion import flipped_faces, mean_log_area_distortion
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.advection import PATIENCE, Advected, _velocity, advected_sphere
from napari_unwrap3d.unwrapping.conformal import conformal_sphere
from napari_unwrap3d.unwrapping.criteria import Criterion, wanted_shares
from shapes import elongated, icosphere

BODY, FACES = elongated(2000, 1)
CONFORMAL = conformal_sphere(BODY, FACES, silent())
WANTED = wanted_shares(BODY, FACES, "reference")


def criterion(name: str = "equiareal", theta: float | None = None) -> Criterion:
    return Criterion(name, theta, BODY, FACES, WANTED)


def advected(chosen: Criterion | None = None, **settings: Any) -> Advected:
    chosen = chosen or criterion()
    return advected_sphere(CONFORMAL, FACES, WANTED, chosen, silent(), **settings)


@pytest.fixture(scope="module")
def relaxed() -> Advected:
    return advected()


def test_areas_are_nearly_kept_and_no_face_is_flipped(relaxed: Advected) -> None:
    assert relaxed.errors[0] > 0.3
    found = mean_log_area_distortion(BODY, relaxed.directions, FACES)
    assert found == pytest.approx(relaxed.errors[relaxed.iteration])
    assert found < 0.06
    assert flipped_faces(relaxed.directions, FACES) == 0
    np.testing.assert_allclose(np.linalg.norm(relaxed.directions, axis=1), 1.0, atol=1e-12)


def test_the_best_iteration_is_taken_and_the_search_ends(relaxed: Advected) -> None:
    assert relaxed.iteration == int(np.argmin(relaxed.values))
    assert len(relaxed.values) <= relaxed.iteration + PATIENCE + 1
    assert len(relaxed.values) == len(relaxed.errors) == len(relaxed.flips)
    assert relaxed.flips[relaxed.iteration] == 0
    np.testing.assert_array_equal(np.isinf(relaxed.values), relaxed.flips > 0)


def test_an_iteration_is_what_that_many_iterations_give(relaxed: Advected) -> None:
    found = advected(iterations=relaxed.iteration)
    np.testing.assert_array_equal(found.directions, relaxed.directions)
    np.testing.assert_array_equal(found.errors, relaxed.errors[: relaxed.iteration + 1])


def test_with_a_small_stiffness_faces_flip_and_are_counted() -> None:
    """The paper's second δ, on a mesh far coarser than its own."""
    found = advected(delta=5e-3)
    assert found.flips.max() > 100
    assert flipped_faces(found.directions, FACES) == 0
    assert found.errors[found.iteration] < found.errors[0]


def test_other_criteria_stop_earlier(relaxed: Advected) -> None:
    mips = advected(criterion("mips"))
    both = advected(criterion("q_log_lambda"))
    area = advected(criterion("area_mips"))
    assert mips.iteration == 0
    np.testing.assert_array_equal(mips.directions, CONFORMAL)
    assert 0 < both.iteration < relaxed.iteration
    assert 0 < area.iteration < relaxed.iteration
    heavier = advected(criterion("q_log_lambda", 0.9))
    assert both.iteration < heavier.iteration


def test_all_faces_can_be_given_the_same_area() -> None:
    alike = wanted_shares(BODY, FACES, "uniform")
    chosen = Criterion("equiareal", None, BODY, FACES, alike)
    found = advected_sphere(CONFORMAL, FACES, alike, chosen, silent())
    spread = [face_areas(v, FACES).std() / face_areas(v, FACES).mean() for v in (BODY, CONFORMAL)]
    areas = face_areas(found.directions, FACES)
    assert areas.std() / areas.mean() < 0.15 < min(spread)


def test_a_reached_tolerance_or_no_iterations_change_nothing() -> None:
    for settings in ({"tolerance": 10.0}, {"iterations": 0}):
        found = advected(**settings)
        np.testing.assert_array_equal(found.directions, CONFORMAL)
        assert (found.iteration, len(found.errors)) == (0, 1)


def test_vertices_leave_where_faces_are_too_small() -> None:
    """Down the slope of log λ, tangentially, by a mean edge in the median."""
    vertices, faces = icosphere(3)
    wanted = face_areas(vertices, faces) * np.exp(vertices[faces].mean(axis=1)[:, 0])
    velocity = _velocity(vertices, faces, wanted / wanted.sum())
    south = velocity[:, 0]
    equator = np.abs(vertices[:, 0]) < 0.9
    assert (south[equator] < 0).all()
    assert np.abs(np.einsum("ij,ij->i", velocity, vertices)).max() < 0.02
    edges = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1)
    assert np.median(np.linalg.norm(velocity, axis=1)) == pytest.approx(edges.mean(), rel=0.1)


def test_the_same_input_gives_the_same_map_bit_for_bit(relaxed: Advected) -> None:
    np.testing.assert_array_equal(advected().directions, relaxed.directions)


def test_it_reports_and_can_be_cancelled() -> None:
    seen: list[float] = []
    progress = Progress(lambda step, fraction, text: seen.append(fraction))
    advected_sphere(CONFORMAL, FACES, WANTED, criterion(), progress, iterations=5)
    assert seen == sorted(seen)
    assert len(seen) == 5
    progress.cancel()
    with pytest.raises(Cancelled):
        advected_sphere(CONFORMAL, FACES, WANTED, criterion(), progress)
