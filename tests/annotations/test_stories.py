"""Whatever is done in whatever order, everybody who watches sees the same, and can undo it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.annotations import Annotations, Change, Shape, history
from napari_unwrap3d.annotations.history import STEPS_KEPT
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import AxesError, ParameterError
from synthetic import make_atlas

WATCHED = ("uv", "direct", "plane", "topography", "volume", "reference", "sphere", "surface")
FLAT = ("uv", "direct", "plane")


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return make_atlas(rows=16)


class Mirror:
    """A viewer: it reads every image once, and then only follows what it is told."""

    def __init__(self, annotations: Annotations, charts: tuple[str, ...]) -> None:
        self.annotations, self.charts = annotations, charts
        self.images: dict[str, dict[str, np.ndarray]] = {}
        for chart in charts:
            annotations.watch(chart)
        annotations.changed.connect(self.change)
        annotations.listed.connect(self.list)

    def list(self) -> None:
        self.images = {name: self.read(name) for name in self.annotations.names}

    def read(self, name: str) -> dict[str, np.ndarray]:
        images = {chart: self.annotations.image(name, chart) for chart in self.charts}
        return {**images, "truth": self.annotations.labels(name).copy()}

    def change(self, change: Change) -> None:
        images = self.images[change.name]
        images["truth"][change.vertices] = change.labels
        assert change.pixels.keys() == set(self.charts)
        for chart, (flat, values) in change.pixels.items():
            images[chart].ravel()[flat] = values

    def check(self) -> None:
        assert self.images.keys() == set(self.annotations.names)
        for name in self.annotations.names:
            for chart, image in self.read(name).items():
                assert (self.images[name][chart] == image).all(), (name, chart)


@st.composite
def shapes(draw: st.DrawFn) -> Shape:
    label = draw(st.integers(0, 3))
    if draw(st.booleans()):
        rng = np.random.default_rng(draw(st.integers(0, 99)))
        kind = draw(st.sampled_from(["box", "half-space"]))
        return Shape("volume", kind, rng.uniform(2, 10, (2, 3)), label)
    kind = draw(st.sampled_from(["polygon", "rectangle", "ellipse"]))
    start = np.array([draw(st.floats(-4, 19)), draw(st.floats(-10, 40))])
    corners = np.array([[0, 0], [0, 9], [6, 9], [6, 0]]) * draw(st.floats(0.1, 1.5)) + start
    overhang = draw(st.sampled_from(["column", "outermost"]))
    return Shape(draw(st.sampled_from(FLAT)), kind, corners, label, overhang)


Edit = Callable[[Annotations], None]


@st.composite
def edits(draw: st.DrawFn) -> Edit:
    """One thing that a person can do."""
    kind = draw(st.sampled_from(["draw"] * 4 + ["shape", "unshape", "list"]))
    name = draw(st.sampled_from(["one", "two"]))
    if kind == "list":
        return lambda a: a.remove(name) if name in a.names else a.add(name)
    if kind == "shape":
        shape = draw(shapes())
        return lambda a: a.add_shape(name, shape) if name in a.names else None
    if kind == "unshape":
        return lambda a: a.set_shapes(name, a.shapes(name)[1:]) if name in a.names else None
    chart, label = draw(st.sampled_from(WATCHED)), draw(st.integers(0, 3))
    overhang = draw(st.sampled_from(["column", "outermost"]))
    seed = draw(st.integers(0, 99))

    def paint(annotations: Annotations) -> None:
        rng, whole = np.random.default_rng(seed), annotations.shape(chart)
        first, size = rng.integers(whole), np.maximum(np.array(whole) // 3, 2)
        drawn = np.zeros(whole, bool)
        drawn[tuple(slice(a, b) for a, b in zip(first, first + size, strict=True))] = True
        annotations.overhang = overhang
        if name in annotations.names:
            annotations.draw(name, chart, np.nonzero(drawn), label)

    return paint


def stories(*others: Edit) -> st.SearchStrategy[list[Edit]]:
    """Edits, and other things to do between them."""
    one = st.one_of(edits(), st.sampled_from(others)) if others else edits()
    return st.lists(one, min_size=1, max_size=12)


def begun(atlas: Atlas) -> Annotations:
    annotations = Annotations(atlas)
    annotations.add("one")
    return annotations


def seen(annotations: Annotations) -> dict[tuple[str, str], bytes]:
    return {
        (name, chart): annotations.image(name, chart).tobytes()
        for name in annotations.names
        for chart in WATCHED
    }


@settings(max_examples=40)
@given(
    story=stories(Annotations.undo, Annotations.redo),
    charts=st.lists(st.sampled_from(WATCHED), unique=True),
)
def test_who_watches_sees_what_is_read(atlas: Atlas, story: list[Edit], charts: list[str]) -> None:
    annotations = Annotations(atlas)
    mirror = Mirror(annotations, tuple(charts))
    annotations.add("one")
    for edit in story:
        edit(annotations)
        mirror.check()


@settings(max_examples=40)
@given(story=stories(Annotations.undo, Annotations.redo))
def test_it_does_not_matter_when_one_looks(atlas: Atlas, story: list[Edit]) -> None:
    looking, not_looking = begun(atlas), begun(atlas)
    for edit in story:
        edit(looking)
        seen(looking)
        edit(not_looking)
    assert seen(looking) == seen(not_looking)


@settings(max_examples=40)
@given(story=stories(), looking=st.booleans())
def test_everything_can_be_undone_and_redone(
    atlas: Atlas, story: list[Edit], looking: bool
) -> None:
    annotations, truth = Annotations(atlas), Annotations(atlas)
    states = [seen(truth)]
    for edit in [lambda a: a.add("one"), *story]:
        steps = len(annotations._history._done)
        with annotations.stroke(), annotations.stroke():
            edit(annotations)
        edit(truth)
        if looking:
            seen(annotations)
        if len(annotations._history._done) > steps:
            states.append(seen(truth))
        assert seen(truth) == states[-1]
    for before in states[-2::-1]:
        annotations.undo()
        if looking:
            assert seen(annotations) == before
    assert not annotations.can_undo
    assert annotations.names == ()
    for after in states[1:]:
        annotations.redo()
        assert seen(annotations) == after
    assert not annotations.can_redo


def test_what_was_drawn_before_one_looked_can_be_undone(atlas: Atlas) -> None:
    annotations = begun(atlas)
    annotations.draw_vertices("one", np.arange(50), 3)
    assert annotations.image("one", "uv").any()
    annotations.undo()
    assert not annotations.image("one", "uv").any()
    annotations.redo()
    owned = annotations.owners("uv").owned(np.arange(50))
    assert np.flatnonzero(annotations.image("one", "uv") == 3).tolist() == sorted(owned)


def test_a_stroke_is_one_step(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    with annotations.stroke():
        for u in range(8):
            annotations.draw("one", "uv", ([4, 5], [u, u]), 1)
        assert not annotations.can_undo
        annotations.undo()  # in the midst of a stroke there is nothing to undo
    assert annotations.image("one", "uv").sum() == 16
    annotations.undo()
    assert not annotations.image("one", "uv").any()
    annotations.redo()
    assert annotations.image("one", "uv").sum() == 16
    annotations.undo()
    annotations.draw("one", "uv", ([0], [0]), 2)
    assert not annotations.can_redo


def test_what_changes_nothing_is_no_step(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    changes: list[Change] = []
    annotations.changed.connect(changes.append)
    annotations.draw("one", "direct", ([3], [3]), 0)
    annotations.undo()
    assert annotations.names == ()
    assert changes == []


def test_a_stroke_that_fails_can_be_taken_back(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    with annotations.stroke():
        annotations.draw("one", "uv", ([3], [3]), 1)
        with pytest.raises(AxesError):
            annotations.draw("one", "uv", ([99], [3]), 1)
    annotations.undo()
    assert not annotations.image("one", "uv").any()


def test_only_so_many_steps_are_kept(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    for step in range(STEPS_KEPT + 5):
        annotations.draw_vertices("one", [0], step % 2 + 1)
    while annotations.can_undo:
        annotations.undo()
    assert annotations.names == ("one",)


def test_large_steps_are_forgotten_sooner(atlas: Atlas, monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere = np.arange(len(atlas.surface.vertices))
    monkeypatch.setattr(history, "BYTES_KEPT", 3 * 12 * len(everywhere))
    annotations = Annotations(atlas)
    annotations.add("one")
    for step in range(9):
        annotations.draw_vertices("one", everywhere, step + 1)
    undone = 0
    while annotations.can_undo:
        annotations.undo()
        undone += 1
    assert undone == 3
    assert set(annotations.labels("one")) == {6}


def test_names_are_changed_and_come_back(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    lists: list[tuple[str, ...]] = []
    annotations.listed.connect(lambda: lists.append(annotations.names))
    annotations.add("one")
    annotations.add("two")
    annotations.draw_vertices("one", [1, 2], 3)
    annotations.rename("one", "three")
    assert annotations.names == ("three", "two")
    assert np.flatnonzero(annotations.labels("three")).tolist() == [1, 2]
    annotations.remove("three")
    annotations.undo()
    annotations.undo()
    assert annotations.names == ("one", "two")
    assert np.flatnonzero(annotations.labels("one")).tolist() == [1, 2]
    assert lists == [
        ("one",),
        ("one", "two"),
        ("three", "two"),
        ("two",),
        ("three", "two"),
        ("one", "two"),
    ]


def test_what_is_no_longer_watched_is_not_told(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add("one")
    changes: list[Change] = []
    annotations.changed.connect(changes.append)
    annotations.watch("uv")
    annotations.watch("uv")
    annotations.draw_vertices("one", np.arange(9), 1)
    annotations.unwatch("uv")
    annotations.draw_vertices("one", [6], 2)
    assert [list(change.pixels) for change in changes] == [["uv"], []]
    flat, values = changes[0].pixels["uv"]
    assert len(flat) > 0
    assert sorted(flat) == sorted(annotations.owners("uv").owned(np.arange(9)))
    assert set(values) == {1}
    assert changes[1].vertices.tolist() == [6]
    assert changes[1].labels.tolist() == [2]


def test_the_axis_is_a_direction_and_a_step(atlas: Atlas) -> None:
    annotations, told = Annotations(atlas), []
    annotations.turned.connect(lambda: told.append(annotations.axis))
    assert annotations.axis is None
    annotations.axis = (0.0, 3.0, -4.0)
    assert annotations.axis == (0.0, 0.6, -0.8)
    annotations.axis = None
    annotations.undo()
    assert annotations.axis == (0.0, 0.6, -0.8)
    annotations.undo()
    assert told == [(0.0, 0.6, -0.8), None, (0.0, 0.6, -0.8), None]
    for bad in ((0, 0, 0), (1, 2), (np.nan, 0, 1), 3.0):
        with pytest.raises(ParameterError, match="axis"):
            annotations.axis = bad  # type: ignore[assignment]
    assert not annotations.can_undo
