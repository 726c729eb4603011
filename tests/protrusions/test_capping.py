"""Protrusions cut off in space and capped."""

from __future__ import annotations

import numpy as np
import pytest

from blebbed import bleb_labels, blebbed_mask, blebbed_surface
from napari_unwrap3d.charts import Surface
from napari_unwrap3d.geometry.mesh import is_consistently_wound, is_watertight, signed_volume
from napari_unwrap3d.protrusions.capping import decompose
from shapes import icosphere, torus_mesh


@pytest.mark.parametrize("continues", ["border", "cortex"])
def test_all_parts_are_closed_and_add_up(continues):
    surface = blebbed_surface()
    labels = bleb_labels(blebbed_mask().to_index(surface.vertices))
    parts = decompose(surface, labels, continues=continues)
    assert set(parts.protrusions) == {1, 2, 3}
    for mesh in (*parts.protrusions.values(), parts.cortex):
        assert is_watertight(mesh.faces)
        assert is_consistently_wound(mesh.faces)
    whole = signed_volume(surface.vertices, surface.faces)
    total = sum(parts.volumes_um3.values()) + parts.cortex_um3
    assert total == pytest.approx(whole, rel=1e-9)
    assert min(parts.volumes_um3.values()) > 0
    # The two blebs that touch are mirror images.
    assert parts.volumes_um3[1] == pytest.approx(parts.volumes_um3[2], rel=0.08)


def test_a_cap_of_a_ball_has_its_volume():
    vertices, faces = icosphere(5)
    surface = Surface(vertices, faces)
    labels = (vertices[:, 0] > 0.3).astype(int)
    parts = decompose(surface, labels)
    assert parts.volumes_um3[1] == pytest.approx(np.pi * 0.7**2 * 2.3 / 3, rel=0.03)


def test_a_patch_that_goes_on_as_the_cortex_does_is_rounder():
    vertices, faces = icosphere(5)
    surface = Surface(vertices, faces)
    labels = (vertices[:, 0] > 0.8).astype(int)
    flat = decompose(surface, labels).volumes_um3[1]
    round_ = decompose(surface, labels, continues="cortex").volumes_um3[1]
    # The cap of a ball goes on as the ball: next to nothing is left of it.
    assert abs(round_) < 0.2 * flat


def test_a_protrusion_with_two_borders_gets_two_patches():
    vertices, faces = torus_mesh()
    surface = Surface(vertices, faces)
    extent = np.ptp(vertices, axis=0)
    axis = int(extent.argmax())
    labels = (vertices[:, axis] > vertices[:, axis].mean()).astype(int)
    parts = decompose(surface, labels)
    assert is_watertight(parts.protrusions[1].faces)
    assert is_watertight(parts.cortex.faces)
    total = parts.volumes_um3[1] + parts.cortex_um3
    assert total == pytest.approx(signed_volume(vertices, faces))


def test_no_protrusion_and_a_single_vertex_leave_the_cell_whole():
    vertices, faces = icosphere(3)
    labels = np.zeros(len(vertices), int)
    for label in (0, 1):
        labels[4] = label
        parts = decompose(Surface(vertices, faces), labels)
        assert not parts.protrusions
        assert parts.cortex_um3 == pytest.approx(signed_volume(vertices, faces))
