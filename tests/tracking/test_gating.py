"""Tracks inside and outside of annotated regions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from moving import blebbing_movie
from napari_unwrap3d import Movie
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import InputError, ParameterError
from napari_unwrap3d.tracking.gating import gated

NAME = "focus"
ROWS = 64


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


@pytest.fixture
def movie(opened: Movie) -> Iterator[Movie]:
    """With a region over the seam: the last and the first eight columns of the middle rows."""
    annotations = opened.common.annotations
    annotations.add(NAME)
    draw(opened, np.r_[120:128, 0:8], 1)
    yield opened
    annotations.times.show(None)
    annotations.remove(NAME)


def draw(movie: Movie, columns: np.ndarray, label: int) -> None:
    v, u = np.meshgrid(np.arange(24, 40), columns, indexing="ij")
    pixels = np.stack([v.ravel(), u.ravel()])
    movie.common.annotations.draw(NAME, "uv", tuple(pixels), label)


def tracks_at(places: dict[int, list[tuple[float, float]]], rows: int = ROWS) -> Tracks:
    """Tracks from timepoint 0 on by their (v, u)."""
    flat = [(k, t, *vu) for k, path in places.items() for t, vu in enumerate(path)]
    track, time, v, u = (np.array(column) for column in zip(*flat, strict=True))
    nowhere = np.zeros(len(track))
    space = {"z_um": nowhere, "y_um": nowhere, "x_um": nowhere}
    columns = {"track_id": track, "timepoint": time, "v_px": v, "u_px": u, **space}
    return Tracks.of(columns, time_step_s=1.0, timepoints=4, rows=rows)


INSIDE, OUTSIDE = (32.0, 2.0), (32.0, 64.0)
TRACKS = tracks_at(
    {
        1: [INSIDE, (32.0, 126.0), (32.0, 127.4), (31.0, 5.0)],  # goes over the seam
        2: [INSIDE, INSIDE, INSIDE, OUTSIDE],
        3: [OUTSIDE, OUTSIDE],
        4: [INSIDE, (np.nan, np.nan)],
    }
)


@pytest.mark.parametrize(
    ("side", "share", "expected"),
    [
        ("inside", 1.0, [1]),
        ("inside", 0.75, [1, 2]),
        ("inside", 0.5, [1, 2, 4]),
        ("inside", 0.0, [1, 2, 3, 4]),
        ("outside", 1.0, [3]),
        ("outside", 0.25, [2, 3]),
    ],
)
def test_tracks_are_on_a_side_for_a_part_of_their_life(
    movie: Movie, side: str, share: float, expected: list[int]
) -> None:
    found = gated(movie, TRACKS, NAME, side=side, share=share)  # type: ignore[arg-type]
    assert found.tolist() == expected


def test_only_a_label_counts_where_one_is_named(movie: Movie) -> None:
    draw(movie, np.arange(60, 68), 2)
    assert gated(movie, TRACKS, NAME).tolist() == [1, 2, 3]
    assert gated(movie, TRACKS, NAME, label=2).tolist() == [3]
    assert gated(movie, TRACKS, NAME, label=1, side="outside").tolist() == [3]


def test_a_region_of_one_timepoint_holds_there_only(movie: Movie) -> None:
    times = movie.common.annotations.times
    times.show(0)
    times.set_one_by_one(NAME, True)
    assert gated(movie, TRACKS, NAME).tolist() == []
    assert gated(movie, TRACKS, NAME, share=0.25).tolist() == [1, 2, 4]


def test_what_cannot_be_gated_is_refused(movie: Movie) -> None:
    with pytest.raises(ParameterError, match="no annotation"):
        gated(movie, TRACKS, "nothing")
    with pytest.raises(ParameterError, match="side"):
        gated(movie, TRACKS, NAME, side="beside")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="share"):
        gated(movie, TRACKS, NAME, share=1.5)
    with pytest.raises(InputError, match="uv image"):
        gated(movie, tracks_at({1: [INSIDE]}, rows=32), NAME)
