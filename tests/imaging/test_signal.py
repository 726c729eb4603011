"""The signal at a surface, against profiles that are known."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d import sample_signal
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Floats, Mask, Stack, Surface, Volume
from napari_unwrap3d.errors import Cancelled, ChartMissingError, InputError, NotFiniteError
from napari_unwrap3d.errors import ParameterError as WrongParameter
from napari_unwrap3d.imaging.signal import (
    InwardField,
    mean_along,
    path_points,
    percentile_along,
    surface_signal,
)
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.progress import Progress, silent
from shapes import icosphere

RADIUS = 3.0
CENTRE = np.array((4.0, 4.2, 4.4))
EDGE = 0.1
VOXEL = (0.2, 0.1, 0.08)
SHAPE = (42, 84, 110)


def radius_of(points: Any, centre: Any = CENTRE) -> Floats:
    return np.linalg.norm(np.asarray(points) - centre, axis=-1)


def world(shape: tuple[int, ...] = SHAPE, voxel_size: Any = VOXEL) -> Floats:
    return np.stack(np.indices(shape), axis=-1) * np.asarray(voxel_size)


def atlas_of(mask: Mask, vertices: Floats, faces: Any, timepoint: int = 0) -> Atlas:
    none: Any = None
    return Atlas(
        surface=Surface(vertices, faces),
        sealed=none,
        reference=none,
        sphere=none,
        uv=none,
        topography=none,
        mask=mask,
        parameters=Parameters.from_dict({"stack": {"timepoint": timepoint}}),
    )


def ball_atlas(timepoint: int = 0, centre: Floats = CENTRE) -> Atlas:
    directions, faces = icosphere(3)
    n = int(2 * (RADIUS + 0.8) / EDGE)
    origin = np.round(centre - n / 2 * EDGE, 1)
    inside = radius_of(world((n,) * 3, (EDGE,) * 3) + origin, centre) < RADIUS
    mask = Mask(inside, (EDGE,) * 3, tuple(origin))
    return atlas_of(mask, centre + RADIUS * directions, faces, timepoint)


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return ball_atlas()


def linear(points: Floats) -> Floats:
    return 100 + 40 * radius_of(points)


def falling(points: Floats) -> Floats:
    return 400 - 50 * radius_of(points)


@pytest.fixture(scope="module")
def stack() -> Stack:
    place = world()
    data = np.stack([linear(place), falling(place), 1000 - 10 * place[..., 2]])
    return Stack(data, "czyx", VOXEL, channels=("membrane", "actin", "slope"))


# Known values --------------------------------------------------------------------


@pytest.mark.parametrize("depth", [0.3, 1.0, 2.0])
def test_mean_and_percentile_of_a_radial_profile(atlas: Atlas, stack: Stack, depth: float) -> None:
    """Outwards rising: the profile falls along the path from 220 by 40 per µm."""
    mean = sample_signal(stack, atlas, 0, depth_um=depth, statistic="mean")
    np.testing.assert_allclose(mean, 220 - 40 * depth / 2, rtol=0.012)
    assert mean.mean() == pytest.approx(220 - 40 * depth / 2, rel=0.004)
    for percentile in (95.0, 50.0, 0.0):
        found = sample_signal(stack, atlas, 0, depth_um=depth, percentile=percentile)
        np.testing.assert_allclose(found, 220 - 40 * depth * (1 - percentile / 100), rtol=0.015)


def test_the_default_is_the_95th_percentile_down_to_a_micrometre(
    atlas: Atlas, stack: Stack
) -> None:
    found = sample_signal(stack, atlas, "actin")
    assert found.shape == (len(atlas.surface.vertices),)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, 250 + 50 * 0.95, rtol=0.01)
    again = sample_signal(stack, atlas, 1, depth_um=1.0, statistic="percentile", percentile=95)
    assert np.array_equal(found, again)


def test_depth_zero_reads_at_the_surface(atlas: Atlas, stack: Stack) -> None:
    found = sample_signal(stack, atlas, "slope", depth_um=0.0)
    np.testing.assert_allclose(found, 1000 - 10 * atlas.surface.vertices[:, 2], rtol=1e-5)


def test_paths_go_straight_to_the_middle_and_end_there(atlas: Atlas) -> None:
    field = InwardField.of(atlas.mask)
    points = atlas.surface.vertices
    walked = list(path_points(field, points, 6.0, 120))
    place, going = walked[40]
    assert going.all()
    np.testing.assert_allclose(radius_of(place), RADIUS - 2.0, atol=0.02)
    along = (place - CENTRE) / radius_of(place)[:, None]
    assert ((along * (points - CENTRE) / RADIUS).sum(axis=1)).min() > 0.995
    place, going = walked[-1]
    assert not going.any()
    assert radius_of(place).max() < 0.4


def test_a_path_in_a_thin_sheet_does_not_come_out_on_the_other_side() -> None:
    solid = np.zeros((40, 60, 60), dtype=bool)
    solid[17:23, 5:55, 5:55] = True  # 0.6 µm thick
    field = InwardField.of(Mask(solid, (EDGE,) * 3))
    points = np.array([[1.65, 2.0 + 0.1 * i, 3.0] for i in range(20)])
    light = np.broadcast_to(np.where(np.arange(40) < 20, 100.0, 900.0)[:, None, None], solid.shape)
    image = Volume(light, (EDGE,) * 3)
    found = surface_signal(image, points, field, 1.0, None, silent())
    assert found.max() < 300
    assert found.min() >= 100


def test_the_order_of_the_axes_does_not_matter(atlas: Atlas, stack: Stack) -> None:
    order = (2, 0, 1)
    turned = Stack(
        stack.data.transpose(0, *(a + 1 for a in order)), "czyx", tuple(VOXEL[a] for a in order)
    )
    mask = atlas.mask
    other = atlas_of(
        Mask(mask.data.transpose(order), mask.voxel_size, tuple(mask.origin[a] for a in order)),
        atlas.surface.vertices[:, order],
        atlas.surface.faces,
    )
    for channel in (0, 2):
        one = sample_signal(stack, atlas, channel)
        two = sample_signal(turned, other, channel)
        np.testing.assert_allclose(one, two, rtol=1e-4)


def test_isotropic_and_anisotropic_stacks_agree(atlas: Atlas, stack: Stack) -> None:
    fine = Stack(linear(world((84,) * 3, (EDGE,) * 3)), "zyx", (EDGE,) * 3)
    np.testing.assert_allclose(
        sample_signal(fine, atlas), sample_signal(stack, atlas, 0), rtol=0.01
    )


# Ratios and normalisation ----------------------------------------------------------


def test_a_channel_divided_by_itself_is_one(atlas: Atlas, stack: Stack) -> None:
    found = sample_signal(stack, atlas, "actin", divide_by="actin", statistic="mean")
    np.testing.assert_allclose(found, 1)


def test_a_ratio_divides_the_signals(atlas: Atlas, stack: Stack) -> None:
    options: dict[str, Any] = {"statistic": "mean", "depth_um": 0.5}
    ratio = sample_signal(stack, atlas, 0, divide_by=1, **options)
    one, two = (sample_signal(stack, atlas, channel, **options) for channel in (0, 1))
    np.testing.assert_allclose(ratio, one / two)
    normal = sample_signal(stack, atlas, 0, divide_by=1, normalize=True, **options)
    np.testing.assert_allclose(normal / ratio, normal[0] / ratio[0])
    assert normal[0] / ratio[0] == pytest.approx((400 - 50 * 2.25) / (100 + 40 * 2.25), rel=5e-3)


def test_normalised_by_the_mean_of_the_whole_cell(atlas: Atlas, stack: Stack) -> None:
    """The mean radius in a ball is ¾ R; a constant channel becomes 1."""
    raw = sample_signal(stack, atlas, 0)
    normal = sample_signal(stack, atlas, 0, normalize=True)
    np.testing.assert_allclose(raw / normal, 100 + 40 * 0.75 * RADIUS, rtol=5e-3)
    flat = Stack(np.full(SHAPE, 37, dtype=np.uint16), "zyx", VOXEL)
    np.testing.assert_allclose(sample_signal(flat, atlas, normalize=True), 1)
    bleached = Stack(stack.data * 0.3, "czyx", VOXEL)
    np.testing.assert_allclose(sample_signal(bleached, atlas, 0, normalize=True), normal, rtol=1e-5)


def test_a_divisor_of_zero_gives_nan(atlas: Atlas) -> None:
    data = np.ones((2, *SHAPE))
    data[1, :20] = 0
    found = sample_signal(Stack(data, "czyx", VOXEL), atlas, 0, divide_by=1)
    low = atlas.surface.vertices[:, 0] < 2.5
    assert np.isnan(found[low]).all()
    assert np.isfinite(found[atlas.surface.vertices[:, 0] > 4.5]).all()


# Where there is something to read ----------------------------------------------------


def test_nan_only_where_a_path_leaves_the_image(atlas: Atlas, stack: Stack) -> None:
    assert np.isfinite(sample_signal(stack, atlas)).all()
    cut = Stack(stack.data[:, :, :, :70], "czyx", VOXEL)  # the image ends at x = 5.56 µm
    found = sample_signal(cut, atlas)
    x = atlas.surface.vertices[:, 2]
    assert np.isnan(found[x > 5.56]).all()
    assert np.isfinite(found[x < 5.56]).all()
    np.testing.assert_array_equal(found[x < 5.5], sample_signal(stack, atlas)[x < 5.5])


def test_the_timepoint_is_that_of_the_atlas(stack: Stack) -> None:
    movie = Stack(np.stack([stack.data, 2 * stack.data]), "tczyx", VOXEL)
    first, second = (sample_signal(movie, ball_atlas(t), 1) for t in (0, 1))
    np.testing.assert_allclose(second, 2 * first)
    np.testing.assert_array_equal(sample_signal(stack, ball_atlas(1), 1), first)
    with pytest.raises(WrongParameter, match=r"no timepoint 2.*timepoints = 2"):
        sample_signal(movie, ball_atlas(2), 1)


def test_what_cannot_be_sampled_is_explained(atlas: Atlas, stack: Stack) -> None:
    for options, words in (
        ({"channel": "septin"}, r"no channel septin.*channels = 3.*membrane, actin"),
        ({"divide_by": 3}, r"no channel 3.*channels = 3"),
        ({"depth_um": -1.0}, r"length.*depth_um = -1"),
        ({"depth_um": float("nan")}, r"length.*depth_um = nan"),
        ({"statistic": "median"}, r"no statistic 'median'.*'mean' or 'percentile'"),
        ({"percentile": 101}, r"between 0 and 100.*percentile = 101"),
    ):
        with pytest.raises(WrongParameter, match=words):
            sample_signal(stack, atlas, **options)  # type: ignore[arg-type]
    dark = Stack(np.zeros(SHAPE), "zyx", VOXEL)
    with pytest.raises(InputError, match=r"not positive.*mean = 0.*normalize=False"):
        sample_signal(dark, atlas, normalize=True)
    with pytest.raises(InputError, match=r"outside of the stack.*surface_um.*stack_um"):
        sample_signal(stack, ball_atlas(centre=CENTRE + 40))
    broken = linear(world())
    broken[20, 40, 50:53] = np.inf
    with pytest.raises(NotFiniteError, match="voxels = 3"):
        sample_signal(Stack(broken, "zyx", VOXEL), atlas)
    none: Any = None
    with pytest.raises(ChartMissingError, match="no surface"):
        sample_signal(stack, Atlas(*[none] * 7))


def test_sampling_reports_and_can_be_stopped(atlas: Atlas, stack: Stack) -> None:
    fractions: list[float] = []
    watch = Progress(lambda step, fraction, message: fractions.append(fraction))
    sample_signal(stack, atlas, 0, divide_by=1, normalize=True, progress=watch)
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0, 1)
    stopped = threading.Event()
    stopped.set()
    with pytest.raises(Cancelled):
        sample_signal(stack, atlas, progress=Progress(cancelled=stopped))


def test_statistics_along_paths_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(21, 300))
    samples[rng.random(samples.shape) < 0.3] = np.nan
    samples[0, :] = rng.normal(size=300)
    np.testing.assert_allclose(mean_along(samples), np.nanmean(samples, axis=0))
    for percentile in (0.0, 33.3, 95.0, 100.0):
        np.testing.assert_allclose(
            percentile_along(samples, percentile), np.nanpercentile(samples, percentile, axis=0)
        )
    nothing = np.full((4, 2), np.nan)
    assert np.isnan(mean_along(nothing)).all()
    assert np.isnan(percentile_along(nothing, 95)).all()
