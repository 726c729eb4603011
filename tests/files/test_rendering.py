"""A rendered mesh is in its place, the right way round, and hides what lies behind."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.files.rendering import OVERSAMPLING, VIEWS, render
from synthetic import icosphere


@pytest.mark.parametrize("view", list(VIEWS))
def test_views_do_not_mirror(view: str) -> None:
    rotation = VIEWS[view]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_a_sphere_covers_its_disk_and_is_as_large_as_its_extent_says() -> None:
    vertices, faces = icosphere(5)
    drawn = render(3.0 * vertices + [7.0, 8.0, 9.0], faces, "z", 300)
    left, right, bottom, top = drawn.extent
    assert (left + right) / 2 == pytest.approx(9.0, abs=1e-6)
    assert (top + bottom) / 2 == pytest.approx(8.0, abs=1e-6)
    pixel = (right - left) / drawn.seen.shape[1]
    assert drawn.seen.shape == (300 * OVERSAMPLING, 300 * OVERSAMPLING)
    assert drawn.seen.sum() * pixel**2 == pytest.approx(np.pi * 9.0, rel=5e-3)


@pytest.mark.parametrize("view", list(VIEWS))
def test_every_pixel_shows_the_point_of_the_surface_that_lies_there(view: str) -> None:
    vertices, faces = icosphere(4)
    vertices = vertices * [1.0, 2.0, 3.0]  # three axes that cannot be mistaken
    drawn = render(vertices, faces, view, 200)
    left, right, bottom, top = drawn.extent
    rows, columns = np.nonzero(drawn.seen)
    seen = vertices @ VIEWS[view].T
    down = top + (rows + 0.5) * (bottom - top) / drawn.seen.shape[0]
    across = left + (columns + 0.5) * (right - left) / drawn.seen.shape[1]
    np.testing.assert_allclose(drawn.interpolate(seen[:, 1]), down, atol=2e-5)
    np.testing.assert_allclose(drawn.interpolate(seen[:, 2]), across, atol=2e-5)
    assert (drawn.interpolate(seen[:, 0]) < 1e-2).all()  # only the near half


def test_what_lies_in_front_hides_what_lies_behind_in_any_order() -> None:
    vertices, faces = icosphere(2)
    both = np.concatenate([vertices + np.array([5.0, 0.0, 0.0]), vertices])
    for order in (1, -1):
        joined = np.concatenate([faces, faces + len(vertices)])[::order]
        drawn = render(both, joined, "z", 100)
        assert (drawn.corners >= len(vertices)).all()


def test_faces_seen_from_behind_are_not_drawn() -> None:
    vertices, faces = icosphere(1)
    inside_out = render(vertices, faces[:, ::-1], "z", 50)
    depth = inside_out.interpolate(vertices[:, 0])
    assert (depth > -1e-2).all()  # the far wall, seen through the near one


def test_light_falls_on_the_upper_left_and_edges_are_smooth() -> None:
    vertices, faces = icosphere(4)
    drawn = render(vertices, faces, "z", 100)
    image = drawn.image(np.full((len(drawn.face), 3), 0.8))
    assert image.shape == (100, 100, 4)
    assert image[30, 30, :3].min() > image[75, 75, :3].max()
    alpha = np.unique(image[..., 3])
    assert alpha[0] == 0.0
    assert alpha[-1] == 1.0
    assert len(alpha) == OVERSAMPLING**2 + 1
