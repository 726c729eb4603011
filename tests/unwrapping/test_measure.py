"""The numbers of the charts say what is measured otherwise, and go into JSON."""

import json

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Reference, SealedSurface, Sphere, Surface
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.unwrapping.measure import measure_sphere
from shapes import QUICK, VOXEL_UM, icosphere


def test_every_step_has_numbers_and_all_are_json(small_pipeline: Pipeline) -> None:
    small_atlas = small_pipeline.run(QUICK)
    steps = ["stack", "surface", "sealed", "reference", "sphere", "uv", "topography"]
    assert list(small_atlas.quality) == steps
    text = json.dumps(small_atlas.quality, allow_nan=False)
    assert json.loads(text)["sphere"]["flipped_faces"] == 0
    json.dumps(small_atlas.provenance, allow_nan=False)


def test_a_sphere_that_is_its_own_map_is_perfect() -> None:
    where, faces = icosphere(3)
    numbers = measure_sphere(Reference(2 * where, faces), Sphere(where, faces, conformal=where))
    assert numbers["flipped_faces"] == numbers["conformal_flipped_faces"] == 0
    assert numbers["mean_q"] == pytest.approx(1.0, abs=1e-6)
    assert numbers["conformal_mean_q"] == pytest.approx(1.0, abs=1e-6)
    assert numbers["mean_abs_log_lambda"] == pytest.approx(0.0, abs=1e-9)


def test_flips_of_either_state_are_counted() -> None:
    where, faces = icosphere(2)
    mirrored = where * [1, 1, -1]
    numbers = measure_sphere(Reference(where, faces), Sphere(mirrored, faces, conformal=where))
    assert numbers["flipped_faces"] == len(faces)
    assert numbers["conformal_flipped_faces"] == 0


@pytest.mark.parametrize("name", ["small_atlas", "handle_atlas"])
def test_the_numbers_of_the_small_cell(name: str, request: pytest.FixtureRequest) -> None:
    atlas: Atlas = request.getfixturevalue(name)
    quality = atlas.quality
    assert quality["surface"]["genus"] == (1 if name == "handle_atlas" else 0)
    for step in ("sealed", "reference"):
        assert quality[step]["genus"] == 0
        assert quality[step]["euler_characteristic"] == 2
        assert quality[step]["components"] == 1
        assert quality[step]["watertight"] is True
    assert quality["sphere"]["conformal_flipped_faces"] == 0
    assert quality["sphere"]["flipped_faces"] == 0
    assert quality["sphere"]["conformal_mean_q"] < 1.015
    assert quality["sphere"]["mean_abs_log_lambda"] <= 0.006
    assert quality["uv"]["unlocated_pixels"] == 0
    assert abs(quality["uv"]["reference_area_error"]) < 0.01
    assert quality["topography"]["folded_fraction"] == 0
    assert quality["topography"]["round_trip_fraction"] == 1.0


def test_what_was_sealed_is_counted_and_summed(handle_atlas: Atlas, small_atlas: Atlas) -> None:
    assert small_atlas.quality["sealed"]["sealed_parts"] == 0
    numbers, parts = handle_atlas.quality["sealed"], handle_atlas.sealed.sealed
    assert numbers["sealed_parts"] == len(parts) >= 1
    volume = sum(part["volume_um3"] for part in parts)
    assert numbers["sealed_volume_um3"] == pytest.approx(volume)
    largest = max(parts, key=lambda part: part["volume_um3"])
    centre = handle_atlas.mask.to_world((np.array(handle_atlas.mask.shape) - 1) / 2)
    # The arch stands on −x, so its membrane or the cut through it is there.
    offset = (np.array(largest["position_um"]) - centre) / VOXEL_UM
    np.testing.assert_allclose(offset, [0, 0, -18], atol=6)


def test_areas_agree_between_the_charts(small_atlas: Atlas) -> None:
    reference = small_atlas.reference
    area = face_areas(reference.vertices, reference.faces).sum()
    assert small_atlas.quality["uv"]["area_um2"] == pytest.approx(area, rel=0.01)
    assert small_atlas.uv.fields["area_um2"].sum() == pytest.approx(area, rel=0.01)
    assert isinstance(small_atlas.surface, Surface)
    assert isinstance(small_atlas.sealed, SealedSurface)
