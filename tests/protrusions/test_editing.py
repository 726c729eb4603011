"""Edits of protrusions by hand: one stroke each, undone as one, measured like anew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Protrusions
from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.files.project import load_project, save_project
from napari_unwrap3d.protrusions.editing import NAME, ProtrusionEdits
from napari_unwrap3d.protrusions.segment import Segmentation
from napari_unwrap3d.protrusions.table import measure_protrusions
from synthetic import make_atlas, with_protrusions


@pytest.fixture(scope="module")
def known() -> Atlas:
    return with_protrusions(make_atlas())


@pytest.fixture
def atlas(known: Atlas) -> Atlas:
    """As nobody drew on it."""
    return fresh(known)


def fresh(atlas: Atlas) -> Atlas:
    return Atlas(**{name: getattr(atlas, name) for name in Atlas.__dataclass_fields__})


def assert_measured_like_anew(atlas: Atlas, found: Protrusions) -> None:
    """The table is that of measuring all, and the parts make up the cell."""
    segmentation = Segmentation(found.labels, found.height_um, found.volume.data, found.cortex.data)
    image, rows = atlas.topography.surface, atlas.topography.shape[1]
    anew = measure_protrusions(segmentation, atlas.mask, atlas.surface, image, rows=rows)
    assert list(found.columns) == list(anew)
    for name, column in anew.items():
        assert found.columns[name].tobytes() == column.tobytes(), name
    np.testing.assert_array_equal(found.cortex.data ^ (found.volume.data > 0), atlas.mask.data)
    assert found.numbers["parts_difference"] == 0
    assert found.numbers["protrusions"] == found.count


def state_of(found: Protrusions) -> tuple[Any, ...]:
    table = tuple(column.tobytes() for column in found.columns.values())
    return (found.labels.tobytes(), found.volume.data.tobytes(), table)


def test_to_start_puts_the_labels_into_an_annotation(atlas: Atlas) -> None:
    edits = ProtrusionEdits(atlas)
    assert not edits.started
    edits.start()
    assert atlas.annotations.names == (NAME,)
    np.testing.assert_array_equal(atlas.annotations.labels(NAME), atlas.protrusions.labels)
    assert edits.protrusions is atlas.protrusions  # nothing was changed
    atlas.annotations.undo()
    assert not edits.started
    assert edits.labels is atlas.protrusions.labels


def test_every_edit_is_one_stroke_and_taken_back_as_one(atlas: Atlas) -> None:
    edits = ProtrusionEdits(atlas)
    edits.start()
    one, other, third = atlas.protrusions.columns["label"].tolist()
    before = state_of(edits.protrusions)
    seeds = np.flatnonzero(edits.labels == one)[[0, -1]]
    bare = np.flatnonzero(edits.labels == 0)[:9]
    for edit in (
        lambda: edits.merge([one, other]),
        lambda: edits.delete(third),
        lambda: edits.delete([one, third]),
        lambda: edits.split(one, seeds),
        lambda: edits.add(bare),
        lambda: atlas.annotations.draw(NAME, "uv", (np.arange(9), np.arange(9)), 2),
    ):
        edit()
        after = edits.protrusions
        assert after.method == "edited"
        assert state_of(after) != before
        assert_measured_like_anew(atlas, after)
        atlas.annotations.undo()
        assert state_of(edits.protrusions) == before
        atlas.annotations.redo()
        assert state_of(edits.protrusions) == state_of(after)
        atlas.annotations.undo()
    assert edits.protrusions.method == "cortex"


def test_to_merge_adds_up_and_to_delete_gives_back_to_the_cortex(atlas: Atlas) -> None:
    edits = ProtrusionEdits(atlas)
    found = atlas.protrusions
    area, volume = found.columns["area_um2"], found.columns["volume_um3"]
    assert edits.merge([2, 1]) == 2
    merged = edits.protrusions
    assert merged.columns["label"].tolist() == [2, 3]
    assert merged.columns["area_um2"][0] == pytest.approx(area[0] + area[1])
    assert merged.columns["volume_um3"][0] == pytest.approx(volume[0] + volume[1])
    edits.delete(2)
    left = edits.protrusions
    assert left.columns["label"].tolist() == [3]
    gained = left.cortex.data.sum() - found.cortex.data.sum()
    assert gained * atlas.voxel_um**3 == pytest.approx(volume[0] + volume[1])
    edits.delete(3)
    assert edits.protrusions.count == 0
    np.testing.assert_array_equal(edits.protrusions.cortex.data, atlas.mask.data)


def test_a_merged_protrusion_is_split_where_it_was_joined(atlas: Atlas) -> None:
    """Two bumps apart from each other: the two highest peaks, by themselves."""
    edits = ProtrusionEdits(atlas)
    whole = atlas.protrusions.labels
    edits.merge([1, 2])
    assert edits.split(1) == [1, 4]
    np.testing.assert_array_equal(edits.labels == 1, whole == 1)
    np.testing.assert_array_equal(edits.labels == 4, whole == 2)
    atlas.annotations.undo()
    points = [atlas.surface.vertices[whole == label].mean(axis=0) for label in (2, 1)]
    assert edits.split(1, points) == [1, 4]  # the first point keeps the label
    np.testing.assert_array_equal(edits.labels == 1, whole == 2)
    assert_measured_like_anew(atlas, edits.protrusions)


def test_what_cannot_be_edited_is_refused_and_changes_nothing(atlas: Atlas) -> None:
    edits = ProtrusionEdits(atlas)
    before = state_of(edits.protrusions)
    mine = np.flatnonzero(edits.labels == 1)
    for wrong in (
        lambda: edits.merge([1, 9]),
        lambda: edits.merge([]),
        lambda: edits.delete(0),
        lambda: edits.split(1, parts=500),
        lambda: edits.split(1, mine[:1]),
        lambda: edits.split(1, mine[[0, 0]]),
    ):
        with pytest.raises(ParameterError):
            wrong()
    assert state_of(edits.protrusions) == before
    assert not atlas.annotations.can_undo


def test_painting_around_a_foot_takes_what_is_over_the_cortex_there(atlas: Atlas) -> None:
    """And erasing it again leaves what was found."""
    edits = ProtrusionEdits(atlas)
    edits.start()
    found = atlas.protrusions
    bare = np.flatnonzero((found.labels == 0) & (found.height_um > 0))
    edits.annotations.draw_vertices(NAME, bare, 3)
    grown = edits.protrusions
    taken = (grown.volume.data == 3) & (found.volume.data == 0)
    assert taken.any()
    # What was taken lies over the reference, as the heights say.
    away = np.linalg.norm(atlas.mask.to_world(np.argwhere(taken)) - 6.0, axis=1)
    assert away.min() > 4.0 - atlas.voxel_um
    edits.annotations.draw_vertices(NAME, bare, 0)
    assert state_of(edits.protrusions) == state_of(found)


STROKES = st.lists(
    st.tuples(
        st.sampled_from(["paint", "merge", "delete", "split", "undo", "redo"]),
        st.integers(0, 641),
        st.integers(0, 6),
        st.booleans(),
    ),
    min_size=1,
    max_size=6,
)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(STROKES)
def test_any_edits_in_any_order_give_what_measuring_the_labels_gives(
    known: Atlas, strokes: list[tuple[str, int, int, bool]]
) -> None:
    """Whether it was looked at in between or not: only the labels count."""
    atlas = fresh(known)
    edits = ProtrusionEdits(atlas)
    edits.start()
    for what, vertex, label, look in strokes:
        there = sorted(set(edits.labels.tolist()) - {0})
        if what == "paint":
            edits.start()
            near = np.linalg.norm(atlas.surface.vertices - atlas.surface.vertices[vertex], axis=1)
            edits.annotations.draw_vertices(NAME, np.flatnonzero(near < 1.5), label)
        elif what == "merge" and len(there) > 1:
            edits.merge(there[:2])
        elif what == "delete" and there:
            edits.delete(there[label % len(there)])
        elif what == "split" and there:
            mine = np.flatnonzero(edits.labels == there[label % len(there)])
            if len(mine) > 1:
                edits.split(there[label % len(there)], mine[[0, -1]])
        elif what in ("undo", "redo"):
            getattr(edits.annotations, what)()
        if look:
            _ = edits.protrusions
    assert_measured_like_anew(atlas, edits.protrusions)
    # Somebody who was not there and sees the labels finds the same.
    other = fresh(known)
    stranger = ProtrusionEdits(other)
    stranger.start()
    for label in np.unique(edits.labels):
        other.annotations.draw_vertices(NAME, np.flatnonzero(edits.labels == label), int(label))
    assert state_of(stranger.protrusions) == state_of(edits.protrusions)


def test_edited_protrusions_are_kept_in_the_project(atlas: Atlas, tmp_path: Any) -> None:
    edits = ProtrusionEdits(atlas)
    edits.merge([1, 2])
    edits.add(np.flatnonzero(edits.labels == 0)[:20])
    now = edits.keep()
    assert atlas.protrusions is now
    assert atlas.quality["protrusions"]["protrusions"] == 3
    opened = load_project(save_project(atlas, tmp_path / "cell"))
    assert opened.protrusions.method == "edited"
    assert state_of(opened.protrusions) == state_of(now)
    np.testing.assert_array_equal(opened.annotations.labels(NAME), now.labels)
    # Editing goes on from there.
    more = ProtrusionEdits(opened)
    more.start()
    assert not opened.annotations.can_undo
    assert more.protrusions is opened.protrusions
    more.delete(1)
    assert_measured_like_anew(opened, more.protrusions)


def test_labels_that_were_drawn_before_are_taken_over_or_started_anew(atlas: Atlas) -> None:
    atlas.annotations.add(NAME)
    atlas.annotations.draw_vertices(NAME, np.arange(30), 5)
    edits = ProtrusionEdits(atlas)
    edits.start()
    assert edits.protrusions.columns["label"].tolist() == [5]
    assert_measured_like_anew(atlas, edits.protrusions)
    edits.start(anew=True)
    assert edits.protrusions is atlas.protrusions
    atlas.annotations.undo()
    assert edits.protrusions.columns["label"].tolist() == [5]


def test_a_cell_without_protrusions_can_be_given_some(atlas: Atlas) -> None:
    """Found none: then all that there is was drawn."""
    edits = ProtrusionEdits(atlas)
    edits.delete([1, 2, 3])
    edits.keep()
    bare = fresh(atlas)
    assert bare.protrusions.count == 0
    edits = ProtrusionEdits(bare)
    assert edits.add(np.flatnonzero(bare.protrusions.height_um > 0.3)) == 1
    found = edits.protrusions
    assert found.count == 1
    assert found.columns["volume_um3"][0] > 0
    assert_measured_like_anew(bare, found)
