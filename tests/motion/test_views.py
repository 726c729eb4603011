"""One timepoint as the atlas of a cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moving import CENTRE_UM, DIRECTIONS, RADIUS_UM, VOXEL_UM, blebbing_movie
from napari_unwrap3d import Atlas, Movie, load, segment_protrusions


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


@pytest.fixture(scope="module")
def atlas(movie: Movie) -> Atlas:
    return movie.atlas(1)


def test_the_space_is_shared_and_the_surface_is_the_frames(movie: Movie, atlas: Atlas) -> None:
    assert atlas.topography.nodes is movie.common.topography.nodes
    assert atlas.reference is movie.common.reference
    np.testing.assert_array_equal(atlas.surface.vertices, movie.frame(1).surface.vertices)
    np.testing.assert_array_equal(atlas.topography.surface, movie.frame(1).topography)
    assert movie.atlas(1) is atlas


def test_points_come_back_through_every_chart(atlas: Atlas) -> None:
    start = atlas.surface.vertices[::7]
    image, valid = atlas.map(start, "surface", "topography")
    back, again = atlas.map(image, "topography", "surface")
    assert valid.all()
    assert again.all()
    assert np.abs(back - start).max() < 0.01 * VOXEL_UM
    flat, seen = atlas.map(start, "surface", "direct")
    there, found = atlas.map(flat, "direct", "surface")
    assert seen.all()
    assert found.all()
    assert np.abs(there - start).max() < 1e-6


def test_from_uv_out_to_the_surface_of_the_timepoint(movie: Movie, atlas: Atlas) -> None:
    pixels = np.array([[20.0, 31.0], [40.0, 90.0], [33.3, 64.7]])
    place, valid = atlas.map(pixels, "uv", "surface")
    back, _ = atlas.map(place, "surface", "uv")
    assert valid.all()
    np.testing.assert_allclose(back, pixels, atol=0.02)
    shown = atlas.uv.fields["surface_height_um"]
    np.testing.assert_allclose(shown, movie.frame(1).uv["height_um"], rtol=1e-6)


def test_labels_go_from_the_image_to_the_surface_and_back(atlas: Atlas) -> None:
    labels = np.zeros(atlas.uv.shape, np.int32)
    labels[20:40, 30:60] = 3
    on_surface = atlas.carry(labels, "uv", "surface", kind="label")
    assert set(np.unique(on_surface)) == {0, 3}
    back = atlas.carry(on_surface, "surface", "uv", kind="label")
    assert (back == labels).mean() > 0.98


def test_the_bumps_of_the_timepoint_are_found(movie: Movie, atlas: Atlas) -> None:
    found = segment_protrusions(atlas)
    tall = CENTRE_UM + (RADIUS_UM + 0.6) * DIRECTIONS[1]
    nearest = np.argmin(np.linalg.norm(atlas.surface.vertices - tall, axis=1))
    assert found.labels[nearest] > 0
    bare = CENTRE_UM + RADIUS_UM * DIRECTIONS[3]
    nearest = np.argmin(np.linalg.norm(atlas.surface.vertices - bare, axis=1))
    assert found.labels[nearest] == 0


def test_the_mask_is_mapped(atlas: Atlas) -> None:
    layer = np.searchsorted(atlas.topography.d_um, 0.5)
    (place,), _ = atlas.map((CENTRE_UM + RADIUS_UM * DIRECTIONS[1])[None], "volume", "uv")
    v, u = np.rint(place).astype(int) % atlas.uv.shape
    assert atlas.topography.mask[layer, v, u]
    assert atlas.topography.mask[layer].mean() < 0.1
    assert atlas.quality["topography"]["meshed_watertight"]


def test_it_is_saved_like_any_cell(atlas: Atlas, tmp_path: Path) -> None:
    opened = load(atlas.save(tmp_path / "timepoint.unwrap3d"))
    np.testing.assert_array_equal(opened.surface.vertices, atlas.surface.vertices)
    np.testing.assert_allclose(opened.topography.nodes, atlas.topography.nodes, atol=1e-4)
    assert opened.provenance["source"]["name"].endswith("timepoint 1")


def test_annotations_are_kept_while_the_atlas_is(movie: Movie) -> None:
    drawn = movie.atlas(0).annotations
    drawn.add("here")
    assert movie.atlas(0).annotations is drawn
