"""The registration of movies: of images, labels, masks and meshes, of channels, and its table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from skimage.measure import marching_cubes

from napari_unwrap3d import Mask, Movie, Parameters, Stack, Surface
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.motion.stages import MovieWork
from napari_unwrap3d.motion.timelapse import Source, Timelapse
from napari_unwrap3d.progress import silent
from turned import CENTRE, VOXEL, body_points, moved, recorded, solid

POSES = [Rigid(), moved((0, 0, 0), (0.3, 0.25, -0.4)), moved((0, 0, 0), (-0.3, 0.6, 0.2))]
TURNS = [Rigid(), moved((3, -2, 4), (0.3, 0.25, -0.4))]
ASIDE = np.array([0.12, -0.21, 0.3])


def image(poses: Sequence[Rigid] = POSES, channels: bool = False) -> Stack:
    frames = []
    for t, pose in enumerate(poses):
        frame = [recorded(pose, (t,), noise=3, seed=t).data]
        if channels:
            other = recorded(Rigid(translation=ASIDE) @ pose, (t,), noise=3, seed=t + 50).data
            frame.append(other.max() - other)
        frames.append(np.stack(frame))
    data = np.clip(np.rint(np.stack(frames)), 0, None).astype(np.uint16)
    if not channels:
        return Stack(data[:, 0], "tzyx", VOXEL, 2.0)
    return Stack(data, "tczyx", VOXEL, 2.0, ("shape", "signal"))


def work_on(source: Stack | Sequence[Source], folder: Path, **groups: Any) -> MovieWork:
    chosen = Parameters.from_dict({"uv": {"rows": 32}, **groups})
    work = MovieWork(Timelapse.of(source, 2.0), chosen, MovieFolder(folder))
    work.begin()
    return work


def wrong_by_voxels(found: Rigid, true: Rigid) -> float:
    points = body_points()
    away = found.apply(true.apply(points)) - points
    return float(np.linalg.norm(away, axis=1).max()) / min(VOXEL)


def labels(poses: Sequence[Rigid] = POSES) -> Stack:
    data = [3 * solid(pose, (t,)).data.astype(np.uint8) for t, pose in enumerate(poses)]
    for frame in data:
        frame[:4] = 7  # another thing, larger than nothing, that does not move
    return Stack(np.stack(data), "tzyx", VOXEL, 2.0)


def masks(poses: Sequence[Rigid] = POSES) -> list[Mask]:
    return [solid(pose, (t,)) for t, pose in enumerate(poses)]


def meshes(poses: Sequence[Rigid] = POSES) -> list[Source]:
    """Each timepoint's mask as a mesh: cubes' corners, in the world of the mask."""
    found: list[Source] = []
    for mask in masks(poses):
        field = ndimage.gaussian_filter(mask.data.astype(float), (0.5, 1, 1))
        corners, faces, _, _ = marching_cubes(field, 0.5, spacing=mask.voxel_size)
        surface = Surface(corners.astype(float), faces[:, ::-1].astype(np.int64))
        found.append(surface)
    return found


def test_an_image_is_registered_and_told_in_a_table(tmp_path: Path) -> None:
    work = work_on(image(), tmp_path)
    for timepoint, true in enumerate(POSES):
        work.register(timepoint, silent())
        assert wrong_by_voxels(work.registered(timepoint).pose, true) < 0.1
    table = Movie(work.folder).registration_table()
    assert list(table.columns) == [
        *("timepoint", "time_s", "shift_z_um", "shift_y_um", "shift_x_um", "shift_um"),
        *("angle_deg", "residual_before", "residual", "corresponding"),
    ]
    assert table.timepoint.tolist() == [0, 1, 2]
    assert table.time_s.tolist() == [0.0, 2.0, 4.0]
    shifts = table[["shift_z_um", "shift_y_um", "shift_x_um"]].to_numpy()
    expected = np.array([pose.apply(CENTRE) - CENTRE for pose in POSES])
    np.testing.assert_allclose(shifts, expected, atol=0.015)
    np.testing.assert_allclose(table.shift_um, np.linalg.norm(expected, axis=1), atol=0.015)
    assert (table.angle_deg == 0).all()
    assert (table.residual[1:] < table.residual_before[1:]).all()
    assert not table.isna().any().any()


@pytest.mark.parametrize(("source", "stack"), [(labels, {"label": 3}), (masks, {}), (meshes, {})])
def test_labels_masks_and_meshes_are_registered_too(
    source: Any, stack: dict[str, int], tmp_path: Path
) -> None:
    work = work_on(source(TURNS), tmp_path, registration={"method": "rigid"}, stack=stack)
    work.register(1, silent())
    found = work.registered(1)
    assert wrong_by_voxels(found.pose, TURNS[1]) < 0.5
    assert found.numbers["angle_deg"] == pytest.approx(TURNS[1].angle_deg, abs=0.5)


def test_a_crop_chooses_which_cell_is_followed(tmp_path: Path) -> None:
    wide = (42, 84, 150)
    rng = np.random.default_rng(0)
    frames = []
    for pose in POSES[:2]:
        frame = recorded(pose, noise=3, shape=wide).data
        frame[8:34, 10:74, 90:148] = 400 + rng.normal(size=(26, 64, 58))
        frames.append(np.rint(frame).astype(np.uint16))
    stack = Stack(np.stack(frames), "tzyx", VOXEL, 2.0)
    work = work_on(stack, tmp_path, stack={"crop_voxels": [1, 42, 1, 84, 2, 86]})
    assert wrong_by_voxels(work.registered(1).pose, POSES[1]) < 0.1


def test_nothing_is_moved_without_registration(tmp_path: Path) -> None:
    work = work_on(image(), tmp_path, registration={"method": "none"})
    for timepoint in range(3):
        work.register(timepoint, silent())
        assert work.registered(timepoint).pose.is_identity
    table = Movie(work.folder).registration_table()
    assert table.iloc[:, 2:].isna().all().all()


@pytest.mark.parametrize("at", ["first", "each"])
def test_channels_are_moved_onto_the_outline(at: str, tmp_path: Path) -> None:
    chosen = {"channels": True, "channel_timepoints": at}
    work = work_on(image(POSES[:2], channels=True), tmp_path, registration=chosen)
    found = [work.registered(timepoint) for timepoint in range(2)]
    for registered in found:
        assert set(registered.channels) == {1}
        assert registered.channels[1].translation == pytest.approx(-ASIDE, abs=0.04)
    same = found[0].channels[1].to_list() == found[1].channels[1].to_list()
    assert same == (at == "first")
    # A point of the cell, where the second channel shows it at the second timepoint.
    seen = POSES[1].apply(CENTRE) + ASIDE
    assert found[1].of_channel(1).apply(seen) == pytest.approx(CENTRE, abs=0.05)
    table = Movie(work.folder).registration_table()
    assert table.shift_x_um_signal.to_numpy() == pytest.approx([0.3, 0.3], abs=0.04)


def test_registering_again_where_what_is_seen_changes(tmp_path: Path) -> None:
    source = image(POSES[:2], channels=True)
    key = work_on(source, tmp_path).registration_key(1)
    assert work_on(source, tmp_path).registration_key(1) == key
    assert work_on(source, tmp_path, movie={"depth_um": 0.5}).registration_key(1) == key
    for stack in ({"channel": 1}, {"crop_voxels": [1, 42, 1, 84, 2, 80]}, {"label": 2}):
        assert work_on(source, tmp_path, stack=stack).registration_key(1) != key
    assert work_on(source, tmp_path, registration={"blur_um": 0.5}).registration_key(1) != key


def test_the_cell_of_a_turned_timepoint_is_that_of_the_first(tmp_path: Path) -> None:
    work = work_on(image(TURNS), tmp_path, registration={"method": "rigid"})
    found = []
    for timepoint in range(2):
        work.segment(timepoint, silent())
        mask, _ = work.folder.mask(timepoint)
        inside = mask.to_world(np.argwhere(mask.data))
        found.append((len(inside), inside.mean(axis=0)))
    assert found[1][0] == pytest.approx(found[0][0], rel=0.03)
    assert found[1][1] == pytest.approx(found[0][1], abs=0.1)
