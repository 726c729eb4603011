import numpy as np
import pytest

from napari_unwrap3d.errors import ChartMissingError
from napari_unwrap3d.textured import COVER, WITHOUT_IMAGE, PaintedTexture, make_skin, skin_chart
from synthetic import make_atlas

RED = (1.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def atlas():
    return make_atlas(4, 64)


def pixel_of(skin, coordinates):
    """Row and column of the texture at texture coordinates."""
    rows, columns = skin.shape
    return (1 - coordinates[..., 1]) * rows - 0.5, coordinates[..., 0] * columns - 0.5


@pytest.mark.parametrize("mesh", ["surface", "sealed", "reference", "sphere"])
def test_the_textured_mesh_is_the_mesh(atlas, mesh):
    skin, faces = make_skin(atlas, mesh), getattr(atlas, mesh).faces
    size = len(getattr(atlas, mesh).vertices)
    assert (skin.origin[skin.faces] == faces).all()
    assert (skin.origin[:size] == np.arange(size)).all()
    assert len(skin.origin) < 1.1 * size


@pytest.mark.parametrize("mesh", ["surface", "reference"])
def test_every_face_shows_the_pixels_that_show_it(atlas, mesh):
    """Also across the seam and around the poles, where no face may span the image."""
    skin, chart = make_skin(atlas, mesh), getattr(atlas, mesh)
    # What each pixel shows, in space, repeated as in the texture.
    position = np.stack([skin.image(chart.vertices[:, k], chart.faces) for k in range(3)], axis=-1)
    position = np.concatenate([position, position[:, : skin.repeated]], axis=1)
    row, column = pixel_of(skin, skin.coordinates[skin.faces].mean(axis=1))
    row, column = np.rint(row).astype(int), np.rint(column).astype(int)
    shown = position[row, column]
    middle = chart.vertices[chart.faces].mean(axis=1)
    edge = np.linalg.norm(chart.vertices[chart.faces[:, 0]] - middle, axis=1).max()
    away = np.linalg.norm(shown - middle, axis=1)
    # Within a pixel and a face; a face that spanned the image would be far off.
    assert away.max() < 3 * edge


def test_without_the_direct_chart_the_surface_shows_uv():
    atlas = make_atlas(3, 32).replaced(on_request={})
    assert skin_chart(atlas, "surface") == "uv"
    assert make_skin(atlas, "surface").chart == "uv"
    with pytest.raises(ChartMissingError):
        make_skin(atlas, "sealed")


def test_a_field_takes_the_colours_of_its_table(atlas):
    skin = make_skin(atlas, "surface")
    texture = PaintedTexture(skin)
    values = np.linspace(-1, 2, 64 * 128).reshape(64, 128)
    values[3, 7] = np.nan
    table = np.array([(0, 0, 255), (0, 255, 0), (255, 0, 0)], np.uint8)
    texture.set_field(values, table, (0.0, 1.0))
    assert texture.pixels[0, 0].tolist() == [0, 0, 255]
    assert texture.pixels[63, 127].tolist() == [255, 0, 0]
    assert texture.pixels[32, 0].tolist() == [0, 255, 0]
    assert texture.pixels[3, 7].tolist() == list(WITHOUT_IMAGE)
    assert (texture.pixels[:, -1] == WITHOUT_IMAGE).all()


def test_annotations_cover_the_field_where_they_are(atlas):
    skin = make_skin(atlas, "surface")
    texture = PaintedTexture(skin)
    texture.cover("one", np.zeros((64, 128), np.uint16), {1: RED})
    texture.take_changed()
    texture.change("one", np.array([5 * 128 + 9, 7 * 128 + 3]), 1)
    part = round(255 * (1 - COVER))
    assert texture.pixels[5, 9].tolist() == [255, part, part]
    changed = np.argwhere((texture.pixels != 255).any(axis=2) & (np.arange(skin.shape[1]) < 128))
    assert changed.tolist() == [[5, 9], [7, 3]]
    box = texture.take_changed()[0]
    assert box == (5, 8, 3, 10)
    assert texture.take_changed() == []
    texture.recolour("one", {1: RED}, visible=False)
    assert (texture.pixels[:, :-1] == 255).all()


def test_the_first_columns_are_repeated_behind_the_last(atlas):
    skin = make_skin(atlas, "surface")
    assert skin.repeated > 0
    texture = PaintedTexture(skin)
    texture.cover("one", np.zeros((64, 128), np.uint16), {1: RED})
    texture.take_changed()
    texture.change("one", np.array([5 * 128]), 1)
    assert (texture.pixels[5, 128] == texture.pixels[5, 0]).all()
    assert texture.take_changed() == [(5, 6, 0, 1), (5, 6, 128, 129)]
