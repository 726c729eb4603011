"""Simulated movies: their signals are what they are said to be, and ruffles travel as said."""

import numpy as np
import pytest
from scipy import ndimage

from napari_unwrap3d.geometry.interpolate import sample_linear
from napari_unwrap3d.simulate import movie
from simulated import GRID, VOXEL, sample

# Signals --------------------------------------------------------------------------------


def test_the_signal_is_what_the_table_says_it_is() -> None:
    truth = sample("blebs").truth(7)
    labels = truth.labels.data
    for row in truth.protrusions.query("height_um > 0.7").itertuples():
        on_it = truth.signal.data[labels == row.id]
        assert np.median(on_it) == pytest.approx(row.signal, abs=0.12)
        on_it = truth.curvature.data[labels == row.id]
        assert np.median(on_it) == pytest.approx(row.curvature_per_um, rel=0.15)
    far = ndimage.distance_transform_edt(labels == 0) > 12
    assert truth.curvature.data[far & ~truth.body.data].max() == 0


@pytest.mark.parametrize("lag_s", [0.0, 6.05])
def test_the_lag_is_that_of_the_peak_of_the_cross_correlation(lag_s: float) -> None:
    simulated = sample("blebs", timepoints=120, lag_s=lag_s, correlation=0.9)
    times = np.arange(-40.0, 40.0, 0.25)
    total = np.zeros(161)
    for one in simulated.cell.protrusions:
        middle = one.course.peak_s
        series = [one.curvature(middle + times), one.lead(middle + times)]
        a, b = ((values - values.mean()) / values.std() for values in series)
        total += [np.mean(np.roll(a, shift) * b) for shift in range(-80, 81)]
    assert (np.argmax(total) - 80) * 0.25 == pytest.approx(lag_s, abs=0.5)
    assert simulated.law.sign == -1
    assert simulated.law.lag_s == lag_s


@pytest.mark.parametrize("correlation", [0.2, 0.5, 1.0])
def test_the_correlation_on_blebs_is_built_in(correlation: float) -> None:
    simulated = sample("blebs", timepoints=60, correlation=correlation)
    found = []
    for one in simulated.cell.protrusions:
        lag = simulated.law.lag_s
        times = np.arange(one.course.birth_s + 2, one.course.end_s + lag - 2, 0.2)
        found.append(np.corrcoef(one.curvature(times - lag), one.lead(times))[0, 1])
    assert np.mean(found) == pytest.approx(correlation, abs=0.04)


@pytest.mark.parametrize("correlation", [0.2, 0.5])
def test_the_correlation_of_ruffles_is_built_in_everywhere(correlation: float) -> None:
    """Signal and curvature of the truth, at places that are fixed in the cell."""
    simulated = sample("ruffles", timepoints=40, correlation=correlation)
    lamella = simulated.cell.lamella
    index = np.arange(300) + 0.5
    azimuth = np.pi * (1 + np.sqrt(5.0)) * index
    radius = np.sqrt(0.36 + 0.28 * index / 300) * lamella.outline(azimuth)
    places = lamella.point(lamella.top(radius), radius, azimuth)
    curvature, signal = np.empty((2, 40, 300))
    for timepoint in range(40):
        truth = simulated.truth(timepoint)
        there = truth.pose.inverse().apply(places)
        curvature[timepoint] = sample_linear(truth.curvature.data, truth.curvature.to_index(there))
        signal[timepoint] = sample_linear(truth.signal.data, truth.signal.to_index(there))
    moving = curvature.std(axis=0) > 0.5 * np.median(curvature.std(axis=0))
    a, b = (series - series.mean(axis=0) for series in (curvature, signal))
    each = (a * b).mean(axis=0) / (a.std(axis=0) * b.std(axis=0))
    assert each[moving].mean() == pytest.approx(correlation, abs=0.05)


def test_the_ratio_of_the_channels_is_the_signal_of_ruffles() -> None:
    simulated = sample("ruffles", bleaching=0.0)
    truth, counts = simulated.truth(3), simulated.frame(3).astype(float)
    background = 100.0 + 2.2 * 12.0
    planes = np.rint(np.arange(counts.shape[1]) * 0.4 / VOXEL).astype(int)
    inside = ndimage.distance_transform_edt(truth.mask.data)[planes] > 2
    diffuse, actin = (ndimage.gaussian_filter(channel - background, 1.0) for channel in counts)
    ratio = actin / np.maximum(diffuse, 40.0)
    known = ndimage.gaussian_filter(truth.signal.data, (2.0, 1.0, 1.0))[planes]
    assert np.corrcoef(ratio[inside], known[inside])[0, 1] > 0.8
    assert ratio[inside].mean() == pytest.approx(known[inside].mean(), rel=0.05)


# Ruffles --------------------------------------------------------------------------------


def test_ruffles_travel_at_their_speeds() -> None:
    """Measured on the labels, over the tilted bottom of the cell."""
    simulated = sample("ruffles", timepoints=40)
    lamella, floor = simulated.cell.lamella, simulated.floor
    assert floor is not None
    tracks: dict[int, list[tuple[float, float]]] = {}
    for timepoint in range(40):
        truth = simulated.truth(timepoint)
        voxels = np.argwhere(truth.labels.data)
        labels = truth.labels.data[tuple(voxels.T)]
        places = truth.pose.apply(truth.labels.to_world(voxels)) - floor.point
        flat = places - np.outer(places @ floor.normal, floor.normal)
        distance = np.linalg.norm(flat, axis=1)
        for row in truth.protrusions.query("height_um > 0.7").itertuples():
            crest = labels == row.id
            along = np.arctan2(flat[crest] @ lamella.frame[2], flat[crest] @ lamella.frame[1])
            middle = np.abs(np.angle(np.exp(1j * (along - row.azimuth_rad)))) < 0.15
            if middle.sum() > 20:
                tracks.setdefault(row.id, []).append((truth.time_s, distance[crest][middle].mean()))
    lives = simulated.protrusions.set_index("id")
    long = {one: np.array(track) for one, track in tracks.items() if len(track) >= 5}
    assert len(long) >= 3
    ratios = [
        -60 * np.polyfit(*track.T, 1)[0] / lives.loc[one, "speed_um_per_min"]
        for one, track in long.items()
    ]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.array(ratios) - 1).max() < 0.25


def test_speeds_of_ruffles_are_spread_around_the_one_asked_for() -> None:
    simulated = movie("ruffles", 10, **GRID, timepoints=300, ruffle_um_per_min=5.0)
    speeds = simulated.protrusions["speed_um_per_min"]
    assert speeds.mean() == pytest.approx(5.0, rel=0.05)
    assert 0.2 < speeds.std() < 1.0
    assert simulated.rates["ruffle_um_per_min"] == 5.0
    assert simulated.rates["retrograde_um_per_min"] == 0.8


def test_speckles_flow_to_the_middle() -> None:
    speckles = sample("ruffles").cell.speckles
    radius, azimuth = np.meshgrid(np.linspace(2, 4, 60), np.linspace(-3, 3, 90), indexing="ij")
    now = speckles.at((radius, azimuth), 10.0)
    later = speckles.at((radius - 0.8 / 60 * 30.0, azimuth), 40.0)
    assert np.allclose(now, later)
    assert now.std() == pytest.approx(1.0, abs=0.3)


def test_ruffles_merge_into_those_ahead() -> None:
    simulated = movie("ruffles", 10, **GRID, timepoints=400)
    by_id = {one.identity: one for one in simulated.cell.crests.ruffles}
    merged = [one for one in by_id.values() if one.merged_into in by_id]
    assert merged
    for one in merged:
        other = by_id[one.merged_into]
        end = one.course.end_s
        apart = float(one.radius_um(end) - other.radius_um(end))
        assert 0 < apart < 1.5 * (one.width_um + other.width_um)
        assert other.course.size(end) > 0
