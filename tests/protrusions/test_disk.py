"""One protrusion on the disk and on the square."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.charts import Surface
from napari_unwrap3d.errors import Cancelled, InputError, NotADiskError, TooSmallError
from napari_unwrap3d.geometry.disk import disk_determinants, disk_topology
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.protrusions.disk import fill_labels, largest_piece, net_of, unwrap_disk
from shapes import icosphere, torus_mesh


@pytest.fixture(scope="module")
def ball():
    vertices, faces = icosphere(4)
    return Surface(3.0 * vertices, faces)


@pytest.fixture(scope="module")
def cap_labels(ball):
    return np.where(ball.vertices[:, 0] > 0.6, 7, 0)


@pytest.fixture(scope="module")
def cap(ball, cap_labels):
    return unwrap_disk(ball, cap_labels, 7, pixels=64)


def test_areas_are_kept_without_flips(ball, cap, cap_labels):
    assert cap.quality["flips"] == 0
    assert (disk_determinants(cap.points, cap.faces) > 0).all()
    assert cap.quality["mean_abs_log_area"] <= 0.01
    assert 1.0 <= cap.quality["mean_q"] < 1.8
    assert set(cap.vertices) <= set(np.flatnonzero(cap_labels))
    assert np.linalg.norm(cap.points, axis=1).max() == pytest.approx(1.0)


def test_a_harmonic_disk_keeps_angles_better(ball, cap, cap_labels):
    harmonic = unwrap_disk(ball, cap_labels, 7, equiareal=False, pixels=16)
    assert harmonic.quality["mean_q"] < cap.quality["mean_q"]
    assert harmonic.quality["mean_abs_log_area"] > cap.quality["mean_abs_log_area"]
    assert harmonic.quality["flips"] == 0


def test_scalars_and_labels_go_to_the_square_and_back(ball, cap):
    height = ball.vertices[:, 0]
    image = cap.scalars_to_square(height)
    assert image.shape == (64, 64)
    error = np.abs(cap.scalars_to_vertices(image) - height[cap.vertices])
    assert error.mean() < 0.02
    assert error.max() < 0.2  # on the border, half a pixel outside of all centres
    halves = np.where(ball.vertices[:, 1] > 0, 4, 2)
    back = cap.labels_to_vertices(cap.labels_to_square(halves))
    assert (back == halves[cap.vertices]).mean() > 0.97
    positions = cap.scalars_to_square(ball.vertices)
    assert positions.shape == (64, 64, 3)
    assert set(np.unique(cap.owner)) <= set(cap.vertices)


def test_the_image_is_seen_from_outside(ball, cap):
    positions = cap.scalars_to_square(ball.vertices)
    down, right = np.gradient(positions, axis=(0, 1))
    outward = np.einsum("ijk,ijk->ij", np.cross(down, right), positions)
    assert (outward[8:-8, 8:-8] > 0).all()


def test_holes_are_filled_and_the_largest_piece_is_taken(ball, cap_labels):
    hole = np.linalg.norm(ball.vertices - [3, 0, 0], axis=1) < 0.6
    torn = np.where(hole, 0, cap_labels)
    torn[np.linalg.norm(ball.vertices - [-3, 0, 0], axis=1) < 0.5] = 7
    found = unwrap_disk(ball, torn, 7, pixels=16)
    whole = unwrap_disk(ball, cap_labels, 7, pixels=16)
    np.testing.assert_array_equal(found.vertices, whole.vertices)
    assert found.quality["vertices_left_out"] > 0
    filled = fill_labels(net_of(ball.vertices, ball.faces), torn == 7)
    assert filled[hole].all()


def test_renumbering_the_surface_changes_nothing(ball, cap, cap_labels):
    order = np.random.default_rng(2).permutation(len(ball.vertices))
    other = Surface(ball.vertices[order], np.argsort(order)[ball.faces])
    found = unwrap_disk(other, cap_labels[order], 7, pixels=64)
    place = np.empty(len(order), int)
    place[order[found.vertices]] = np.arange(len(found.vertices))
    np.testing.assert_allclose(found.points[place[cap.vertices]], cap.points, atol=1e-5)


def test_half_the_cell_is_a_disk_and_a_band_is_not(ball):
    z = ball.vertices[:, 0]
    half = unwrap_disk(ball, np.where(z > -0.1, 1, 0), 1, pixels=16)
    assert half.quality["flips"] == 0
    with pytest.raises(NotADiskError) as caught:
        unwrap_disk(ball, np.where(np.abs(z) < 1.0, 1, 0), 1)
    assert caught.value.measured["boundary_loops"] == 2


def test_a_handle_is_refused_with_its_genus():
    vertices, faces = torus_mesh()
    labels = (np.linalg.norm(vertices - vertices[0], axis=1) > 0.5).astype(int)
    with pytest.raises(NotADiskError) as caught:
        unwrap_disk(Surface(vertices, faces), labels, 1)
    assert caught.value.measured["genus"] == 1


def test_a_single_vertex_and_a_missing_label_say_so(ball):
    labels = np.zeros(len(ball.vertices), int)
    labels[5] = 2
    with pytest.raises(TooSmallError):
        unwrap_disk(ball, labels, 2)
    for label in (0, 3):
        with pytest.raises(InputError, match=f"no protrusion {label}"):
            unwrap_disk(ball, labels, label)
    with pytest.raises(InputError):
        unwrap_disk(ball, labels[1:], 2)


def test_no_edge_inside_joins_the_border():
    vertices, faces = icosphere(4)
    ragged = vertices[:, 0] + np.random.default_rng(0).normal(0, 0.15, len(vertices)) > 0.2
    filled = fill_labels(net_of(vertices, faces), ragged)
    part = largest_piece(vertices, faces, filled[faces].all(axis=1))
    assert disk_topology(part.faces).is_disk
    ends = np.sort(
        np.concatenate([part.faces[:, [0, 1]], part.faces[:, [1, 2]], part.faces[:, [2, 0]]])
    )
    edges, count = np.unique(ends, axis=0, return_counts=True)
    border = np.zeros(len(part.vertices), bool)
    border[edges[count == 1]] = True
    assert not border[edges[count == 2]].all(axis=1).any()


def test_it_can_be_cancelled(ball, cap_labels):
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        unwrap_disk(ball, cap_labels, 7, progress=progress)
