"""What a movie can be made from, and what is refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from moving import blebbing
from napari_unwrap3d import Mask, Stack, Surface, read_stack
from napari_unwrap3d.errors import AxesError, InputError
from napari_unwrap3d.motion.timelapse import Timelapse
from shapes import icosphere


def stack(axes: str = "tczyx", time_step: float | None = 1.5) -> Stack:
    sizes = {"t": 3, "c": 2, "z": 4, "y": 5, "x": 6}
    shape = [sizes[axis] for axis in axes]
    data = np.arange(np.prod(shape)).reshape(shape)
    return Stack(data, axes, (0.3, 0.1, 0.1), time_step, ("a", "b") if "c" in axes else ())


def test_a_stack_gives_one_timepoint_after_the_other() -> None:
    lapse = Timelapse.of(stack())
    assert (len(lapse), lapse.time_step_s, lapse.channels) == (3, 1.5, ("a", "b"))
    np.testing.assert_allclose(lapse.times_s, [0, 1.5, 3])
    second = lapse.at(1)
    assert isinstance(second, Stack)
    assert second.axes == "czyx"
    np.testing.assert_array_equal(second.data, stack().data[1])


def test_a_given_time_step_wins() -> None:
    assert Timelapse.of(stack(), 0.5).time_step_s == 0.5


def test_a_stack_without_channels_names_its_one() -> None:
    assert Timelapse.of(stack("tzyx")).channels == ("0",)


def test_masks_and_meshes_are_timepoints_without_channels() -> None:
    assert Timelapse.of(blebbing(2), 1.0).channels == ()
    sphere = Surface(*icosphere(1))
    assert len(Timelapse.of([sphere] * 4, 1.0)) == 4


@pytest.mark.parametrize(
    ("source", "step", "error", "words"),
    [
        (stack("zyx"), 1.0, AxesError, "at least two timepoints"),
        (stack(time_step=None), None, InputError, "time between two timepoints is not known"),
        (stack(), -1.0, InputError, "is positive"),
        (stack(), float("nan"), InputError, "is positive"),
        (blebbing(2)[:1], 1.0, InputError, "for each timepoint"),
        ([*blebbing(2), stack("zyx")], 1.0, InputError, "for each timepoint"),
        ([stack(), stack()], 1.0, AxesError, "has no t axis"),
    ],
)
def test_what_is_no_movie_is_refused(
    source: object, step: float | None, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        Timelapse.of(source, step)  # type: ignore[arg-type]


@pytest.mark.parametrize("timepoint", [-1, 3])
def test_there_is_no_other_timepoint(timepoint: int) -> None:
    with pytest.raises(InputError, match=f"no timepoint {timepoint}"):
        Timelapse.of(stack()).at(timepoint)


def test_the_key_is_that_of_the_content() -> None:
    lapse, again = Timelapse.of(stack()), Timelapse.of(stack())
    assert lapse.key(0) == again.key(0) != lapse.key(1)
    masks = Timelapse.of(blebbing(3), 1.0)
    assert masks.key(0) != masks.key(1)
    moved = Mask(blebbing(1)[0].data, (0.25,) * 3, (0.25, 0, 0))
    assert Timelapse.of([moved, moved], 1.0).key(0) != masks.key(0)


def test_a_lazy_stack_is_read_one_timepoint_at_a_time() -> None:
    import dask.array

    asked: list[int] = []

    def volume(block_info: dict[int, dict[str, tuple[int, ...]]]) -> np.ndarray:
        asked.append(block_info[None]["chunk-location"][0])
        return np.ones((1, 4, 5, 6))

    data = dask.array.map_blocks(
        volume, chunks=((1,) * 3, (4,), (5,), (6,)), dtype=float, meta=np.empty((0,) * 4)
    )
    lapse = Timelapse.of(read_stack(data, (1, 1, 1), 1.0, axes="tzyx"))
    assert asked == []
    lapse.key(2)
    assert asked == [2]
