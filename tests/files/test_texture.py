"""An independent reader finds every uv pixel on the surface where the chart has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from napari_unwrap3d.errors import AxesError, InputError, MeshError
from napari_unwrap3d.files.meshes import read_mesh
from napari_unwrap3d.files.texture import atlas_texture, texture_corners, write_textured_mesh
from napari_unwrap3d.geometry.mesh import signed_volume
from napari_unwrap3d.unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction
from shapes import icosphere, rotation
from synthetic import make_atlas

ROWS = 64


def coordinates_image(rows: int = ROWS) -> np.ndarray:
    """Red is v, green is u / 2, blue tells the half: every pixel has a colour of its own."""
    v, u = np.indices((rows, 2 * rows))
    return np.stack([v, u % rows, 255 * (u >= rows)], axis=2).astype(np.uint8)


def turned_sphere() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of no symmetry, faces, and (v, u) per vertex."""
    directions, faces = icosphere(4)
    directions = directions @ rotation(1).T
    return directions * (1.0, 1.5, 2.0) + (5, 0, 0), faces, direction_to_uv(directions, ROWS)


def loaded(path: Path) -> trimesh.Trimesh:
    mesh = trimesh.load(path, force="mesh", process=False)
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def test_another_reader_finds_the_pixel_of_every_vertex(tmp_path: Path) -> None:
    vertices, faces, vu = turned_sphere()
    mesh = loaded(
        write_textured_mesh(tmp_path / "my cell.obj", vertices, faces, vu, coordinates_image())
    )
    assert {p.name for p in tmp_path.iterdir()} == {"my cell.obj", "my_cell.mtl", "my_cell.png"}
    image = np.asarray(mesh.visual.material.image.convert("RGB"))
    np.testing.assert_array_equal(image, coordinates_image())
    # The reader's own conversion to pixels: t counts from below.
    s, t = mesh.visual.uv.T
    row = np.rint((1 - t) * ROWS - 0.5).astype(int)
    column = np.rint(s * 2 * ROWS - 0.5).astype(int) % (2 * ROWS)
    where = {tuple(np.round(p, 5)): i for i, p in enumerate(vertices)}
    original = np.array([where[tuple(np.round(p[::-1], 5))] for p in mesh.vertices])
    away = np.abs(vu[original, 0] - (ROWS - 1) / 2) < ROWS / 2 - 3  # from faces around a pole
    expected = np.rint(vu[original]).astype(int) % (ROWS, 2 * ROWS)
    np.testing.assert_array_equal(row[away], expected[away, 0])
    np.testing.assert_array_equal(column[away], expected[away, 1])
    assert away.mean() > 0.95


def test_no_triangle_spans_the_image_and_each_is_where_its_centre_is(tmp_path: Path) -> None:
    vertices, faces, vu = turned_sphere()
    mesh = loaded(write_textured_mesh(tmp_path / "a.obj", vertices, faces, vu, coordinates_image()))
    corners = mesh.visual.uv[mesh.faces] * (2 * ROWS, ROWS)
    away = np.abs(corners[:, :, 1].mean(axis=1) - ROWS / 2) < ROWS / 2 - 6
    assert np.ptp(corners[away, :, 0], axis=1).max() < ROWS / 4
    assert np.ptp(corners[:, :, 0], axis=1).max() < 1.2 * ROWS  # next to a pole at most half way
    # Same handedness everywhere: the image is not mirrored on the surface, at the seam neither.
    a, b, c = np.moveaxis(corners[away], 1, 0)
    (p, q), (r, s) = (b - a).T, (c - a).T
    turn = p * s - q * r
    assert (turn > 0).all() or (turn < 0).all()


def test_the_mesh_stays_closed_and_comes_back(tmp_path: Path) -> None:
    vertices, faces, vu = turned_sphere()
    path = write_textured_mesh(tmp_path / "a.obj", vertices, faces, vu, coordinates_image())
    mesh = loaded(path)
    assert mesh.volume == pytest.approx(signed_volume(vertices, faces), rel=1e-5)
    assert path.read_text().count("\nv ") == len(vertices)
    surface = read_mesh(path)
    assert len(surface.vertices) == len(vertices)
    assert surface.report["genus"] == 0
    assert surface.report["volume_um3"] == pytest.approx(signed_volume(vertices, faces), rel=1e-5)


def test_faces_without_an_image_are_kept_and_grey(tmp_path: Path) -> None:
    vertices, faces, vu = turned_sphere()
    vu[17] = np.nan
    path = write_textured_mesh(tmp_path / "a.obj", vertices, faces, vu, coordinates_image())
    missing = int((faces == 17).any(axis=1).sum())
    text = path.read_text()
    assert text.count("/") == 3 * (len(faces) - missing)
    assert text.rstrip().splitlines()[-missing - 1] == "usemtl without_image"
    assert read_mesh(path).report["faces"] == len(faces)


def test_corners_at_a_pole_take_the_u_of_the_others() -> None:
    vu = np.array([[-0.5, 3.0], [2.0, 60.0], [2.0, 70.0], [2.0, 127.0], [2.0, 1.0]])
    corners = texture_corners(vu, np.array([[0, 1, 2], [3, 4, 0]]), ROWS)
    np.testing.assert_allclose(corners[0], [[-0.5, 65], [2, 60], [2, 70]])
    np.testing.assert_allclose(corners[1], [[2, 127], [2, 129], [-0.5, 128]])
    assert np.ptp(corners[1, :, 1]) == pytest.approx(2)


def test_a_face_around_a_pole_has_the_colour_of_the_pole() -> None:
    vu = np.array([[1.0, 10.0], [1.0, 53.0], [1.0, 96.0], [62.0, 10.0], [62.0, 53.0], [62.0, 96.0]])
    corners = texture_corners(vu, np.array([[0, 1, 2], [5, 4, 3]]), ROWS)
    assert (corners[0, :, 0] == 0).all()
    assert (corners[1, :, 0] == ROWS - 1).all()
    assert np.ptp(corners[:, :, 1], axis=1).max() == 0


@pytest.mark.parametrize("requested", [True, False])
@pytest.mark.parametrize("chart", ["surface", "reference", "sphere", "sealed"])
def test_the_texture_of_a_chart(tmp_path: Path, chart: str, requested: bool) -> None:
    """With the direct chart the sealed surface has one, too."""
    atlas = make_atlas()
    atlas = atlas if requested else atlas.replaced(on_request={})
    texture = atlas_texture(atlas, chart)
    if chart == "sealed" and not requested:
        assert texture is None
        return
    assert texture is not None
    vu, image = texture
    rows = atlas.uv.shape[0]
    assert image.shape == (rows, 2 * rows, 3)
    mesh = getattr(atlas, chart)
    path = write_textured_mesh(tmp_path / f"{chart}.obj", mesh.vertices, mesh.faces, vu, image)
    np.testing.assert_array_equal(np.rint(255 * imread(path.with_suffix(".png"))[..., :3]), image)
    direction = mesh.vertices - (0 if chart == "sphere" else 6.0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    off_axis = np.abs(direction[:, 0]) < 1 - 1e-9
    found = uv_to_direction(vu[off_axis], rows)
    np.testing.assert_allclose(found, direction[off_axis], atol=1e-6)
    assert pixel_grid(rows).reshape(rows, 2 * rows, 2).shape[:2] == image.shape[:2]


def test_what_is_no_texture_is_named(tmp_path: Path) -> None:
    vertices, faces, vu = turned_sphere()
    image, path = coordinates_image(), tmp_path / "a.obj"
    for error, arguments in [
        (AxesError, (path, vertices, faces, vu, image[:-1])),
        (InputError, (path, vertices, faces, vu, image / 255)),
        (InputError, (tmp_path / "a.ply", vertices, faces, vu, image)),
        (MeshError, (path, vertices, faces, vu[:-1], image)),
    ]:
        with pytest.raises(error):
            write_textured_mesh(*arguments)
    assert not list(tmp_path.iterdir())


def test_shades_of_grey(tmp_path: Path) -> None:
    vertices, faces, vu = turned_sphere()
    grey = coordinates_image()[..., 0]
    mesh = loaded(write_textured_mesh(tmp_path / "a.obj", vertices, faces, vu, grey))
    image = np.asarray(mesh.visual.material.image.convert("RGB"))
    np.testing.assert_array_equal(image, np.repeat(grey[..., None], 3, axis=2))
