"""Protrusions as fields of a cell and as colours, without a window."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.charts import Mask, Protrusions, Volume
from napari_unwrap3d.fields import PROTRUSION, fields_of
from napari_unwrap3d.protrusions.colours import instance_colours
from napari_unwrap3d.textured import PaintedTexture, make_skin
from napari_unwrap3d.viewer.protrusions.filter import Filter, filter_from
from napari_unwrap3d.viewer.protrusions.look import strengths
from synthetic import make_atlas

VOLUME = f"{PROTRUSION}volume_um3"


@pytest.fixture(scope="module")
def atlas() -> Any:
    made = make_atlas(3, 32)
    labels = (made.surface.vertices[:, 0] > 8.5).astype(np.int32) * 7
    volume = np.zeros(made.mask.shape, np.int32)
    columns = {
        "label": np.array([4, 7]),
        "motif": np.array([0, 2], np.int8),
        "volume_um3": np.array([1.5, 2.5]),
        "neck_um": np.array([np.nan, 0.5]),
    }
    found = Protrusions(
        labels,
        np.zeros(len(labels)),
        Volume(volume, made.mask.voxel_size),
        Mask(np.asarray(made.mask.data), made.mask.voxel_size),
        columns,
    )
    return made.replaced(on_request={**made.on_request, "protrusions": found})


def test_a_measure_is_a_field_on_every_chart(atlas: Any) -> None:
    fields, inside = fields_of(atlas), atlas.protrusions.labels == 7
    assert VOLUME in fields.names
    assert f"{PROTRUSION}label" not in fields.names
    assert fields.field(VOLUME).unit == "µm³"
    values = fields.values(VOLUME, "surface")
    assert (values[inside] == 2.5).all()
    assert np.isnan(values[~inside]).all()
    for chart in ("uv", "direct", "reference", "sphere"):
        carried = fields.values(VOLUME, chart)
        assert set(np.unique(carried[np.isfinite(carried)])) == {2.5}, chart
    assert fields.colours(VOLUME).colormap == "viridis"


def test_other_protrusions_are_other_values(atlas: Any) -> None:
    cell = atlas.replaced()
    fields = fields_of(cell)
    fields.values(VOLUME, "surface")
    before = cell.protrusions
    columns = {**before.columns, "volume_um3": np.array([1.5, 9.0])}
    cell.keep("protrusions", replace(before, columns=columns), {})
    assert fields.renew()
    assert not fields.renew(), "there is nothing new the second time"
    assert not fields.known(VOLUME, "surface")
    assert np.nanmax(fields.values(VOLUME, "surface")) == 9.0
    # Another atlas of the same charts takes over what is the same, and not these.
    again = atlas.replaced()
    other = fields_of(again)
    other.values("mean_curvature_per_um", "uv")
    fields.adopt(other)
    assert fields.known("mean_curvature_per_um", "uv")
    assert not fields.known(VOLUME, "uv")


def test_colours_differ_and_are_always_the_same() -> None:
    colours = instance_colours(range(1, 60))
    assert len(set(colours.values())) == 59
    assert instance_colours([17])[17] == colours[17]
    values = np.array(list(colours.values()))
    assert ((values >= 0) & (values <= 1)).all()
    # Labels that follow each other, which are often neighbours, are far apart.
    assert np.abs(np.diff(values[:, :3], axis=0)).max(axis=1).min() > 0.15


def test_recolouring_draws_what_drawing_everything_draws() -> None:
    atlas = make_atlas(3, 32)
    skin = make_skin(atlas, "reference")
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 6, atlas.uv.shape)
    field = rng.random(atlas.uv.shape)
    table = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    painted, anew = PaintedTexture(skin), PaintedTexture(skin)
    for texture in (painted, anew):
        texture.set_field(field, table, (0.0, 1.0))
    first, second = strengths(6, (), (), False), strengths(6, {2}, {3, 4}, False)
    painted.cover("a", labels, first)
    painted.take_changed()
    for colours, visible in ((second, True), (second, False), (first, True)):
        painted.recolour("a", colours, visible)
        anew.cover("a", labels, colours, visible)
        assert (painted.pixels == anew.pixels).all()
        assert painted.take_changed()
    painted.recolour("a", first, True)
    assert painted.take_changed() == [], "nothing differs"


def test_the_filter_takes_ranges_and_motifs(atlas: Any) -> None:
    found = atlas.protrusions
    assert Filter().hidden(found) == frozenset()
    assert Filter(motif="bleb").hidden(found) == {7}
    assert Filter(column="volume_um3", low=2.0).hidden(found) == {4}
    assert Filter(column="volume_um3", high=2.0).hidden(found) == {7}
    # What has no value is in no range, however wide.
    assert Filter(column="neck_um", low=-1e9).hidden(found) == {4}
    wanted = Filter("bleb", "volume_um3", None, 3.0)
    assert filter_from(wanted.plain()) == wanted
    with pytest.raises(ValueError, match="finite"):
        filter_from({**wanted.plain(), "low": float("inf")})
