"""Tracks that were made on the stack are moved as the movie was registered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.geometry.rigid import Rigid
from napari_unwrap3d.imaging.register import Registered
from napari_unwrap3d.tracking.recorded import in_common_world

POSES = [Rigid(), Rigid(translation=np.array([0.5, -1.0, 2.0])), None]


class Moved:
    """A movie of which only the registration is known, of its last timepoint not even that."""

    folder: Any = SimpleNamespace(
        registered=lambda timepoint: (
            None if POSES[timepoint] is None else Registered(POSES[timepoint])
        )  # type: ignore[arg-type]
    )

    def __len__(self) -> int:
        return len(POSES)


@pytest.fixture
def tracks() -> Tracks:
    place = np.random.default_rng(0).normal(size=(3, 8))
    columns = {
        "track_id": [1, 1, 1, 1, 2, 2, 2, 2],
        "timepoint": [0, 1, 2, 3, 0, 1, 2, 3],
        **dict(zip(("z_um", "y_um", "x_um"), place, strict=True)),
        "area_um2": np.arange(8.0),
    }
    return Tracks.of(columns, time_step_s=1.0, timepoints=4)


def test_every_timepoint_moves_as_it_was_registered(tracks: Tracks) -> None:
    moved = in_common_world(Moved(), tracks)  # type: ignore[arg-type]
    shift = moved.position_um - tracks.position_um
    np.testing.assert_allclose(shift[tracks.timepoint == 1], [[0.5, -1.0, 2.0]] * 2)
    assert not shift[tracks.timepoint != 1].any()
    np.testing.assert_array_equal(moved.columns["area_um2"], tracks.columns["area_um2"])
