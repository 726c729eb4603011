"""Step 6: the surface's own mesh cut at the seam, and the mapped mask's mesh."""

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import EmptyMaskError
from napari_unwrap3d.geometry.curvilinear import evaluate
from napari_unwrap3d.geometry.mesh import (
    degenerate_faces,
    euler_characteristic,
    is_consistently_wound,
    is_watertight,
    signed_volume,
)
from napari_unwrap3d.unwrapping.topographic_surface import (
    cut_at_seam,
    faces_in_columns,
    mesh_mapped_mask,
)
from napari_unwrap3d.unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction
from shapes import icosphere

ROWS, LAYERS = 32, 21


def image_of_a_sphere(rows: int = ROWS) -> tuple[np.ndarray, np.ndarray]:
    where, faces = icosphere(4)
    return np.column_stack([np.zeros(len(where)), direction_to_uv(where, rows)]), faces


def shell_nodes() -> np.ndarray:
    """Positions (LAYERS, ROWS + 2, 2 ROWS, 3) between the radii 5 and 15."""
    around = uv_to_direction(pixel_grid(ROWS).reshape(-1, 2), ROWS).reshape(ROWS, -1, 3)
    pole = np.broadcast_to([1.0, 0.0, 0.0], (1, 2 * ROWS, 3))
    unit = np.concatenate([pole, around, -pole])
    return ((5 + 0.5 * np.arange(LAYERS))[:, None, None, None] * unit).astype(np.float32)


def test_no_face_spans_the_image_and_none_is_lost() -> None:
    image, faces = image_of_a_sphere()
    vertices, cut, origin = cut_at_seam(image, faces, ROWS)
    assert len(cut) == len(faces)
    np.testing.assert_array_equal(origin[cut], faces)
    spans = np.ptp(vertices[cut][:, :, 2], axis=1)
    away = np.abs(image[faces][:, :, 1] - (ROWS - 1) / 2).max(axis=1) < ROWS / 2 - 2
    assert spans[away].max() < ROWS / 4
    assert vertices[:, 2].max() < 4 * ROWS


def test_copies_lie_one_turn_away_from_their_origin() -> None:
    image, faces = image_of_a_sphere()
    vertices, _, origin = cut_at_seam(image, faces, ROWS)
    np.testing.assert_array_equal(vertices[:, :2], image[origin][:, :2])
    turns = (vertices[:, 2] - image[origin][:, 2]) / (2 * ROWS)
    assert set(np.unique(turns.round(9))) == {0.0, 1.0}
    assert len(vertices) == len(image) + (turns > 0.5).sum()


def test_the_cut_mesh_covers_the_image_once() -> None:
    """Away from the poles the areas of the faces in (v, u) sum to that of the image."""
    image, faces = image_of_a_sphere()
    vertices, cut, _ = cut_at_seam(image, faces, ROWS)
    corners = vertices[cut][:, :, 1:]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1])
    away = np.abs(image[faces][:, :, 1] - (ROWS - 1) / 2).max(axis=1) < ROWS / 2 - 2
    assert (area[away] > 0).all() or (area[away] < 0).all()
    covered = np.abs(area[away]).sum() / (2 * ROWS)
    assert ROWS - 6 < covered < ROWS - 4


def test_faces_without_an_image_are_left_out() -> None:
    image, faces = image_of_a_sphere()
    image[17] = np.nan
    vertices, cut, origin = cut_at_seam(image, faces, ROWS)
    assert len(cut) == len(faces) - (faces == 17).any(axis=1).sum()
    assert 17 not in origin
    assert np.isfinite(vertices).all()
    everything = np.full_like(image, np.nan)
    assert len(cut_at_seam(everything, faces, ROWS)[1]) == 0


@pytest.mark.parametrize("smoothing", [0.0, 1.0])
def test_a_sphere_in_the_shell_is_closed_over_seam_and_poles(smoothing: float) -> None:
    nodes = shell_nodes()
    layer = np.arange(LAYERS, dtype=np.float32)[:, None, None]
    level = np.broadcast_to(np.clip(0.5 * (10.3 - layer), -0.5, 0.5), nodes.shape[:3])
    grid, faces = mesh_mapped_mask(level, smoothing)
    vertices = evaluate(nodes, grid)
    assert is_watertight(faces)
    assert is_consistently_wound(faces)
    assert euler_characteristic(faces) == 2
    assert len(np.unique(faces)) == len(vertices)
    radius = np.linalg.norm(vertices, axis=1)
    np.testing.assert_allclose(radius, 5 + 0.5 * (10.5 if smoothing else 10.3), atol=0.1)
    assert signed_volume(vertices, faces) == pytest.approx(
        4 / 3 * np.pi * radius.mean() ** 3, rel=0.01
    )


def test_what_lies_across_the_seam_is_not_torn() -> None:
    """A bump over the seam and one over a pole give the same surface as elsewhere."""
    nodes = shell_nodes()
    unit = nodes[0] / np.linalg.norm(nodes[0], axis=-1, keepdims=True)
    layer = np.arange(LAYERS, dtype=np.float32)[:, None, None]
    volumes = []
    for axis in ([0, 0.0, -1], [0, 0.0, 1], [0, 1.0, 0], [1, 0, 0], [-1, 0, 0]):
        height = 6 + 8 * np.exp(10 * (unit @ np.array(axis) - 1))
        level = np.clip(0.5 * (height - layer), -0.5, 0.5).astype(np.float32)
        grid, faces = mesh_mapped_mask(level, 0.0)
        vertices = evaluate(nodes, grid)
        assert is_watertight(faces)
        assert euler_characteristic(faces) == 2
        volumes.append(signed_volume(vertices, faces))
    np.testing.assert_allclose(volumes, volumes[0], rtol=0.01)


def test_what_reaches_the_outermost_layer_is_closed_there() -> None:
    level = np.full((LAYERS, ROWS + 2, 2 * ROWS), 0.5, np.float32)
    grid, faces = mesh_mapped_mask(level, 0.0)
    assert is_watertight(faces)
    assert np.abs(grid[:, 0] - (LAYERS - 1.5)).max() < 0.5


def test_nothing_inside_is_an_error() -> None:
    with pytest.raises(EmptyMaskError):
        mesh_mapped_mask(np.full((LAYERS, ROWS + 2, 2 * ROWS), -0.5, np.float32), 0.0)


def test_the_cut_mesh_of_the_cell_is_its_own_mesh(small_atlas: Atlas) -> None:
    chart = small_atlas.topography
    faces = small_atlas.surface.faces
    assert len(chart.cut_faces) == len(faces)
    np.testing.assert_array_equal(chart.cut_origin[chart.cut_faces], faces)
    assert not degenerate_faces(chart.meshed_vertices, chart.meshed_faces).mean() > 0.01


def meshed_sphere() -> tuple[np.ndarray, np.ndarray]:
    """The mesh of layers up to 10 of the shell, in grid coordinates."""
    level = np.where(np.arange(LAYERS) <= 10, 0.5, -0.5).astype(np.float32)
    return mesh_mapped_mask(
        np.broadcast_to(level[:, None, None], (LAYERS, ROWS + 2, 2 * ROWS)).copy(), 0.0
    )


def test_whole_columns_lose_no_face() -> None:
    vertices, faces = meshed_sphere()
    shape = (ROWS + 2, 2 * ROWS)
    kept = faces_in_columns(vertices, faces, np.zeros(shape, np.int64), np.full(shape, LAYERS - 1))
    assert kept[0] is vertices
    assert kept[1] is faces


@pytest.mark.parametrize("column", [20, 0, 2 * ROWS - 1])
def test_faces_at_columns_that_end_before_them_are_none(column: int) -> None:
    """At the seam, too, where a face has corners at both ends of the row."""
    vertices, faces = meshed_sphere()
    shape = (ROWS + 2, 2 * ROWS)
    first, last = np.zeros(shape, np.int64), np.full(shape, LAYERS - 1)
    first[16, column] = 12
    left, fewer = faces_in_columns(vertices, faces, first, last)
    # The four cells around the column, of two faces each.
    assert len(faces) - len(fewer) == 8
    distance = np.abs(left[:, 2] - column)
    distance = np.minimum(distance, 2 * ROWS - distance)
    assert np.hypot(distance, left[:, 1] - 16).min() > 0.9
    first[16, column], last[16, column] = 0, 9
    assert len(faces_in_columns(vertices, faces, first, last)[1]) == len(fewer)
