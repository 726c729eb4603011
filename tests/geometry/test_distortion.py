"""Stretch of maps with a known answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.geometry.distortion import (
    area_distortion,
    conformal_error,
    flipped_faces,
    mean_conformal_error,
    mean_log_area_distortion,
    singular_values,
    spherical_determinants,
)
from napari_unwrap3d.geometry.mesh import face_areas
from shapes import icosphere, lumpy, rotation

FLAT = np.column_stack([np.zeros(60), np.random.default_rng(0).random((60, 2))])
TRIANGLES = np.random.default_rng(1).permuted(np.tile(np.arange(60), (40, 1)), axis=1)[:, :3]
factors = st.floats(0.05, 20.0)


@settings(max_examples=30)
@given(a=factors, b=factors, seed=st.integers(0, 1000))
def test_a_plane_stretched_by_two_factors(a: float, b: float, seed: int) -> None:
    stretched = FLAT * [1, a, b] @ rotation(seed).T + 3
    larger, smaller = singular_values(FLAT, stretched, TRIANGLES)
    np.testing.assert_allclose(larger, max(a, b), rtol=1e-6)
    np.testing.assert_allclose(smaller, min(a, b), rtol=1e-6)
    np.testing.assert_allclose(
        conformal_error(FLAT, stretched, TRIANGLES), max(a, b) / min(a, b), rtol=1e-6
    )
    # Every face is stretched by the same factor, so the shares of area stay.
    np.testing.assert_allclose(area_distortion(FLAT, stretched, TRIANGLES), 1.0, rtol=1e-6)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), scale=st.floats(1e-3, 1e3))
def test_rotations_shifts_and_scales_of_either_side_do_not_count(seed: int, scale: float) -> None:
    source, faces = lumpy(2)
    target = icosphere(2)[0]
    q = conformal_error(source, target, faces)
    share = area_distortion(source, target, faces)
    moved = scale * source @ rotation(seed).T - 2
    turned = target @ rotation(seed + 1).T / scale
    np.testing.assert_allclose(conformal_error(moved, turned, faces), q, rtol=1e-6)
    np.testing.assert_allclose(area_distortion(moved, turned, faces), share, rtol=1e-6)
    np.testing.assert_allclose(conformal_error(turned, moved, faces), q, rtol=1e-6)


def test_identity_has_no_distortion() -> None:
    vertices, faces = lumpy(2)
    np.testing.assert_allclose(conformal_error(vertices, vertices, faces), 1.0, atol=1e-6)
    assert mean_conformal_error(vertices, vertices, faces) == pytest.approx(1.0, abs=1e-6)
    assert mean_log_area_distortion(vertices, vertices, faces) == pytest.approx(0.0, abs=1e-12)


def test_area_distortion_is_the_share_of_the_source_over_that_of_the_target() -> None:
    """Of two equal triangles one is stretched three times: shares ½ become ¼ and ¾."""
    source = np.array([[0.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]])
    target = source * [1, 1, 1]
    target[3] = [0, -3, 0]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    np.testing.assert_allclose(area_distortion(source, target, faces), [2.0, 2.0 / 3.0])
    expected = (np.log(2) + np.log(1.5)) / 2
    assert mean_log_area_distortion(source, target, faces) == pytest.approx(expected)
    np.testing.assert_allclose(conformal_error(source, target, faces), [1.0, 3.0])


def test_the_mean_of_q_is_weighted_by_the_area_of_the_source() -> None:
    source, faces = lumpy(2)
    target = icosphere(2)[0]
    q, area = conformal_error(source, target, faces), face_areas(source, faces)
    expected = (q * area).sum() / area.sum()
    assert mean_conformal_error(source, target, faces) == pytest.approx(expected)


@pytest.mark.parametrize("corners", [(0, 1), (1, 2), (2, 0), (0, 1, 2)])
def test_a_collapsed_face_is_infinitely_bad_and_not_nan(corners: tuple[int, ...]) -> None:
    vertices, faces = icosphere(1)
    target = vertices.copy()
    target[faces[3, list(corners)]] = target[faces[3, corners[0]]]
    q = conformal_error(vertices, target, faces)
    assert not np.isnan(q).any()
    assert q.min() > 1.0 - 1e-12
    assert q[3] > 1e12
    larger, smaller = singular_values(vertices, target, faces)
    assert smaller[3] < 1e-12
    assert (larger[3] > 0.1) == (len(corners) == 2)
    assert np.isfinite(mean_log_area_distortion(vertices, target, faces))


def test_determinants_of_the_octahedron() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [0, 2, 4], [3, 2, 1], [0, 5, 1]])
    np.testing.assert_allclose(np.abs(spherical_determinants(axes, faces)), 1.0)
    assert spherical_determinants(axes, faces[:1]) == 1.0


def test_flips_collapses_and_nan_all_count() -> None:
    vertices, faces = icosphere(2)
    assert flipped_faces(vertices, faces) == 0
    assert flipped_faces(vertices, faces[:, ::-1]) == len(faces)
    turned = faces.copy()
    turned[5] = turned[5, ::-1]
    assert flipped_faces(vertices, turned) == 1
    around = (faces == 7).any(axis=1).sum()
    for bad in (np.nan, np.inf, 0.0):
        broken = vertices.copy()
        broken[7] = bad
        with np.errstate(invalid="ignore"):
            assert flipped_faces(broken, faces) == around
