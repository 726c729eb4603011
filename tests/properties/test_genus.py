"""Genus 1 to 50: the surface stays as it is, the sealed surface and the reference are spheres."""

from __future__ import annotations

import numpy as np
import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.parameters import Parameters
from shapes import QUICK, VOXEL_UM, sponge, torus

VOXEL = (VOXEL_UM,) * 3
MESH_VOXEL = Parameters.from_dict({**QUICK.model_dump(), "stack": {"working_voxel_um": 0.08}})


def charts(source: unwrap3d.Mask | unwrap3d.Surface, until: str) -> unwrap3d.Atlas:
    parameters = MESH_VOXEL if isinstance(source, unwrap3d.Surface) else QUICK
    return unwrap3d.Pipeline(source).run(parameters, until=until)


def plate(holes: int) -> np.ndarray:
    """A plate with round holes in rows."""
    rows = max(1, int(np.sqrt(holes)))
    columns = -(-holes // rows)
    solid = np.zeros((16, 8 + 10 * rows, 8 + 10 * columns), bool)
    solid[4:12, 3:-3, 3:-3] = True
    y, x = np.indices(solid.shape[1:])
    for hole in range(holes):
        row, column = divmod(hole, columns)
        solid[:, np.hypot(y - 8.5 - 10 * row, x - 8.5 - 10 * column) < 3] = False
    return solid


SOLIDS = {
    "ring": (torus(10, 4, (13, 33, 33)), 1),
    **{f"plate with {holes} holes": (plate(holes), holes) for holes in (2, 7, 50)},
    "sponge": (sponge(1, 24), 23),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_any_genus_gives_spheres(name: str) -> None:
    solid, genus = SOLIDS[name]
    atlas = charts(unwrap3d.Mask(solid, VOXEL), "sphere")
    quality = atlas.quality
    assert quality["surface"]["genus"] == genus
    for chart in ("sealed", "reference"):
        assert quality[chart]["genus"] == 0, chart
        assert (quality[chart]["components"], quality[chart]["boundary_edges"]) == (1, 0), chart
    assert len(atlas.sealed.sealed) > 0
    assert any("sealed parts" in said for said in atlas.provenance["repairs"])
    assert quality["sphere"]["flipped_faces"] == 0 == quality["sphere"]["conformal_flipped_faces"]


def test_a_mesh_of_any_genus_is_kept_and_sealed_beside() -> None:
    vertices, faces = clamped_marching_cubes(plate(7).astype(np.float32) - np.float32(0.5))
    atlas = charts(unwrap3d.Surface(VOXEL_UM * vertices, faces), "reference")
    np.testing.assert_array_equal(atlas.surface.faces, faces)
    quality = atlas.quality
    assert (quality["surface"]["genus"], quality["sealed"]["genus"]) == (7, 0)
    assert quality["reference"]["genus"] == 0
