"""Protrusions over the cortex: parts that add up, known shapes, turned and scaled cells."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import ndimage
from sklearn.metrics import adjusted_rand_score

from napari_unwrap3d.charts import Mask, Surface
from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.parameters import ProtrusionParameters, SurfaceParameters
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.protrusions.over_cortex import over_cortex
from napari_unwrap3d.protrusions.segment import Segmentation
from napari_unwrap3d.unwrapping.surface import surface
from shapes import VOXEL_UM, ball, grid, tube_along

SIZE = 72
RADIUS = 20.0
MIDDLE = (SIZE - 1) / 2


def rod(direction: list[float], length: float, radius: float) -> np.ndarray:
    """A round rod from the middle, ending `length` voxels from it."""
    unit = np.array(direction) / np.linalg.norm(direction)
    steps = np.linspace(0, length - radius, 120)[:, None]
    return tube_along(MIDDLE + steps * unit, radius, (SIZE,) * 3)


def knob(direction: list[float], away: float, radius: float) -> np.ndarray:
    unit = np.array(direction) / np.linalg.norm(direction)
    return np.linalg.norm(grid(SIZE) - away * unit, axis=-1) < radius


@cache
def body() -> np.ndarray:
    return ball(RADIUS, SIZE)


@cache
def cell(name: str) -> np.ndarray:
    """A ball with what its name says."""
    solid = body().copy()
    if name == "blebs":
        for direction in ([1, 0.2, 0], [-0.3, 1, 0.4], [0.1, -0.5, 1], [-1, -0.4, -0.6]):
            solid |= knob(direction, 22, 6.5)
    if name == "filopodia":
        for direction in ([1, 0.3, 0], [-0.3, 1, 0.4], [0.1, -0.5, 1], [-1, -0.4, -0.6]):
            solid |= rod(direction, 33, 2.6)
    if name == "sheet":
        points = grid(SIZE)
        across = np.abs(points[..., 0] - 1.3) < 2.2
        solid |= across & (np.hypot(points[..., 1], points[..., 2]) < 31) & (points[..., 2] > 5)
    if name == "arch":
        turn = np.linspace(0, np.pi, 300)
        curve = np.stack([0 * turn, 13 * np.cos(turn), 14 + 14 * np.sin(turn)], axis=1)
        solid |= tube_along(MIDDLE + curve, 2.6, (SIZE,) * 3)
    if name == "dumbbell":
        solid = ball(15, SIZE) & False
        for side, radius in ((-14.0, 17.0), (15.0, 14.0)):
            solid |= knob([1, 0, 0], side, radius)
    if name == "tunnel":
        hole = tube_along(
            MIDDLE + np.stack([np.linspace(-40, 40, 400), *np.full((2, 400), 9.0)], axis=1),
            2.0,
            (SIZE,) * 3,
        )
        solid = (solid | knob([1, 0.2, 0], 22, 6.5)) & ~hole
    return solid


def of(solid: np.ndarray, voxel_um: float = VOXEL_UM) -> tuple[Mask, Surface]:
    mask = Mask(solid, (voxel_um,) * 3, (1.0, -2.0, 0.5))
    return mask, surface(mask, SurfaceParameters(), None, silent())


def found(solid: np.ndarray, voxel_um: float = VOXEL_UM, **parameters: object) -> Segmentation:
    return over_cortex(*of(solid, voxel_um), ProtrusionParameters(**parameters), silent())


@cache
def segmented(name: str) -> Segmentation:
    return found(cell(name))


NAMES = ["ball", "blebs", "filopodia", "sheet", "arch", "dumbbell", "tunnel"]


@pytest.mark.parametrize("name", NAMES)
def test_a_voxel_is_in_the_cortex_or_in_one_protrusion(name: str) -> None:
    result, solid = segmented(name), cell(name)
    assert ((result.volume > 0) ^ result.cortex)[solid].all()
    assert not result.volume[~solid].any()
    assert not result.cortex[~solid].any()
    count = int(result.volume.max())
    assert set(np.unique(result.labels)) <= set(range(count + 1))
    for label in range(1, count + 1):
        pieces = ndimage.label(result.volume == label, np.ones((3, 3, 3)))[1]
        assert pieces == 1
    sizes = np.bincount(result.volume.ravel(), minlength=1)[1:]
    assert (np.diff(sizes) <= 0).all()


@pytest.mark.parametrize(
    ("name", "count"),
    [("ball", 0), ("blebs", 4), ("filopodia", 4), ("sheet", 1), ("arch", 1), ("dumbbell", 1)],
)
def test_as_many_protrusions_as_were_made(name: str, count: int) -> None:
    assert segmented(name).volume.max() == count


@pytest.mark.parametrize("name", ["blebs", "filopodia", "sheet", "arch"])
def test_the_cortex_is_the_body(name: str) -> None:
    cortex = segmented(name).cortex
    assert (cortex ^ body()).sum() < 0.012 * body().sum()


def test_one_may_cover_half_of_the_cell() -> None:
    """A cap on a stalk, over a whole half of the body."""
    points = grid(SIZE)
    away, above = np.linalg.norm(points, axis=-1), points[..., 0] > 0
    stalk = (np.hypot(points[..., 1], points[..., 2]) < 4) & above & (points[..., 0] < 22)
    cap = (away > 19) & (away < 23) & above
    solid = (away < 15) | stalk | cap
    result = found(solid)
    assert result.volume.max() == 1
    assert (result.volume[cap] == 1).all()
    assert result.cortex[away < 13].all()
    assert (result.labels > 0).mean() > 0.5


def test_a_ball_has_no_height() -> None:
    result = segmented("ball")
    assert np.abs(result.height_um).max() < 0.6 * VOXEL_UM
    assert result.numbers["kind_reason"] == "nothing stands out of the cortex"


def test_the_height_of_rods_is_their_length() -> None:
    result = segmented("filopodia")
    for label in range(1, 5):
        top = result.height_um[result.labels == label].max() / VOXEL_UM
        # The surface of the mask is smoothed, which takes half a voxel off thin tips.
        assert abs(top - (33 - RADIUS)) < 0.8


@pytest.mark.parametrize(
    ("name", "kind"), [("blebs", "blebs"), ("filopodia", "filopodia"), ("sheet", "lamellipodia")]
)
def test_the_kind_is_found_and_a_reason_given(name: str, kind: str) -> None:
    numbers = segmented(name).numbers
    assert numbers["kind"] == kind
    assert kind in numbers["kind_reason"]
    assert found(cell(name), kind="blebs").numbers["kind_reason"] == "chosen"


def test_a_tunnel_through_the_body_makes_no_protrusion() -> None:
    result = segmented("tunnel")
    assert result.volume.max() == 1
    alone = found(body() | knob([1, 0.2, 0], 22, 6.5))
    difference = ((result.volume > 0) ^ (alone.volume > 0)).sum()
    assert difference < 0.1 * (alone.volume > 0).sum()


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)])
def test_a_quarter_turn_changes_no_label(axes: tuple[int, int]) -> None:
    turned = found(np.rot90(cell("blebs"), axes=axes))
    before = np.rot90(segmented("blebs").volume, axes=axes)
    inside = np.rot90(cell("blebs"), axes=axes)
    assert adjusted_rand_score(before[inside], turned.volume[inside]) > 0.99


def test_the_unit_of_length_only_scales_the_heights() -> None:
    larger, result = found(cell("blebs"), 3 * VOXEL_UM), segmented("blebs")
    np.testing.assert_array_equal(larger.volume, result.volume)
    np.testing.assert_array_equal(larger.labels, result.labels)
    np.testing.assert_allclose(larger.height_um, 3 * result.height_um, atol=1e-4)


def test_room_around_the_cell_changes_nothing() -> None:
    wider = found(np.pad(cell("blebs"), ((5, 0), (0, 9), (2, 3))))
    np.testing.assert_array_equal(wider.volume[5:, :-9, 2:-3], segmented("blebs").volume)


def test_small_and_low_ones_are_left_out_on_request() -> None:
    assert found(cell("blebs"), least_height_um=2.0).volume.max() == 0
    assert found(cell("blebs"), least_area_um2=50.0).volume.max() == 0


def test_a_given_threshold_is_taken() -> None:
    high = found(cell("blebs"), threshold_um=0.3)
    assert high.numbers["threshold_um"] == pytest.approx(0.3)
    assert 0 < (high.volume > 0).sum() < (segmented("blebs").volume > 0).sum()


def test_an_arch_is_two_filopodia_where_feet_are_not_joined() -> None:
    assert found(cell("arch"), join=0.0).volume.max() == 2


def test_twice_the_same() -> None:
    again = found(cell("filopodia"))
    np.testing.assert_array_equal(again.volume, segmented("filopodia").volume)
    np.testing.assert_array_equal(again.height_um, segmented("filopodia").height_um)


def test_it_can_be_cancelled() -> None:
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        over_cortex(*of(cell("ball")), ProtrusionParameters(), progress)


def test_a_surface_of_its_own_vertices_gets_a_label_each() -> None:
    mask, mesh = of(cell("blebs"))
    fewer = replace(mesh, vertices=mesh.vertices + 0.01)
    result = over_cortex(mask, fewer, ProtrusionParameters(), silent())
    assert result.labels.shape == result.height_um.shape == (len(mesh.vertices),)
    assert np.isfinite(result.height_um).all()
