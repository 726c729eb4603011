"""Step 3: areas are kept, nothing is flipped, and the slider goes from one to the other."""

from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.distortion import (
    flipped_faces,
    mean_conformal_error,
    mean_log_area_distortion,
)
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.conformal import conformal_sphere
from napari_unwrap3d.unwrapping.equiareal import equiareal_sphere
from shapes import elongated, icosphere, lumpy

ARM = lumpy(4, size=0.8)
CONFORMAL = conformal_sphere(*ARM, silent())


def relaxed(blend: float = 1.0, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    return equiareal_sphere(ARM[0], CONFORMAL, ARM[1], silent(), blend=blend, **settings)


def test_areas_are_kept_to_the_tolerance_and_no_face_is_flipped() -> None:
    vertices, faces = ARM
    assert mean_log_area_distortion(vertices, CONFORMAL, faces) > 0.2
    found, history = relaxed(tolerance=0.01)
    assert flipped_faces(found, faces) == 0
    assert mean_log_area_distortion(vertices, found, faces) <= 0.01
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    assert history[-1] <= 0.01 < history[-2]


def test_the_history_is_the_error_it_speaks_of() -> None:
    vertices, faces = ARM
    found, history = relaxed()
    first = mean_log_area_distortion(vertices, CONFORMAL, faces)
    assert history[0] == pytest.approx(first)
    assert history[-1] == pytest.approx(mean_log_area_distortion(vertices, found, faces))
    assert history[-1] == min(history)


def test_every_region_gets_its_share() -> None:
    """Not only on average: a cap of the body covers its share of the sphere."""
    vertices, faces = ARM
    found, _ = relaxed()
    area = face_areas(vertices, faces) / face_areas(vertices, faces).sum()
    share = face_areas(found, faces) / face_areas(found, faces).sum()
    for axis in np.eye(3):
        for part in (vertices[faces].mean(axis=1) @ axis > 0.8, vertices[faces][:, 0] @ axis < 0):
            assert share[part].sum() == pytest.approx(area[part].sum(), rel=0.01)


def test_the_slider_goes_from_angles_to_areas() -> None:
    vertices, faces = ARM
    blends = [relaxed(blend)[0] for blend in (0.0, 0.3, 0.7, 1.0)]
    q = [mean_conformal_error(vertices, found, faces) for found in blends]
    areas = [mean_log_area_distortion(vertices, found, faces) for found in blends]
    assert q[0] < q[1] < q[2] < q[3]
    assert areas[0] > areas[1] > areas[2] > areas[3]
    assert all(flipped_faces(found, faces) == 0 for found in blends)


@pytest.mark.parametrize(("vertices", "seed", "length"), [(2500, 0, 2.0), (4000, 3, 3.0)])
def test_the_slider_is_monotone_and_flips_nothing_on_its_whole_way(
    vertices: int, seed: int, length: float
) -> None:
    points, faces = elongated(vertices, seed, length)
    conformal = conformal_sphere(points, faces, silent())
    q, areas = [], []
    for blend in np.linspace(0.0, 1.0, 11):
        found, _ = equiareal_sphere(points, conformal, faces, silent(), blend=float(blend))
        assert flipped_faces(found, faces) == 0
        q.append(mean_conformal_error(points, found, faces))
        areas.append(mean_log_area_distortion(points, found, faces))
    assert (np.diff(q) > 0).all()
    assert (np.diff(areas) < 0).all()
    assert areas[-1] < 0.005 < 0.5 < areas[0]


def test_all_faces_can_be_given_the_same_area() -> None:
    points, faces = elongated()
    conformal = conformal_sphere(points, faces, silent())
    alike = np.full(len(faces), 1.0 / len(faces))
    found, history = equiareal_sphere(points, conformal, faces, silent(), wanted=alike)
    areas = face_areas(found, faces)
    assert flipped_faces(found, faces) == 0
    assert areas.std() < 0.03 * areas.mean()
    assert face_areas(points, faces).std() > 0.4 * face_areas(points, faces).mean()
    assert history[-1] == pytest.approx(np.abs(np.log(areas / areas.sum() * len(faces))).mean())


def test_the_way_to_a_blend_may_begin_at_another_one() -> None:
    near, _ = relaxed(0.6)
    direct, _ = relaxed(0.7, tolerance=0.001)
    found, history = relaxed(0.7, tolerance=0.001, start=near)
    assert flipped_faces(found, ARM[1]) == 0
    assert history[0] < 0.1
    assert np.abs(found - direct).max() < 0.02


def test_at_zero_the_conformal_map_comes_back() -> None:
    found, history = relaxed(0.0)
    np.testing.assert_array_equal(found, CONFORMAL)
    assert history[-1] == pytest.approx(0.0, abs=1e-12)


def test_no_iterations_or_a_reached_tolerance_change_nothing() -> None:
    found, history = relaxed(tolerance=10.0)
    np.testing.assert_array_equal(found, CONFORMAL)
    assert len(history) == 1


def test_a_sphere_is_already_equiareal() -> None:
    vertices, faces = icosphere(3)
    found, _ = equiareal_sphere(3 * vertices, vertices, faces, silent(), tolerance=1e-6)
    assert np.abs(found - vertices).max() < 1e-3


def test_size_does_not_matter() -> None:
    vertices, faces = ARM
    plain, _ = relaxed(tolerance=0.02)
    scaled, _ = equiareal_sphere(1e4 * vertices, CONFORMAL, faces, silent(), tolerance=0.02)
    np.testing.assert_allclose(scaled, plain, atol=1e-6)


def test_a_badly_squeezed_start_is_brought_home() -> None:
    vertices, faces = icosphere(4)
    squeezed = vertices + np.array([0, 0, 0.93])
    squeezed /= np.linalg.norm(squeezed, axis=1, keepdims=True)
    ratio = face_areas(squeezed, faces)
    assert ratio.max() / ratio.min() > 300
    assert mean_log_area_distortion(vertices, squeezed, faces) > 0.8
    found, _ = equiareal_sphere(vertices, squeezed, faces, silent(), tolerance=0.05)
    assert flipped_faces(found, faces) == 0
    assert mean_log_area_distortion(vertices, found, faces) < 0.1


def test_the_same_input_gives_the_same_map_bit_for_bit() -> None:
    first, _ = relaxed(tolerance=0.02)
    second, _ = relaxed(tolerance=0.02)
    np.testing.assert_array_equal(first, second)


def test_it_reports_and_can_be_cancelled() -> None:
    seen: list[float] = []
    progress = Progress(lambda step, fraction, text: seen.append(fraction))
    equiareal_sphere(ARM[0], CONFORMAL, ARM[1], progress)
    assert seen
    assert seen == sorted(seen)
    progress.cancel()
    with pytest.raises(Cancelled):
        equiareal_sphere(ARM[0], CONFORMAL, ARM[1], progress)
