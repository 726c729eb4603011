import numpy as np
import pytest

from napari_unwrap3d.geometry.brush import Brush, lasso, ring
from napari_unwrap3d.geometry.picking import RayPicker
from synthetic import icosphere


def sheet(n=40, step=0.1):
    """A flat sheet of (n, n) vertices in the plane z = 0, y and x from 0."""
    y, x = np.mgrid[:n, :n] * step
    vertices = np.stack([np.zeros(n * n), y.ravel(), x.ravel()], axis=1)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n + 1], 1), np.stack([a, a + n + 1, a + n], 1)])
    return vertices, faces


def at(vertices, faces, point):
    """The face of a sheet below a point (y, x), and the point."""
    middle = vertices[faces].mean(axis=1)
    face = np.linalg.norm(middle[:, 1:] - point, axis=1).argmin()
    return np.array([face]), vertices[faces[face]].mean(axis=0)[None]


def test_on_a_flat_sheet_the_brush_is_round():
    vertices, faces = sheet()
    face, point = at(vertices, faces, [2.0, 2.0])
    found = Brush(vertices, faces).vertices(face, point, 0.75)
    ball = np.flatnonzero(np.linalg.norm(vertices - point[0], axis=1) <= 0.75)
    assert found.tolist() == ball.tolist()


def test_the_brush_stays_on_its_fold():
    """Two sheets a tenth of a brush apart, joined at one side only."""
    vertices, faces = sheet()
    other = vertices + np.array([0.05, 0.0, 0.0])
    left = np.flatnonzero(vertices[:, 2] == 0.0)
    n = len(vertices)
    bridge = np.concatenate(
        [
            np.stack([left[:-1], left[1:], left[:-1] + n], 1),
            np.stack([left[1:], left[1:] + n, left[:-1] + n], 1),
        ]
    )
    both = np.concatenate([vertices, other]), np.concatenate([faces, faces + n, bridge])
    face, point = at(vertices, faces, [2.0, 2.0])
    found = Brush(*both).vertices(face, point, 0.5)
    assert len(found)
    assert (found < n).all()
    # Next to the bend it goes around it.
    face, point = at(vertices, faces, [2.0, 0.15])
    assert (Brush(*both).vertices(face, point, 0.5) >= n).any()


def test_a_tiny_brush_marks_the_nearest_corner():
    vertices, faces = sheet()
    face, point = at(vertices, faces, [1.0, 1.0])
    found = Brush(vertices, faces).vertices(face, point, 1e-6)
    corners = faces[face[0]]
    nearest = corners[np.linalg.norm(vertices[corners] - point[0], axis=1).argmin()]
    assert found.tolist() == [nearest]


def test_several_dabs_are_the_union_and_leave_nothing_behind():
    vertices, faces = sheet()
    brush = Brush(vertices, faces)
    places = [at(vertices, faces, point) for point in ([0.5, 0.5], [0.6, 0.9], [3.0, 3.0])]
    each = [brush.vertices(face, point, 0.4) for face, point in places]
    face, point = (np.concatenate(parts) for parts in zip(*places, strict=True))
    together = brush.vertices(face, point, 0.4)
    assert together.tolist() == np.unique(np.concatenate(each)).tolist()
    assert brush.vertices(*places[0], 0.4).tolist() == each[0].tolist()


@pytest.mark.parametrize("eye", [None, np.array([-30.0, 0.0, 0.0])])
def test_a_lasso_marks_what_is_seen_inside_it(eye):
    vertices, faces = icosphere(4)
    turn = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    outline = np.stack([np.full(50, -2.0), 0.5 * np.cos(turn), 0.5 * np.sin(turn)], axis=1)
    directions = np.tile([1.0, 0.0, 0.0], (50, 1)) if eye is None else outline - eye
    found = lasso(RayPicker(vertices, faces), outline, directions)
    along = vertices if eye is None else (vertices - eye) * (28.0 / (vertices - eye)[:, :1])
    radius = np.linalg.norm(along[:, 1:], axis=1)
    near = vertices[:, 0] < 0
    assert set(np.flatnonzero(near & (radius < 0.49))) <= set(found)
    assert set(found) <= set(np.flatnonzero(near & (radius < 0.501)))


def test_a_lasso_of_two_points_marks_nothing():
    picker = RayPicker(*icosphere(2))
    assert len(lasso(picker, [[0, 0, 0], [1, 0, 0]], [[1, 0, 0]] * 2)) == 0


@pytest.mark.parametrize("normal", [(0, 0, 2.0), (1, 1, 1), (-0.2, 0, 0.1)])
def test_a_ring_is_closed_round_and_across_its_direction(normal):
    centre = np.array([1.0, 2.0, 3.0])
    segments = ring(centre, np.array(normal, float), 0.7)
    assert np.allclose(segments[:, 1], np.roll(segments[:, 0], -1, axis=0))
    away = segments[:, 0] - centre
    assert np.allclose(np.linalg.norm(away, axis=1), 0.7)
    assert np.allclose(away @ np.array(normal, float), 0)
