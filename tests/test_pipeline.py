"""The pipeline: what runs again, what is kept, progress, cancellation, determinism."""

import threading
from pathlib import Path

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Mask, Surface
from napari_unwrap3d.errors import (
    Cancelled,
    EmptyMaskError,
    FullMaskError,
    InputError,
    ParameterError,
    SeveralCellsError,
    TooSmallError,
    Unwrap3DError,
)
from napari_unwrap3d.geometry.mesh import euler_characteristic
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import STEP_NAMES, STEPS, Pipeline, unwrap
from napari_unwrap3d.progress import Progress
from pipelines import cancelling_after, changed, copy_of
from shapes import QUICK, VOXEL_UM, ball, grid, icosphere, lumpy, small_cell_mask

CHANGES = {
    "stack": {
        "second_cell_fraction": 0.4,
        "psf": "psf.tif",
        "psf_voxel_um": (0.1, 0.1, 0.1),
        "crop_voxels": (0, 40, 0, 40, 0, 40),
        "crop_um": (0.0, 4.0, 0.0, 4.0, 0.0, 4.0),
    },
    "surface": {"curvature_smoothing_voxels": 2.5},
    "reference": {"extra_iterations": 1},
    "sphere": {"blend": 0.8},
    "uv": {"rows": 48, "axis_zyx": (1.0, 2.0, 3.0)},
    "topography": {"margin_voxels": 3.0},
}


def test_nothing_runs_again_without_a_change(small_pipeline: Pipeline) -> None:
    seen: list[str] = []
    atlas = small_pipeline.run(QUICK, lambda step, fraction, message: seen.append(step))
    assert seen == []
    assert atlas.reference is small_pipeline.results["reference"]


@pytest.mark.parametrize("group", CHANGES)
def test_a_change_makes_its_step_and_what_follows_stale(
    small_pipeline: Pipeline, group: str
) -> None:
    states = small_pipeline.state(changed(group, **CHANGES[group]))
    first = next(i for i, step in enumerate(STEPS) if group in step.parameters)
    expected = ["done"] * first + ["stale"] * (len(STEPS) - first)
    assert list(states.values()) == expected
    assert set(small_pipeline.state(QUICK).values()) == {"done"}


@pytest.mark.parametrize("group", ["sphere", "uv", "topography"])
def test_only_what_is_stale_runs_again(small_pipeline: Pipeline, group: str) -> None:
    pipeline = copy_of(small_pipeline)
    before = dict(pipeline.results)
    seen: list[str] = []
    parameters = changed(group, **CHANGES[group])
    pipeline.run(parameters, lambda step, fraction, message: seen.append(step))
    first = STEP_NAMES.index(group)
    assert list(dict.fromkeys(seen)) == list(STEP_NAMES[first:])
    for name in STEP_NAMES:
        same = pipeline.results[name] is before[name]
        assert same == (STEP_NAMES.index(name) < first)
    assert set(pipeline.state(parameters).values()) == {"done"}


def test_every_parameter_belongs_to_the_key_of_a_step(small_pipeline: Pipeline) -> None:
    """No parameter can change without anything becoming stale."""
    for group, values in CHANGES.items():
        for name in type(getattr(QUICK, group)).model_fields:
            model = getattr(QUICK, group)
            other = values.get(name, _other(getattr(model, name)))
            states = small_pipeline.state(
                QUICK.model_copy(update={group: model.model_copy(update={name: other})})
            )
            assert "stale" in states.values(), (group, name)


def _other(value: object) -> object:
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + "?"
    return 1 if value is None else value * 2 + 1


def test_a_new_pipeline_has_nothing_and_grows_step_by_step() -> None:
    pipeline = Pipeline(Mask(ball(10, 33), (VOXEL_UM,) * 3))
    assert set(pipeline.state(QUICK).values()) == {"missing"}
    part = pipeline.run(QUICK, until="sealed")
    assert list(pipeline.results) == ["stack", "surface", "sealed"]
    assert part.has("sealed")
    assert not part.has("reference")
    assert list(part.quality) == ["stack", "surface", "sealed"]
    sealed = pipeline.results["sealed"]
    whole = pipeline.run(QUICK)
    assert whole.sealed is sealed
    assert all(whole.has(name) for name in STEP_NAMES[1:])
    assert list(whole.quality) == list(STEP_NAMES)


def test_the_same_input_gives_the_same_atlas_bit_for_bit() -> None:
    mask = Mask(ball(10, 33) | (np.linalg.norm(grid(33) - [3, 0, 9], axis=-1) < 4), (0.1,) * 3)
    first, second = unwrap(mask, QUICK), unwrap(mask, QUICK)
    pairs = [
        (first.surface.vertices, second.surface.vertices),
        (first.reference.vertices, second.reference.vertices),
        (first.reference.faces, second.reference.faces),
        (first.sphere.vertices, second.sphere.vertices),
        (first.uv.positions, second.uv.positions),
        (first.topography.nodes, second.topography.nodes),
        (first.topography.surface, second.topography.surface),
        (first.topography.meshed_vertices, second.topography.meshed_vertices),
    ]
    for one, other in pairs:
        np.testing.assert_array_equal(one, other)
    assert first.quality == second.quality
    keys = [{k: v["key"] for k, v in a.provenance["steps"].items()} for a in (first, second)]
    assert keys[0] == keys[1]


def test_another_input_has_another_key() -> None:
    solid = ball(10, 33)
    masks = [
        Mask(solid, (0.1,) * 3),
        Mask(solid, (0.2,) * 3),
        Mask(solid, (0.1,) * 3, (1, 0, 0)),
        Mask(np.roll(solid, 1), (0.1,) * 3),
    ]
    vertices, faces = icosphere(2)
    sources = [*masks, Surface(vertices, faces), Surface(2 * vertices, faces)]
    keys = {Pipeline(source)._source_key for source in sources}
    assert len(keys) == len(sources)
    assert Pipeline(Mask(solid.copy(), (0.1,) * 3))._source_key in keys


def test_progress_runs_from_zero_to_one_in_every_step() -> None:
    seen: dict[str, list[float]] = {}
    names: list[str] = []

    def callback(step: str, fraction: float, message: str) -> None:
        seen.setdefault(step, []).append(fraction)
        names.append(step)
        assert isinstance(message, str)

    Pipeline(Mask(ball(10, 33), (VOXEL_UM,) * 3)).run(QUICK, callback)
    assert tuple(seen) == STEP_NAMES
    assert tuple(dict.fromkeys(names)) == STEP_NAMES
    for step, fractions in seen.items():
        assert fractions == sorted(fractions), step
        assert (fractions[0], fractions[-1]) == (0.0, 1.0)


def reports_until_done(source: Mask) -> int:
    count = 0

    def callback(step: str, fraction: float, message: str) -> None:
        nonlocal count
        count += 1

    Pipeline(source).run(QUICK, callback)
    return count


def test_cancelling_at_any_moment_keeps_what_is_finished() -> None:
    """Cancel at every few reports, go on, and end with what an undisturbed run gives."""
    source = Mask(ball(9, 31), (VOXEL_UM,) * 3)
    total = reports_until_done(source)
    pipeline = Pipeline(source)
    cancelled = []
    for moment in (1, 2, 3, 5, 8, total // 4, total // 3, total // 2, 2 * total // 3):
        progress = cancelling_after(moment)
        before = dict(pipeline.kept)
        try:
            pipeline.run(QUICK, progress)
        except Cancelled as error:
            cancelled.append(error)
        for name, kept in before.items():
            assert pipeline.kept[name] is kept
    assert len(cancelled) >= 5
    assert all("Run again" in error.hint for error in cancelled)
    whole = pipeline.run(QUICK)
    plain = unwrap(source, QUICK)
    np.testing.assert_array_equal(whole.topography.nodes, plain.topography.nodes)


@pytest.mark.parametrize("step", ["surface", "reference", "sphere", "topography"])
def test_cancelling_from_another_thread(step: str) -> None:
    reached = threading.Event()

    def callback(name: str, fraction: float, message: str) -> None:
        if name == step:
            reached.set()

    progress = Progress(callback)

    def cancel() -> None:
        reached.wait(60)
        progress.cancel()

    thread = threading.Thread(target=cancel)
    thread.start()
    pipeline = Pipeline(Mask(ball(9, 31), (VOXEL_UM,) * 3))
    with pytest.raises(Cancelled):
        pipeline.run(QUICK, progress)
    thread.join()
    assert step not in pipeline.kept
    assert list(pipeline.kept) == list(STEP_NAMES[: STEP_NAMES.index(step)])
    assert pipeline.state(QUICK)[step] == "missing"


def test_a_run_that_was_cancelled_before_it_began_does_nothing() -> None:
    progress = Progress()
    progress.cancel()
    pipeline = Pipeline(Mask(ball(9, 31), (VOXEL_UM,) * 3))
    with pytest.raises(Cancelled):
        pipeline.run(QUICK, progress)
    assert pipeline.kept == {}


def test_unknown_steps_and_inputs_are_errors(small_pipeline: Pipeline) -> None:
    with pytest.raises(ParameterError, match="'flat'"):
        small_pipeline.run(QUICK, until="flat")
    with pytest.raises(InputError, match="ndarray"):
        Pipeline(np.zeros((5, 5, 5)))


def two_cells() -> np.ndarray:
    solid = np.zeros((40, 40, 80), bool)
    solid[:, :, :40] = ball(10, 40)
    solid[:, :, 40:] = ball(9, 40)
    return solid


@pytest.mark.parametrize(
    ("solid", "error"),
    [
        (np.zeros((30, 30, 30), bool), EmptyMaskError),
        (np.ones((30, 30, 30), bool), FullMaskError),
        (two_cells(), SeveralCellsError),
        (ball(3, 30), TooSmallError),
    ],
    ids=["empty", "full", "two cells", "tiny"],
)
def test_masks_that_cannot_be_unwrapped(solid: np.ndarray, error: type[Unwrap3DError]) -> None:
    with pytest.raises(error) as caught:
        unwrap(Mask(solid, (VOXEL_UM,) * 3), QUICK)
    assert caught.value.measured
    assert caught.value.hint


PLACE = np.array([10.0, 20, -5])


@pytest.fixture(scope="module")
def mesh_atlas() -> Atlas:
    vertices, faces = lumpy(4, size=0.4)
    voxel = {"stack": {"working_voxel_um": 0.08}, "uv": {"rows": 48}}
    source = Surface(vertices + PLACE, faces, {"ink": np.arange(len(vertices))})
    return unwrap(source, Parameters.from_dict({**QUICK.model_dump(), **voxel}))


def test_a_mesh_keeps_its_vertices_faces_and_fields(mesh_atlas: Atlas) -> None:
    vertices, faces = lumpy(4, size=0.4)
    np.testing.assert_array_equal(mesh_atlas.surface.vertices, vertices + PLACE)
    np.testing.assert_array_equal(mesh_atlas.surface.faces, faces)
    np.testing.assert_array_equal(mesh_atlas.surface.fields["ink"], np.arange(len(vertices)))
    quality = mesh_atlas.quality["topography"]
    assert quality["unmapped_fraction"] == 0
    assert quality["folded_cells"] == 0
    assert quality["round_trip_max_voxels"] < 0.01
    assert mesh_atlas.provenance["source"]["kind"] == "surface"


def test_a_larger_cell_has_the_same_charts(mesh_atlas: Atlas) -> None:
    """Lengths scale, angles and pixels do not."""
    vertices, faces = lumpy(4, size=0.4)
    factor = 1000.0
    voxel = {"stack": {"working_voxel_um": 0.08 * factor}, "uv": {"rows": 48}}
    source = Surface(factor * (vertices + PLACE), faces)
    large = unwrap(source, Parameters.from_dict({**QUICK.model_dump(), **voxel}))
    small = mesh_atlas
    np.testing.assert_allclose(
        large.reference.vertices, factor * small.reference.vertices, rtol=1e-6
    )
    np.testing.assert_allclose(large.sphere.vertices, small.sphere.vertices, atol=1e-6)
    # Both are found to 1e-3 voxel, and stored in single precision.
    height = large.topography.surface[:, 0] / factor - small.topography.surface[:, 0]
    assert np.abs(height).max() < 0.01 * 0.08
    assert large.quality["topography"]["unmapped_fraction"] == 0
    np.testing.assert_allclose(
        large.surface.fields["mean_curvature_per_um"] * factor,
        small.surface.fields["mean_curvature_per_um"],
        rtol=1e-3,
        atol=1e-3,
    )


def test_provenance_says_what_was_done(handle_atlas: Atlas) -> None:
    provenance = handle_atlas.provenance
    assert set(provenance) >= {"versions", "source", "steps", "repairs"}
    assert provenance["versions"]["numpy"] == np.__version__
    assert list(provenance["steps"]) == list(STEP_NAMES)
    assert all(step["seconds"] >= 0 for step in provenance["steps"].values())
    assert any("sealed parts" in repair for repair in provenance["repairs"])
    assert handle_atlas.parameters == QUICK


def test_the_fields_of_the_charts_are_there(small_atlas: Atlas) -> None:
    surface = {"mean_curvature_per_um", "gaussian_curvature", "height_um"}
    assert set(small_atlas.surface.fields) >= surface
    assert "mean_curvature_per_um" in small_atlas.reference.fields
    image = {
        "conformal_error",
        "area_distortion",
        "area_um2",
        "mean_curvature_per_um",
        "surface_height_um",
        "surface_mean_curvature_per_um",
    }
    assert set(small_atlas.uv.fields) >= image
    for values in small_atlas.uv.fields.values():
        assert values.shape == small_atlas.uv.shape


def test_the_cell_lies_where_its_mask_lies(small_atlas: Atlas) -> None:
    """World coordinates all the way, off the origin."""
    mask = small_cell_mask()
    inside = mask.to_world(np.argwhere(mask.data))
    for vertices in (
        small_atlas.surface.vertices,
        small_atlas.sealed.vertices,
        small_atlas.topography.meshed_vertices,
    ):
        np.testing.assert_allclose(vertices.min(axis=0), inside.min(axis=0), atol=0.15)
        np.testing.assert_allclose(vertices.max(axis=0), inside.max(axis=0), atol=0.15)
    assert euler_characteristic(small_atlas.reference.faces) == 2


def test_another_field_of_a_mesh_is_another_source(small_atlas: Atlas) -> None:
    mesh = small_atlas.surface
    keys = [
        Pipeline(Surface(mesh.vertices, mesh.faces, fields))._source_key
        for fields in ({}, {}, {"actin": mesh.vertices[:, 0]}, {"actin": mesh.vertices[:, 1]})
    ]
    assert keys[0] == keys[1]
    assert len(set(keys)) == 3


def test_a_field_of_the_surface_weighs_the_axis(small_pipeline: Pipeline) -> None:
    weighed = changed("uv", axis_weight="field", axis_field="gaussian_curvature")
    atlas = copy_of(small_pipeline).run(weighed, until="uv")
    assert not np.allclose(atlas.uv.rotation, small_pipeline.results["uv"].rotation)
    wrong = changed("uv", axis_weight="field", axis_field="actin")
    with pytest.raises(ParameterError, match=r"'actin'"):
        copy_of(small_pipeline).run(wrong, until="uv")


def test_another_psf_under_the_same_name_is_noticed(
    small_pipeline: Pipeline, tmp_path: Path
) -> None:
    path = tmp_path / "psf.tif"
    path.write_bytes(b"1")
    parameters = changed("stack", psf=str(path))
    keys = [small_pipeline._key(STEPS[0], parameters)]
    path.write_bytes(b"22")
    keys.append(small_pipeline._key(STEPS[0], parameters))
    assert keys[0] != keys[1]
