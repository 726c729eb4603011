"""The opened cell as the reference: d = 0 is the body."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from napari_unwrap3d.charts import Mask, Reference, SealedSurface
from napari_unwrap3d.geometry.mesh import euler_characteristic, is_watertight
from napari_unwrap3d.parameters import ReferenceParameters, SealedParameters, SurfaceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.cortex import cortex_depth
from napari_unwrap3d.unwrapping.reference import reference
from napari_unwrap3d.unwrapping.surface import sealed_surface, surface
from shapes import ball, grid

RADIUS, SIZE = 16.0, 61
CENTRE = (SIZE - 1) / 2
VOXEL = 0.1


def with_bumps() -> Mask:
    """A ball with a bleb of radius 6, a thin rod, and a rod that stands as an arch."""
    points = grid(SIZE)
    z, y, x = np.moveaxis(points, -1, 0)
    solid = np.linalg.norm(points, axis=-1) < RADIUS
    solid |= np.linalg.norm(points - [0, 0, RADIUS + 3], axis=-1) < 6
    solid |= (np.hypot(z, x) < 2.5) & (y > 0) & (y < RADIUS + 9)
    solid |= (np.hypot(np.hypot(z + RADIUS, y) - 6, x) < 2) & (z < 0)
    return Mask(solid, (VOXEL,) * 3, (1.0, 2.0, 3.0))


def sealed_of(mask: Mask) -> SealedSurface:
    parameters = SurfaceParameters()
    plain = surface(mask, parameters, None, silent())
    return sealed_surface(mask, plain, parameters, SealedParameters(), silent())


@pytest.fixture(scope="module")
def sealed() -> SealedSurface:
    return sealed_of(with_bumps())


def from_centre(chart: Reference, mask: Mask) -> npt.NDArray[np.float64]:
    return np.linalg.norm(mask.to_index(chart.vertices) - CENTRE, axis=1)


@pytest.mark.parametrize("method", ["cortex", "second_cortex"])
def test_the_reference_is_the_body_without_what_stands_on_it(
    sealed: SealedSurface, method: str
) -> None:
    chart = reference(sealed, ReferenceParameters(method=method, vertices=4000), silent())
    assert is_watertight(chart.faces)
    assert euler_characteristic(chart.faces) == 2
    assert chart.stopped_by == method
    radius = from_centre(chart, with_bumps())
    # A ball of the body's own size cannot enter the bleb by more than its footprint allows.
    assert np.median(np.abs(radius - RADIUS)) < 0.3
    assert np.abs(radius - RADIUS).max() < 2.5


def test_the_flow_swallows_more(sealed: SealedSurface) -> None:
    """What the second method is for: the mean distance from the body is smaller."""
    off = {
        method: np.abs(
            from_centre(
                reference(sealed, ReferenceParameters(method=method, vertices=4000), silent()),
                with_bumps(),
            )
            - RADIUS
        ).mean()
        for method in ("flow", "second_cortex")
    }
    assert off["second_cortex"] < 0.6 * off["flow"]


def test_the_body_of_a_ball_is_the_ball() -> None:
    depth = cortex_depth(ball(12.4, 35), 0.6, False, silent())
    apart = 12.4 - np.linalg.norm(grid(35), axis=-1)
    near = np.abs(apart) < 1
    assert np.abs(depth[near] - apart[near]).mean() < 0.15
    assert np.abs(depth[near] - apart[near]).max() < 0.5


def test_a_wide_bump_is_swallowed_less_in_the_second_pass() -> None:
    solid = np.asarray(with_bumps().data)
    bump = solid & (np.linalg.norm(grid(SIZE), axis=-1) > RADIUS + 0.5)
    first = cortex_depth(solid, 0.45, False, silent()) > 0
    second = cortex_depth(solid, 0.45, True, silent()) > 0
    assert (second & bump).sum() < 0.5 * (first & bump).sum()
    # Nothing of the body is lost for it.
    body = np.linalg.norm(grid(SIZE), axis=-1) < RADIUS - 0.7
    assert second[body].all()
