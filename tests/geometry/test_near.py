"""Nodes next to a mesh, and vertices under another sheet, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from napari_unwrap3d.geometry.near import nearest_vertices
from napari_unwrap3d.geometry.overlaps import covered
from shapes import icosphere, rotation


@pytest.mark.parametrize("periodic", [False, True])
def test_nodes_near_a_mesh_have_a_near_corner(periodic: bool) -> None:
    directions, faces = icosphere(3)
    shape = (20, 22, 24)
    vertices = 6.5 * directions + [9.3, 10.7, 11.1]
    wrapped = vertices.copy()
    positions = None
    if periodic:  # the same grid, cut elsewhere: the mesh lies over its seam
        wrapped[:, 2] = np.mod(vertices[:, 2] - 12, shape[2])
        index = np.stack(np.indices(shape), axis=-1).astype(np.float32)
        index[..., 2] = np.mod(index[..., 2] + 12, shape[2])
        positions = index
    owner = nearest_vertices(
        wrapped, vertices, faces, shape, 1.5, (2, 2, 2), positions, periodic=periodic
    )
    if periodic:
        owner = np.roll(owner, 12, axis=2)
    nodes = np.stack(np.nonzero(owner >= 0), axis=1)
    radius = np.linalg.norm(nodes - [9.3, 10.7, 11.1], axis=1)
    assert np.abs(radius - 6.5).max() < 1.8
    everywhere = np.stack(np.indices(shape), axis=-1).reshape(-1, 3)
    away = np.abs(np.linalg.norm(everywhere - [9.3, 10.7, 11.1], axis=1) - 6.5)
    assert (owner.ravel()[away < 1.3] >= 0).all()
    tree = cKDTree(vertices)
    distance = np.linalg.norm(vertices[owner[tuple(nodes.T)]] - nodes, axis=1)
    nearest = tree.query(nodes)[0]
    assert np.mean(distance <= nearest + 1e-5) > 0.95
    assert (distance <= nearest + 0.5).all()


def test_layers_that_are_not_there_are_left_out() -> None:
    directions, faces = icosphere(2)
    vertices = 5.0 * directions + 7.0
    first, last = np.full((15, 15), 4), np.full((15, 15), 9)
    whole = nearest_vertices(vertices, vertices, faces, (15, 15, 15), 1.5, (2, 2, 2))
    part = nearest_vertices(
        vertices, vertices, faces, (15, 15, 15), 1.5, (2, 2, 2), layers=(first, last)
    )
    assert (part[4:10] == whole[4:10]).all()
    assert (part[:4] == -1).all()
    assert (part[10:] == -1).all()


def test_no_vertex_of_a_single_sheet_is_covered_and_all_of_a_lower_one_are() -> None:
    rows = 64
    directions, faces = icosphere(4)
    turned = directions @ rotation(3).T  # no vertex at a pole
    v = np.arccos(turned[:, 0]) * rows / np.pi - 0.5
    u = (np.arctan2(turned[:, 1], turned[:, 2]) + np.pi) * rows / np.pi - 0.5
    lower = np.column_stack([0.3 * turned[:, 1], v, u])
    assert not covered(lower, faces, rows, 0.1).any()
    upper = lower + np.array([1.0, 0.0, 0.0])
    south = (turned[faces, 0] < 0.2).all(axis=1)  # the upper sheet is not everywhere
    both = np.concatenate([lower, upper])
    meshes = np.concatenate([faces, faces[south] + len(lower)])
    hidden = covered(both, meshes, rows, 0.1)
    assert not hidden[len(lower) :].any()
    assert hidden[: len(lower)][turned[:, 0] < 0.05].all()
    assert not hidden[: len(lower)][turned[:, 0] > 0.2].any()
    both[5] = np.nan
    assert not covered(both, meshes, rows, 0.1)[5]
    assert not covered(both, meshes, rows, 1.1).any()
