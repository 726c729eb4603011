"""Step 4: the image grid, and which way round it is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import UV, Reference, Sphere
from napari_unwrap3d.parameters import UVParameters
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.uv import (
    direction_to_uv,
    pixel_distortion,
    pixel_grid,
    uv,
    uv_to_direction,
)
from shapes import BUMPS, cell_centre, icosphere

RADIUS = 3.0


def round_charts(curvature: np.ndarray | None = None) -> tuple[Reference, Sphere]:
    where, faces = icosphere(4)
    values = np.ones(len(where)) if curvature is None else curvature
    base = Reference(RADIUS * where, faces, {"mean_curvature_per_um": values})
    return base, Sphere(where, faces, conformal=where)


def made(rows: int = 32, weight: str = "none") -> tuple[UV, Reference, Sphere]:
    base, ball = round_charts(icosphere(4)[0][:, 1] ** 2)
    chart = uv(base, ball, UVParameters(rows=rows, axis_weight=weight), silent())
    return chart, base, ball


def test_directions_by_hand() -> None:
    """Row 0 is at +z; the middle column is at azimuth 0, that is +x."""
    points = np.array([[-0.5, 7.0], [15.5, 31.5], [15.5, 47.5], [31.5, 3.0], [15.5, 15.5]])
    expected = [[1, 0, 0], [0, 0, 1], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    np.testing.assert_allclose(uv_to_direction(points, 32), expected, atol=1e-12)


def test_pixels_lie_at_the_angles_of_the_charts_definition() -> None:
    grid = pixel_grid(16)
    assert grid.shape == (16, 32, 2)
    np.testing.assert_array_equal(grid[3, 5], [3, 5])
    z, y, x = uv_to_direction(grid.reshape(-1, 2), 16).reshape(16, 32, 3)[3, 5]
    assert np.arccos(z) == pytest.approx((3 + 0.5) * np.pi / 16)
    assert np.arctan2(y, x) == pytest.approx((5 + 0.5) * np.pi / 16 - np.pi)


@settings(max_examples=20)
@given(seed=st.integers(0, 1000), rows=st.sampled_from([32, 64, 512]))
def test_pixels_and_directions_are_inverse(seed: int, rows: int) -> None:
    high = [rows - 0.51, 2 * rows - 0.5]
    points = np.random.default_rng(seed).uniform([-0.49, -0.5], high, (50, 2))
    back = direction_to_uv(uv_to_direction(points, rows), rows)
    np.testing.assert_allclose(back, points, atol=1e-7)


def test_every_pixel_is_where_its_direction_is() -> None:
    chart, base, ball = made()
    assert chart.shape == (32, 64)
    assert (chart.face >= 0).all()
    assert chart.weights.min() > -1e-9
    np.testing.assert_allclose(chart.weights.sum(axis=-1), 1.0)
    corners = ball.vertices[ball.faces[chart.face]]
    point = np.einsum("ijkl,ijk->ijl", corners, chart.weights)
    turned = point @ chart.rotation.T
    unit = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    expected = uv_to_direction(pixel_grid(32).reshape(-1, 2), 32).reshape(32, 64, 3)
    assert np.abs(unit - expected).max() < 1e-12
    # The position on the reference is the same combination of its vertices.
    corners = base.vertices[base.faces[chart.face]]
    np.testing.assert_allclose(
        np.einsum("ijkl,ijk->ijl", corners, chart.weights), chart.positions, atol=1e-12
    )


def test_fields_of_the_reference_are_pulled_back() -> None:
    chart, _, _ = made()
    expected = (chart.positions[..., 1] / np.linalg.norm(chart.positions, axis=-1)) ** 2
    found = chart.fields["mean_curvature_per_um"]
    assert np.abs(found - expected).max() < 0.01
    assert set(chart.fields) >= {"conformal_error", "area_distortion", "area_um2"}


def test_the_image_is_not_mirrored(small_atlas: Atlas) -> None:
    """Seen from outside, with v down and u to the right, the surface is as it is in space."""
    positions = small_atlas.uv.positions[:, :, ::-1]  # (x, y, z), a right-handed frame
    middle = positions[1:-1, 1:-1]
    right = positions[1:-1, 2:] - positions[1:-1, :-2]
    down = positions[2:, 1:-1] - positions[:-2, 1:-1]
    outward = middle - positions.reshape(-1, 3).mean(axis=0)
    # Right × down points into a right-handed picture, away from who looks from outside.
    handed = np.einsum("ijk,ijk->ij", np.cross(right, down), outward)
    assert (handed < 0).all()


def test_the_bumps_are_around_each_other_as_in_space(small_atlas: Atlas) -> None:
    """A chiral cell: going round the fourth bump, the others come in the same order."""
    centre = cell_centre()
    axes = np.array([np.array(axis) / np.linalg.norm(axis) for axis, _, _ in BUMPS])
    reference = small_atlas.reference.vertices - centre
    nearest = [
        np.argmax((reference / np.linalg.norm(reference, axis=1, keepdims=True)) @ axis)
        for axis in axes
    ]
    on_sphere = small_atlas.sphere.vertices[nearest]
    space = [np.linalg.det(np.delete(axes, i, 0)) for i in range(4)]
    mapped = [np.linalg.det(np.delete(on_sphere, i, 0)) for i in range(4)]
    np.testing.assert_array_equal(np.sign(space), np.sign(mapped))


@pytest.mark.parametrize(
    "weight", ["mean_curvature", "absolute_curvature", "positive_curvature", "field", "none"]
)
def test_every_weight_gives_an_image(weight: str) -> None:
    chart, _, _ = made(weight=weight)
    assert np.linalg.det(chart.rotation) == pytest.approx(1.0)


def test_distortion_of_the_equirectangular_image_of_a_sphere() -> None:
    """Q = 1 / sin(inclination), and the areas of the pixels sum to that of the sphere."""
    rows = 64
    where = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows).reshape(rows, -1, 3)
    fields = pixel_distortion(RADIUS * where)
    sine = np.sin((np.arange(rows) + 0.5) * np.pi / rows)[:, None]
    area = 4 * np.pi * RADIUS**2
    q = fields["conformal_error"]
    assert (q >= 1).all()
    np.testing.assert_allclose((q * sine)[2:-2], 1.0, rtol=0.01)
    assert fields["area_um2"].sum() == pytest.approx(area, rel=0.002)
    expected = (area / (2 * rows**2)) / fields["area_um2"]
    np.testing.assert_allclose(fields["area_distortion"], expected, rtol=0.003)


def test_the_distortion_of_an_image_scales_with_its_surface() -> None:
    positions = np.random.default_rng(0).normal(size=(16, 32, 3))
    small, large = pixel_distortion(positions), pixel_distortion(10 * positions)
    np.testing.assert_allclose(large["area_um2"], 100 * small["area_um2"])
    for name in ("conformal_error", "area_distortion"):
        np.testing.assert_allclose(large[name], small[name])


def test_reports_are_monotone() -> None:
    base, ball = round_charts()
    seen: list[float] = []
    progress = Progress(lambda step, fraction, text: seen.append(fraction))
    uv(base, ball, UVParameters(rows=64, axis_weight="none"), progress)
    assert seen == sorted(seen)
    assert len(seen) >= 2
