"""Touching blebs told apart."""

from __future__ import annotations

import numpy as np
import pytest

from blebbed import VOXEL_UM, bleb_labels, blebbed_mask, blebbed_surface
from napari_unwrap3d.charts import Surface
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.parameters import RefinementParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions.refine import (
    CURVATURE,
    curvature_threshold,
    refine,
    refine_segmentation,
    smoothed,
    split_caps,
)
from napari_unwrap3d.protrusions.segment import Segmentation


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


@pytest.fixture(scope="module")
def truth():
    return bleb_labels(blebbed_mask().to_index(blebbed_surface().vertices))


@pytest.fixture(scope="module")
def united(truth):
    """The two blebs that touch are 5, the third is 9."""
    return np.array([0, 5, 5, 9], np.int32)[truth]


@pytest.fixture(scope="module")
def parts(united):
    return refine(blebbed_surface(), united, VOXEL_UM, RefinementParameters(), silent())


def test_a_touching_pair_becomes_two_and_a_single_bleb_stays(parts, truth, united):
    np.testing.assert_array_equal(parts == 9, truth == 3)
    assert set(np.unique(parts)) == {0, 5, 9, 10}
    for bleb in (1, 2):
        assert max(iou(parts == k, truth == bleb) for k in (5, 10)) > 0.85
    np.testing.assert_array_equal(parts > 0, united > 0)


def test_noise_of_the_curvature_cuts_no_bleb(united, truth):
    surface = blebbed_surface()
    noise = np.random.default_rng(0).normal(0, 1.5, len(united))
    field = {CURVATURE: surface.fields[CURVATURE] + noise}
    noisy = Surface(surface.vertices, surface.faces, field)
    found = refine(noisy, united, VOXEL_UM, RefinementParameters(), silent())
    assert set(np.unique(found)) == {0, 5, 9, 10}
    for bleb in (1, 2):
        assert max(iou(found == k, truth == bleb) for k in (5, 10)) > 0.8
    raw = RefinementParameters(smoothing_voxels=0.0)
    assert len(np.unique(refine(noisy, united, VOXEL_UM, raw, silent()))) > 4


def test_smoothing_keeps_the_mean_and_what_is_constant():
    surface = blebbed_surface()
    mass = vertex_mass(surface.vertices, surface.faces)
    values = surface.fields[CURVATURE]
    smooth = smoothed(surface, values, 0.4)
    assert mass @ smooth == pytest.approx(mass @ values)
    assert smooth.std() < values.std()
    np.testing.assert_allclose(smoothed(surface, np.full(len(mass), 3.0), 0.4), 3.0)
    np.testing.assert_allclose(smoothed(surface, values, 0.0), values)


def test_names_do_not_matter(parts, united):
    renamed = np.where(united == 5, 2, np.where(united == 9, 1, 0))
    other = refine(blebbed_surface(), renamed, VOXEL_UM, RefinementParameters(), silent())
    pairs = np.unique(np.stack([parts, other], axis=1), axis=0)
    assert len(pairs) == len(np.unique(parts)) == len(np.unique(other))


def test_parts_below_the_smallest_area_are_none(united):
    vast = RefinementParameters(minimum_area=1e6)
    found = refine(blebbed_surface(), united, VOXEL_UM, vast, silent())
    np.testing.assert_array_equal(found, united)


def test_no_protrusion_and_one_vertex_are_left_as_they_are():
    surface = blebbed_surface()
    labels = np.zeros(len(surface.vertices), np.int32)
    found = refine(surface, labels, VOXEL_UM, RefinementParameters(), silent())
    assert not found.any()
    labels[17] = 3
    found = refine(surface, labels, VOXEL_UM, RefinementParameters(), silent())
    np.testing.assert_array_equal(found, labels)


def test_what_is_no_disk_is_left_as_it_is(truth):
    labels = (truth == 0).astype(np.int32)  # the body, with holes where blebs were
    found = refine(blebbed_surface(), labels, VOXEL_UM, RefinementParameters(), silent())
    assert set(np.unique(found)) == {0, 1}


def test_the_volumes_are_split_where_the_surface_is(united):
    mask = blebbed_mask()
    grid = np.stack(np.meshgrid(*map(np.arange, mask.data.shape), indexing="ij"), axis=-1)
    true = bleb_labels(grid) * mask.data
    volume = np.array([0, 5, 5, 9], np.int32)[true]
    found = Segmentation(united, np.zeros(len(united)), volume, mask.data & (volume == 0))
    split = refine_segmentation(found, mask, blebbed_surface(), RefinementParameters(), silent())
    np.testing.assert_array_equal(split.volume > 0, volume > 0)
    np.testing.assert_array_equal(split.volume == 9, volume == 9)
    assert split.numbers["protrusions_split"] == 1
    for bleb in (1, 2):
        assert max(iou(split.volume == k, true == bleb) for k in (5, 10)) > 0.85


def discs(*places, size=80):
    row, column = np.indices((size, size))
    return np.any([np.hypot(row - r, column - c) < radius for r, c, radius in places], axis=0)


@pytest.mark.parametrize(("apart", "count"), [(4, 1), (8, 1), (17, 2), (19, 2), (25, 2)])
def test_two_discs_are_two_where_a_waist_is_between_them(apart, count):
    image = discs((40, 25, 10), (40, 25 + apart, 10))
    caps = split_caps(image, 0.3)
    assert caps.max() == count
    assert ((caps > 0) | ~image).all()


def test_the_depth_of_the_waist_is_relative_to_the_smaller_disc():
    for scale in (1, 2):
        image = discs((40, 30, 6 * scale), (40, 30 + 9 * scale, 5 * scale))
        assert split_caps(image, 0.1).max() == 2
        assert split_caps(image, 0.6).max() == 1


def test_nothing_high_gives_no_cap():
    assert split_caps(np.zeros((16, 16), bool), 0.3).max() == 0
    assert curvature_threshold(np.ones(50)) == 1.0


def test_the_threshold_is_the_higher_of_two():
    values = np.repeat([-1.0, 0.0, 3.0], 100) + np.random.default_rng(0).normal(0, 0.05, 300)
    assert ((values > curvature_threshold(values)) == (values > 2)).mean() > 0.98


def test_a_surface_is_not_changed(united):
    surface = blebbed_surface()
    before = united.copy()
    other = Surface(surface.vertices, surface.faces, surface.fields)
    refine(other, united, VOXEL_UM, RefinementParameters(), silent())
    np.testing.assert_array_equal(united, before)
