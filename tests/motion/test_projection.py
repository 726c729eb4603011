"""S(u, v) of a timepoint by topographic cMCF."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from moving import blebbing, blebbing_movie, quick
from napari_unwrap3d import Movie
from napari_unwrap3d.charts import Frame
from napari_unwrap3d.errors import NotCertifiedError
from napari_unwrap3d.imaging.register import Registered
from napari_unwrap3d.motion import projection
from napari_unwrap3d.motion.frames import CommonSpace, frame_of
from napari_unwrap3d.progress import silent


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")


@pytest.fixture(scope="module")
def flatten(movie: Movie) -> Callable[[], Frame]:
    space = CommonSpace(movie.common)
    parameters = quick(movie={"projection": "plane"})

    def made() -> Frame:
        mask = blebbing(2)[1]
        return frame_of(space, mask, None, None, Registered(), 1, 2.0, parameters, silent())

    return made


def test_the_plane_shows_the_same_cell_with_its_whole_area(
    movie: Movie, flatten: Callable[[], Frame]
) -> None:
    frame, outermost = flatten(), movie.frame(1)
    assert frame.numbers["projection"] == "plane"
    assert outermost.numbers["projection"] == "outermost"
    assert set(frame.uv) == set(outermost.uv)
    assert all(np.isfinite(image).all() for image in frame.uv.values())
    assert frame.uv["area_um2"].sum() == pytest.approx(frame.numbers["area_um2"], rel=0.02)
    # What hangs over or stands steep is spread out, and nothing is seen twice.
    assert frame.uv["height_um"].max() == pytest.approx(outermost.uv["height_um"].max(), abs=0.1)


def test_where_it_is_not_one_to_one_the_outermost_is_shown_and_the_reason_kept(
    movie: Movie, flatten: Callable[[], Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise NotCertifiedError("Faces are flipped.", flipped_faces=7, hint="Smooth it.")

    monkeypatch.setattr(projection, "plane", refuse)
    frame = flatten()
    assert frame.numbers["projection"] == "outermost"
    assert "flipped" in frame.numbers["projection_reason"]
    assert "Smooth it" not in frame.numbers["projection_reason"]
    expected = movie.frame(1).uv["height_um"]
    np.testing.assert_allclose(frame.uv["height_um"], expected, atol=1e-5)
