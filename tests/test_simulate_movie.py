"""Simulated movies: frames on demand, and a truth that agrees with itself and with them."""

import pickle
from typing import Any

import numpy as np
import pytest
from scipy import ndimage, stats

from napari_unwrap3d import read_stack
from napari_unwrap3d.errors import Cancelled, FileFormatError, InputError, ParameterError
from napari_unwrap3d.geometry.distance import signed_distance
from napari_unwrap3d.geometry.interpolate import sample_linear
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.simulate import MOVIES, Lifetimes, SimulatedMovie, movie
from napari_unwrap3d.simulate.solids import genus
from simulated import GRID, SIZE, VOXEL, sample

TIMES = (0, 7, 13, 22)


@pytest.fixture(params=MOVIES)
def simulated(request) -> SimulatedMovie:
    return sample(request.param)


# Frames -----------------------------------------------------------------------------


def test_the_stack_has_axes_channels_and_times(simulated: SimulatedMovie) -> None:
    stack = simulated.stack
    assert stack.axes == "tczyx"
    assert stack.shape == (24, 2, 40, SIZE, SIZE)
    assert stack.data.dtype == np.uint16
    assert stack.data.chunks[0] == (1,) * 24
    assert stack.time_step == simulated.time_step_s
    assert stack.channels == simulated.channels
    assert len(set(stack.channels)) == 2
    assert len(simulated) == stack.timepoints == len(simulated.times_s)


def test_a_frame_is_the_same_alone_in_any_order_and_elsewhere(simulated: SimulatedMovie) -> None:
    kind = simulated.kind
    late = simulated.frame(9)
    for timepoint in (2, 10, 0):
        simulated.frame(timepoint)
    again = movie(kind, 11, **GRID, timepoints=24, drift_um=0.45, rotation_deg=3.0)
    sent = pickle.loads(pickle.dumps(simulated))
    assert np.array_equal(simulated.stack.data[9].compute(), late)
    assert np.array_equal(again.frame(9), late)
    assert np.array_equal(sent.frame(9), late)
    assert again.stack.data.name == simulated.stack.data.name
    for name in ("mask", "labels", "signal"):
        mine, other = (getattr(one.truth(5), name).data for one in (simulated, again))
        assert np.array_equal(mine, other)
    assert not np.array_equal(simulated.frame(8), late)


def test_seeds_make_different_cells() -> None:
    other = movie("blebs", 12, **GRID, timepoints=24, drift_um=0.45, rotation_deg=3.0)
    assert not np.array_equal(other.truth(0).mask.data, sample("blebs").truth(0).mask.data)


def test_no_more_than_a_few_frames_are_kept() -> None:
    streamed = movie("blebs", 10, size=72, timepoints=5)
    stack = np.asarray(streamed.stack.data)
    for timepoint, (counts, truth) in enumerate(streamed.frames()):
        assert truth.timepoint == timepoint
        assert np.array_equal(counts, stack[timepoint])
    assert streamed._moments.cache_info().currsize <= 2


def test_the_light_bleaches_and_nothing_else() -> None:
    still = movie(
        "blebs", 10, **GRID, timepoints=3, drift_um=0.0, bleaching=0.4, births_per_um2_per_min=0.0
    )
    assert still.protrusions.empty
    background = 100.0 + 2.2 * 12.0
    inside = ndimage.zoom(still.truth(0).mask.data, (0.5, 1, 1), order=0)
    inside = ndimage.binary_erosion(inside, iterations=3)[: still.frame_shape[1]]
    light = [
        [counts[inside[: counts.shape[0]]].mean() - background for counts in still.frame(t)]
        for t in range(3)
    ]
    assert np.allclose(np.divide(light[2], light[0]), 0.6, atol=0.02)
    assert np.allclose(np.divide(light[1], light[0]), np.sqrt(0.6), atol=0.02)


def test_what_is_deep_is_dim_and_out_of_focus() -> None:
    clear, dull = (
        movie("blebs", 10, **GRID, timepoints=2, depth_decay=decay).frame(0)[0].astype(float)
        for decay in (0.0, 0.7)
    )
    z = np.arange(len(clear))

    def contrast(counts: Any, planes: Any) -> float:
        return float(np.percentile(counts[planes], 99) - np.percentile(counts[planes], 5))

    shallow, deep = (z > 10) & (z < 15), (z > 25) & (z < 30)
    lost = [1 - contrast(dull, planes) / contrast(clear, planes) for planes in (shallow, deep)]
    assert 0.1 < lost[0] < 0.5
    assert lost[1] > lost[0] + 0.2


def test_a_movie_is_written_frame_by_frame_and_read_again(tmp_path) -> None:
    short = movie("filopodia", 10, size=72, timepoints=3)
    seen: list[float] = []
    path = short.write(
        tmp_path / "cell.ome.zarr", Progress(lambda step, done, text: seen.append(done))
    )
    stack = read_stack(path)
    assert (stack.axes, stack.channels) == ("tczyx", short.channels)
    assert stack.voxel_size == pytest.approx(short.recording.voxel_size)
    assert stack.time_step == pytest.approx(2.0)
    assert np.array_equal(np.asarray(stack.data), np.asarray(short.stack.data))
    assert seen[-1] == 1.0
    with pytest.raises(FileFormatError, match="OME-Zarr"):
        short.write(tmp_path / "cell.tif")


# Where the cell lies --------------------------------------------------------------------


def test_the_cell_drifts_and_turns_as_far_as_asked(simulated: SimulatedMovie) -> None:
    middle = np.full(3, (SIZE - 1) / 2 * VOXEL)
    shifts = np.array([pose.apply(middle) - middle for pose in simulated.poses])
    angles = np.array([pose.angle_deg for pose in simulated.poses])
    assert simulated.poses[0].is_identity
    assert np.abs(shifts).max() == pytest.approx(0.45)
    assert angles.max() == pytest.approx(3.0)
    steps = np.linalg.norm(np.diff(shifts, axis=0), axis=1)
    assert steps.max() < 0.35 * 0.45


def test_the_cell_stays_clear_of_the_border(simulated: SimulatedMovie) -> None:
    for timepoint in range(0, 24, 3):
        inside = np.argwhere(simulated.truth(timepoint).mask.data)
        assert inside.min() >= 4
        assert inside.max() <= SIZE - 5


def test_body_points_move_with_the_cell(simulated: SimulatedMovie) -> None:
    points = simulated.body_points(500)
    for timepoint in TIMES:
        truth = simulated.truth(timepoint)
        there = points.at(timepoint)
        assert np.allclose(truth.pose.apply(there), points.points)
        # The border runs half a voxel outside of the outermost voxels' centres.
        level = sample_linear(signed_distance(truth.body.data), truth.body.to_index(there))
        assert np.percentile(np.abs(level), 99) < 1.0
        free = points.free(timepoint)
        above = sample_linear(signed_distance(truth.mask.data), truth.mask.to_index(there[~free]))
        assert free.mean() > 0.6
        assert (above < 0.5).all()


def test_the_body_is_rigid(simulated: SimulatedMovie) -> None:
    first = simulated.truth(0).body
    moved = simulated.truth(22)
    axis = np.arange(0, SIZE, 2) * VOXEL
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    there = moved.pose.inverse().apply(points)
    mine = sample_linear(signed_distance(first.data), first.to_index(points))
    other = sample_linear(signed_distance(moved.body.data), moved.body.to_index(there))
    near = np.abs(mine) < 4.0
    assert np.abs(mine - other)[near].mean() < 0.3
    assert abs((mine - other)[near].mean()) < 0.05


@pytest.mark.parametrize(("kind", "tilt"), [("ruffles", 45.0), ("blebs", 30.0)])
def test_the_flat_bottom_is_tilted(kind: str, tilt: float) -> None:
    standing = movie(kind, 11, **GRID, timepoints=2, tilt_deg=tilt)
    floor = standing.floor
    assert floor is not None
    assert np.degrees(np.arccos(-floor.normal[0])) == pytest.approx(tilt)
    body = standing.truth(0).body
    border = body.data & ~ndimage.binary_erosion(body.data)
    height = (body.to_world(np.argwhere(border)) - floor.point) @ floor.normal
    assert height.min() > -0.5 * VOXEL
    # A flat bottom takes much of the surface, a round one of this size would not.
    assert (height < VOXEL).mean() > 0.1


# Protrusions ----------------------------------------------------------------------------


def test_labels_are_protrusions_of_the_mask(simulated: SimulatedMovie) -> None:
    table = simulated.protrusions
    for timepoint in TIMES:
        truth = simulated.truth(timepoint)
        labels = truth.labels.data
        assert np.array_equal(labels > 0, labels.astype(bool) & truth.mask.data & ~truth.body.data)
        assert (truth.body.data & ~truth.mask.data).sum() == 0
        assert set(np.unique(labels[labels > 0])) <= set(truth.protrusions["id"])
        assert set(truth.protrusions["id"]) <= set(table["id"])
        large = truth.protrusions.query("height_um > 0.6")
        assert set(large["id"]) <= set(np.unique(labels))


@pytest.mark.parametrize("kind", ["blebs", "filopodia"])
def test_an_identity_stays_at_its_place(kind: str) -> None:
    simulated = sample(kind)
    feet = simulated.protrusions.set_index("id")[["z_um", "y_um", "x_um"]]
    for timepoint in TIMES:
        truth = simulated.truth(timepoint)
        voxels = np.argwhere(truth.labels.data)
        labels = truth.labels.data[tuple(voxels.T)]
        places = truth.pose.apply(truth.labels.to_world(voxels))
        reach = np.linalg.norm(places - feet.loc[labels].to_numpy(), axis=1)
        tallest = truth.protrusions.set_index("id")["height_um"].loc[labels].to_numpy()
        assert (reach < tallest + 1.2).all()


def test_heights_are_those_of_the_labels() -> None:
    simulated = sample("blebs")
    for timepoint in TIMES:
        truth = simulated.truth(timepoint)
        outside = ndimage.distance_transform_edt(~truth.body.data) * VOXEL
        known = truth.protrusions.query("height_um > 0.5").set_index("id")["height_um"]
        found = ndimage.maximum(outside, truth.labels.data, known.index.to_numpy())
        assert np.abs(found - known).max() < 2.0 * VOXEL


def test_every_bleb_expands_quickly_and_is_retracted_slowly() -> None:
    events = sample("blebs", timepoints=200).events.query("complete")
    assert len(events) > 30
    expansion = events["peak_s"] - events["birth_s"]
    retraction = events["end_s"] - events["peak_s"]
    assert (expansion < retraction).all()
    assert expansion.median() == pytest.approx(6.0, abs=1.5)


def test_heights_follow_lives() -> None:
    simulated = sample("blebs", timepoints=200)
    lives, events = simulated.protrusions, simulated.events
    assert (lives["lifetime_s"] == lives["end_s"] - lives["birth_s"]).all()
    spans = events.groupby("id").agg({"birth_s": "min", "end_s": "max", "cycle": "count"})
    joined = lives[lives["complete"]].set_index("id")
    spans = spans.loc[joined.index]
    assert np.allclose(joined["birth_s"], spans["birth_s"])
    assert np.allclose(joined["end_s"], spans["end_s"])
    assert (joined["cycles"] == spans["cycle"]).all()
    assert (joined["cycles"] > 1).any()
    by_id = {one.identity: one for one in simulated.cell.protrusions}
    for event in events.itertuples():
        fine = np.linspace(event.birth_s, event.end_s, 2001)
        heights = by_id[event.id].height_um(fine)
        assert fine[np.argmax(heights)] == pytest.approx(event.peak_s, abs=0.05)
        assert heights.max() == pytest.approx(event.height_um, rel=1e-3)
    courses = simulated.courses.merge(lives[["id", "birth_s", "end_s"]], on="id")
    assert (courses["time_s"] > courses["birth_s"]).all()
    assert (courses["time_s"] < courses["end_s"]).all()


def test_lifetimes_come_from_the_stated_distribution() -> None:
    lifetimes = Lifetimes(5.0, 15.0, 0.5)
    long = movie("blebs", 10, **GRID, timepoints=2, time_step=1500.0, lifetimes=lifetimes)
    born = long.protrusions.query("birth_s >= 0")["lifetime_s"].to_numpy()
    assert long.lifetimes is lifetimes
    assert len(born) > 300
    assert stats.kstest(born, lifetimes.cdf).pvalue > 0.01
    assert born.mean() == pytest.approx(lifetimes.mean_s, rel=0.1)


def test_births_are_a_poisson_process() -> None:
    """Where hardly any is refused for want of room, their number and gaps are known."""
    rate, seconds = 0.03, 3600.0
    rare = movie(
        "blebs",
        10,
        **GRID,
        timepoints=2,
        time_step=seconds,
        births_per_um2_per_min=rate,
        lifetimes=Lifetimes(3.0, 5.0, 0.3),
    )
    new = rare.protrusions.query("birth_s >= 0").drop_duplicates("site")["birth_s"].to_numpy()
    points = rare.body_points(20_000).points
    radii = np.linalg.norm(points - rare.cell.body.centre, axis=1)
    least_area = 4 * np.pi * (radii**2).mean()
    expected = rate * least_area * seconds / 60.0
    assert 0.85 * expected < len(new) < 1.4 * expected
    gaps = np.diff(new)
    assert stats.kstest(gaps, "expon", args=(0, gaps.mean())).pvalue > 0.01


def test_another_bleb_may_follow_at_a_place() -> None:
    lives = sample("blebs", timepoints=200).protrusions.sort_values("birth_s")
    repeated = lives[lives["site"].duplicated(keep=False)]
    assert len(repeated) > 5
    for _, group in repeated.groupby("site"):
        assert (group["birth_s"].to_numpy()[1:] > group["end_s"].to_numpy()[:-1] + 2.0).all()


def test_filopodia_grow_at_their_rates() -> None:
    simulated = sample("filopodia", timepoints=60)
    courses = simulated.courses
    lives = simulated.protrusions.set_index("id")
    assert lives["extension_um_per_min"].mean() == pytest.approx(9.0, rel=0.1)
    assert lives["retraction_um_per_min"].mean() == pytest.approx(6.0, rel=0.1)
    of_lives = lives.loc[courses["id"]]
    growing = courses["speed_um_per_min"].to_numpy() > 0.1
    shrinking = courses["speed_um_per_min"].to_numpy() < -0.1
    known = of_lives["extension_um_per_min"].to_numpy()
    assert np.allclose(courses["speed_um_per_min"][growing], known[growing], rtol=0.02)
    known = of_lives["retraction_um_per_min"].to_numpy()
    assert np.allclose(courses["speed_um_per_min"][shrinking], -known[shrinking], rtol=0.02)
    # The same from the labels of two timepoints: how far they reach from the foot.
    tips = []
    for timepoint in (10, 13):
        truth = simulated.truth(timepoint)
        voxels = np.argwhere(truth.labels.data)
        labels = truth.labels.data[tuple(voxels.T)]
        places = truth.pose.apply(truth.labels.to_world(voxels))
        feet = lives.loc[labels, ["z_um", "y_um", "x_um"]].to_numpy()
        reach = np.linalg.norm(places - feet, axis=1)
        tips.append({label: reach[labels == label].max() for label in np.unique(labels)})
    both = [
        one
        for one in set(tips[0]) & set(tips[1])
        if lives.loc[one, "birth_s"] < 15 and lives.loc[one, "peak_s"] > 29 and tips[0][one] > 1
    ]
    for one in both:
        grown = (tips[1][one] - tips[0][one]) / (3 * simulated.time_step_s) * 60.0
        assert grown == pytest.approx(lives.loc[one, "extension_um_per_min"], abs=2.5)


def test_cells_have_no_handles(simulated: SimulatedMovie) -> None:
    for timepoint in TIMES:
        assert genus(simulated.truth(timepoint).mask.data) == 0


# Arguments ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"kind": "blob"}, "filopodia"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "whole number"),
        ({"timepoints": 1}, "timepoints"),
        ({"size": 40}, "size"),
        ({"working_voxel_um": 0.0}, "working_voxel_um"),
        ({"time_step": 0.0}, "time_step"),
        ({"time_step": float("nan")}, "time_step"),
        ({"drift_um": -0.1}, "drift_um"),
        ({"drift_um": 6.0}, "too small for the cell and its drift"),
        ({"rotation_deg": 20.0}, "rotation_deg"),
        ({"bleaching": 1.0}, "bleaching"),
        ({"depth_decay": -0.1}, "depth_decay"),
        ({"tilt_deg": 90.0}, "tilt_deg"),
        ({"lag_s": -1.0}, "lag_s"),
        ({"correlation": 1.2}, "correlation"),
        ({"births_per_um2_per_min": -1.0}, "births_per_um2_per_min"),
        ({"ruffle_um_per_min": 4.0}, "It is for ruffles"),
        ({"kind": "ruffles", "retrograde_um_per_min": 0.0}, "retrograde_um_per_min"),
        ({"kind": "ruffles", "births_per_um2_per_min": 1.0}, "blebs and filopodia"),
        ({"kind": "filopodia", "lifetimes": Lifetimes()}, "It is for blebs"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict, named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        movie(**arguments)


@pytest.mark.parametrize("wrong", [(-1.0, 10.0, 0.5), (5.0, 4.0, 0.5), (5.0, 10.0, -0.1)])
def test_lifetimes_are_checked(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(ParameterError, match="lifetimes"):
        Lifetimes(*wrong)


def test_there_are_as_many_timepoints_as_asked_for() -> None:
    with pytest.raises(InputError, match="from 0 to 23"):
        sample("blebs").frame(24)
    with pytest.raises(InputError, match="timepoint -1"):
        sample("blebs").truth(-1)
    with pytest.raises(ParameterError, match="at least one point"):
        sample("blebs").body_points(0)


def test_progress_rises_to_one_and_cancels() -> None:
    fractions: list[float] = []
    reported = Progress(lambda step, done, text: fractions.append(done))
    movie("ruffles", 10, size=72, timepoints=2, progress=reported)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    stopped = Progress()
    stopped.cancel()
    with pytest.raises(Cancelled):
        movie("blebs", 10, size=72, timepoints=2, progress=stopped)
