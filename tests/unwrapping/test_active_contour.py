"""Step 5 by active contour cMCF: layers that move as one, and agree with the streamlines."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.curvilinear import count_folded
from napari_unwrap3d.geometry.mesh import euler_characteristic, is_watertight, signed_volume
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.unwrapping.active_contour import automatic_step, grid_faces
from napari_unwrap3d.unwrapping.elements import elements
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import QUICK, VOXEL_UM


def with_topography(**values: object) -> Parameters:
    chosen = QUICK.topography.model_copy(update=values)
    return QUICK.model_copy(update={"topography": chosen})


def run(pipeline: Pipeline, **values: object) -> Atlas:
    return Pipeline(pipeline.source, dict(pipeline.kept)).run(with_topography(**values))


@pytest.mark.parametrize("smoothing", ["none", "box", "robust"])
def test_the_map_is_one_to_one_and_holds_the_surface(
    small_pipeline: Pipeline, small_atlas: Atlas, smoothing: str
) -> None:
    atlas = run(small_pipeline, propagation="active_contour", contour_smoothing=smoothing)
    chart, numbers = atlas.topography, atlas.quality["topography"]
    assert numbers["unmapped_fraction"] == 0
    assert numbers["round_trip_fraction"] == 1
    assert numbers["folded_fraction"] < 0.001
    assert count_folded(chart.nodes, chart.first_layer, chart.last_layer)[0] == 0
    assert abs(numbers["volume_difference"]) < 0.02
    # The same heights as along the streamlines, nearly.
    step = np.abs(chart.surface[:, 0] - small_atlas.topography.surface[:, 0]) / VOXEL_UM
    assert np.median(step) < 0.1
    assert np.quantile(step, 0.95) < 1.0


def test_layers_are_a_step_apart_and_start_at_the_reference(
    small_pipeline: Pipeline, small_atlas: Atlas
) -> None:
    chart = run(small_pipeline, propagation="active_contour").topography
    zero = int(np.argmin(np.abs(chart.d_um)))
    reference = small_atlas.uv.positions
    np.testing.assert_allclose(chart.positions[zero], reference, atol=1e-3 * VOXEL_UM)
    inside = zero < chart.last_layer.min()
    assert inside
    outward = chart.nodes[zero : chart.last_layer.min()]
    step = np.linalg.norm(np.diff(outward, axis=0), axis=-1)
    np.testing.assert_allclose(step, 0.5 * VOXEL_UM, rtol=0.01)


def test_it_can_be_cancelled(small_pipeline: Pipeline) -> None:
    def callback(step: str, fraction: float, message: str) -> None:
        if "contour" in message:
            progress.cancel()

    progress = Progress(callback)
    pipeline = Pipeline(small_pipeline.source, dict(small_pipeline.kept))
    with pytest.raises(Cancelled):
        pipeline.run(with_topography(propagation="active_contour"), progress)


def test_the_grid_is_a_sphere_seen_from_outside() -> None:
    rows = 16
    faces = grid_faces(rows)
    inner = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows)
    vertices = np.concatenate([[[1.0, 0, 0]], inner, [[-1.0, 0, 0]]])
    assert euler_characteristic(faces) == 2
    assert is_watertight(faces)
    assert signed_volume(vertices, faces) == pytest.approx(4 / 3 * np.pi, rel=0.03)


def test_the_automatic_step_is_a_pixel_but_at_most_half_a_voxel() -> None:
    rows = 64
    unit = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows).reshape(rows, 2 * rows, 3)
    along_v = np.pi / rows
    along_u = 2 * np.sin(np.pi / rows / 2) * np.sin((np.arange(rows) + 0.5) * np.pi / rows).mean()
    expected = 0.5 * (along_u + along_v)
    assert automatic_step(unit, 1.0) == pytest.approx(expected, rel=1e-3)
    assert automatic_step(unit, 0.2) == pytest.approx(expected / 0.2, rel=1e-3)
    assert automatic_step(100.0 * unit, 1.0) == 0.5


def test_the_automatic_step_is_used(small_pipeline: Pipeline) -> None:
    voxels = QUICK.model_copy(update={"uv": QUICK.uv.model_copy(update={"rows": 160})})
    fine = Pipeline(small_pipeline.source, dict(small_pipeline.kept)).run(voxels, until="uv")
    expected = automatic_step(fine.uv.positions, VOXEL_UM)
    assert expected < 0.5
    chosen = voxels.topography.model_copy(update={"automatic_step": True})
    atlas = Pipeline(small_pipeline.source, dict(small_pipeline.kept)).run(
        voxels.model_copy(update={"topography": chosen})
    )
    np.testing.assert_allclose(np.diff(atlas.topography.d_um), expected * VOXEL_UM)


def test_dv_sums_to_the_volume_of_the_cell(small_atlas: Atlas) -> None:
    """Of the mapped mask; what lies below the deepest nodes is the core around the middle."""
    chart = small_atlas.topography
    volume = elements(chart)
    assert volume.shape == chart.shape
    assert volume.min() >= 0
    first = chart.first_layer[1:-1]
    reached = np.arange(len(chart.d_um))[:, None, None] > first
    shell = float((volume * (chart.mask & reached)).sum(dtype=float))
    core = np.take_along_axis(chart.positions, (first + 1)[None, :, :, None], axis=0)[0]
    poles = [chart.nodes[chart.first_layer[row, 0] + 1, row, :1] for row in (0, -1)]
    rows = chart.shape[1]
    ends = np.concatenate([poles[0], core.reshape(-1, 3), poles[1]]).astype(float)
    inside = signed_volume(ends, grid_faces(rows))
    # Half of the deepest node's voxel lies within the core.
    expected = small_atlas.quality["surface"]["volume_um3"]
    assert shell + inside == pytest.approx(expected, rel=0.03)
