"""A frame as views show it: its texture, its pixels, its fields, its places."""

from __future__ import annotations

import numpy as np
import pytest

from moving import blebbing_movie
from napari_unwrap3d import Movie
from napari_unwrap3d.errors import ChartMissingError
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.motion.frame_fields import FRAME, FrameFields, MovieColours, given_on_mesh
from napari_unwrap3d.motion.frame_places import FramePlaces
from napari_unwrap3d.motion.shown_frames import ShownFrame, shown_frame


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


@pytest.fixture(scope="module")
def shown(movie: Movie) -> ShownFrame:
    return shown_frame(movie.frame(1))


def test_every_corner_has_its_own_place_in_the_texture(shown: ShownFrame) -> None:
    frame, laid = shown.frame, shown.laid
    corners = shown.vertices[shown.faces]
    assert np.allclose(corners, frame.surface.vertices[frame.surface.faces], atol=1e-4)
    rows, width = laid.shape
    place = laid.coordinates.astype(float) * (width, rows) - 0.5
    v, u = rows - 1 - place[:, 1], place[:, 0]
    vertex = laid.origin
    inside = (np.abs(u - (width - 1)) > 0.5) & ~frame.outside[vertex]
    # But for the poles, where a face is a point of the image.
    near = inside & (v > 2) & (v < rows - 3)
    expected = frame.topography[vertex, 1:]
    assert np.allclose(v[near], expected[near, 0], atol=0.01)
    turn = np.mod(u[near] - expected[near, 1] + rows, 2 * rows) - rows
    assert np.abs(turn).max() < 0.01
    # No face spans the image.
    spread = np.ptp(u[laid.faces], axis=1)
    assert spread[inside[laid.faces].all(axis=1)].max() <= rows


def test_all_frames_have_textures_of_one_size(movie: Movie) -> None:
    assert len({shown_frame(movie.frame(t)).laid.shape for t in range(len(movie))}) == 1


def test_the_pixels_under_vertices_are_where_they_are(shown: ShownFrame) -> None:
    frame, rows = shown.frame, shown.rows
    middle = frame.surface.vertices[len(frame.surface.vertices) // 2]
    near = np.linalg.norm(frame.surface.vertices - middle, axis=1) < 1.5
    chosen = np.flatnonzero(near & ~frame.outside)
    v, u = shown.pixels_under(chosen)
    marked = np.zeros((rows, 2 * rows), bool)
    marked[v, u] = True
    own = np.floor(frame.topography[chosen, 1:] + 0.5).astype(int)
    assert marked[np.clip(own[:, 0], 0, rows - 1), own[:, 1] % (2 * rows)].all()
    # What the outermost pixels show lies near the chosen vertices.
    sampled = shown.sampled(marked)
    far = np.linalg.norm(frame.surface.vertices - middle, axis=1) > 3.0
    height = frame.uv["height_um"]
    outermost = np.abs(shown.sampled(height) - frame.topography[:, 0]) < 0.1
    assert not (sampled[far & outermost] > 0).any()
    assert marked.sum() < 0.25 * marked.size
    empty = shown.pixels_under(np.zeros(0, np.int64))
    assert len(empty[0]) == 0


def test_limits_are_those_of_all_frames(movie: Movie, shown: ShownFrame) -> None:
    colours = MovieColours(movie)
    assert not colours.known("height_um")
    low, high = colours.of("height_um").limits
    everything = np.concatenate([given_on_mesh(f, "height_um") for f in movie.frames()])
    assert np.nanpercentile(everything, 0.5) <= low < high <= np.nanpercentile(everything, 99.5)
    fields = FrameFields(movie.common, shown, colours)
    for timepoint in range(len(movie)):
        there = FrameFields(movie.common, shown_frame(movie.frame(timepoint)), colours, fields)
        assert there.colours("height_um").limits == (low, high)


def test_fields_of_the_frame_come_first_and_reach_every_chart(
    movie: Movie, shown: ShownFrame
) -> None:
    fields = FrameFields(movie.common, shown, MovieColours(movie))
    names = fields.names
    assert names[:2] == ("mean_curvature_per_um", "height_um")
    assert "area_distortion" in names
    frame = shown.frame
    for name in ("height_um", "area_um2"):
        assert np.array_equal(fields.values(name, "uv"), frame.uv[name], equal_nan=True)
        assert len(fields.values(name, FRAME)) == len(frame.surface.vertices)
    assert np.allclose(
        fields.values("height_um", FRAME), frame.surface.fields["height_um"], equal_nan=True
    )
    assert len(fields.values("height_um", "sphere")) == len(movie.common.sphere.vertices)
    static = fields.values("area_distortion", FRAME)
    assert np.array_equal(
        static, shown.sampled(fields.values("area_distortion", "uv")), equal_nan=True
    )


def test_a_movie_without_frames_has_no_colours(movie: Movie, tmp_path: object) -> None:
    folder = MovieFolder(tmp_path)  # type: ignore[arg-type]
    folder.begin({"timepoints": 3, "name": "empty", "time_step_s": 1.0, "channels": []})
    with pytest.raises(ChartMissingError, match="No frame"):
        MovieColours(Movie(folder)).of("height_um")


def test_a_place_of_the_frame_is_found_from_uv_and_back(movie: Movie, shown: ShownFrame) -> None:
    places = FramePlaces(movie.common, shown)
    frame = shown.frame
    face = frame.surface.faces[len(frame.surface.faces) // 3]
    weights = np.array([0.2, 0.3, 0.5])
    place = places.on_mesh(FRAME, face, weights)
    assert place.uv is not None
    assert place.on_frame is not None
    assert np.allclose(place.on_frame, weights @ frame.surface.vertices[face])
    back = places.at_pixel("uv", place.uv)
    assert back is not None
    assert back.on_frame is not None
    assert np.linalg.norm(back.on_frame - place.on_frame) < 3 * movie.common.voxel_um
