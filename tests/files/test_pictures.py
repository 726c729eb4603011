"""Every chart has its picture; what is drawn is where it should be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.files.drawing import round_length, sequential, symmetric
from napari_unwrap3d.files.panels import front_and_back, highest_pixel
from napari_unwrap3d.files.pictures import PICTURES, write_pictures
from napari_unwrap3d.progress import Progress
from synthetic import RADIUS, make_atlas, with_protrusions


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return with_protrusions(make_atlas())


def test_every_chart_has_a_picture_with_something_on_it(atlas: Atlas, tmp_path: Path) -> None:
    written = write_pictures(atlas, tmp_path / "pictures")
    assert [path.stem for path in written] == list(PICTURES)
    for path in written:
        image = np.asarray(imread(path))
        assert min(image.shape[:2]) > 500, path.stem
        assert (image[..., :3] < 0.8).any(axis=-1).mean() > 0.005, path.stem
        assert image[0, 0, :3].min() == 1.0, path.stem


def test_the_same_atlas_gives_the_same_picture(atlas: Atlas, tmp_path: Path) -> None:
    few = atlas.replaced(reference=None, topography=None, sphere=None, uv=None, on_request={})
    one, other = write_pictures(few, tmp_path / "a"), write_pictures(few, tmp_path / "b")
    assert [path.name for path in one] == ["surface.png"]
    assert one[0].read_bytes() == other[0].read_bytes()


def test_charts_without_fields_are_drawn_too(atlas: Atlas, tmp_path: Path) -> None:
    surface = replace(atlas.surface, fields={})
    bare = atlas.replaced(surface=surface, reference=None, sphere=None)
    assert {path.stem for path in write_pictures(bare, tmp_path)} == {
        "surface",
        "uv",
        "uv_distortion",
        "topography",
        "direct",
        "protrusions",
    }


def test_drawing_can_be_cancelled(atlas: Atlas, tmp_path: Path) -> None:
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        write_pictures(atlas, tmp_path, progress)


def test_the_front_view_has_the_axis_up_and_azimuth_zero_in_the_middle(atlas: Atlas) -> None:
    axis = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
    axis = axis * np.linalg.det(axis)
    for view, azimuth in zip(front_and_back(axis), (0.0, np.pi), strict=True):
        assert np.linalg.det(view) == pytest.approx(1.0)
        seen = np.array([0.0, np.sin(azimuth), np.cos(azimuth)]) @ axis
        next_to_it = np.array([0.0, np.sin(azimuth + 0.1), np.cos(azimuth + 0.1)]) @ axis
        np.testing.assert_allclose(view @ seen, [-1, 0, 0], atol=1e-12)  # nearest
        assert (view @ next_to_it)[2] > 0  # u runs to the right, as in the uv image
        np.testing.assert_allclose(view @ axis[0], [0, -1, 0], atol=1e-12)  # the north pole is up


def test_sections_go_through_the_highest_point(atlas: Atlas) -> None:
    v, u = highest_pixel(atlas.topography.mask)
    rows = atlas.topography.shape[1]
    heights = atlas.uv.fields["surface_height_um"][rows // 4 : rows - rows // 4]
    step = atlas.topography.d_um[1] - atlas.topography.d_um[0]
    assert atlas.uv.fields["surface_height_um"][v, u] > heights.max() - step


@pytest.mark.parametrize("span", [0.013, 1.0, 4.9, 26.0, 1234.0])
def test_scale_bars_have_round_lengths_of_a_fifth_at_most(span: float) -> None:
    length = round_length(span)
    assert span / 13 < length <= span / 5
    assert f"{length:.0e}"[0] in "125"


def test_colours_are_symmetric_and_do_not_magnify_rounding_errors() -> None:
    rng = np.random.default_rng(0)
    colours = symmetric(rng.normal(0.3, 1.0, 1000), "")
    assert colours.low == -colours.high
    np.testing.assert_allclose(colours(np.zeros(1))[0], colours(np.zeros(1))[0][::-1], atol=0.01)
    assert symmetric(1e-15 * rng.normal(size=100), "").high >= 1e-3
    constant = symmetric(np.full(10, 1 / RADIUS), "")
    assert constant.high > 1.5 / RADIUS
    assert sequential(np.array([np.nan, 2.0, 2.0]), "").high > 2.0
