"""Fields mean the same on every chart, and are computed once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Stack
from napari_unwrap3d.errors import ChartMissingError, ParameterError
from napari_unwrap3d.fields import (
    AREA_DISTORTION,
    CHARTS,
    CONFORMAL_ERROR,
    CURVATURE,
    GAUSSIAN,
    HEIGHT,
    REFERENCE_CURVATURE,
    colours_of,
    field_on,
    field_titles,
    fields_of,
    topography_signal,
)


@pytest.fixture(scope="module")
def stack(small_atlas: Atlas) -> Stack:
    """Its intensity is the number of the z slice times ten, and 1000 less in channel 1."""
    mask = small_atlas.mask
    shape = np.ceil(np.add(mask.to_index(np.zeros(3)) * -1, mask.shape)).astype(int)
    z = np.indices(shape)[0]
    data = np.stack([10 * z, 1000 - 10 * z]).astype(np.uint16)
    return Stack(data, "czyx", mask.voxel_size, channels=("actin", "septin"))


def test_there_are_titles_with_units(small_atlas: Atlas) -> None:
    # A copy: the fields of the shared one may know a stack from another test.
    atlas = small_atlas.replaced()
    titles = field_titles(atlas)
    assert next(iter(titles)) == CURVATURE
    assert titles[CURVATURE] == "Mean curvature (1/µm)"
    known = {CURVATURE, HEIGHT, GAUSSIAN, AREA_DISTORTION, CONFORMAL_ERROR, REFERENCE_CURVATURE}
    assert set(titles) == known


def test_every_field_is_on_every_chart(plane_atlas: Atlas) -> None:
    plane_atlas.direct  # noqa: B018 (computes it)
    for name in field_titles(plane_atlas):
        for chart in CHARTS:
            values = field_on(plane_atlas, name, chart)
            mesh = chart in ("surface", "sealed", "reference", "sphere")
            size = (len(getattr(plane_atlas, chart).vertices),) if mesh else None
            assert values.shape == (size or getattr(plane_atlas, chart).shape)
            assert values.dtype == np.float32
            assert np.isfinite(values).mean() > 0.98, (name, chart)


def test_a_field_is_the_same_on_the_charts_that_show_the_same(small_atlas: Atlas) -> None:
    uv = field_on(small_atlas, CURVATURE, "uv")
    carried = small_atlas.carry(small_atlas.surface.fields[CURVATURE], "surface", "uv")
    np.testing.assert_allclose(uv, carried, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(
        field_on(small_atlas, CURVATURE, "reference"), field_on(small_atlas, CURVATURE, "sphere")
    )
    back = small_atlas.carry(field_on(small_atlas, CURVATURE, "reference"), "reference", "uv")
    assert np.corrcoef(back.ravel(), uv.ravel())[0, 1] > 0.98


def test_a_field_of_the_image_is_read_on_the_surface(small_atlas: Atlas) -> None:
    image = np.asarray(small_atlas.uv.fields[AREA_DISTORTION])
    values = field_on(small_atlas, AREA_DISTORTION, "surface")
    vu = np.rint(small_atlas.topography.surface[:, 1:]).astype(int)
    rows, columns = image.shape
    nearest = image[np.clip(vu[:, 0], 0, rows - 1), vu[:, 1] % columns]
    assert np.median(np.abs(values / nearest - 1)) < 0.02


def test_the_gaussian_curvature_adds_up_to_that_of_the_topology(small_atlas: Atlas) -> None:
    total = field_on(small_atlas, GAUSSIAN, "surface") @ small_atlas.elements("surface")
    assert total == pytest.approx(4 * np.pi, rel=1e-3)


def test_values_are_computed_once(small_atlas: Atlas, monkeypatch: pytest.MonkeyPatch) -> None:
    first = field_on(small_atlas, HEIGHT, "uv")

    def no_more(*_: Any, **__: Any) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(Atlas, "carry", no_more)
    assert field_on(small_atlas, HEIGHT, "uv") is first
    assert fields_of(small_atlas).known(HEIGHT, "uv")


def test_another_atlas_of_the_same_charts_knows_what_was_computed(small_atlas: Atlas) -> None:
    first, second = small_atlas.replaced(), small_atlas.replaced(quality={})
    values = field_on(first, HEIGHT, "reference")
    second_fields = fields_of(second)
    second_fields.adopt(fields_of(first))
    assert second_fields.values(HEIGHT, "reference") is values
    moved = small_atlas.surface.vertices + 1.0
    other = small_atlas.replaced(surface=replace(small_atlas.surface, vertices=moved))
    other_fields = fields_of(other)
    other_fields.adopt(fields_of(first))
    assert not other_fields.known(HEIGHT, "reference"), "its surface is another"


def test_what_is_missing_is_said_and_not_computed(small_atlas: Atlas) -> None:
    atlas = small_atlas.replaced(on_request={})
    with pytest.raises(ChartMissingError, match="direct"):
        field_on(atlas, CURVATURE, "direct")
    assert not atlas.has("direct")
    assert not fields_of(atlas).reachable(CURVATURE, "direct")
    with pytest.raises(ChartMissingError, match="volume"):
        field_on(atlas, CURVATURE, "volume")
    with pytest.raises(ParameterError, match="warmth"):
        field_on(atlas, "warmth", "uv")


def test_before_the_topography_only_what_can_be_carried_is_reachable(small_atlas: Atlas) -> None:
    # The fields refer to the atlas weakly; keep it for as long as they are asked.
    atlas = small_atlas.replaced(topography=None)
    early = fields_of(atlas)
    assert early.reachable(CURVATURE, "surface")
    assert not early.reachable(CURVATURE, "uv")
    assert early.reachable(REFERENCE_CURVATURE, "uv")
    assert not early.reachable(REFERENCE_CURVATURE, "surface")
    assert early.colours(REFERENCE_CURVATURE).limits[1] > 0


def test_the_channels_of_the_stack_are_fields(small_atlas: Atlas, stack: Stack) -> None:
    titles = field_titles(small_atlas, stack)
    assert titles["signal_0"] == "Signal: actin"
    z = small_atlas.surface.vertices[:, 0] / small_atlas.voxel_um
    for name, expected in (("signal_0", 10 * z), ("signal_1", 1000 - 10 * z)):
        values = field_on(small_atlas, name, "surface", stack)
        known = np.isfinite(values)
        assert known.mean() > 0.9, "some paths leave the stack"
        assert np.corrcoef(values[known], expected[known])[0, 1] > 0.95
    labelled = small_atlas.parameters.model_copy(
        update={"stack": small_atlas.parameters.stack.model_copy(update={"label": 2})}
    )
    assert "signal_0" not in field_titles(small_atlas.replaced(parameters=labelled), stack)


def test_a_channel_is_carried_to_the_topography(small_atlas: Atlas, stack: Stack) -> None:
    volume = topography_signal(small_atlas, stack, "actin")
    assert volume.dtype == np.uint16
    expected = 10 * small_atlas.topography.positions[..., 0] / small_atlas.voxel_um
    index = small_atlas.topography.positions / small_atlas.voxel_um
    inside = ((index > 0) & (index < np.array(stack.shape[1:]) - 1)).all(axis=-1)
    assert inside.mean() > 0.5
    np.testing.assert_allclose(volume[inside], expected[inside], atol=0.51)
    floats = Stack(stack.data.astype(np.float32), "czyx", stack.voxel_size)
    carried = topography_signal(small_atlas, floats)
    np.testing.assert_allclose(carried[inside], expected[inside], atol=0.02)
    beyond = ((index < -0.51) | (index > np.array(stack.shape[1:]) - 0.49)).any(axis=-1)
    assert np.isnan(carried[beyond]).all()
    assert (volume[beyond] == 0).all()


def test_colours_are_robust_and_symmetric_for_curvatures() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(0.5, 1.0, 10_000)
    values[:3] = (1e6, np.nan, -np.inf)
    curvature, height = colours_of(CURVATURE, values), colours_of(HEIGHT, values)
    assert curvature.limits[0] == -curvature.limits[1]
    assert 2.5 < curvature.limits[1] < 3.2
    assert -2.1 < height.limits[0] < height.limits[1] < 3.2
    assert curvature.colormap != height.colormap
    flat = colours_of(HEIGHT, np.zeros(5))
    assert flat.limits[1] > flat.limits[0]
    assert colours_of(CONFORMAL_ERROR, np.ones(5)).limits == (1.0, 1.05)


def test_a_place_has_a_value_once_it_is_known(small_atlas: Atlas) -> None:
    fields = fields_of(small_atlas)
    values = fields.values(CURVATURE, "surface")
    corners = small_atlas.surface.faces[7]
    found = fields.at(CURVATURE, corners, np.array([0.2, 0.3, 0.5]))
    assert found == pytest.approx(float(values[corners] @ [0.2, 0.3, 0.5]))
    assert fields.at("signal_9", corners, np.ones(3) / 3) is None
