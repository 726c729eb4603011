"""Location, areas and coverage of a sphere's mesh on an image."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry.flat import FlatSphere
from napari_unwrap3d.geometry.poles import open_at_poles
from shapes import icosphere, rotation

ROWS = 32


def flat_ball(seed: int = 3) -> FlatSphere:
    """A sphere whose faces lie in one piece: v goes with z (Lambert), so straight enough."""
    where, faces = icosphere(4)
    where = where @ rotation(seed).T
    v = (1.0 - where[:, 0]) * ROWS / 2 - 0.5
    u = (np.arctan2(where[:, 1], where[:, 2]) + np.pi) * ROWS / np.pi - 0.5
    opened = open_at_poles(np.column_stack([np.zeros(len(v)), v, u]), faces, ROWS)
    return FlatSphere(
        np.column_stack([v, u]),
        faces,
        opened.face_turns,
        opened.pole_faces,
        opened.pole_weights,
        ROWS,
    )


def test_areas_sum_to_the_image() -> None:
    area, error = flat_ball().areas()
    assert area.sum() == pytest.approx(2 * ROWS**2)
    assert error.max() < 1e-9


def test_flipped_faces_are_found_also_at_the_poles() -> None:
    flat = flat_ball()
    fine = set(flat.flipped())
    for target in (1000, int(flat.faces[flat.pole_faces[0]][0])):
        vertices = flat.vertices.copy()
        vertices[target, 0] += 15.0
        moved = FlatSphere(
            vertices, flat.faces, flat.turns, flat.pole_faces, flat.pole_weights, ROWS
        )
        new = set(moved.flipped()) - fine
        assert new
        assert all(target in flat.faces[face] for face in new)


def test_nan_counts_as_flipped() -> None:
    flat = flat_ball()
    vertices = flat.vertices.copy()
    vertices[50] = np.nan
    bad = FlatSphere(vertices, flat.faces, flat.turns, flat.pole_faces, flat.pole_weights, ROWS)
    around = np.flatnonzero((flat.faces == 50).any(axis=1))
    assert set(around) <= set(bad.flipped())


def test_a_fold_is_counted() -> None:
    flat = flat_ball()
    vertices = flat.vertices.copy()
    middle = np.abs(vertices - [ROWS / 2, ROWS]).max(axis=1) < 4
    vertices[middle, 1] += 14.0
    folded = FlatSphere(vertices, flat.faces, flat.turns, flat.pole_faces, flat.pole_weights, ROWS)
    covering = folded.pixels().covering
    assert covering.max() >= 3
    assert (covering[:8] == flat.pixels().covering[:8]).all()


def test_pixel_centres_on_edges_and_corners_are_covered_once() -> None:
    """Every vertex is moved onto a pixel centre, seam and degenerate faces included."""
    flat = flat_ball()
    vertices = np.rint(flat.vertices)
    on_grid = FlatSphere(vertices, flat.faces, flat.turns, flat.pole_faces, flat.pole_weights, ROWS)
    # Faces may fold by that, but the degree stays one, so that coverage is odd everywhere.
    assert (on_grid.pixels().covering[4:-4] % 2 == 1).all()


@pytest.mark.parametrize("offset", [0.0, 2 * ROWS, -4 * ROWS, 17.3])
def test_coordinates_are_wrapped(offset: float) -> None:
    flat = flat_ball()
    points = np.random.default_rng(0).uniform(-0.4, [ROWS - 0.6, 2 * ROWS - 0.6], (500, 2))
    moved = points + np.array([0.0, offset])
    face, weights = flat.locate(moved)
    back = flat.at(face, weights)
    miss = np.abs(back - moved)
    miss[:, 1] = np.abs((miss[:, 1] + ROWS) % (2 * ROWS) - ROWS)
    assert np.quantile(miss, 0.99) < 1e-9
    assert (back[:, 1] >= -0.5).all()
    assert (back[:, 1] < 2 * ROWS - 0.5).all()


def test_no_points_have_no_place() -> None:
    face, weights = flat_ball().locate(np.zeros((0, 2)))
    assert face.shape == (0,)
    assert weights.shape == (0, 3)


def test_vertices_are_where_they_are() -> None:
    flat = flat_ball()
    face, corner = np.arange(len(flat.faces)), np.zeros(len(flat.faces), np.int64)
    keep = ~np.isin(face, flat.pole_faces)
    points = flat.at(face[keep], np.eye(3)[corner[keep]])
    expected = flat.vertices[flat.faces[keep, 0]]
    miss = np.abs(points - expected)
    miss[:, 1] = np.minimum(miss[:, 1], 2 * ROWS - miss[:, 1])
    assert miss.max() < 1e-9
    for pole in (0, 1):
        ring = np.full(3, flat.pole_faces[pole])
        np.testing.assert_allclose(
            np.sort(flat.at(ring, np.eye(3))[:, 0]),
            np.sort(flat.vertices[flat.faces[flat.pole_faces[pole]], 0]),
            atol=1e-9,
        )
