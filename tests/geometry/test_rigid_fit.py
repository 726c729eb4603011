"""Rigid fits: known motions are found to a hundredth of a voxel, whatever the light."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.geometry.rigid_fit import Samples, fit_motion, moved_back, sampled
from napari_unwrap3d.geometry.sharp_fit import SharpPair, refined_motion

EDGE = 0.5
SIZE = 40
MIDDLE = np.full(3, (SIZE - 1) / 2 * EDGE)
ORIGIN = (1.0, -2.0, 0.5)


def blobs(points: np.ndarray) -> np.ndarray:
    """A smooth function (n,) of points (n, 3) in µm, different along all axes."""
    rng = np.random.default_rng(3)
    value = np.zeros(len(points))
    for _ in range(12):
        place = MIDDLE + rng.uniform(-5, 5, 3)
        value += rng.uniform(0.5, 1) * np.exp(-((points - place) ** 2).sum(axis=1) / (2 * 1.6**2))
    return value


def grid(pose: Rigid, origin: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    points = np.indices((SIZE,) * 3).reshape(3, -1).T * EDGE + np.asarray(origin)
    return blobs(pose.inverse().apply(points)).reshape((SIZE,) * 3).astype(np.float32)


def samples() -> Samples:
    fixed = grid(Rigid())
    index = np.argwhere(np.ones(fixed.shape, bool))[::7]
    slopes = np.stack([g[tuple(index.T)] / EDGE for g in np.gradient(fixed)], axis=1)
    return Samples(index * EDGE, fixed[tuple(index.T)].astype(float), slopes.astype(float))


def motion(rotate: bool = True) -> Rigid:
    turn = Rotation.from_rotvec(np.radians([2.0, -3.0, 1.5]) * rotate).as_matrix()
    return Rigid.about(MIDDLE, turn, (0.6, -0.4, 0.5))


def error(found: Rigid, true: Rigid) -> float:
    corners = MIDDLE + 6 * np.array([(1, 1, 1), (-1, 1, 0), (0, -1, 1), (1, 0, -1)])
    return float(np.linalg.norm(found.apply(true.apply(corners)) - corners, axis=1).max()) / EDGE


@pytest.mark.parametrize("rotate", [True, False])
def test_motion_gain_offset_and_slope_are_told_apart(rotate: bool) -> None:
    true = motion(rotate)
    slope = np.linspace(0, 0.2, SIZE, dtype=np.float32)[:, None]
    dim = 0.4 * grid(true, ORIGIN) + 3 + slope
    fit = fit_motion(samples(), dim, ORIGIN, EDGE, Rigid(), rotate=rotate)
    assert error(fit.pose, true) < 0.02
    assert fit.light[0] == pytest.approx(1 / 0.4, rel=0.01)


def test_places_that_do_not_correspond_drop_out() -> None:
    true = motion()
    moving = grid(true)
    moving[5:16, 22:34, 20:30] += 1.5
    here = samples()
    fit = fit_motion(here, moving, (0, 0, 0), EDGE, Rigid(), rotate=True)
    assert error(fit.pose, true) < 0.05
    found, _ = sampled(moving, (0, 0, 0), EDGE, here.points, fit.pose)
    weights = fit.weights(here.values, found, here.points)
    changed = found - blobs(here.points) > 0.5
    assert changed.sum() > 50
    assert (weights[changed] == 0).all()


def test_what_is_outside_of_the_moving_volume_does_not_count() -> None:
    true = motion()
    fit = fit_motion(samples(), grid(true)[:, :27], (0, 0, 0), EDGE, Rigid(), rotate=True)
    assert error(fit.pose, true) < 0.03
    _, inside = sampled(grid(true), (0, 0, 0), EDGE, np.array([[-1.0, 3, 3], [3, 3, 3]]), Rigid())
    assert inside.tolist() == [False, True]


def test_without_anything_to_go_by_the_start_stays() -> None:
    flat = np.ones((SIZE,) * 3, np.float32)
    points = samples().points
    nothing = Samples(points, np.ones(len(points)), np.zeros((len(points), 3)))
    start = motion()
    assert fit_motion(nothing, flat, (0, 0, 0), EDGE, start, rotate=True).pose is start
    pair = SharpPair(flat, flat, flat, np.zeros(3), np.zeros(3), EDGE, np.ones(3))
    assert refined_motion(pair, np.zeros_like(flat), start, rotate=True) is start
    assert refined_motion(pair, flat, start, rotate=True) is start


def test_steps_are_undone() -> None:
    step = np.array([0.3, -0.2, 0.1, 0.02, 0.01, -0.03])
    pose = moved_back(step, MIDDLE, 2.0)
    assert pose.apply(MIDDLE) - MIDDLE == pytest.approx(-step[:3])
    turned = Rotation.from_matrix(pose.rotation).as_rotvec()
    assert turned == pytest.approx(-step[3:] / 2.0)


def sharp_pair(true: Rigid, noise: float, seed: int) -> tuple[SharpPair, np.ndarray]:
    rng = np.random.default_rng(seed)
    fixed = grid(Rigid()) + noise * rng.normal(size=(SIZE,) * 3)
    moving = 0.7 * grid(true, ORIGIN) + noise * rng.normal(size=(SIZE,) * 3) + 1
    smooth = ndimage.gaussian_filter(fixed, 1.5)
    images = [image.astype(np.float32) for image in (fixed, moving, smooth)]
    pair = SharpPair(*images, np.zeros(3), np.array(ORIGIN), EDGE, np.zeros(3))
    weights = np.ones((SIZE,) * 3, np.float32)
    return pair, weights


@pytest.mark.parametrize("rotate", [True, False])
def test_sharp_volumes_give_the_rest(rotate: bool) -> None:
    true = motion(rotate)
    near = Rigid(translation=np.array([0.1, -0.15, 0.1])) @ true.inverse()
    pair, weights = sharp_pair(true, 0.0, 0)
    assert error(refined_motion(pair, weights, near, rotate=rotate), true) < 0.02
    pair, weights = sharp_pair(true, 0.08, 0)
    assert error(refined_motion(pair, weights, near, rotate=rotate), true) < 0.1


def test_a_blur_that_does_not_turn_is_allowed_for() -> None:
    true = motion()
    sigma = np.array([2.4, 0.0, 0.0])
    fixed, moving = (ndimage.gaussian_filter(grid(pose), sigma) for pose in (Rigid(), true))
    weights = np.zeros(fixed.shape, np.float32)
    weights[6:-6, 6:-6, 6:-6] = 1
    errors = []
    for blur in (sigma * EDGE, np.zeros(3)):
        pair = SharpPair(fixed, moving, fixed, np.zeros(3), np.zeros(3), EDGE, blur)
        errors.append(error(refined_motion(pair, weights, true.inverse(), rotate=True), true))
    assert errors[0] < 0.5 * errors[1]
