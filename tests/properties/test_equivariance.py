"""Turning, shifting, scaling or renumbering the input does the same to what comes out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.mesh import face_areas, signed_volume
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.sphere import sphere
from shapes import QUICK, elongated, grid, lumpy, rotation

SMALL = Parameters.from_dict(
    {
        **QUICK.model_dump(),
        "stack": {"working_voxel_um": None},
        "reference": {"stop": "fixed", "fixed_iteration": 5, "vertices": 1500},
        "uv": {"rows": 48},
    }
)
EDGE = 0.1
FEW = settings(max_examples=5, suppress_health_check=[HealthCheck.too_slow])

seeds = st.integers(0, 10_000)
orders = st.permutations([0, 1, 2]).map(tuple)
places = st.tuples(*[st.floats(-100, 100)] * 3)
scales = st.floats(0.01, 100)


def solid(seed: int) -> np.ndarray:
    """A ball with three blebs, in a box of three different lengths."""
    rng = np.random.default_rng(seed)
    points = grid((34, 38, 42))
    cell = np.linalg.norm(points, axis=-1) < 10
    for axis in rng.normal(size=(3, 3)):
        centre = rng.uniform(8, 11) * axis / np.linalg.norm(axis)
        cell |= np.linalg.norm(points - centre, axis=-1) < rng.uniform(3, 5)
    return cell


def charts(source: Any, until: str = "reference", **changes: Any) -> unwrap3d.Atlas:
    values = SMALL.model_dump()
    for group, value in changes.items():
        values[group] = {**values[group], **value}
    return unwrap3d.Pipeline(source).run(Parameters.from_dict(values), until=until)


def turned(mask: unwrap3d.Mask, order: tuple[int, ...], flips: tuple[bool, ...]) -> unwrap3d.Mask:
    data = mask.data.transpose(order)
    for axis, flip in enumerate(flips):
        data = np.flip(data, axis) if flip else data
    return unwrap3d.Mask(np.ascontiguousarray(data), mask.voxel_size)


def turned_points(
    points: np.ndarray, shape: tuple[int, ...], order: tuple[int, ...], flips: tuple[bool, ...]
) -> np.ndarray:
    """Where points of a mask are in the turned mask."""
    moved = points[:, order].copy()
    for axis, flip in enumerate(flips):
        if flip:
            moved[:, axis] = EDGE * (shape[order[axis]] - 1) - moved[:, axis]
    return moved


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance of a vertex of one mesh to the nearest of the other, both ways."""
    there, back = KDTree(other).query(one)[0], KDTree(one).query(other)[0]
    return float(max(there.max(), back.max()))


def measures(chart: Any) -> tuple[float, float]:
    area = float(face_areas(chart.vertices, chart.faces).sum())
    return area, signed_volume(chart.vertices, chart.faces)


@FEW
@given(seed=seeds, order=orders, flips=st.tuples(*[st.booleans()] * 3))
def test_turned_and_mirrored_masks(
    seed: int, order: tuple[int, ...], flips: tuple[bool, ...]
) -> None:
    mask = unwrap3d.Mask(solid(seed), (EDGE,) * 3)
    plain, other = charts(mask, "topography"), charts(turned(mask, order, flips), "topography")
    for name in ("surface", "sealed", "reference"):
        one, two = getattr(plain, name), getattr(other, name)
        expected = turned_points(one.vertices, mask.shape, order, flips)
        assert apart(expected, two.vertices) < (3 if name == "reference" else 1) * EDGE, name
        assert measures(two) == pytest.approx(measures(one), rel=0.01), name
        assert signed_volume(two.vertices, two.faces) > 0
    for atlas in (plain, other):
        assert atlas.quality["sphere"]["flipped_faces"] == 0
        assert atlas.quality["topography"]["folded_cells"] == 0
    heights = [np.quantile(a.surface.fields["height_um"], (0.1, 0.5, 0.9)) for a in (plain, other)]
    np.testing.assert_allclose(heights[0], heights[1], atol=0.5 * EDGE)


@FEW
@given(seed=seeds, order=st.permutations("tczyx"), voxel=st.sampled_from([(1, 1, 1), (3, 1, 1)]))
def test_axes_in_any_order_give_the_same_mask(
    seed: int, order: list[str], voxel: tuple[int, ...]
) -> None:
    rng = np.random.default_rng(seed)
    image = rng.poisson(np.where(solid(seed), 200, 50)).astype(np.uint16)
    movie = np.stack([np.stack([image // 3, image]), np.stack([image, image // 2])])
    mixed = movie.transpose(["tczyx".index(letter) for letter in order])
    size = tuple(EDGE * v for v in voxel)
    chosen = {"timepoint": 0, "channel": 1, "working_voxel_um": EDGE}
    plain = charts(unwrap3d.read_stack(image, size), "stack", stack={"working_voxel_um": EDGE})
    other = charts(
        unwrap3d.read_stack(mixed, size, 1.0, axes="".join(order)), "stack", stack=chosen
    )
    np.testing.assert_array_equal(plain.mask.data, other.mask.data)
    assert plain.mask.origin == other.mask.origin


@FEW
@given(seed=seeds, scale=scales, place=places)
def test_larger_cells_elsewhere(seed: int, scale: float, place: tuple[float, ...]) -> None:
    """Lengths scale, places shift, directions and whole numbers stay."""
    data = solid(seed)
    plain = charts(unwrap3d.Mask(data, (EDGE,) * 3), "sphere")
    moved = unwrap3d.Mask(data, (scale * EDGE,) * 3, tuple(scale * p for p in place))
    other = charts(moved, "sphere")
    for name in ("surface", "sealed", "reference"):
        one, two = getattr(plain, name), getattr(other, name)
        np.testing.assert_array_equal(one.faces, two.faces)
        expected = scale * (one.vertices + place)
        np.testing.assert_allclose(two.vertices, expected, atol=scale * 1e-6)
    np.testing.assert_allclose(other.sphere.vertices, plain.sphere.vertices, atol=1e-5)
    curvature = [a.surface.fields["mean_curvature_per_um"] for a in (plain, other)]
    np.testing.assert_allclose(scale * curvature[1], curvature[0], rtol=1e-3, atol=1e-3)


@FEW
@given(seed=seeds, margins=st.tuples(*[st.integers(0, 7)] * 3))
def test_empty_room_around_the_cell_does_not_count(seed: int, margins: tuple[int, ...]) -> None:
    data = solid(seed)
    plain = charts(unwrap3d.Mask(data, (EDGE,) * 3))
    wide = np.pad(data, [(m, 2 * m) for m in margins])
    other = charts(unwrap3d.Mask(wide, (EDGE,) * 3, tuple(-EDGE * m for m in margins)))
    np.testing.assert_array_equal(plain.reference.faces, other.reference.faces)
    np.testing.assert_allclose(plain.reference.vertices, other.reference.vertices, atol=1e-6)


@FEW
@given(seed=seeds)
def test_rotated_meshes(seed: int) -> None:
    vertices, faces = lumpy(4, seed, size=0.4)
    turn = rotation(seed + 1)
    stack = {"working_voxel_um": 0.06}
    plain = charts(unwrap3d.Surface(vertices, faces), stack=stack)
    other = charts(unwrap3d.Surface(vertices @ turn.T, faces), stack=stack)
    assert measures(other.reference) == pytest.approx(measures(plain.reference), rel=0.01)
    back = other.reference.vertices @ turn
    assert apart(back, plain.reference.vertices) < 3 * 0.06
    # At single vertices it depends on how the voxels lie: by a tenth in the median.
    curvature = [a.surface.fields["mean_curvature_per_um"] for a in (plain, other)]
    assert curvature[0].mean() == pytest.approx(curvature[1].mean(), rel=0.02)
    assert np.median(np.abs(curvature[0] - curvature[1])) < 0.15 * curvature[0].mean()


@FEW
@given(seed=seeds)
def test_renumbered_meshes_give_the_same_solid(seed: int) -> None:
    vertices, faces = lumpy(3, seed, size=0.5)
    rng = np.random.default_rng(seed)
    name = rng.permutation(len(vertices))
    moved = np.empty_like(vertices)
    moved[name] = vertices
    corner = (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3
    again = np.take_along_axis(name[faces], corner, axis=1)
    stack = {"working_voxel_um": 0.08}
    plain = charts(unwrap3d.Surface(vertices, faces), stack=stack)
    other = charts(unwrap3d.Surface(moved, rng.permutation(again)), stack=stack)
    np.testing.assert_array_equal(plain.mask.data, other.mask.data)
    assert other.surface.report["area_um2"] == pytest.approx(plain.surface.report["area_um2"])
    assert measures(other.reference) == pytest.approx(measures(plain.reference), rel=0.01)


@FEW
@given(
    seed=seeds,
    scale=scales,
    method=st.sampled_from(["poisson", "advection"]),
    criterion=st.sampled_from(["equiareal", "q_log_lambda", "area_mips"]),
)
def test_the_sphere_turns_with_the_reference(
    seed: int, scale: float, method: str, criterion: str
) -> None:
    """Up to a rotation, as the conformal map has no preferred one."""
    vertices, faces = elongated(1000, seed)
    turn = rotation(seed)
    chosen = unwrap3d.Parameters().sphere.model_copy(
        update={"method": method, "criterion": criterion, "iterations": 20}
    )
    one = sphere(unwrap3d.Reference(vertices, faces), chosen, silent())
    two = sphere(unwrap3d.Reference(scale * vertices @ turn.T + 5, faces), chosen, silent())
    assert (one.iteration, one.blend) == (two.iteration, two.blend)
    u, _, vt = np.linalg.svd(two.vertices.T @ one.vertices)
    assert np.linalg.det(u @ vt) > 0
    assert np.abs(two.vertices @ (u @ vt) - one.vertices).max() < 1e-3
