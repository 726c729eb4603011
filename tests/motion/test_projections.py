"""Projections of all timepoints of a movie."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import movies
from napari_unwrap3d.charts import Stack
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.motion.movie import load_movie
from napari_unwrap3d.motion.projections import Projections


def test_all_timepoints_are_seen_on_the_same_pixels(breathing: Any) -> None:
    found = list(Projections.of(breathing, "ramp", 0.3).all())
    assert len(found) == len(breathing)
    assert len({each.image.shape for each in found}) == 1
    assert len({each.extent for each in found}) == 1
    seen = [np.isfinite(each.image).sum() for each in found]
    assert seen[2] > seen[0]
    np.testing.assert_array_equal(found[0].image, found[-1].image)
    # The ramp along x is a ramp to the right.
    left = found[0].extent[0]
    columns = left + (np.arange(found[0].image.shape[1]) + 0.5) * found[0].pixel_um
    expected = np.broadcast_to(columns / movies.VOXEL_UM, found[0].image.shape)
    there = np.isfinite(found[0].image)
    np.testing.assert_allclose(found[0].image[there], expected[there], atol=1e-3)


def test_a_movie_without_its_stack_takes_it_anew(breathing: Any) -> None:
    opened = load_movie(breathing.folder.path)
    with pytest.raises(InputError, match="stack"):
        Projections.of(opened)
    stack = movies.breathing_stack()
    found = Projections.of(opened, 1, 0.3, stack=stack).at(2)
    expected = Projections.of(breathing, 1, 0.3).at(2)
    np.testing.assert_array_equal(found.image, expected.image)
    with pytest.raises(ParameterError, match="channel"):
        Projections.of(breathing, "nothing")
    short = Stack(stack.data[:3], stack.axes, stack.voxel_size, stack.time_step, stack.channels)
    with pytest.raises(InputError, match="not that of the movie"):
        Projections.of(opened, stack=short)
