"""Annotations of one timepoint only: whatever is done, every timepoint has what was drawn on it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from annotations.test_stories import Mirror
from napari_unwrap3d.annotations import Annotations, Shape
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import ParameterError
from synthetic import make_atlas

NAME, OTHER = "ruffle", "bottom"
TIMEPOINTS = 3


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return one_atlas()


@pytest.fixture
def drawn(atlas: Atlas) -> Annotations:
    """With one annotation that is another one at every timepoint; the first is shown."""
    annotations = Annotations(atlas)
    annotations.add(NAME)
    annotations.times.show(0)
    annotations.times.set_one_by_one(NAME, True)
    return annotations


def square(corner: int) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.mgrid[4:8, corner : corner + 4]
    return rows.ravel(), columns.ravel()


def image(corner: int, label: int = 1) -> np.ndarray:
    pixels = np.zeros((16, 32), np.uint16)
    pixels[square(corner)] = label
    return pixels


def test_each_timepoint_keeps_what_was_drawn_on_it(drawn: Annotations) -> None:
    for timepoint in range(TIMEPOINTS):
        drawn.times.show(timepoint)
        assert not drawn.image(NAME, "uv").any()
        drawn.draw(NAME, "uv", square(5 * timepoint), 1)
    for timepoint in (1, 0, 2):
        drawn.times.show(timepoint)
        assert (drawn.image(NAME, "uv") == image(5 * timepoint)).all()
        assert (drawn.times.image(NAME, 1) == image(5)).all()
    assert drawn.times.drawn(NAME) == (0, 1, 2)


def test_only_timepoints_that_were_drawn_on_are_kept(drawn: Annotations) -> None:
    drawn.times.show(1)
    drawn.draw(NAME, "uv", square(3), 2)
    for timepoint in range(50):
        drawn.times.show(timepoint)
    assert drawn.times.drawn(NAME) == (1,)
    (part,) = drawn.state().timed
    assert list(part.drawn) == [1]
    drawn.times.show(1)
    drawn.draw(NAME, "uv", square(3), 0)
    assert drawn.times.drawn(NAME) == ()


def test_what_is_the_same_on_all_timepoints_stays(drawn: Annotations) -> None:
    drawn.add(OTHER)
    drawn.draw(OTHER, "uv", square(9), 3)
    for timepoint in range(TIMEPOINTS):
        drawn.times.show(timepoint)
        assert (drawn.image(OTHER, "uv") == image(9, 3)).all()
        assert (drawn.times.image(OTHER, timepoint) == image(9, 3)).all()
    assert not drawn.times.one_by_one(OTHER)


def test_a_stroke_is_taken_back_on_its_own_timepoint(drawn: Annotations) -> None:
    told: list[int] = []
    drawn.times.edited.connect(told.append)
    drawn.times.show(1)
    drawn.draw(NAME, "uv", square(2), 1)
    drawn.times.show(2)
    drawn.draw(NAME, "uv", square(8), 1)
    drawn.undo()
    assert not drawn.image(NAME, "uv").any()
    assert told == []
    drawn.undo()
    assert told == [1]
    assert drawn.times.drawn(NAME) == ()
    drawn.redo()
    assert told == [1, 1]
    assert (drawn.times.image(NAME, 1) == image(2)).all()
    assert not drawn.image(NAME, "uv").any()


def test_the_choice_keeps_what_is_seen_and_can_be_taken_back(drawn: Annotations) -> None:
    drawn.add(OTHER)
    drawn.draw(OTHER, "uv", square(9), 1)
    drawn.times.show(1)
    drawn.times.set_one_by_one(OTHER, True)
    assert (drawn.image(OTHER, "uv") == image(9)).all()
    drawn.times.show(2)
    assert not drawn.image(OTHER, "uv").any()
    drawn.draw(OTHER, "uv", square(20), 1)
    drawn.times.set_one_by_one(OTHER, False)
    drawn.times.show(0)
    assert (drawn.image(OTHER, "uv") == image(20)).all()
    drawn.undo()
    assert not drawn.image(OTHER, "uv").any()
    assert drawn.times.drawn(OTHER) == (1, 2)
    for _ in range(2):
        drawn.undo()
    assert (drawn.image(OTHER, "uv") == image(9)).all()
    assert not drawn.times.one_by_one(OTHER)


def test_without_a_movie_there_is_no_choice(atlas: Atlas) -> None:
    annotations = Annotations(atlas)
    annotations.add(NAME)
    with pytest.raises(ParameterError, match="movie"):
        annotations.times.set_one_by_one(NAME, True)


def test_all_timepoints_have_the_same_colours(drawn: Annotations) -> None:
    drawn.draw(NAME, "uv", square(2), 1)
    drawn.times.show(1)
    red = (1.0, 0.0, 0.0, 1.0)
    drawn.set_colours(NAME, {1: red})
    for timepoint in (0, 2):
        drawn.times.show(timepoint)
        assert drawn.colours(NAME) == {1: red}


def test_a_state_brings_every_timepoint_back(drawn: Annotations, atlas: Atlas) -> None:
    drawn.draw(NAME, "uv", square(2), 1)
    drawn.times.show(2)
    drawn.draw(NAME, "uv", square(8), 4)
    drawn.add_shape(NAME, Shape("uv", "polygon", np.array([[1, 1], [1, 5], [4, 5]]), 2))
    drawn.add(OTHER)
    seen = drawn.image(NAME, "uv")
    there = Annotations(atlas)
    there.times.show(2)
    there.restore(drawn.state())
    assert set(there.names) == {NAME, OTHER}
    assert (there.image(NAME, "uv") == seen).all()
    assert there.times.one_by_one(NAME)
    assert not there.times.one_by_one(OTHER)
    there.times.show(0)
    assert (there.image(NAME, "uv") == image(2)).all()
    assert not there.shapes(NAME)


ACTIONS = st.one_of(
    st.tuples(st.just("show"), st.integers(0, TIMEPOINTS - 1)),
    st.tuples(st.just("draw"), st.integers(0, 24)),
    st.tuples(st.just("surface"), st.integers(0, 200)),
    st.sampled_from([("undo", 0), ("redo", 0), ("choose", 0), ("remove", 0), ("rename", 0)]),
)


@given(st.lists(ACTIONS, max_size=20))
@settings(max_examples=25, deadline=None)
def test_whoever_watches_sees_the_same_and_everything_comes_back(story: list) -> None:
    annotations = Annotations(one_atlas())
    mirror = Mirror(annotations, ("uv", "reference"))
    annotations.times.show(0)
    annotations.add(NAME)
    for what, number in story:
        name = next(iter(annotations.names), None)
        if what == "show":
            annotations.times.show(number)
        elif what in ("undo", "redo"):
            getattr(annotations, what)()
        elif name is None:
            continue
        elif what == "draw":
            annotations.draw(name, "uv", square(number), 1 + number % 3)
        elif what == "surface":
            annotations.draw_vertices(name, np.arange(number, number + 20), 2)
        elif what == "choose":
            annotations.times.set_one_by_one(name, not annotations.times.one_by_one(name))
        elif what == "remove":
            annotations.remove(name)
        else:
            annotations.rename(name, f"{name}'")
        mirror.check()
    end = {t: _everything(annotations, t) for t in range(TIMEPOINTS)}
    strokes = 0
    while annotations.can_undo:
        annotations.undo()
        strokes += 1
        mirror.check()
    assert annotations.names == ()
    for _ in range(strokes):
        annotations.redo()
    mirror.check()
    # What was undone before the end is not made again.
    assert {t: _everything(annotations, t) for t in range(TIMEPOINTS)} == end


@cache
def one_atlas() -> Atlas:
    """Hypothesis takes no fixture of a module."""
    return make_atlas(rows=16)


def _everything(annotations: Annotations, timepoint: int) -> dict[str, bytes]:
    return {n: annotations.times.image(n, timepoint).tobytes() for n in annotations.names}
