"""Series along tracks: events, lags, means, correlations, and what they take.

    .venv/bin/python benchmarks/tracks_series.py
    .venv/bin/python benchmarks/tracks_series.py --seeds 10 --parts events lag   # to try something

Movies are those of common/unwrapped.py: simulated cells that were recorded by a simulated
microscope, segmented, unwrapped and tracked with the defaults. What is held to be true:

events    Every cycle of a simulated bleb has its peak at a known time. A cycle counts where a
          track follows its bleb at the peak (blebs that nobody sees have no track), and the peak
          is not at the first or last timepoint, where nothing shows that it is one. How many
          cycles there are in all, seen or not, is beside it. Found events are paired with true
          ones of the same bleb one to one, the nearest first, within PAIRED_S.
lag       The signal of a simulated bleb follows its curvature by a known time, and has the
          opposite sign. Found: the lag of the largest mean cross-correlation of the two along the
          tracks, and its sign.
mean      A function of the place in space is given to the vertices of the surface of a frame and
          goes the way of any other field. The mean of it over regions all over the sphere, those
          over the seam and over both poles among them, is compared with that over millions of
          points that are spread evenly over the mesh in space, of those that lie outermost. Beside
          it is the mean that does not allow for the distortion.
corr.     The actin of a simulated lamella is correlated with the curvature over time at every
          place of its upper side, by a number that is set: .2 or .5. Found: the mean correlation
          of the curvature with the ratio of actin to the diffuse dye (as in the paper's Fig. 5), at
          places that do not move and are always on that upper side, and its interval.
time      CPU time of tracking and measuring 200 frames of 512 x 256 pixels with 100 protrusions in
          each; the frames are those of a movie, over and over, and the protrusions are made up.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import results
from common.results import Bar, Entries
from common.unwrapped import Unwrapped, unwrapped

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import FrameProtrusions, Tracks
from napari_unwrap3d.files.movie import MovieFolder
from napari_unwrap3d.geometry.spread import spread_directions
from napari_unwrap3d.measuring.analysis import measure_tracks
from napari_unwrap3d.measuring.places import places_of
from napari_unwrap3d.measuring.sampling import TrackSums
from napari_unwrap3d.measuring.still import still_tracks
from napari_unwrap3d.motion.frames import AREA, HEIGHT, CommonSpace
from napari_unwrap3d.tracking.objects import track_protrusions
from napari_unwrap3d.unwrapping.outermost import OutermostSurface
from napari_unwrap3d.unwrapping.uv import direction_to_uv, uv_to_direction

SEEDS = (0, 1, 2)
PARTS = ("events", "lag", "mean", "correlation", "time")
BLEBS, RUFFLES = 50, 90
PAIRED_S = 6.0
CORRELATIONS = (0.2, 0.5)
# The paper samples signals of ruffles as the mean along 1 µm inwards.
AS_IN_FIGURE_5 = {"movie": {"statistic": "mean"}}
SIGNAL, ACTIN = "signal_septin", "signal_actin/signal_CyOFP1"
CURVATURE = "mean_curvature_per_um"

EVENTS_BAR = Bar(0.05, "of the number of events, off")
PEAKS_BAR = Bar(0.9, "of the peaks within 1 timepoint", at_least=True)
LAG_BAR = Bar(1.0, "timepoints off")
MEAN_BAR = Bar(0.01, "of the mean in 3D, off at the worst place")
SIZE_BAR = Bar(0.05, "off")
INTERVAL_BAR = Bar(0.9, "of the movies: the interval holds the truth", at_least=True)
TIME_BAR = Bar(60.0, "CPU s")

# Of the known field: its period in µm, and how much it changes.
PERIOD_UM, CHANGE = 4.0, 0.5
REGION_UM, REGIONS = 1.5, 400
POINTS = 6_000_000
# A point of the mesh is outermost where it is no deeper than this under the image's surface.
OUTERMOST_UM = 0.15
CROWD_TIMEPOINTS, CROWD = 200, 100
RADIUS_PX = 9.0


# Events and lag ------------------------------------------------------------------------


def measured_blebs(seed: int) -> tuple[Unwrapped, Tracks, unwrap3d.Measurements]:
    """A movie of blebs, its tracks and what is measured along them."""
    case = unwrapped("blebs", seed, BLEBS)
    tracks = track_protrusions(case.movie)
    # Those of the movie may have been kept before the defaults of measurements changed.
    chosen = unwrap3d.Parameters.from_dict(
        {"measurement": {"correlate": f"{CURVATURE}, {SIGNAL}"}}
    ).measurement
    parameters = case.movie.parameters.model_copy(update={"measurement": chosen})
    return case, tracks, measure_tracks(case.movie, tracks, parameters)


def identities(case: Unwrapped, tracks: Tracks) -> np.ndarray:
    """The true bleb (n,) of every row of tracks, 0 for none."""
    found = np.zeros(len(tracks), int)
    for timepoint in np.unique(tracks.timepoint).tolist():
        names = case.matched(timepoint)
        rows = np.flatnonzero(tracks.timepoint == timepoint)
        labels = np.nan_to_num(tracks.columns["label"][rows]).astype(int)
        found[rows] = [names.get(label, 0) for label in labels.tolist()]
    return found


def true_peaks(case: Unwrapped, tracks: Tracks, names: np.ndarray) -> list[tuple[int, float]]:
    """(bleb, time) of the peaks of all cycles that a track follows."""
    step, last = case.movie.time_step_s, case.movie.times_s[-1]
    peaks = []
    for cycle in case.truth.events.itertuples():
        own = tracks.times_s[names == cycle.id]
        followed = (np.abs(own - cycle.peak_s) <= step).any()
        if followed and step <= cycle.peak_s <= last - step:
            peaks.append((int(cycle.id), float(cycle.peak_s)))
    return peaks


def found_peaks(tracks: Tracks, names: np.ndarray, events: Any) -> list[tuple[int, float]]:
    """(bleb, time) of the events of all tracks; of a track that follows no bleb: (0, time)."""
    owner = {}
    for track in tracks.ids.tolist():
        own = names[tracks.rows_of(track)]
        own = own[own > 0]
        owner[track] = int(np.bincount(own).argmax()) if len(own) else 0
    return [(owner[int(e.track_id)], float(e.time_s)) for e in events.itertuples()]


def paired(true: list[tuple[int, float]], found: list[tuple[int, float]]) -> dict[int, float]:
    """How far off in s the event of every true peak is, by its number; each event once."""
    apart = sorted(
        (abs(time_s - when), i, j)
        for i, (bleb, time_s) in enumerate(true)
        for j, (name, when) in enumerate(found)
        if bleb == name and abs(time_s - when) <= PAIRED_S
    )
    off: dict[int, float] = {}
    taken: set[int] = set()
    for distance, i, j in apart:
        if i not in off and j not in taken:
            off[i] = distance
            taken.add(j)
    return off


def events(seed: int) -> Entries:
    """Number of events and times of their peaks."""
    case, tracks, found = measured_blebs(seed)
    names = identities(case, tracks)
    true = true_peaks(case, tracks, names)
    seen = found_peaks(tracks, names, found.table("events"))
    step, last = case.movie.time_step_s, float(case.movie.times_s[-1])
    inside = [peak for peak in seen if step <= peak[1] <= last - step]
    off = paired(true, seen)
    within = sum(distance <= step for distance in off.values())
    in_movie = case.truth.events.query("@step <= peak_s <= @last - @step")
    return {
        f"tracks/events-total/blebs-{seed}": EVENTS_BAR.entry(
            abs(len(inside) / len(true) - 1),
            found=len(inside),
            true=len(true),
            paired=len(off),
            cycles_seen_or_not=len(in_movie),
            tracks=len(tracks.ids),
        ),
        f"tracks/event-times/blebs-{seed}": PEAKS_BAR.entry(
            within / len(true),
            median_off_s=results.significant(float(np.median(list(off.values()))), 3),
            true=len(true),
        ),
    }


def lag(seed: int) -> Entries:
    """Lag of the signal behind the curvature."""
    case, _, found = measured_blebs(seed)
    law = case.truth.law
    table = found.table("cross_correlation")
    strongest = float(table["mean"][table["mean"].abs().idxmax()])
    right = np.sign(strongest) == law.sign
    off = abs(found.numbers["lag_s"] - law.lag_s) / case.movie.time_step_s
    return {
        f"tracks/lag/blebs-{seed}": LAG_BAR.entry(
            off if right else None,
            found_s=results.significant(found.numbers["lag_s"], 3),
            true_s=law.lag_s,
            correlation=results.significant(strongest, 3),
            note="" if right else "wrong sign",
        )
    }


# Means ---------------------------------------------------------------------------------


def known_field(points: np.ndarray) -> np.ndarray:
    """A function (n,) of the place (n, 3) in µm that changes all over the cell."""
    return 1.0 + CHANGE * np.sin(2 * np.pi * points / PERIOD_UM).mean(axis=1)


def area_in_space(case: Unwrapped, timepoint: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Area and integral of the known field over what of the mesh lies outermost at each pixel."""
    frame = case.movie.frame(timepoint)
    cell, rows = frame.surface, case.movie.common.uv.shape[0]
    rng = np.random.default_rng(seed)
    corners = cell.vertices[cell.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    face = rng.choice(len(area), POINTS, p=area / area.sum())
    a, b = rng.random((2, POINTS))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    weights = np.stack([1 - a - b, a, b], axis=1)
    ends = cell.faces[face]
    directions = uv_to_direction(frame.topography[:, 1:], rows)
    mixed = np.einsum("ij,ijk->ik", weights, directions[ends])
    depth = np.einsum("ij,ij->i", weights, frame.topography[:, 0][ends])
    place = direction_to_uv(mixed / np.linalg.norm(mixed, axis=1, keepdims=True), rows)
    v, u = np.floor(place + 0.5).astype(int).T
    v, u = np.clip(v, 0, rows - 1), u % (2 * rows)
    outermost = depth > np.nan_to_num(frame.uv[HEIGHT][v, u], nan=np.inf) - OUTERMOST_UM
    points = np.einsum("ij,ijk->ik", weights, corners[face])
    pixel = (v * 2 * rows + u)[outermost]
    each = area.sum() / POINTS
    values = known_field(points[outermost])
    size, total = (
        each * np.bincount(pixel, w, 2 * rows * rows).reshape(rows, 2 * rows)
        for w in (np.ones(len(pixel)), values)
    )
    return size, total


def mean(seed: int) -> Entries:
    """Means of a known field over regions everywhere."""
    case = unwrapped("blebs", seed, BLEBS, protrusions=False)
    timepoint = BLEBS // 2
    frame = case.movie.frame(timepoint)
    chart = CommonSpace(case.movie.common).topography_of(frame.surface, frame.topography)
    outermost = OutermostSurface(frame.surface, chart)
    image = outermost.image(known_field(frame.surface.vertices)).astype(np.float32)
    tracks = everywhere(case.movie, timepoint)
    measurement = {"measurement": {"region_um": REGION_UM}}
    parameters = unwrap3d.Parameters.from_dict(measurement)
    places = places_of(case.movie, tracks, parameters)
    sums = TrackSums(case.movie, places, ("known",), parameters)
    frame.uv["known"] = image  # type: ignore[index]
    sums.add(frame)
    size, total = area_in_space(case, timepoint, seed)
    boxes = np.rint(places.corners).astype(int)
    true, plain = np.empty(len(boxes)), np.empty(len(boxes))
    for number, (top, left, bottom, right) in enumerate(boxes):
        inside = pixels_under(top, left, bottom, right, len(image))
        true[number] = total[inside].sum() / size[inside].sum()
        plain[number] = image[inside].mean()
    off = np.abs(sums.columns()["known"] / true - 1)
    uncorrected = np.abs(plain / true - 1)
    polar = (boxes[:, 0] < 0) | (boxes[:, 2] > len(image))
    del frame.uv["known"]  # type: ignore[attr-defined]
    return {
        f"tracks/mean/blebs-{seed}": MEAN_BAR.entry(
            float(off.max()),
            median=results.significant(float(np.median(off)), 3),
            over_the_poles=results.significant(float(off[polar].max()), 3),
            uncorrected=results.significant(float(uncorrected.max()), 3),
            uncorrected_median=results.significant(float(np.median(uncorrected)), 3),
            uncorrected_over_the_poles=results.significant(float(uncorrected[polar].max()), 3),
            regions=len(boxes),
        )
    }


def everywhere(movie: unwrap3d.Movie, timepoint: int) -> Tracks:
    """Regions all over the sphere at one timepoint, two of them at the poles."""
    rows = movie.common.uv.shape[0]
    places = direction_to_uv(spread_directions(REGIONS), rows)
    places = np.concatenate([places, [[-0.5, 10.0], [rows - 0.5, 10.0]]])
    number = len(places)
    columns = {name: np.zeros(number) for name in ("z_um", "y_um", "x_um")}
    columns |= {"track_id": np.arange(1, number + 1), "timepoint": np.full(number, timepoint)}
    columns |= {"v_px": places[:, 0], "u_px": places[:, 1]}
    return Tracks.of(columns, time_step_s=1.0, timepoints=len(movie), rows=rows)


def pixels_under(top: int, left: int, bottom: int, right: int, rows: int) -> np.ndarray:
    """Which pixels (N, 2N) a box holds that may reach over the seam and the poles."""
    v, u = np.meshgrid(np.arange(top, bottom), np.arange(left, right), indexing="ij")
    over = (v < 0) | (v >= rows)
    v = np.where(v < 0, -1 - v, np.where(v >= rows, 2 * rows - 1 - v, v))
    inside = np.zeros((rows, 2 * rows), bool)
    inside[np.clip(v, 0, rows - 1), np.where(over, u + rows, u) % (2 * rows)] = True
    return inside


# Correlation ---------------------------------------------------------------------------


def on_lamella(case: Unwrapped, tracks: Tracks) -> np.ndarray:
    """Which tracks (m,) are always on the upper side of the lamella."""
    lamella = case.truth.cell.lamella
    always = np.ones(len(tracks.ids), bool)
    for timepoint in np.unique(tracks.timepoint).tolist():
        rows = np.flatnonzero(tracks.timepoint == timepoint)
        points = case.to_stack(tracks.position_um[rows], timepoint)
        own = case.truth.poses[timepoint].inverse().apply(points)
        height, a, b = ((own - lamella.origin) @ lamella.frame.T).T
        radius = np.hypot(a, b)
        part = radius / lamella.outline(np.arctan2(b, a))
        there = (height > 0.6 * lamella.top(radius)) & (part > 0.45) & (part < 0.88)
        always[np.searchsorted(tracks.ids, tracks.track_id[rows])] &= there
    return always


def correlation(seed: int) -> Entries:
    """Sign, size and interval of correlations that are built in."""
    entries: Entries = {}
    held = []
    for built_in in CORRELATIONS:
        arguments = {"correlation": built_in, "groups": AS_IN_FIGURE_5}
        case = unwrapped("ruffles", seed, RUFFLES, protrusions=False, **arguments)
        tracks = still_tracks(case.movie, 2000)
        tracks = tracks.kept(tracks.ids[on_lamella(case, tracks)].tolist())
        measurement = {"correlate": f"{CURVATURE}, {ACTIN}"}
        parameters = unwrap3d.Parameters.from_dict({"measurement": measurement})
        found = measure_tracks(case.movie, tracks, parameters).numbers
        low, high = found["correlation_low"], found["correlation_high"]
        held.append(low <= built_in <= high)
        entries[f"tracks/correlation-{built_in:g}/ruffles-{seed}"] = SIZE_BAR.entry(
            abs(found["correlation"] - built_in * case.truth.law.sign),
            found=results.significant(found["correlation"], 3),
            interval=[results.significant(low, 3), results.significant(high, 3)],
            places=len(tracks.ids),
        )
    entries[f"tracks/correlation-interval/ruffles-{seed}"] = INTERVAL_BAR.entry(
        float(np.mean(held)), movies=len(held)
    )
    return entries


# Time ----------------------------------------------------------------------------------


def crowded(case: Unwrapped, folder: Path) -> unwrap3d.Movie:
    """A movie of many timepoints, whose frames are those of another one over and over."""
    source = case.movie.folder.path
    for entry in source.iterdir():
        if entry.is_file():
            shutil.copy(entry, folder / entry.name)
    (folder / "frames").mkdir()
    for timepoint in range(CROWD_TIMEPOINTS):
        frame = source / "frames" / f"{timepoint % len(case.movie):05d}.zip"
        (folder / "frames" / f"{timepoint:05d}.zip").symlink_to(frame)
    manifest = json.loads((folder / "movie.json").read_text("utf-8"))
    manifest["timepoints"] = CROWD_TIMEPOINTS
    (folder / "movie.json").write_text(json.dumps(manifest), "utf-8")
    return unwrap3d.Movie(MovieFolder(folder))


def crowd(movie: unwrap3d.Movie, timepoint: int) -> FrameProtrusions:
    """Round protrusions on the sphere that jitter a little."""
    rows = movie.common.uv.shape[0]
    rng = np.random.default_rng(timepoint)
    directions = spread_directions(CROWD) + 0.01 * rng.normal(size=(CROWD, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    grid = np.stack(np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij"), axis=-1)
    pixels = uv_to_direction(grid.reshape(-1, 2).astype(float), rows)
    cosine = pixels @ directions.T
    nearest = cosine.argmax(axis=1)
    near = cosine[np.arange(len(pixels)), nearest] > np.cos(RADIUS_PX * np.pi / rows)
    labels = np.where(near, nearest + 1, 0).reshape(rows, 2 * rows).astype(np.int32)
    places = direction_to_uv(directions, rows)
    feet = movie.common.map(places, "uv", "reference")[0]
    columns: dict[str, Any] = {
        "label": np.arange(1, CROWD + 1),
        "area_um2": np.full(CROWD, 3.0) + 0.1 * rng.normal(size=CROWD),
        "height_max_um": np.full(CROWD, 1.0) + 0.05 * rng.normal(size=CROWD),
        "v_px": places[:, 0],
        "u_px": places[:, 1],
    }
    for number, axis in enumerate("zyx"):
        columns[f"{axis}_um"] = columns[f"foot_{axis}_um"] = feet[:, number]
    vertices = len(movie.frame(timepoint).surface.vertices)
    return FrameProtrusions(timepoint, np.zeros(vertices, np.int32), labels, columns)


def spent(seed: int) -> Entries:
    """CPU time of tracking and of measuring."""
    from napari_unwrap3d.tracking.objects import link_tables

    case = unwrapped("blebs", seed, BLEBS, protrusions=False)
    with tempfile.TemporaryDirectory() as folder:
        movie = crowded(case, Path(folder))
        found = [crowd(movie, timepoint) for timepoint in range(CROWD_TIMEPOINTS)]
        movie.protrusions = lambda t, *_: found[t]  # type: ignore[method-assign]
        start = time.process_time()
        tracks = link_tables(
            [(one.timepoint, dict(one.columns)) for one in found],
            movie.parameters.tracking,
            time_step_s=movie.time_step_s,
            timepoints=len(movie),
            rows=movie.common.uv.shape[0],
        )
        linked = time.process_time()
        measurements = measure_tracks(movie, tracks)
        done = time.process_time()
        image = "x".join(map(str, movie.frame(0).uv[AREA].shape[::-1]))
    return {
        f"tracks/time/crowd-{seed}": TIME_BAR.entry(
            done - start,
            tracking_s=results.significant(linked - start, 3),
            series_s=results.significant(done - linked, 3),
            rows=len(tracks),
            tracks=len(tracks.ids),
            series=len(measurements.table("series").columns),
            image=image,
        )
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    options = parser.parse_args()
    takes = {
        "events": events,
        "lag": lag,
        "mean": mean,
        "correlation": correlation,
        "time": spent,
    }
    scored = set(options.seeds) <= set(SEEDS)
    everything: Entries = {}
    for seed in options.seeds:
        for part in options.parts:
            # Time is the same whatever the movie.
            if part == "time" and seed != options.seeds[0]:
                continue
            entries = takes[part](seed)
            results.show(entries)
            everything |= entries
            if scored:
                results.merge(entries)
    results.summarise(everything)


if __name__ == "__main__":
    main()
