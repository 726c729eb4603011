"""The step from the reference to the sphere: which method, which target, which criterion."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.charts import Reference, Sphere
from napari_unwrap3d.files.atomic import plain
from napari_unwrap3d.parameters import SphereParameters
from napari_unwrap3d.progress import Progress, silent
from napari_unwrap3d.quality import quality_rows
from napari_unwrap3d.unwrapping.criteria import Criterion, wanted_shares
from napari_unwrap3d.unwrapping.measure import measure_sphere
from napari_unwrap3d.unwrapping.sphere import sphere
from shapes import elongated

BODY = Reference(*elongated(1500))
METHODS = ("poisson", "advection")
CRITERIA = ("equiareal", "mips", "q_log_lambda", "area_mips")


def computed(**settings: Any) -> Sphere:
    return sphere(BODY, SphereParameters(**settings), silent())


unwrapped = lru_cache(computed)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_quality_says_what_was_chosen_and_why(method: str, criterion: str) -> None:
    chart = unwrapped(method=method, criterion=criterion)
    numbers = measure_sphere(BODY, chart)
    assert (numbers["method"], numbers["criterion"]) == (method, criterion)
    assert numbers["flipped_faces"] == 0 == numbers["conformal_flipped_faces"]
    assert json.loads(json.dumps(plain(numbers))) == numbers
    expected = {
        "equiareal": numbers["mean_abs_log_lambda"],
        "q_log_lambda": (numbers["mean_q"] + numbers["mean_abs_log_lambda"]) / 2,
    }
    value = numbers["criterion_value"]
    assert value == pytest.approx(expected.get(criterion, value))
    if method == "advection":
        at = chart.criterion_history[chart.iteration]
        assert at.tolist() == [numbers["iteration"], value]
        assert numbers["iterations_with_flips"] == (chart.flip_history > 0).sum()
    elif criterion != "equiareal":
        at = chart.criterion_history[:, 0] == chart.blend
        # The map itself begins at the conformal one, those of the search near each other.
        assert chart.criterion_history[at, 1] == pytest.approx(value, rel=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_criteria_lie_between_angles_and_areas(method: str) -> None:
    numbers = {c: measure_sphere(BODY, unwrapped(method=method, criterion=c)) for c in CRITERIA}
    q = {criterion: found["mean_q"] for criterion, found in numbers.items()}
    areas = {criterion: found["mean_abs_log_lambda"] for criterion, found in numbers.items()}
    for between in ("q_log_lambda", "area_mips"):
        assert q["mips"] < q[between] < q["equiareal"]
        assert areas["mips"] > areas[between] > areas["equiareal"]


@pytest.mark.parametrize("criterion", ["q_log_lambda", "area_mips"])
def test_no_other_blend_is_better_and_the_blend_alone_gives_the_same_map(criterion: str) -> None:
    chosen = unwrapped(criterion=criterion)
    assert 0.1 < chosen.blend < 0.9
    np.testing.assert_array_equal(unwrapped(blend=chosen.blend).vertices, chosen.vertices)
    wanted = wanted_shares(BODY.vertices, BODY.faces, "reference")
    value = Criterion(criterion, None, BODY.vertices, BODY.faces, wanted)
    assert value(chosen.vertices) == chosen.criterion_value
    for blend in (0.0, chosen.blend - 0.1, chosen.blend + 0.1, 1.0):
        assert value(unwrapped(blend=blend).vertices) > chosen.criterion_value


def test_more_weight_on_areas_moves_the_blend_to_them() -> None:
    blends = [unwrapped(criterion="q_log_lambda", theta=theta).blend for theta in (0, 0.5, 1)]
    assert blends[0] < 0.05
    assert blends[0] < blends[1] < blends[2] == 1.0


def test_the_blend_is_the_far_end_of_a_search() -> None:
    chart = unwrapped(criterion="q_log_lambda", theta=1.0, blend=0.4)
    assert chart.blend == 0.4
    assert chart.criterion_history[-1, 0] == 0.4


@pytest.mark.parametrize("method", METHODS)
def test_uniform_areas(method: str) -> None:
    numbers = measure_sphere(BODY, unwrapped(method=method, target="uniform"))
    assert numbers["target"] == "uniform"
    assert numbers["criterion_value"] < 0.1 < numbers["mean_abs_log_lambda"]


def test_only_an_equiareal_sphere_is_judged_by_its_areas() -> None:
    for settings, judged in (
        ({}, True),
        ({"method": "advection"}, True),
        ({"target": "uniform"}, False),
        ({"method": "advection", "criterion": "mips"}, False),
        ({"blend": 0.5}, False),
    ):
        rows = quality_rows({"sphere": measure_sphere(BODY, unwrapped(**settings))})
        mark = next(row.mark for row in rows if row.quantity == "mean_abs_log_lambda")
        assert bool(mark) == judged, settings


@pytest.mark.parametrize("settings", [{"criterion": "area_mips"}, {"method": "advection"}])
def test_the_same_input_gives_the_same_map_bit_for_bit(settings: dict) -> None:
    first, second = unwrapped(**settings), computed(**settings)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.criterion_history, second.criterion_history)


@pytest.mark.parametrize("settings", [{"criterion": "area_mips"}, {"method": "advection"}])
def test_progress_never_goes_back(settings: dict) -> None:
    seen: list[float] = []
    progress = Progress(lambda step, fraction, text: seen.append(fraction))
    sphere(BODY, SphereParameters(**settings), progress)
    assert seen == sorted(seen)
    assert 0 <= seen[0] <= seen[-1] <= 1
