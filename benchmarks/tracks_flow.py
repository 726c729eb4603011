"""Ruffles and retrograde flow by optical flow: how fast, against the truth, and at what cost.

    .venv/bin/python benchmarks/tracks_flow.py
    .venv/bin/python benchmarks/tracks_flow.py --seeds 10      # to try something

Simulated cells stand on a plane tilted by 45°; ruffles travel over the lamella at about 4.2
µm/min, each at its own speed, above actin that flows at 0.8 µm/min (paper, Fig. 5). The bottom
and the lamella are annotated in the uv image, as a user does.

Ruffles: regions carried by the flow of the mean curvature, while they are on a crest (above the
upper threshold of a 3-class Otsu) for five timepoints or more; the median over them of the
median lateral velocity of each, against the mean speed of the ruffles that are there. For the
lateral speed every region is compared with the very ruffle that it rides on. Retrograde flow:
regions carried by the paper's flow (Farnebäck) of the actin signal over the dye, averaged over
10 s, half the time between two ruffles; the most frequent lateral speed, by a kernel of
0.2 µm/min, which resolves what the paper's bins of 0.4 µm/min do. The paper's way (the thresholds
of a 3-class Otsu of the mean lateral speeds of regions that follow the signal as it is) is
reported.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from common import results
from common.results import Bar, Entries
from common.unwrapped import Unwrapped, unwrapped
from skimage.filters import threshold_multiotsu

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.geometry.padding import sample_uv_nearest
from napari_unwrap3d.simulate.lamella import INNER, OUTER, SPACING_UM
from napari_unwrap3d.tracking.regions import track_flow
from napari_unwrap3d.tracking.velocities import (
    LATERAL,
    SPEED,
    annotated_plane,
    median_velocities,
    most_frequent,
)

SEEDS = (0, 1, 2)
TIMEPOINTS = 30
ON_CREST = 5  # timepoints
SMOOTHING_S = 10.0
BANDWIDTH = 0.2  # µm/min
BOTTOM = "bottom"
BOTTOM_UM, BOTTOM_PART = 0.5, 0.8  # over the floor; of the outline's radius
RATIO = "signal_actin/signal_CyOFP1"
LONG = 200

POPULATION_BAR = Bar(0.10, "relative error of the speed")
LATERAL_BAR = Bar(0.05, "relative error of the lateral speed")
TIME_BAR = Bar(60.0, "CPU s")


@dataclass(frozen=True, eq=False)
class Lamella:
    """Where places of the common world are over the true bottom."""

    case: Unwrapped

    def local(self, points: np.ndarray, timepoint: int) -> tuple[np.ndarray, np.ndarray]:
        """(up, a, b) in µm (n, 3), and the distance from the middle in parts of the outline's."""
        truth = self.case.truth
        own = truth.poses[timepoint].inverse().apply(self.case.to_stack(points, timepoint))
        lamella = truth.cell.lamella
        local = (own - lamella.origin) @ lamella.frame.T
        radius = np.hypot(local[:, 1], local[:, 2])
        return local, radius / lamella.outline(np.arctan2(local[:, 2], local[:, 1]))

    def ruffle(self, points: np.ndarray, timepoint: int) -> np.ndarray:
        """The ruffle (n,) on which points are, or 0."""
        truth = self.case.truth
        local, _ = self.local(points, timepoint)
        owner = truth.cell.crests.at(timepoint * truth.time_step_s)[1]
        at = np.rint(local[:, 1:] / SPACING_UM).astype(int) + len(owner) // 2
        at = np.clip(at, 0, len(owner) - 1)
        return np.where(self.upper(local), owner[at[:, 0], at[:, 1]], 0)

    def upper(self, local: np.ndarray) -> np.ndarray:
        return local[:, 0] > 0.6 * self.case.truth.cell.lamella.thickness_um

    def up(self) -> np.ndarray:
        """The true normal of the bottom in the common world."""
        registered = self.case.movie.folder.registered(0)
        assert registered is not None
        own = self.case.truth.poses[0].rotation @ self.case.truth.floor.normal
        return registered.pose.rotation @ own


def annotate_bottom(case: Unwrapped) -> None:
    """Draw the bottom into the uv image of the common space."""
    common = case.movie.common
    positions = np.asarray(common.uv.positions)
    local, part = Lamella(case).local(positions.reshape(-1, 3), 0)
    bottom = (local[:, 0] < BOTTOM_UM) & (part < BOTTOM_PART)
    if BOTTOM not in common.annotations.names:
        common.annotations.add(BOTTOM)
    pixels = np.nonzero(bottom.reshape(positions.shape[:2]))
    common.annotations.draw(BOTTOM, "uv", pixels, 1)


def zone(case: Unwrapped) -> np.ndarray:
    """The lamella (N, 2N), as a user draws it to gate tracks: of the common surface."""
    positions = np.asarray(case.movie.common.uv.positions)
    lamella = Lamella(case)
    local, part = lamella.local(positions.reshape(-1, 3), 0)
    inside = lamella.upper(local) & (part > INNER) & (part < OUTER)
    return inside.reshape(positions.shape[:2])


def followed(case: Unwrapped, **flow: Any) -> Tracks:
    """Regions that follow a field, with their lateral speed."""
    chosen = unwrap3d.Parameters.from_dict({"flow": {"plane": BOTTOM, **flow}})
    return track_flow(case.movie, chosen)


def sampled(case: Unwrapped, tracks: Tracks, name: str) -> np.ndarray:
    """A field at every row of tracks."""
    found = np.full(len(tracks), np.nan)
    for t in range(len(case.movie)):
        rows = tracks.timepoint == t
        found[rows] = sample_uv_nearest(case.movie.frame(t).uv[name], tracks.place_px[rows])
    return found


def crest_threshold(case: Unwrapped) -> float:
    """The upper threshold of a 3-class Otsu of the mean curvature over the movie."""
    images = [case.movie.frame(t).uv["mean_curvature_per_um"] for t in range(0, len(case.movie), 3)]
    values = np.concatenate([image[::2, ::2].ravel() for image in images])
    return float(threshold_multiotsu(values[np.isfinite(values)], 3)[1])


def ruffles(case: Unwrapped, seed: int, lamella: np.ndarray) -> Entries:
    """Speeds of regions on crests, as a population and each against its own ruffle."""
    truth = case.truth
    tracks = followed(case)
    gate = sample_uv_nearest(lamella, tracks.place_px)
    crest = gate & (sampled(case, tracks, "mean_curvature_per_um") > crest_threshold(case))
    plane = annotated_plane(case.movie, BOTTOM)
    ids, velocity = median_velocities(tracks, crest, ON_CREST)
    lateral = np.linalg.norm(plane.along(velocity), axis=1)
    flat = np.linalg.norm(velocity[:, 1:], axis=1)
    states = [truth.cell.state(t * truth.time_step_s) for t in range(len(truth))]
    true = float(np.mean([row["speed_um_per_min"] for rows in states for row in rows]))
    own = own_speeds(case, tracks, crest, ids)
    ratio = lateral / own
    angle = np.degrees(np.arccos(min(abs(float(plane.normal @ Lamella(case).up())), 1.0)))
    return {
        f"tracks/ruffle-speed/ruffles-{seed}": POPULATION_BAR.entry(
            abs(float(np.median(lateral)) / true - 1),
            found_um_per_min=results.significant(float(np.median(lateral)), 3),
            true_um_per_min=results.significant(true, 3),
            regions=len(ids),
        ),
        f"tracks/lateral-speed/ruffles-{seed}": LATERAL_BAR.entry(
            abs(float(np.nanmedian(ratio)) - 1),
            ratio=results.significant(float(np.nanmedian(ratio)), 3),
            ratio_without_plane=results.significant(float(np.nanmedian(flat / own)), 3),
            ratio_on_surface=results.significant(
                float(np.nanmedian(tracks.columns[SPEED][crest]) / true), 3
            ),
            plane_error_deg=results.significant(float(angle), 2),
            regions=int(np.isfinite(ratio).sum()),
        ),
    }


def own_speeds(case: Unwrapped, tracks: Tracks, crest: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """The true speed (k,) of the ruffle that each region is on for most of the time; or NaN."""
    lamella = Lamella(case)
    identity = np.zeros(len(tracks), int)
    for t in range(len(case.movie)):
        rows = tracks.timepoint == t
        identity[rows] = lamella.ruffle(tracks.position_um[rows], t)
    speed = {row["id"]: row["speed_um_per_min"] for row in case.truth.cell.lives()}
    found = np.full(len(ids), np.nan)
    for number, track in enumerate(ids.tolist()):
        ridden = identity[crest & (tracks.track_id == track)]
        names, counts = np.unique(ridden[ridden > 0], return_counts=True)
        if len(names) and counts.max() > len(ridden) / 2:
            found[number] = speed[int(names[counts.argmax()])]
    return found


def retrograde(case: Unwrapped, seed: int, lamella: np.ndarray) -> Entries:
    """The most frequent lateral speed of what the averaged signal shows, and the paper's way."""
    tracks = followed(case, field=RATIO, method="farneback", smoothing_s=SMOOTHING_S)
    gate = sample_uv_nearest(lamella, tracks.place_px)
    found = most_frequent(tracks.columns[LATERAL][gate], BANDWIDTH)
    true = case.truth.rates["retrograde_um_per_min"]
    plain = followed(case, field=RATIO, method="farneback", clipped_percent=0.0)
    inside = sample_uv_nearest(lamella, plain.place_px) & np.isfinite(plain.columns[LATERAL])
    count = np.bincount(plain.track_id[inside])
    total = np.bincount(plain.track_id[inside], plain.columns[LATERAL][inside])
    mean = total[count >= ON_CREST] / count[count >= ON_CREST]
    slow, fast = threshold_multiotsu(mean[mean < 10], 3)
    return {
        f"tracks/retrograde-speed/ruffles-{seed}": POPULATION_BAR.entry(
            abs(found / true - 1),
            found_um_per_min=results.significant(found, 3),
            true_um_per_min=true,
            papers_slow_um_per_min=results.significant(float(slow), 3),
            papers_fast_um_per_min=results.significant(float(fast), 3),
        )
    }


class Repeated:
    """A movie that goes forth and back until it is long enough; the rest is that of the movie."""

    def __init__(self, movie: unwrap3d.Movie, timepoints: int) -> None:
        self._movie, self._timepoints = movie, timepoints

    def __len__(self) -> int:
        return self._timepoints

    def __getattr__(self, name: str) -> Any:
        return getattr(self._movie, name)

    def _at(self, timepoint: int) -> int:
        period = 2 * len(self._movie) - 2
        return min(timepoint % period, period - timepoint % period)

    def frame(self, timepoint: int) -> Any:
        return self._movie.frame(self._at(timepoint))

    def is_lost(self, _: int) -> bool:
        return False

    def has_frame(self, _: int) -> bool:
        return False  # nothing is read that was kept

    def keep_tracks(self, *_: Any) -> None:
        """Not measured."""


def duration(case: Unwrapped, seed: int) -> Entries:
    """CPU seconds for 200 timepoints and 1000 regions."""
    movie: Any = Repeated(case.movie, LONG)
    start = time.process_time()
    tracks = track_flow(movie, unwrap3d.Parameters())
    spent = time.process_time() - start
    rows, columns = case.movie.common.uv.shape
    return {
        f"tracks/time-flow/ruffles-{seed}": TIME_BAR.entry(
            spent,
            timepoints=LONG,
            grid=f"{columns}x{rows}",
            regions=tracks.numbers["first_regions"],
        )
    }


def measure(seed: int, timepoints: int) -> Entries:
    """The entries of one movie."""
    case = unwrapped("ruffles", seed, timepoints, protrusions=False)
    annotate_bottom(case)
    lamella = zone(case)
    return {**ruffles(case, seed, lamella), **retrograde(case, seed, lamella)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--timepoints", type=int, default=TIMEPOINTS)
    parser.add_argument("--no-time", action="store_true")
    options = parser.parse_args()
    scored = tuple(options.seeds) == SEEDS and options.timepoints == TIMEPOINTS
    for seed in options.seeds:
        entries = measure(seed, options.timepoints)
        results.show(entries)
        if scored:
            results.merge(entries)
    if not options.no_time:
        seed = options.seeds[0]
        entries = duration(unwrapped("ruffles", seed, options.timepoints, protrusions=False), seed)
        results.show(entries)
        if scored:
            results.merge(entries)


if __name__ == "__main__":
    main()
