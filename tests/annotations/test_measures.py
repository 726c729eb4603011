"""What labels measure agrees with geometry, and with the same measured in uv."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.annotations import Annotations, fit_plane, label_rows
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import InputError
from shapes import cell_centre
from synthetic import CENTRE, RADIUS, make_atlas


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return make_atlas()


def annotated(atlas: Atlas, labels: np.ndarray) -> Annotations:
    annotations = Annotations(atlas)
    annotations.add("one")
    for label in np.unique(labels):
        annotations.draw_vertices("one", np.flatnonzero(labels == label), int(label))
    return annotations


def test_areas_and_means_are_the_surfaces(atlas: Atlas) -> None:
    z = atlas.surface.vertices[:, 0]
    annotations = annotated(atlas, np.where(z > 8, 2, np.where(z > 6, 1, 0)))
    annotations.add("nothing")
    field = np.where(z > 9, np.nan, z)
    rows = label_rows(annotations, {"z_um": field})
    assert [(row["annotation"], row["label"]) for row in rows] == [("one", 1), ("one", 2)]
    areas = atlas.elements("surface")
    for row, chosen in zip(rows, ((z > 6) & (z <= 8), z > 8), strict=True):
        known = chosen & np.isfinite(field)
        assert row["vertices"] == chosen.sum()
        assert row["area_um2"] == pytest.approx(areas[chosen].sum())
        assert row["fraction"] == pytest.approx(areas[chosen].sum() / areas.sum())
        assert row["mean_z_um"] == pytest.approx(np.average(field[known], weights=areas[known]))
    assert "mean_height_um" in label_rows(annotations)[0]


def test_the_same_mean_is_measured_in_uv(small_atlas: Atlas) -> None:
    """On the smooth part of the cell, where it lies along its reference."""
    away = small_atlas.surface.vertices - cell_centre()
    toward = away @ np.array([0.6, -0.7, -0.4]) / np.linalg.norm(away, axis=1)
    annotations = annotated(small_atlas, toward > 0.85)
    field = away[:, 1]
    (row,) = label_rows(annotations, {"y_um": field})
    region = annotations.image("one", "uv") == 1
    in_uv = small_atlas.region_mean(small_atlas.outermost.image(field), region)
    assert row["mean_y_um"] == pytest.approx(in_uv, abs=0.02)
    assert row["area_um2"] == pytest.approx(small_atlas.elements("uv")[region].sum(), rel=0.05)


@pytest.mark.parametrize("axis", [(-1.0, 0.0, 0.0), (0.3, -0.8, 0.5)])
def test_the_plane_of_a_cap(atlas: Atlas, axis: tuple[float, float, float]) -> None:
    """Of a cap of a sphere: it looks outward, and the distances are those of the cap."""
    unit = np.array(axis) / np.linalg.norm(axis)
    directions = atlas.sphere.vertices
    round_cell = atlas.replaced(
        surface=type(atlas.surface)(CENTRE + RADIUS * directions, atlas.surface.faces)
    )
    angle = 0.5
    fit = fit_plane(annotated(round_cell, 3 * (directions @ unit > np.cos(angle))), "one", 3)
    assert np.dot(fit.normal, unit) > 0.999
    thickness = RADIUS * (1 - np.cos(angle))  # by Archimedes heights are evenly spread
    assert fit.rms_um == pytest.approx(thickness / np.sqrt(12), rel=0.1)
    middle = CENTRE + (RADIUS - thickness / 2) * unit
    assert np.linalg.norm(np.array(fit.centroid_um) - middle) < 0.05
    assert fit.area_um2 == pytest.approx(2 * np.pi * RADIUS * thickness, rel=0.1)


def test_too_little_for_a_plane(atlas: Atlas) -> None:
    annotations = annotated(atlas, np.arange(len(atlas.surface.vertices)) < 2)
    for label in (1, 5):
        with pytest.raises(InputError, match="three vertices"):
            fit_plane(annotations, "one", label)
