"""Scrubbing: what changes in both canvases when another timepoint is shown."""

from __future__ import annotations

import numpy as np
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from viewer.playing import TIMEPOINTS, Projector


def test_every_timepoint_has_its_mesh_and_its_field_in_both_canvases(projector: Projector) -> None:
    frame = projector.movie.frame(0)
    assert projector.cell.visible
    assert not projector.viewer.layers["surface"].visible
    count = len(frame.surface.vertices)
    assert np.allclose(projector.cell.vertices[:count], frame.surface.vertices, atol=1e-4)
    image = projector.canvas.image("uv")
    assert np.array_equal(image.data, frame.uv[projector.canvas.colouring.field], equal_nan=True)
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
    # What is hidden follows when it is shown.
    projector.cell.visible = False
    projector.go_to(2)
    projector.cell.visible = True
    frame = projector.movie.frame(2)
    assert np.allclose(
        projector.cell.vertices[: len(frame.surface.vertices)], frame.surface.vertices, atol=1e-4
    )
    # Without a movie the window shows the common space.
    projector.go_to(2)
    projector.session.set_movie(None)
    assert "cell at t" not in projector.viewer.layers
    assert projector.views.layers is None
    assert projector.session.frame is None
    QTest.keyClick(projector.main, Qt.Key.Key_Period)


def test_charts_of_the_common_space_follow_and_fields_keep_their_limits(
    projector: Projector,
) -> None:
    field = projector.canvas.colouring.field
    sphere = projector.viewer.layers["sphere"]
    before = np.array(sphere.vertex_values)
    projector.go_to(3)
    projector.settle()
    after = np.asarray(sphere.vertex_values)
    assert (before != after).any()
    atlas, frame = projector.movie.common, projector.movie.frame(3)
    expected = np.nan_to_num(atlas.carry(frame.uv[field], "uv", "sphere"))
    assert np.allclose(after[: len(expected)], expected, atol=1e-5)
    # The topographic surface is that of the timepoint.
    flat = projector.viewer.layers["topographic surface"]
    flat.visible = True
    for timepoint in (2, 4):
        projector.go_to(timepoint)
        topography = projector.movie.frame(timepoint).topography
        origin = flat.metadata["napari_unwrap3d"]["vertices"]
        assert np.allclose(flat.vertices[:, 0], topography[origin, 0], atol=1e-4)
        assert len(flat.vertex_values) == len(flat.vertices)
    # A field is drawn with the same limits at every timepoint.
    colouring = projector.canvas.colouring
    names = colouring.fields.names
    assert {"height_um", "area_um2", "signal_membrane", "signal_ramp"} <= set(names)
    box = projector.canvas.colour_bar.field_box
    for field in ("signal_ramp", "area_um2", "area_distortion"):
        box.setCurrentIndex(box.findData(field))
        box.activated.emit(box.currentIndex())
        projector.wait(lambda field=field: colouring.field == field and not colouring.busy)
        seen = []
        for timepoint in (0, TIMEPOINTS - 1):
            projector.go_to(timepoint)
            image = projector.canvas.image("uv")
            assert image.contrast_limits == list(colouring.limits)
            assert tuple(projector.cell.contrast_limits) == colouring.limits
            assert projector.cell.colormap.name == image.colormap.name == colouring.colormap.name
            seen.append((np.array(image.data), colouring.limits))
            shown = projector.layers.shown
            assert shown is not None
            # The mesh shows what the image shows where it is.
            expected = shown.sampled(np.asarray(image.data))[shown.laid.origin]
            own = np.asarray(projector.cell.vertex_values)
            known = np.isfinite(expected) & (own != 0)
            difference = np.abs(own - expected)[known]
            assert np.median(difference) <= 0.1 * np.ptp(colouring.limits)
        assert seen[0][1] == seen[1][1]
        static = field == "area_distortion"
        assert np.array_equal(seen[0][0], seen[1][0], equal_nan=True) == static


def test_the_linked_cursor_is_on_the_surface_of_the_timepoint(projector: Projector) -> None:
    projector.go_to(3)
    projector.settle()
    cursor, frame = projector.canvas.cursor, projector.movie.frame(3)
    atlas = projector.movie.common
    # From uv to the surface: near a vertex that lies outermost there, at its height.
    for vertex in np.linspace(0, len(frame.surface.vertices) - 1, 12).astype(int):
        d, v, u = frame.topography[vertex]
        if abs(frame.uv["height_um"][int(v + 0.5), int(u + 0.5) % 128] - d) > 0.2:
            continue
        place = cursor._places.at_pixel("uv", np.clip((v, u), 0, np.array(atlas.uv.shape) - 1))
        distance = np.linalg.norm(place.on_frame - frame.surface.vertices[vertex])
        assert distance < 3 * atlas.voxel_um
    # And back: from a face of the mesh to where its corners are in (d, v, u).
    face = frame.surface.faces[100]
    place = cursor._places.on_mesh("frame", face, np.array([0.2, 0.3, 0.5]))
    assert np.allclose(place.on_frame, np.array([0.2, 0.3, 0.5]) @ frame.surface.vertices[face])
    assert frame.topography[face, 0].min() <= place.topography[0] <= frame.topography[face, 0].max()
    cursor.show(place)
    marks = cursor._in_3d(projector.viewer, place)
    assert any(np.allclose(mark, place.on_frame) for mark in marks)
    assert f"{place.on_frame[0]:.2f}" in projector.canvas.status.text().replace("−", "-")
    # What the pointer is over on the surface is marked in uv.
    projector.go_to(1)
    projector.settle()
    camera = projector.viewer.scene.camera
    camera.center = tuple(projector.cell.extent.world.mean(axis=0))
    camera.zoom = 40.0
    main = projector.main
    middle = QPoint(main.width() // 2, main.height() // 2)
    offsets = iter(range(10_000))

    def marked() -> bool:
        QTest.mouseMove(main, middle + QPoint(next(offsets) % 5, 0))
        return cursor.place is not None and cursor.place.on_frame is not None

    projector.wait(marked)
    # What lies there in uv is what the pointer is over.
    v, u = np.floor(cursor.place.uv + 0.5).astype(int)
    height = projector.movie.frame(1).uv["height_um"][v, u % 128]
    assert abs(height - cursor.place.topography[0]) < 3 * projector.movie.common.voxel_um
