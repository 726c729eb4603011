"""The sealed surface's own mesh as the reference: straight to the sphere and the image."""

from functools import lru_cache

import numpy as np
import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.errors import FlippedFacesError
from napari_unwrap3d.unwrapping import conformal
from napari_unwrap3d.unwrapping.sphere import STALLED
from shapes import QUICK, pear, torus


def ring() -> unwrap3d.Mask:
    """A thick ring, of genus 1; its hole is closed by a membrane."""
    return unwrap3d.Mask(torus(13, 6, (34, 58, 58)), (0.1,) * 3)


SHAPES = {"pear": pear, "ring": ring}
TEXT = """
[sealed]
handles = "seal"
[reference]
skip = true
keep_mesh = true
[sphere]
blend = {blend}
[uv]
rows = 128
"""


@lru_cache
def straight(shape: str, blend: float = 1.0) -> unwrap3d.Atlas:
    """Unwrapped by settings of a file, the quick ones of the tests besides."""
    chosen = unwrap3d.Parameters.from_toml(TEXT.format(blend=blend)).model_dump(exclude_unset=True)
    quick = QUICK.model_dump()
    return unwrap3d.unwrap(
        SHAPES[shape](),
        unwrap3d.Parameters.from_dict({k: quick[k] | chosen.get(k, {}) for k in quick}),
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_the_surface_itself_lies_on_the_sphere(shape: str) -> None:
    atlas = straight(shape)
    np.testing.assert_array_equal(atlas.reference.vertices, atlas.sealed.vertices)
    np.testing.assert_array_equal(atlas.sphere.faces, atlas.sealed.faces)
    numbers = atlas.quality["sphere"]
    assert numbers["conformal_flipped_faces"] == 0 == numbers["flipped_faces"]
    assert numbers["conformal_mean_q"] < 1.05
    assert numbers["mean_abs_log_lambda"] < STALLED


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("blend", [0.0, 1.0])
def test_the_topography_is_flat_on_it(shape: str, blend: float) -> None:
    atlas = straight(shape, blend)
    assert atlas.quality["topography"]["unmapped_fraction"] == 0.0
    assert atlas.quality["topography"]["round_trip_fraction"] == 1.0
    away = np.abs(atlas.topography.surface[:, 0])
    if shape == "ring":  # what lies under the membrane's edge is not on the sealed surface
        away = away[np.abs(atlas.surface.vertices - atlas.surface.vertices.mean(0)).max(1) > 1.0]
    assert np.percentile(away, 95) < 0.1 * atlas.voxel_um


def test_what_was_sealed_on_the_way_is_listed() -> None:
    assert not any("sealed parts" in repair for repair in straight("pear").provenance["repairs"])
    assert any("sealed parts" in repair for repair in straight("ring").provenance["repairs"])
    assert straight("ring").quality["sealed"]["sealed_membrane_count"] == 1


def test_angles_or_areas() -> None:
    angles, areas = (straight("pear", blend).quality["sphere"] for blend in (0.0, 1.0))
    assert angles["mean_q"] < 1.05 < areas["mean_q"]
    assert areas["mean_abs_log_lambda"] < 0.1 * angles["mean_abs_log_lambda"]


def test_where_the_flow_stalls_on_thin_faces_the_embedding_is_better() -> None:
    history = straight("pear").sphere.error_history
    assert history[-2] > STALLED > history[-1]
    assert straight("pear").quality["sphere"]["mean_q"] < 2.0


def test_it_survives_the_file(tmp_path) -> None:
    atlas = straight("ring")
    atlas.save(tmp_path / "ring.unwrap3d")
    again = unwrap3d.load(tmp_path / "ring.unwrap3d")
    assert again.parameters.reference.keep_mesh
    np.testing.assert_array_equal(again.reference.vertices, atlas.sealed.vertices)


def test_a_map_that_cannot_be_held_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conformal, "flipped_faces", lambda *_: 3)
    with pytest.raises(FlippedFacesError, match="do not skip it") as refused:
        conformal.conformal_sphere(*small_mesh(), unwrap3d.Progress())
    assert refused.value.measured["flips"] == 3


def small_mesh() -> tuple[np.ndarray, np.ndarray]:
    surface = straight("pear").sealed
    return surface.vertices, surface.faces
