"""The flowed surface is brought back to the cortex, whatever the protrusions did."""

import numpy as np
import pytest

from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.geometry.mesh import signed_volume
from napari_unwrap3d.unwrapping.cortex_fit import fit_to, fit_to_cortex
from shapes import lumpy, rotation


def test_scale_and_shift_are_recovered_also_when_some_vertices_went_far() -> None:
    vertices, faces = lumpy(3)
    mass = vertex_mass(vertices, faces)
    moved = (vertices - [3, -2, 5]) / 7.0
    np.testing.assert_allclose(fit_to(moved, vertices, mass), vertices, atol=1e-9)
    arms = vertices[:, 2] > np.quantile(vertices[:, 2], 0.85)
    moved[arms] *= 0.7  # protrusions that were drawn in
    fitted = fit_to(moved, vertices, mass)
    assert np.abs(fitted - vertices)[~arms].max() < 0.02


def test_a_given_scale_is_kept_when_the_flow_is_placed() -> None:
    vertices, faces = lumpy(3)
    mass = vertex_mass(vertices, faces)
    placed = fit_to((vertices - 5) / 7.0, vertices, mass, scale=7.0)
    np.testing.assert_allclose(placed, vertices, atol=1e-9)
    larger = fit_to((vertices - 5) / 7.0, vertices, mass, scale=8.0)
    assert signed_volume(larger, faces) == pytest.approx(
        signed_volume(vertices, faces) * (8 / 7) ** 3
    )


def cell_with_arms() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A body, the same with three arms, its faces, and which vertices are on no arm."""
    vertices, faces = lumpy(5, size=0.3)
    body = vertices * [1.0, 1.1, 0.9]
    directions = body / np.linalg.norm(body, axis=1, keepdims=True)
    reach = np.max(directions @ rotation(5).T, axis=1)
    arm = reach > 0.97
    cell = body + 6.0 * np.maximum(reach - 0.97, 0.0)[:, None] / 0.03 * directions * 0.2
    return body, cell, faces, ~arm


def test_the_proportions_of_the_cortex_come_back_and_arms_have_no_say() -> None:
    body, cell, faces, cortex = cell_with_arms()
    rounded = body @ np.diag([1.03, 0.97, 1.02]) + [0.02, -0.01, 0.03]
    fitted = fit_to_cortex(rounded, cell, faces, reach=0.03)
    before = np.linalg.norm(rounded - body, axis=1)[cortex]
    after = np.linalg.norm(fitted - body, axis=1)[cortex]
    assert after.max() < 0.2 * before.max()


def test_the_fit_turns_and_grows_with_the_cell() -> None:
    body, cell, faces, _ = cell_with_arms()
    rounded = 1.03 * body + 0.02
    turn = rotation(7)
    plain = fit_to_cortex(rounded, cell, faces, reach=0.03)
    turned = fit_to_cortex(9 * rounded @ turn.T - 4, 9 * cell @ turn.T - 4, faces, reach=0.27)
    np.testing.assert_allclose(turned, 9 * plain @ turn.T - 4, atol=1e-3)


def test_where_there_is_no_cortex_the_surface_stays_where_it_was() -> None:
    body, cell, faces, _ = cell_with_arms()
    far = 0.4 * body
    assert fit_to_cortex(far, cell, faces, reach=10.0) is far
