"""Smoothing that keeps the volume."""

import numpy as np
import pytest

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.mesh import face_areas, signed_volume
from napari_unwrap3d.geometry.smoothing import smooth_keeping_volume
from napari_unwrap3d.progress import Progress, silent
from shapes import icosphere, lumpy, rotation


def rough() -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = lumpy(3)
    noise = np.random.default_rng(0).normal(size=(len(vertices), 1))
    return vertices * (1 + 0.02 * noise), faces


def test_noise_goes_and_the_volume_stays() -> None:
    vertices, faces = rough()
    smooth = smooth_keeping_volume(vertices, faces, silent(), iterations=3)
    assert signed_volume(smooth, faces) == pytest.approx(signed_volume(vertices, faces))
    clean = lumpy(3)[0]
    before, after = (np.linalg.norm(v - clean, axis=1).mean() for v in (vertices, smooth))
    assert after < 0.7 * before
    assert face_areas(smooth, faces).sum() < face_areas(vertices, faces).sum()


def test_size_place_and_orientation_do_not_matter() -> None:
    vertices, faces = rough()
    turn = rotation(0)
    plain = smooth_keeping_volume(vertices, faces, silent(), iterations=4)
    moved = smooth_keeping_volume(5 * vertices @ turn.T + 30, faces, silent(), iterations=4)
    np.testing.assert_allclose(moved, 5 * plain @ turn.T + 30, atol=1e-9)


def test_a_sphere_stays_where_and_as_large_as_it_is() -> None:
    directions, faces = icosphere(3)
    smooth = smooth_keeping_volume(directions + 10.0, faces, silent(), iterations=10)
    np.testing.assert_allclose(np.linalg.norm(smooth - 10.0, axis=1), 1.0, atol=0.01)


def test_nothing_is_done_in_no_iterations_or_steps() -> None:
    vertices, faces = rough()
    assert smooth_keeping_volume(vertices, faces, silent(), iterations=0) is vertices
    same = smooth_keeping_volume(vertices, faces, silent(), iterations=3, step=0.0)
    np.testing.assert_allclose(same, vertices, atol=1e-12)


def test_it_can_be_cancelled() -> None:
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        smooth_keeping_volume(*rough(), progress, iterations=3)
