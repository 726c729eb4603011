"""How angles and areas are distorted, as histograms."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.unwrapping.histograms import histogram, sphere_histograms, uv_histograms


def test_shares_are_of_the_weights_and_outliers_count_at_the_ends() -> None:
    values = np.concatenate([np.linspace(0, 1, 999), [1e6, np.inf, np.nan]])
    weights = np.where(values < 0.5, 3.0, 1.0)
    found = histogram(values, weights, bins=2)
    assert found.shares.sum() == pytest.approx(1)
    assert found.edges[-1] < 2
    assert found.shares[0] == pytest.approx(0.75, abs=0.01)


def test_equal_values_have_a_histogram_too() -> None:
    found = histogram(np.ones(9), np.ones(9))
    assert (np.diff(found.edges) > 0).all()
    assert found.mean == 1


def test_means_are_those_of_the_quality(small_atlas: Atlas) -> None:
    of_sphere = sphere_histograms(small_atlas.reference, small_atlas.sphere)
    assert of_sphere["q"].mean == pytest.approx(small_atlas.quality["sphere"]["mean_q"])
    of_uv = uv_histograms(small_atlas.uv)
    assert of_uv["q"].mean == pytest.approx(small_atlas.quality["uv"]["mean_q"])


def test_many_values_of_little_weight_do_not_widen_the_range() -> None:
    rng = np.random.default_rng(0)
    values = np.r_[rng.normal(0, 1, 1000), np.linspace(50, 100, 200)]
    weights = np.r_[np.ones(1000), np.full(200, 1e-3)]
    found = histogram(values, weights)
    assert found.edges[-1] < 5
    assert found.edges[0] > -5
    assert found.shares.sum() == pytest.approx(1)
    assert found.mean == pytest.approx(values @ weights / weights.sum())
