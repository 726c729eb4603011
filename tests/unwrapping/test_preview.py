"""Shapes shown while a slider moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.geometry.curvature import total_absolute_curvature
from napari_unwrap3d.parameters import ReferenceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.preview import between_blends, flow_preview, iterations_to_keep


def test_every_iteration_is_kept_and_lies_on_the_cell(small_atlas: Atlas) -> None:
    sealed = small_atlas.sealed
    preview = flow_preview(sealed, ReferenceParameters(), 4, silent(), vertices=1500)
    assert preview.frames.shape == (5, preview.frames.shape[1], 3)
    assert preview.frames.dtype == np.float32
    curve = [
        total_absolute_curvature(frame.astype(float), preview.faces) for frame in preview.frames
    ]
    assert (np.diff(curve) < 0).all(), "every iteration is smoother than the last"
    size = np.ptp(sealed.vertices, axis=0)
    for frame in preview.frames:
        np.testing.assert_allclose(np.ptp(frame, axis=0), size, rtol=0.35)
        np.testing.assert_allclose(
            frame.mean(axis=0), sealed.vertices.mean(axis=0), atol=0.1 * size.max()
        )
    np.testing.assert_array_equal(preview.at(99), preview.frames[-1])


def test_a_sealed_surface_without_its_mask_is_refused(small_atlas: Atlas) -> None:
    bare = replace(small_atlas.sealed, mask=None)
    with pytest.raises(ParameterError, match="mask"):
        flow_preview(bare, ReferenceParameters(), 4, silent())


def test_as_many_iterations_are_kept_as_can_be_of_interest() -> None:
    assert iterations_to_keep(ReferenceParameters(), 5) == 20
    assert iterations_to_keep(ReferenceParameters(), 40) == 50
    fixed = ReferenceParameters(stop="fixed", fixed_iteration=60)
    assert iterations_to_keep(fixed, 50) == 70


def test_blends_go_along_great_circles() -> None:
    rng = np.random.default_rng(0)
    states = {}
    for blend in (0.0, 0.5, 1.0):
        vectors = rng.normal(size=(20, 3))
        states[blend] = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    for blend, expected in states.items():
        np.testing.assert_allclose(between_blends(states, blend), expected, atol=1e-12)
    middle = between_blends(states, 0.25)
    np.testing.assert_allclose(np.linalg.norm(middle, axis=1), 1.0)
    to_start = np.einsum("ij,ij->i", middle, states[0.0])
    to_stop = np.einsum("ij,ij->i", middle, states[0.5])
    np.testing.assert_allclose(to_start, to_stop, atol=1e-12)
    same = {0.0: states[0.0], 1.0: states[0.0]}
    np.testing.assert_allclose(between_blends(same, 0.3), states[0.0], atol=1e-12)


def test_one_state_is_not_enough() -> None:
    with pytest.raises(ParameterError):
        between_blends({0.0: np.eye(3)}, 0.5)
