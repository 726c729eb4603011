"""Scrubbing: what changes in both canvases when another timepoint is shown."""

from __future__ import annotations

import numpy as np

from viewer.playing import TIMEPOINTS, Projector


def test_the_first_frame_stands_in_the_place_of_the_mean_surface(projector: Projector) -> None:
    frame = projector.movie.frame(0)
    assert projector.cell.visible
    assert not projector.viewer.layers["surface"].visible
    count = len(frame.surface.vertices)
    assert np.allclose(projector.cell.vertices[:count], frame.surface.vertices, atol=1e-4)
    image = projector.canvas.image("uv")
    assert np.array_equal(image.data, frame.uv[projector.canvas.colouring.field], equal_nan=True)


def test_every_timepoint_has_its_mesh_and_its_field_in_both_canvases(projector: Projector) -> None:
    field = projector.canvas.colouring.field
    for timepoint in (*range(1, TIMEPOINTS), 0):
        projector.go_to(timepoint)
        frame = projector.movie.frame(timepoint)
        vertices, faces, values = projector.cell.data
        count = len(frame.surface.vertices)
        assert np.allclose(vertices[:count], frame.surface.vertices, atol=1e-4)
        # The copies at the seam are where the vertices are that they are copies of.
        assert np.allclose(vertices[faces], frame.surface.vertices[frame.surface.faces], atol=1e-4)
        known = np.nan_to_num(frame.surface.fields[field])
        assert np.allclose(values[:count], known, rtol=1e-5)
        image = projector.canvas.image("uv")
        assert np.array_equal(image.data, frame.uv[field], equal_nan=True)
