"""Simulated cells: what the truth says is what the voxels and the stack hold."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.measure import euler_number

from napari_unwrap3d.charts import Mask, Size3
from napari_unwrap3d.errors import Cancelled, ParameterError
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.simulate import KINDS, Microscope, SimulatedCell, cell
from napari_unwrap3d.simulate.bodies import Body
from napari_unwrap3d.simulate.microscope import sampling
from napari_unwrap3d.simulate.protrusions import bleb
from napari_unwrap3d.simulate.solids import body_field, build, genus, smooth_noise

SIZE = 80
PROBES_UM = (0.35, 0.5, 0.7, 0.9, 1.1)
CORNERS = np.ones((3, 3, 3))
BALL = Body(
    np.full(3, 3.95), np.full(3, 2.5), np.eye(3), np.zeros((1, 3)), np.zeros(1), np.zeros(1)
)


def sample(kind: str, seed: int = 1, roughness: float = 0.0) -> SimulatedCell:
    return kept(kind, seed, roughness)


@cache
def kept(kind: str, seed: int, roughness: float) -> SimulatedCell:
    return cell(kind, seed, size=SIZE, roughness=roughness)


@pytest.fixture(params=KINDS)
def simulated(request: pytest.FixtureRequest) -> SimulatedCell:
    return sample(request.param)


def resampled(simulated: SimulatedCell) -> np.ndarray:
    """The stack's values at the centres of the mask's voxels, by their world coordinates."""
    mask, stack = simulated.truth.mask, simulated.stack
    index = np.moveaxis(np.indices(mask.shape), 0, -1).reshape(-1, 3)
    points = mask.to_world(index) / stack.voxel_size
    values = ndimage.map_coordinates(
        np.asarray(stack.data, dtype=float), points.T, order=1, mode="nearest"
    )
    return values.reshape(mask.shape)


def ball(mask: Mask, centre: np.ndarray, radius_um: float) -> np.ndarray:
    axes = np.ogrid[tuple(slice(n) for n in mask.shape)]
    squares = [(a * mask.voxel_size[0] - c) ** 2 for a, c in zip(axes, centre, strict=True)]
    return sum(squares) < radius_um**2


# The same and different ----------------------------------------------------------


def test_the_same_arguments_give_the_same_cell_bit_for_bit() -> None:
    first, again = sample("mix"), cell("mix", 1, size=SIZE)
    assert np.array_equal(first.stack.data, again.stack.data)
    assert np.array_equal(first.truth.labels.data, again.truth.labels.data)
    assert np.array_equal(first.truth.body.data, again.truth.body.data)
    assert np.array_equal(first.truth.heights_um, again.truth.heights_um)


def test_every_seed_and_every_kind_has_another_body() -> None:
    cells = [sample(kind) for kind in KINDS] + [sample("mix", 2)]
    volumes = {int(c.truth.body.data.sum()) for c in cells}
    assert len(volumes) == len(cells)


def test_the_noise_alone_changes_with_the_microscope() -> None:
    quiet = Microscope(photons=1000.0, read_noise=0.0)
    bright = cell("mix", 1, size=SIZE, microscope=quiet)
    assert np.array_equal(bright.truth.mask.data, sample("mix").truth.mask.data)
    assert not np.array_equal(bright.stack.data, sample("mix").stack.data)


# One clean solid ----------------------------------------------------------------


def test_the_cell_is_one_piece_without_cavities(simulated: SimulatedCell) -> None:
    mask = simulated.truth.mask.data
    assert ndimage.label(mask)[1] == 1
    assert ndimage.label(mask, CORNERS)[1] == 1
    assert ndimage.label(~mask)[1] == 1


def test_the_cell_keeps_the_margin_and_fills_the_rest(simulated: SimulatedCell) -> None:
    box = ndimage.find_objects(simulated.truth.mask.data.astype(int))[0]
    assert all(side.start >= 8 and side.stop <= SIZE - 8 for side in box)
    assert max(side.stop - side.start for side in box) > 0.6 * SIZE
    # Centred, to within the voxels of a random shift.
    assert all(abs(side.start + side.stop - SIZE) <= 4 for side in box)


def test_the_genus_is_that_of_the_voxels(simulated: SimulatedCell) -> None:
    truth = simulated.truth
    for connectivity in (1, 3):
        assert 1 - euler_number(truth.mask.data, connectivity) == truth.genus
    assert truth.handles_um.shape == (truth.genus, 3)
    assert (truth.genus > 0) == (simulated.kind in {"touching_filopodia", "handles"})
    assert genus(truth.body.data) == 0


def test_genus_counts_handles_and_refuses_what_is_not_one_clean_solid() -> None:
    z, y, x = np.indices((12, 40, 40)) - np.array([6, 20, 20])[:, None, None, None]
    torus = (np.hypot(y, x) - 12) ** 2 + z**2 < 14
    ball = z**2 + y**2 + x**2 < 30
    assert genus(torus) == 1
    assert genus(ball) == 0
    assert genus(ball & ~(z**2 + y**2 + x**2 < 9)) is None  # a cavity
    assert genus((ball & (z > 1)) | (ball & (z < -1))) is None  # two pieces
    corner = np.zeros((8, 8, 8), bool)
    corner[2:4, 2:4, 2:4] = corner[4:6, 4:6, 4:6] = True
    assert genus(corner) is None  # connected or not, depending on the connectivity
    assert genus(np.zeros((4, 4, 4), bool)) is None


# Labels and heights ----------------------------------------------------------------


def test_labels_cover_the_mask_outside_of_the_body(simulated: SimulatedCell) -> None:
    truth = simulated.truth
    labels = truth.labels.data
    assert labels.dtype == np.int32
    assert np.array_equal(labels > 0, truth.mask.data & ~truth.body.data)
    assert np.array_equal(np.unique(labels), np.arange(len(truth.kinds) + 1))
    assert len(truth.heights_um) == len(truth.kinds)


def test_every_protrusion_is_one_piece_that_stands_on_the_body(simulated: SimulatedCell) -> None:
    truth = simulated.truth
    near_body = ndimage.distance_transform_cdt(~truth.body.data) == 1
    boxes = ndimage.find_objects(truth.labels.data)
    for number, box in enumerate(boxes, start=1):
        own = truth.labels.data[box] == number
        sizes = np.bincount(ndimage.label(own, CORNERS)[0].ravel())[1:]
        # Where two tips are fused, a few voxels of one may lie beyond the other.
        assert sizes.max() >= 0.98 * sizes.sum(), truth.kinds[number - 1]
        assert (own & near_body[box]).any()


@pytest.mark.parametrize(
    ("kind", "roughness"), [*((kind, 0.0) for kind in KINDS), ("mix", 0.03), ("blebs", 0.05)]
)
def test_heights_are_those_of_the_labels(kind: str, roughness: float) -> None:
    truth = sample(kind, roughness=roughness).truth
    voxel = truth.mask.voxel_size[0]
    above = ndimage.distance_transform_edt(~truth.body.data, sampling=voxel)
    highest = ndimage.maximum(above, truth.labels.data, np.arange(1, len(truth.kinds) + 1))
    assert np.abs(highest - truth.heights_um).max() < 1.5 * voxel + 3 * roughness


def test_kinds_of_protrusions_are_those_of_the_cell() -> None:
    expected = {
        "blebs": {"bleb"},
        "lamellipodia": {"lamellipodium"},
        "filopodia": {"filopodium"},
        "touching_filopodia": {"filopodium"},
        "mix": {"bleb", "lamellipodium", "filopodium"},
    }
    for kind, kinds in expected.items():
        assert set(sample(kind).truth.kinds) == kinds
    assert {"arch", "bleb"} <= set(sample("handles").truth.kinds)


def test_protrusions_are_at_least_four_voxels_thick(simulated: SimulatedCell) -> None:
    truth = simulated.truth
    inside = ndimage.distance_transform_edt(truth.mask.data)
    thickest = ndimage.maximum(inside, truth.labels.data, np.arange(1, len(truth.kinds) + 1))
    # The deepest voxel of a solid 4 voxels thick is at most 2 voxels from the outside.
    assert thickest.min() >= 2.0


def test_filling_the_places_of_handles_closes_them() -> None:
    truth = sample("handles").truth
    for place in truth.handles_um:
        left = [genus(truth.mask.data | ball(truth.mask, place, r)) for r in PROBES_UM]
        assert truth.genus - 1 in left


def test_cutting_where_filopodia_touch_opens_the_loops() -> None:
    truth = sample("touching_filopodia").truth
    for place in truth.handles_um:
        cut = [truth.mask.data & ~ball(truth.mask, place, r) for r in PROBES_UM]
        # What is cut off the tips adds pieces, not loops.
        loops = [ndimage.label(c, CORNERS)[1] - euler_number(c, 3) for c in cut]
        assert truth.genus - 1 in loops


def test_a_bleb_on_a_ball_has_the_height_and_volume_of_two_spheres() -> None:
    """The union of two balls without a blend is known in closed form."""
    size, voxel, ball, cap, rise = 80, 0.1, 2.5, 0.8, 0.5
    up = np.array([1.0, 0.0, 0.0])
    shape = bleb(BALL, up, cap, rise, np.zeros(3), 0.0, 1e-6)
    solids = build(BALL, [shape], [], size, voxel)
    apart = ball + rise
    lens = np.pi * (ball + cap - apart) ** 2
    lens *= apart**2 + 2 * apart * (ball + cap) - 3 * (ball - cap) ** 2
    expected = 4 / 3 * np.pi * cap**3 - lens / (12 * apart)
    assert solids.body.sum() * voxel**3 == pytest.approx(4 / 3 * np.pi * ball**3, rel=5e-3)
    assert (solids.labels == 1).sum() * voxel**3 == pytest.approx(expected, rel=0.02)


# The stack ---------------------------------------------------------------------------


def test_the_stack_is_what_was_asked_for() -> None:
    stack = sample("blebs").stack
    assert stack.axes == "zyx"
    assert stack.data.dtype == np.uint16
    assert stack.voxel_size == (0.3, 0.104, 0.104)
    depth = (SIZE - 1) * 0.104
    assert stack.shape == (int(depth / 0.3) + 1, SIZE, SIZE)


@pytest.mark.parametrize("voxel_size", [(0.3, 0.104, 0.104), (0.2, 0.15, 0.25)])
def test_stack_and_truth_agree_in_world_coordinates(voxel_size: Size3) -> None:
    bright = Microscope(photons=400.0)
    simulated = cell("blebs", 5, size=SIZE, voxel_size=voxel_size, microscope=bright)
    truth = simulated.truth.mask.data
    values = resampled(simulated)
    found = ndimage.binary_fill_holes(values > threshold_otsu(values))
    iou = (found & truth).sum() / (found | truth).sum()
    assert iou > 0.8
    offset = np.subtract(ndimage.center_of_mass(found), ndimage.center_of_mass(truth))
    assert np.abs(offset).max() * 0.104 < 0.03


def test_the_blur_is_anisotropic_and_the_camera_noisy() -> None:
    z, y, x = (Microscope().psf_um[a] for a in range(3))
    assert z > 2 * y == 2 * x
    simulated = sample("blebs")
    background = ndimage.binary_dilation(simulated.truth.mask.data, iterations=12)
    values = np.asarray(simulated.stack.data, dtype=float)
    corner = values[:4, :8, :8]
    microscope = simulated.microscope
    level = microscope.offset + microscope.counts_per_photon * microscope.background_photons
    assert not background[:8, :8, :8].any()
    assert corner.mean() == pytest.approx(level, rel=0.06)
    variance = microscope.counts_per_photon**2 * microscope.background_photons
    assert corner.var() == pytest.approx(variance + microscope.read_noise**2, rel=0.4)


@pytest.mark.parametrize("pixel", [0.0, 0.104, 0.3])
def test_sampling_keeps_light_and_places(pixel: float) -> None:
    count, voxel, step, sigma = 200, 0.104, 0.3, 0.35
    weights = sampling(count, voxel, step, sigma, pixel)
    where = np.arange(count) * voxel
    samples = np.arange(len(weights)) * step
    inner = (samples > 2.5) & (samples < where[-1] - 2.5)
    assert np.allclose(weights.sum(axis=1)[inner], 1.0, atol=1e-9)
    assert np.allclose((weights @ where)[inner], samples[inner], atol=1e-9)
    # Variances add up: of the Gaussian, of the pixel and of the source voxel.
    spread = weights @ where**2 - (weights @ where) ** 2
    expected = sigma**2 + (pixel**2 + voxel**2) / 12
    assert np.allclose(spread[inner], expected, atol=2e-3)


# Options ----------------------------------------------------------------------------


def test_roughness_moves_the_membrane_by_that_much() -> None:
    size, voxel, roughness = 80, 0.1, 0.05
    noise = smooth_noise(np.random.default_rng(0), size) * np.float32(roughness)
    distance = body_field(BALL, size, voxel)
    spread = []
    for displacement in (None, noise):
        mask = build(BALL, [], [], size, voxel, displacement).mask
        spread.append(distance[mask & ~ndimage.binary_erosion(mask)].var())
    assert np.sqrt(spread[1] - spread[0]) == pytest.approx(roughness, rel=0.2)
    assert sample("blebs", roughness=0.05).truth.genus == 0


def test_a_coarser_grid_holds_a_larger_cell() -> None:
    coarse = cell("filopodia", 1, size=80, working_voxel_um=0.208).truth
    assert coarse.mask.voxel_size == (0.208, 0.208, 0.208)
    assert coarse.genus == 0
    assert coarse.heights_um.max() > sample("filopodia").truth.heights_um.max()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"kind": "blob"}, "touching_filopodia"),
        ({"seed": -1}, "seed = -1"),
        ({"size": 20}, "size = 20"),
        ({"working_voxel_um": 0.0}, "working_voxel_um"),
        ({"roughness": 1.0}, "roughness = 1"),
    ],
)
def test_wrong_parameters_are_named(arguments: dict, named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        cell(**arguments)


def test_progress_rises_to_one_and_cancels() -> None:
    fractions: list[float] = []
    cell("blebs", 1, size=72, progress=Progress(lambda step, done, text: fractions.append(done)))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        cell("blebs", 1, size=72, progress=stopped)
