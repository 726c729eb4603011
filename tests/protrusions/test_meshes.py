"""The closed meshes of the parts of a cell: closed, outward, and as large as their voxels."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask, Protrusions, Volume
from napari_unwrap3d.geometry.mesh import is_watertight, nonmanifold_vertices, signed_volume
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.protrusions.meshes import CORTEX, meshes_against_whole, part_meshes
from napari_unwrap3d.simulate import cell


def parts(
    volume: np.ndarray, mask: np.ndarray, voxel: float, origin: tuple[float, ...]
) -> Protrusions:
    size = (voxel,) * 3
    labels = np.unique(volume[volume > 0])
    return Protrusions(
        labels=np.zeros(4, np.int32),
        height_um=np.zeros(4),
        volume=Volume(volume.astype(np.int32), size, origin),  # type: ignore[arg-type]
        cortex=Mask(mask & (volume == 0), size, origin),  # type: ignore[arg-type]
        columns={"label": labels},
    )


@pytest.fixture(scope="module", params=["blebs", "lamellipodia", "filopodia"])
def true_parts(request: pytest.FixtureRequest) -> tuple[Protrusions, Mask]:
    truth = cell(request.param, 11, size=112).truth
    mask = truth.mask
    return parts(truth.labels.data, mask.data, mask.voxel_size[0], mask.origin), mask


@pytest.mark.parametrize("simplified", [True, False])
def test_every_part_is_closed_and_as_large_as_its_voxels(
    true_parts: tuple[Protrusions, Mask], simplified: bool
) -> None:
    found, mask = true_parts
    meshes = part_meshes(found, simplified=simplified)
    assert list(meshes) == [CORTEX, *found.columns["label"].tolist()]
    for mesh in meshes.values():
        assert is_watertight(mesh.faces)
        assert len(nonmanifold_vertices(mesh.faces)) == 0
        assert mesh.report["volume_um3"] == pytest.approx(signed_volume(mesh.vertices, mesh.faces))
        assert mesh.report["volume_um3"] == pytest.approx(mesh.report["voxels_um3"], rel=0.06)
    assert abs(meshes_against_whole(meshes, mask)) < 0.01
    total = sum(mesh.report["voxels_um3"] for mesh in meshes.values())
    assert total == pytest.approx(mask.data.sum() * mask.voxel_size[0] ** 3)


def test_meshes_lie_where_their_voxels_are(true_parts: tuple[Protrusions, Mask]) -> None:
    found, _ = true_parts
    moved = parts(
        found.volume.data, found.cortex.data | (found.volume.data > 0), 0.25, (5.0, -3.0, 1.0)
    )
    label = int(found.columns["label"][0])
    mesh = part_meshes(moved, only=[label], simplified=False)[label]
    places = moved.volume.to_world(np.argwhere(moved.volume.data == label))
    np.testing.assert_allclose(mesh.vertices.min(axis=0), places.min(axis=0), atol=0.6)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), places.max(axis=0), atol=0.6)


def test_small_and_odd_parts_have_a_mesh_too() -> None:
    """One voxel, a line, two pieces, a corner that touches, and a solid up to the border."""
    volume = np.zeros((12, 12, 12), np.int32)
    volume[3, 3, 3] = 1
    volume[5, 5, 2:9] = 2
    volume[8, 2, 2] = volume[8, 8, 8] = 3
    volume[9, 9, 4] = volume[10, 10, 5] = 4
    volume[:2] = 5
    mask = np.ones(volume.shape, bool)
    meshes = part_meshes(parts(volume, mask, 1.0, (0.0, 0.0, 0.0)))
    assert list(meshes) == [0, 1, 2, 3, 4, 5]
    for label, mesh in meshes.items():
        assert is_watertight(mesh.faces), label
        assert mesh.report["volume_um3"] > 0, label


def test_only_what_is_asked_for_and_there_is_meshed() -> None:
    volume = np.zeros((12, 12, 12), np.int32)
    volume[3:8, 3:8, 3:8] = 4
    found = parts(volume, volume > 0, 1.0, (0.0, 0.0, 0.0))
    assert list(part_meshes(found)) == [4]  # there is no cortex
    assert list(part_meshes(found, only=[4, 9])) == [4]
    fractions: list[float] = []
    part_meshes(
        found, progress=Progress(lambda step, fraction, message: fractions.append(fraction))
    )
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
