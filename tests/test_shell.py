"""The nodes next to the surface, and values at them that are read like an array."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.shell import NEAR_VOXELS, Shell, ShellVolume, surface_index


@pytest.fixture(scope="module")
def shell(small_atlas: Atlas) -> Shell:
    return Shell.of(small_atlas)


def test_the_shell_is_what_lies_next_to_the_surface(small_atlas: Atlas, shell: Shell) -> None:
    chart = small_atlas.topography
    near = np.zeros(chart.shape, bool).ravel()
    near[shell.flat] = True
    near = near.reshape(chart.shape)
    # Where the mask changes between two nodes of a column, the surface passes.
    passes = chart.mask[1:] != chart.mask[:-1]
    assert (near[1:] | near[:-1])[passes].mean() > 0.99
    points = chart.positions.reshape(-1, 3)[shell.flat]
    _, _, distance = small_atlas._surface_locator.closest(points)
    assert distance.max() < (NEAR_VOXELS + 1) * small_atlas.voxel_um
    to_vertex = np.linalg.norm(points - small_atlas.surface.vertices[shell.vertex], axis=1)
    assert (to_vertex >= distance - 1e-6).all()
    assert np.median(to_vertex - distance) < small_atlas.voxel_um
    layer = np.rint(surface_index(small_atlas)[:, 0])
    assert np.median(np.abs(shell.layer - layer[shell.vertex])) <= 3
    inside = shell.within(chart.mask)
    assert 0 < len(inside.flat) < len(shell.flat)
    assert chart.mask.ravel()[inside.flat].all()


def test_a_volume_is_read_like_an_array(shell: Shell) -> None:
    values = np.random.default_rng(0).normal(size=len(shell.flat)).astype(np.float32)
    values[::7] = np.nan
    volume = ShellVolume(shell, values)
    whole = np.asarray(volume)
    assert whole.shape == volume.shape == shell.shape
    assert len(volume) == shell.shape[0]
    np.testing.assert_array_equal(whole.ravel()[shell.flat], values)
    assert np.isnan(whole).sum() == whole.size - np.isfinite(values).sum()
    middle = len(volume) // 2
    for index in (middle, -1, (middle, slice(None), 3), (middle, slice(2, 5), slice(4, 6))):
        np.testing.assert_array_equal(volume[index], whole[index])
    with pytest.raises(IndexError):
        volume[len(volume)]
    with pytest.raises(IndexError):
        volume[::2]


def test_several_layers_are_read_as_their_projection(shell: Shell) -> None:
    volume = ShellVolume(shell, np.random.default_rng(1).normal(size=len(shell.flat)))
    whole = np.ma.masked_invalid(np.asarray(volume))
    low, high = len(volume) // 4, 3 * len(volume) // 4
    for name in ("max", "mean"):
        volume.projection = name
        expected = getattr(whole[low:high], name)(axis=0)
        found = volume[low:high, :, :]
        assert found.shape == (1, *shell.shape[1:])
        np.testing.assert_allclose(found[0], expected.filled(np.nan), rtol=1e-5, atol=1e-6)
        assert np.isnan(volume[low:low]).all()
