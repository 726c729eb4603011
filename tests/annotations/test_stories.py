"""Whatever is done in whatever order, everybody who watches sees the same, and can undo it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.annotations import Annotations, Change, Shape, history
from napari_unwrap3d.annotations.history import STEPS_KEPT
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import AxesError
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


def polygon(draw: Any) -> Shape:
    chart = draw(st.sampled_from(FLAT))
    kind = draw(st.sampled_from(["polygon", "rectangle", "ellipse"]))
    v, u = draw(st.floats(-4, 19)), draw(st.floats(-10, 40))
    corners = np.array([[0, 0], [0, 9], [6, 9], [6, 0]]) * draw(st.floats(0.1, 1.5)) + [v, u]
    overhang = draw(st.sampled_from(["column", "outermost"]))
    return Shape(chart, kind, corners, draw(st.integers(0, 3)), overhang)


def edit(annotations: Annotations, draw: Any) -> None:
    """One thing that a person can do."""
    kind = draw(
        st.sampled_from(["draw"] * 6 + ["shape", "space", "unshape", "undo", "redo", "list"])
    )
    name = draw(st.sampled_from(annotations.names)) if annotations.names else None
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if name is None or kind == "list":
        if name is not None and draw(st.booleans()):
            annotations.remove(name)
        else:
            annotations.add(f"{len(annotations.names)} {rng.integers(10**9)}")
    elif kind == "draw":
        chart = draw(st.sampled_from(WATCHED))
        annotations.overhang = draw(st.sampled_from(["column", "outermost"]))
        shape = annotations.shape(chart)
        corner = [rng.integers(n) for n in shape]
        box = np.ix_(
            *[np.arange(c, min(c + max(n // 3, 2), n)) for c, n in zip(corner, shape, strict=True)]
        )
        drawn = np.zeros(shape, bool)
        drawn[box] = True
        annotations.draw(name, chart, np.nonzero(drawn), draw(st.integers(0, 3)))
    elif kind == "shape":
        annotations.add_shape(name, polygon(draw))
    elif kind == "space":
        centre = rng.uniform(2, 10, (2, 3))
        kind = draw(st.sampled_from(["box", "half-space"]))
        annotations.add_shape(name, Shape("volume", kind, centre, draw(st.integers(0, 3))))
    elif kind == "unshape":
        annotations.set_shapes(name, annotations.shapes(name)[1:])
    elif kind == "undo":
        annotations.undo()
    else:
        annotations.redo()


def seen(annotations: Annotations) -> dict[tuple[str, str], bytes]:
    return {
        (name, chart): annotations.image(name, chart).tobytes()
        for name in annotations.names
        for chart in WATCHED
    }


@settings(max_examples=40)
@given(data=st.data())
def test_who_watches_sees_what_is_read(atlas: Atlas, data: st.DataObject) -> None:
    annotations = Annotations(atlas)
    charts = tuple(data.draw(st.lists(st.sampled_from(WATCHED), unique=True)))
    mirror = Mirror(annotations, charts)
    for _ in range(data.draw(st.integers(1, 12))):
        edit(annotations, data.draw)
    mirror.check()


@settings(max_examples=40)
@given(data=st.data())
def test_everything_can_be_undone_and_redone(atlas: Atlas, data: st.DataObject) -> None:
    annotations = Annotations(atlas)
    mirror = Mirror(annotations, ("uv", "direct"))
    for _ in range(data.draw(st.integers(1, 12))):
        if data.draw(st.booleans()):
            edit(annotations, data.draw)
        else:
            with annotations.stroke(), annotations.stroke():
                edit(annotations, data.draw)
                edit(annotations, data.draw)
    last = seen(annotations)
    states = [last]
    while annotations.can_undo:
        annotations.undo()
        states.append(seen(annotations))
    mirror.check()
    assert annotations.names == ()
    for state in states[-2::-1]:
        assert annotations.can_redo or state is last
        annotations.redo()
        assert seen(annotations) == state
    mirror.check()


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
    annotations.draw_vertices("one", [5], 1)
    annotations.unwatch("uv")
    annotations.draw_vertices("one", [6], 1)
    assert [list(change.pixels) for change in changes] == [["uv"], []]
    assert changes[1].vertices.tolist() == [6]
    assert changes[1].labels.tolist() == [1]
