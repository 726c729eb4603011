"""The paper's protrusions: height, binary, instances, kinds and volumes in (d, u, v)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Surface
from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.affinity import edge_affinity
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.geometry.sphere_grid import pixel_areas
from napari_unwrap3d.geometry.topology import largest_parts
from napari_unwrap3d.parameters import TopographicParameters
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.protrusions.segment import Segmentation
from napari_unwrap3d.protrusions.topographic import binary, height, instances, kinds, volumes
from napari_unwrap3d.protrusions.topographic.method import by_topography
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import QUICK, icosphere

# The small cell has a fifth of the size of the paper's: so have its protrusions.
SMALL = {
    "smallest_start_um2": 0.3,
    "smallest_region_um2": 0.5,
    "smallest_instance_um2": 0.1,
    "background_um": 0.3,
    "smallest_top": 50,
}


def segmented(atlas: Atlas, **changed: Any) -> Segmentation:
    chosen = TopographicParameters(**{**SMALL, **changed})
    parameters = atlas.parameters.model_copy(update={"topographic": chosen})
    charts = (atlas.mask, atlas.surface, atlas.uv, atlas.topography)
    return by_topography(*charts, parameters, silent())


@pytest.fixture(scope="module")
def found(small_atlas: Atlas) -> Segmentation:
    return segmented(small_atlas)


@pytest.fixture(scope="module")
def turned_atlas(small_atlas: Atlas, found: Segmentation) -> Atlas:
    """The same cell with its highest protrusion over the north pole."""
    tip = small_atlas.surface.vertices[np.argmax(found.height_um)]
    axis = tuple(map(float, tip - small_atlas.reference.vertices.mean(axis=0)))
    uv = QUICK.uv.model_copy(update={"axis_zyx": axis})
    return Pipeline.resumed(small_atlas).run(QUICK.model_copy(update={"uv": uv}))


# Height ----------------------------------------------------------------------------------


def column_chart(mask: np.ndarray, last: int | None = None) -> Any:
    layers, rows, columns = mask.shape
    ends = np.full((rows + 2, columns), layers - 1 if last is None else last)
    return SimpleNamespace(mask=mask, d_um=np.arange(layers) * 0.5 - 1.0, last_layer=ends)


def test_the_height_is_the_top_of_the_longest_stretch() -> None:
    mask = np.random.default_rng(3).random((9, 4, 8)) < 0.6
    mask[:, 0, 0] = False
    image = height.height_image(column_chart(mask, last=7))
    for i, j in np.ndindex(4, 8):
        column, best, top, run = mask[:8, i, j], 0, -1, 0
        for k in range(8):
            run = run + 1 if column[k] else 0
            if run > best:
                best, top = run, k
        expected = np.nan if best == 0 else -1.0 + 0.5 * (top + 0.5)
        np.testing.assert_equal(image[i, j], expected)


def bumps(axes: list[tuple[float, float, float]], rows: int = 96) -> np.ndarray:
    """A height image with a bump in each direction."""
    directions = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows)
    units = [np.asarray(a) / np.linalg.norm(a) for a in axes]
    image = sum(np.exp((directions @ unit - 1) / 0.03) for unit in units)
    return np.reshape(image, (rows, 2 * rows))


def test_the_baseline_is_the_same_under_a_bump_at_a_pole_and_across_the_seam() -> None:
    parameters = TopographicParameters()
    areas = pixel_areas(96)
    means, tops = [], []
    # Azimuth −π, where the seam is, is x < 0.
    for axis in [(1, 0, 0), (-1, 0, 0), (0, 0, -1), (0, 0, 1), (0.7, 0, -0.7)]:
        base = height.baseline(bumps([axis]), parameters, silent())
        means.append((areas * base).sum() / areas.sum())
        tops.append(base.max())
    np.testing.assert_allclose(means, means[0], rtol=0.02)
    np.testing.assert_allclose(tops, tops[0], rtol=0.04)


def test_the_baseline_of_a_constant_is_the_constant_and_empty_columns_do_not_matter() -> None:
    image = np.full((64, 128), 0.7)
    image[:9] = image[20:30, 110:] = np.nan
    base = height.baseline(image, TopographicParameters(), silent())
    np.testing.assert_allclose(base, 0.7, atol=1e-4)
    nothing = height.baseline(np.full((64, 128), np.nan), TopographicParameters(), silent())
    np.testing.assert_array_equal(nothing, 0)


def test_a_smaller_asymmetry_and_a_larger_smoothness_go_further_below_a_bump() -> None:
    image = bumps([(0, 1, 0)])

    def top(**changed: float) -> float:
        return height.baseline(image, TopographicParameters(**changed), silent()).max()

    assert top(asymmetry=0.05) < 0.9 * top()
    assert top(smoothness=100.0) < 0.8 * top()
    assert top(smoothness=1e9) == pytest.approx(0, abs=0.05)


def test_over_the_plane_the_height_is_d(small_atlas: Atlas) -> None:
    parameters = TopographicParameters(zero="plane")
    plane = height.heights(small_atlas.surface, small_atlas.topography, parameters, silent())
    known = np.isfinite(small_atlas.topography.surface[:, 0])
    np.testing.assert_array_equal(plane.vertex_um[known], small_atlas.topography.surface[known, 0])
    assert np.isfinite(plane.vertex_um).all()


# Binary ----------------------------------------------------------------------------------


def sphere_with_heights() -> tuple[Surface, np.ndarray]:
    vertices, faces = icosphere(4)
    return Surface(5 * vertices, faces), np.where(vertices[:, 0] > 0.8, 1.0, 0.0)


@pytest.mark.parametrize("iterations", [0, 20, 200])
def test_the_spreading_ends_at_the_background(iterations: int) -> None:
    surface, high = sphere_with_heights()
    areas = vertex_mass(surface.vertices, surface.faces)
    affinity = edge_affinity(surface.vertices, surface.faces, 0.9)
    parameters = TopographicParameters(binary_iterations=iterations, binary_chance=0.2)
    marked, numbers = binary.binary_protrusions(high, surface, areas, affinity, 0.1, parameters)
    assert marked[high > 0].mean() > 0.9
    # 0.8 µm on a sphere of radius 5 µm, and an edge that zigzags.
    reach = np.cos(np.arccos(0.8) + 0.85 / 5) * 5
    assert surface.vertices[marked, 0].min() > reach
    assert numbers["share_above_threshold"] == pytest.approx(0.1, abs=0.01)


def test_small_regions_are_left_out() -> None:
    surface, high = sphere_with_heights()
    areas = vertex_mass(surface.vertices, surface.faces)
    graph = edge_affinity(surface.vertices, surface.faces, 0.9)
    speck = surface.vertices[:, 0].argmin()
    marked = high > 0
    marked[speck] = True
    kept = binary.without_small(marked, graph, areas, 1.0)
    np.testing.assert_array_equal(kept, high > 0)
    assert not binary.without_small(marked, graph, areas, 1e6).any()
    assert not binary.without_small(marked & False, graph, areas, 1.0).any()


def test_noise_below_half_a_voxel_is_no_protrusion() -> None:
    surface, _ = sphere_with_heights()
    areas = vertex_mass(surface.vertices, surface.faces)
    noise = 0.02 * np.random.default_rng(0).normal(size=len(areas))
    graph = edge_affinity(surface.vertices, surface.faces, 0.9)
    for threshold in ("mean", "otsu"):
        parameters = TopographicParameters(threshold=threshold)
        marked, _ = binary.binary_protrusions(noise, surface, areas, graph, 0.2, parameters)
        assert not marked.any()


# Kinds -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scale", "kind"),
    [((1, 1, 1), "blebs"), ((5, 0.5, 4), "lamellipodia"), ((6, 0.6, 0.6), "filopodia")],
)
def test_the_kind_shows_in_the_principal_axes(scale: tuple[float, float, float], kind: str) -> None:
    vertices, _ = icosphere(3)
    half = vertices[vertices[:, 0] > 0] * scale
    assert kinds.kind_of_shape(half, np.ones(len(half))) == kind
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert kinds.kind_of_shape(half @ turn + 7, np.ones(len(half))) == kind


def test_a_single_vertex_has_a_kind() -> None:
    assert kinds.kind_of_shape(np.ones((1, 3)), np.ones(1)) in kinds.METHODS


# Volumes ---------------------------------------------------------------------------------


def test_labels_grow_over_the_seam_and_the_pole_and_inside_only() -> None:
    inside = np.ones((3, 6, 12), bool)
    inside[2] = False
    labels = np.zeros(inside.shape, np.int32)
    labels[0, 0, 0] = 4
    volumes._expand(labels, inside, np.array([[0, 0, 0]]), 1)
    grown = {tuple(i) for i in np.argwhere(labels == 4)}
    assert grown == {(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 6), (0, 0, 1), (0, 0, 11)}


def test_labels_fall_from_the_top_and_meet_half_way() -> None:
    inside = np.zeros((6, 8, 16), bool)
    inside[3:, 2:6, 2:5] = inside[3:, 2:6, 10:13] = True  # two columns
    inside[:3, 2:6, 2:13] = True  # that stand on one block
    labels = np.zeros(inside.shape, np.int32)
    labels[5, 3, 3], labels[5, 3, 11] = 1, 2
    volumes._from_the_top(labels, inside, silent())
    np.testing.assert_array_equal(labels > 0, inside)
    assert (labels[..., 2:7][inside[..., 2:7]] == 1).all()
    assert (labels[..., 9:13][inside[..., 9:13]] == 2).all()


def test_of_every_label_the_largest_part_stays() -> None:
    labels = np.zeros((6, 6, 6), np.int32)
    labels[:2, :2, :2], labels[5, 5, 5] = 3, 3
    labels[4, 0, 0] = 1
    kept = largest_parts(labels)
    assert kept[5, 5, 5] == 0
    assert (kept == 3).sum() == 8
    assert (kept == 1).sum() == 1


def test_a_label_of_one_vertex_gives_a_volume_without_fuss(small_atlas: Atlas) -> None:
    labels = np.zeros(len(small_atlas.surface.vertices), np.int32)
    labels[np.nanargmax(small_atlas.topography.surface[:, 0])] = 1
    image = height.height_image(small_atlas.topography)
    chart = small_atlas
    volume = volumes.protrusion_volumes(
        chart.mask, chart.surface, chart.uv, chart.topography, labels, image, 3, silent()
    )
    assert volume.shape == chart.mask.shape
    assert set(np.unique(volume)) <= {0, 1}
    assert (volume > 0).sum() < 200


# All of it -------------------------------------------------------------------------------


def test_the_mushroom_of_the_small_cell_is_found(small_atlas: Atlas, found: Segmentation) -> None:
    assert found.labels.dtype == np.int32
    assert found.labels.max() >= 1
    assert found.labels[np.argmax(found.height_um)] > 0
    assert found.numbers["kind"] == "blebs"
    assert "round" in found.numbers["kind_reason"]
    # Its voxels are those at the vertices that have its label.
    label = found.labels[np.argmax(found.height_um)]
    points = small_atlas.mask.to_world(np.argwhere(found.volume == label))
    centre = small_atlas.surface.vertices[found.labels == label].mean(axis=0)
    assert np.linalg.norm(points.mean(axis=0) - centre) < 0.2
    assert len(points) * 0.1**3 > 0.5


def test_cortex_and_protrusions_are_the_cell(small_atlas: Atlas, found: Segmentation) -> None:
    np.testing.assert_array_equal(found.cortex | (found.volume > 0), small_atlas.mask.data)
    assert not (found.cortex & (found.volume > 0)).any()


def test_the_same_wherever_the_axis_is_put(
    small_atlas: Atlas, turned_atlas: Atlas, found: Segmentation
) -> None:
    turned = segmented(turned_atlas)
    highest = np.argmax(found.height_um)
    assert turned_atlas.topography.surface[highest, 1] < 6  # over the pole
    assert adjusted_rand_score(found.labels, turned.labels) > 0.95
    cell = small_atlas.mask.data
    assert adjusted_rand_score(found.volume[cell], turned.volume[cell]) > 0.95


def test_the_same_with_the_seam_through_the_protrusion(
    small_atlas: Atlas, found: Segmentation
) -> None:
    rows = small_atlas.uv.shape[0]
    column = small_atlas.topography.surface[np.argmax(found.height_um), 2]
    roll = float((column + 0.5) * 180 / rows - 360)
    uv = QUICK.uv.model_copy(update={"axis_roll_degrees": (roll + 180) % 360 - 180})
    atlas = Pipeline.resumed(small_atlas).run(QUICK.model_copy(update={"uv": uv}))
    own = found.labels == found.labels[np.argmax(found.height_um)]
    columns = atlas.topography.surface[own, 2]
    assert columns.min() < 4
    assert columns.max() > 2 * rows - 5
    assert adjusted_rand_score(found.labels, segmented(atlas).labels) > 0.95


def test_a_handle_does_no_harm(handle_atlas: Atlas) -> None:
    found = segmented(handle_atlas)
    assert found.labels.max() >= 2
    np.testing.assert_array_equal(found.cortex | (found.volume > 0), handle_atlas.mask.data)


def test_twice_the_same(small_atlas: Atlas, found: Segmentation) -> None:
    again = segmented(small_atlas)
    np.testing.assert_array_equal(found.labels, again.labels)
    np.testing.assert_array_equal(found.volume, again.volume)
    assert found.numbers == again.numbers


def test_without_protrusions_there_are_none(small_atlas: Atlas) -> None:
    found = segmented(small_atlas, threshold="value", threshold_um=99.0)
    assert not found.labels.any()
    assert not found.volume.any()
    assert found.numbers["kind"] == "none"
    np.testing.assert_array_equal(found.cortex, small_atlas.mask.data)


@pytest.mark.parametrize("kind", ["blebs", "lamellipodia", "filopodia"])
def test_a_kind_that_is_asked_for(small_atlas: Atlas, kind: str) -> None:
    chosen = small_atlas.parameters.protrusions.model_copy(update={"kind": kind})
    parameters = small_atlas.parameters.model_copy(
        update={"protrusions": chosen, "topographic": TopographicParameters(**SMALL)}
    )
    atlas = small_atlas
    found = by_topography(
        atlas.mask, atlas.surface, atlas.uv, atlas.topography, parameters, silent()
    )
    assert found.numbers["kind"] == kind
    assert found.numbers["kind_reason"] == "asked for"


def test_it_can_be_cancelled(small_atlas: Atlas) -> None:
    def stop(step: str, fraction: float, message: str) -> None:
        if fraction > 0.4:
            progress.cancel()

    progress = Progress(stop)
    atlas = small_atlas
    with pytest.raises(Cancelled):
        by_topography(
            atlas.mask, atlas.surface, atlas.uv, atlas.topography, atlas.parameters, progress
        )


def test_labels_are_renumbered_without_gaps() -> None:
    labels = np.array([0, 9, 4, 9, 0, 2])
    np.testing.assert_array_equal(instances.renumbered(labels), [0, 3, 2, 3, 0, 1])
