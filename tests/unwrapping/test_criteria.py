"""Stopping criteria: their formulas by hand, and the search along the slider."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry.distortion import (
    mean_conformal_error,
    mean_log_area_distortion,
    singular_values,
)
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.unwrapping.criteria import Criterion, best_blend, wanted_shares
from shapes import icosphere, lumpy

NAMES = ("equiareal", "mips", "q_log_lambda", "area_mips")
BODY, FACES = lumpy(3, size=0.5)
ROUND = icosphere(3)[0]


def criterion(name: str, theta: float | None = None, vertices: np.ndarray = BODY) -> Criterion:
    return Criterion(name, theta, vertices, FACES, wanted_shares(vertices, FACES, "reference"))


@pytest.mark.parametrize("theta", [0.0, 0.3, 1.0, 2.5])
def test_they_are_the_papers_formulas(theta: float) -> None:
    """From singular values of surfaces scaled to unit area, as the paper writes them."""
    area = face_areas(BODY, FACES)
    unit = [v / np.sqrt(face_areas(v, FACES).sum()) for v in (BODY, ROUND)]
    larger, smaller = singular_values(*unit, FACES)
    q, weights = larger / smaller, area / area.sum()
    mips = q + 1 / q
    stretch = larger * smaller
    error = np.abs(np.log(stretch)).mean()
    assert criterion("equiareal")(ROUND) == pytest.approx(error)
    assert criterion("mips")(ROUND) == pytest.approx(weights @ mips)
    both = (1 - theta) * (weights @ q) + theta * error
    assert criterion("q_log_lambda", theta)(ROUND) == pytest.approx(both)
    powers = mips * (stretch + 1 / stretch) ** theta
    assert criterion("area_mips", theta)(ROUND) == pytest.approx(weights @ powers)


def test_without_a_theta_it_is_the_papers() -> None:
    assert criterion("q_log_lambda")(ROUND) == criterion("q_log_lambda", 0.5)(ROUND)
    assert criterion("area_mips")(ROUND) == criterion("area_mips", 1.0)(ROUND)
    q, error = (f(BODY, ROUND, FACES) for f in (mean_conformal_error, mean_log_area_distortion))
    assert criterion("q_log_lambda")(ROUND) == pytest.approx((q + error) / 2)


@pytest.mark.parametrize(
    ("name", "least"), [("equiareal", 0), ("mips", 2), ("q_log_lambda", 0.5), ("area_mips", 4)]
)
def test_an_isometry_has_the_least_value(name: str, least: float) -> None:
    perfect = criterion(name, vertices=3 * ROUND)
    assert perfect(ROUND) == pytest.approx(least, abs=1e-6)
    assert criterion(name)(ROUND) > least + 0.001


@given(scale=st.floats(1e-3, 1e3), name=st.sampled_from(NAMES))
def test_the_size_of_the_reference_does_not_count(scale: float, name: str) -> None:
    assert criterion(name, vertices=scale * BODY)(ROUND) == pytest.approx(criterion(name)(ROUND))


def test_uniform_shares_are_alike() -> None:
    wanted = wanted_shares(BODY, FACES, "uniform")
    assert wanted.sum() == pytest.approx(1.0)
    assert np.ptp(wanted) == 0
    even = Criterion("equiareal", None, BODY, FACES, wanted)
    share = face_areas(ROUND, FACES) / face_areas(ROUND, FACES).sum()
    assert even(ROUND) == pytest.approx(np.abs(np.log(share * len(FACES))).mean())


class Slider:
    """A made-up slider: the map at a blend is a number, best at one place."""

    def __init__(self, best: float) -> None:
        self.best = best
        self.starts: list[tuple[float, float]] = []

    def relax(self, blend: float, start: np.ndarray, progress: Progress) -> np.ndarray:
        progress(0.5, "relaxing")
        self.starts.append((blend, float(start[0])))
        return np.array([blend])

    def __call__(self, where: np.ndarray) -> float:
        return float((where[0] - self.best) ** 2)


@pytest.mark.parametrize("best", [0.0, 0.07, 0.37, 0.5, 0.93, 1.0])
def test_the_search_finds_the_best_blend(best: float) -> None:
    slider = Slider(best)
    blend, tried = best_blend(slider, np.zeros(1), slider.relax, 1.0, silent())
    assert blend == pytest.approx(best, abs=0.011)
    assert (np.diff(tried[:, 0]) > 0).all()
    assert tried[:, 1].min() == tried[tried[:, 0] == blend, 1]
    assert len(tried) <= 15


def test_the_search_ends_where_the_slider_is_set() -> None:
    slider = Slider(0.9)
    blend, tried = best_blend(slider, np.zeros(1), slider.relax, 0.613, silent())
    assert blend == 0.613 == tried[-1, 0]


def test_every_map_begins_at_the_nearest_one() -> None:
    slider = Slider(0.37)
    best_blend(slider, np.zeros(1), slider.relax, 1.0, silent())
    known = {0.0}
    for blend, start in slider.starts:
        assert abs(start - blend) == min(abs(blend - other) for other in known)
        known.add(blend)
    assert len(known) == len(slider.starts) + 1


def test_the_search_reports_and_can_be_cancelled() -> None:
    seen: list[float] = []
    slider = Slider(0.37)
    progress = Progress(lambda step, fraction, text: seen.append(fraction))
    best_blend(slider, np.zeros(1), slider.relax, 1.0, progress)
    assert seen == sorted(seen)
    assert seen[-1] <= 1
    progress.cancel()
    with pytest.raises(Cancelled):
        best_blend(slider, np.zeros(1), slider.relax, 1.0, progress)
