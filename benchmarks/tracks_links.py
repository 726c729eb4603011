"""How well protrusions are followed: links, identities over seam and poles, lifetimes, time.

    .venv/bin/python benchmarks/tracks_links.py
    .venv/bin/python benchmarks/tracks_links.py --seeds 10 --timepoints 50  # to try something

Simulated blebbing cells are recorded through a microscope, unwrapped and tracked, by both
methods, with default parameters. A protrusion that was found is the true bleb that most of its
surface is of, one to one; how far it reaches plays no part, as a low bud has no clear border.

What counts as truth: a bleb grows out of the body from nothing and goes back into it. It is
visible while its true height is more than VISIBLE_UM, and it is one at all if it is once higher
than NOTICED_UM; at these heights half of all blebs are followed, or found, on the seeds that the
method was developed on (10 and above; these are 2.5 and 3.7 voxels). Its lifetime is the time
over which it is visible. Whoever is invisible for longer than the longest gap is a new one when
it comes back, as between two cycles of a bleb that was nearly gone.

The bars: links between two timepoints that follow each other, of all blebs that are visible at
both of them; identities of blebs that lie over the seam or a pole of the uv image, and of
objects all over a ball that turns under it; lifetimes of blebs that begin and end within the
movie; TrackMate's own links on its own data. tracks_time.py measures the time.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from common import results
from common.results import Bar, Entries
from common.unwrapped import Unwrapped, unwrapped
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation
from scipy.stats import ks_2samp

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.tracking.detections import FOOT
from napari_unwrap3d.tracking.linking import link
from napari_unwrap3d.tracking.objects import link_tables, track_protrusions
from napari_unwrap3d.unwrapping.uv import direction_to_uv

SEEDS = (0, 1, 2)
TIMEPOINTS = 50
METHODS = ("surface", "boxes")
VISIBLE_UM = 0.38
NOTICED_UM = 0.56
MOST = 0.5
# Of walkers on a ball.
WALKERS, WALK, BALL_UM, STEP_UM, NOISE_UM, POLE_PX = 60, 100, 5.0, 0.3, 0.1, 8.0
TRACKMATE = Path(__file__).resolve().parents[2] / "shared" / "data" / "trackmate"
TRACKMATE_STEP = 15.0

LINKS_BAR = Bar(0.95, "of links", at_least=True)
SEAM_BAR = Bar(0.95, "of those over seam or pole", at_least=True)
MEAN_BAR = Bar(0.05, "of the true mean")
KS_BAR = Bar(0.1, "Kolmogorov-Smirnov distance")
TRACKMATE_BAR = Bar(0.995, "of links", at_least=True)

Place = tuple[int, int]  # timepoint, label


# Truth -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Spell:
    """For how long a bleb is visible.

    Attributes
    ----------
    identity : int
    first, last : int
        Timepoints.
    top_um : float
        The greatest true height.
    """

    identity: int
    first: int
    last: int
    top_um: float


def visible(case: Unwrapped) -> dict[int, dict[int, float]]:
    """Identity → timepoint → height of every bleb while it is visible."""
    found: dict[int, dict[int, float]] = {}
    for row in case.truth.courses.itertuples():
        if row.height_um > VISIBLE_UM:
            found.setdefault(row.id, {})[row.timepoint] = row.height_um
    return found


def spells(case: Unwrapped, gap: int) -> list[Spell]:
    """All of them that are once noticed; over at most `gap` lost timepoints it is one."""
    found = []
    for identity, heights in visible(case).items():
        times = np.array(sorted(heights))
        for part in np.split(times, np.flatnonzero(np.diff(times) > gap + 1) + 1):
            top = max(heights[t] for t in part.tolist())
            if top > NOTICED_UM:
                found.append(Spell(identity, int(part[0]), int(part[-1]), top))
    return found


def true_links(case: Unwrapped, gap: int) -> set[tuple[int, int]]:
    """(identity, timepoint) of every bleb that is visible then and at the next timepoint."""
    heights = visible(case)
    return {
        (spell.identity, t)
        for spell in spells(case, gap)
        for t in range(spell.first, spell.last)
        if t in heights[spell.identity] and t + 1 in heights[spell.identity]
    }


# What was found ------------------------------------------------------------------------


def identities(case: Unwrapped, parameters: unwrap3d.Parameters) -> dict[Place, int]:
    """The true bleb that every protrusion found is; 0 for none."""
    found: dict[Place, int] = {}
    for t in range(len(case.movie)):
        one = case.movie.protrusions(t, parameters)
        matched = most_of(case, t, one.labels)
        found |= {(t, label): matched.get(label, 0) for label in one.columns["label"].tolist()}
    return found


def most_of(case: Unwrapped, timepoint: int, labels: np.ndarray) -> dict[int, int]:
    """Label → the identity that most of its surface is of, one to one by the shared area."""
    surface = case.movie.frame(timepoint).surface
    area = vertex_mass(surface.vertices, surface.faces)
    names, index = np.unique(case.identities(timepoint), return_inverse=True)
    count = int(labels.max(initial=0)) + 1
    shared = np.bincount(labels * len(names) + index, area, count * len(names))
    shared = shared.reshape(count, len(names))
    most = (names > 0) & (shared >= MOST * shared.sum(axis=1, keepdims=True))
    shared = np.where(most & (np.arange(count) > 0)[:, None], shared, 0.0)
    rows, columns = linear_sum_assignment(-shared)
    good = shared[rows, columns] > 0
    return dict(zip(rows[good].tolist(), names[columns[good]].tolist(), strict=True))


def steps(tracks: unwrap3d.Tracks) -> list[tuple[Place, Place]]:
    """Protrusions that follow each other in a track; over gaps, too."""
    found = []
    for track in tracks.ids.tolist():
        rows = tracks.rows_of(track)
        time, label = tracks.timepoint[rows], np.nan_to_num(tracks.columns["label"][rows])
        places = [(int(t), int(n)) for t, n in zip(time, label, strict=True) if n > 0]
        found += list(pairwise(places))
    return found


def links(case: Unwrapped, tracks: unwrap3d.Tracks, who: dict[Place, int], gap: int) -> Entries:
    """Precision of all links, recall of those that are there."""
    made = steps(tracks)
    right = [(a, b) for a, b in made if who[a] == who[b] != 0]
    true = true_links(case, gap)
    there = {(who[a], a[0]) for a, b in right if b[0] == a[0] + 1}
    seen = set(who)
    both = {
        (identity, t)
        for identity, t in true
        if any(who[p] == identity for p in seen if p[0] == t)
        and any(who[p] == identity for p in seen if p[0] == t + 1)
    }
    recall = len(true & there) / len(true)
    return {
        "precision": LINKS_BAR.entry(len(right) / max(len(made), 1), links=len(made)),
        "recall": LINKS_BAR.entry(
            recall,
            links=len(true),
            of_found_blebs=results.significant(len(both & there) / max(len(both), 1)),
        ),
    }


def over_border(
    case: Unwrapped, parameters: unwrap3d.Parameters, who: dict[Place, int]
) -> set[int]:
    """Identities of the blebs that lie over the seam or a pole at some timepoint."""
    found = set()
    for t in range(len(case.movie)):
        image = case.movie.protrusions(t, parameters).uv
        sides = set(image[:, 0].tolist()) & set(image[:, -1].tolist())
        poles = set(image[[0, -1]].ravel().tolist())
        found |= {who[t, label] for label in (sides | poles) - {0}}
    return found - {0}


def kept_identities(
    case: Unwrapped, tracks: unwrap3d.Tracks, who: dict[Place, int], gap: int, only: set[int]
) -> tuple[int, int]:
    """How many spells of some blebs are one track and nothing else is in it; and how many."""
    of_place = {}
    holds: dict[int, set[int]] = {}
    for track, t, label in zip(
        tracks.track_id.tolist(),
        tracks.timepoint.tolist(),
        np.nan_to_num(tracks.columns["label"]).astype(int).tolist(),
        strict=True,
    ):
        if label > 0:
            of_place[t, label] = track
            holds.setdefault(track, set()).add(who[t, label])
    kept = 0
    chosen = [spell for spell in spells(case, gap) if spell.identity in only]
    for spell in chosen:
        inside = [p for p in who if who[p] == spell.identity and spell.first <= p[0] <= spell.last]
        mine = {of_place.get(place) for place in inside}
        kept += len(mine) == 1 and None not in mine and holds[next(iter(mine))] == {spell.identity}
    return kept, len(chosen)


def lifetimes(case: Unwrapped, tracks: unwrap3d.Tracks, gap: int) -> tuple[np.ndarray, np.ndarray]:
    """Lifetimes in s of what begins and ends within the movie: found, and true."""
    end, step = len(case.movie) - 1, case.movie.time_step_s
    table = tracks.track_table
    complete = (table.first_timepoint > 0) & (table.last_timepoint < end)
    true = [s.last - s.first + 1 for s in spells(case, gap) if s.first > 0 and s.last < end]
    return table.lifetime_s[complete].to_numpy(), np.array(true) * step


# Entries -------------------------------------------------------------------------------


def measure(seeds: tuple[int, ...], timepoints: int, methods: tuple[str, ...]) -> Entries:
    """Links and lifetimes of every movie; lifetimes and identities over the borders of all."""
    entries: Entries = {}
    borders: dict[str, Counter[str]] = {method: Counter() for method in methods}
    together: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {method: [] for method in methods}
    for seed in seeds:
        case = unwrapped("blebs", seed, timepoints, protrusions=False)
        for method in methods:
            parameters = with_method(case.movie.parameters, method)
            start = time.process_time()
            track_protrusions(case.movie, parameters)
            finding = time.process_time() - start
            start = time.process_time()
            tracks = track_protrusions(case.movie, parameters)
            seconds = time.process_time() - start
            who = identities(case, parameters)
            gap = int(parameters.tracking.gap_s / case.movie.time_step_s + 1e-9)
            found = links(case, tracks, who, gap)
            for name, entry in found.items():
                entries[f"tracks/{name}-{method}/blebs-{seed}"] = entry
            only = over_border(case, parameters, who)
            kept, count = kept_identities(case, tracks, who, gap, only)
            borders[method].update(kept=kept, count=count)
            everyone = kept_identities(case, tracks, who, gap, set(who.values()))
            print(
                f"  seed {seed}, {method}: {len(tracks.ids)} tracks; identity kept in "
                f"{everyone[0]} of {everyone[1]} blebs, over a border in {kept} of {count}; "
                f"{finding:.1f} CPU s, {seconds:.1f} without finding protrusions"
            )
            lived = lifetimes(case, tracks, gap)
            entries |= of_lifetimes(*lived, f"{method}/blebs-{seed}")
            together[method].append(lived)
    for method, parts in together.items():
        found_s, true_s = (np.concatenate(side) for side in zip(*parts, strict=True))
        entries |= of_lifetimes(found_s, true_s, f"{method}/blebs")
    for method, counted in borders.items():
        share = counted["kept"] / counted["count"] if counted["count"] else None
        name = f"tracks/identity-border-{method}/blebs"
        entries[name] = SEAM_BAR.entry(share, blebs=counted["count"])
    return entries


def of_lifetimes(found: np.ndarray, true: np.ndarray, name: str) -> Entries:
    """How far lifetimes that were found are from the true ones, of one movie or of all."""
    error = abs(found.mean() / true.mean() - 1) if len(found) else None
    distance = ks_2samp(found, true).statistic if len(found) else None
    return {
        f"tracks/lifetime-mean-{name}": MEAN_BAR.entry(
            error,
            mean_s=results.significant(float(found.mean()), 4) if len(found) else None,
            true_s=results.significant(float(true.mean()), 4),
        ),
        f"tracks/lifetime-ks-{name}": KS_BAR.entry(distance, tracks=len(found), blebs=len(true)),
    }


def walkers(seed: int) -> Entries:
    """Objects all over a ball that turns: those that cross the seam or come to a pole."""
    rng = np.random.default_rng(seed)
    start = spread(WALKERS) + rng.normal(0, 0.1, (WALKERS, 3))
    start /= np.linalg.norm(start, axis=1, keepdims=True)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turns = STEP_UM / BALL_UM * np.arange(WALK)[:, None] * axis
    path = np.stack([Rotation.from_rotvec(turn).apply(start) for turn in turns])
    size = rng.uniform(1.0, 6.0, WALKERS)
    tables = [(t, walked(rng, path[t], size)) for t in range(WALK)]
    tracking = unwrap3d.Parameters().tracking
    tracks = link_tables(tables, tracking, time_step_s=1.21, timepoints=WALK, rows=256)
    places = direction_to_uv(path.reshape(-1, 3), 256).reshape(WALK, WALKERS, 2)
    steps = np.abs(np.diff(places[..., 1], axis=0)).max(axis=0)
    polar = np.minimum(places[..., 0], 255 - places[..., 0]).min(axis=0)
    crossing = np.flatnonzero((steps > 128) | (polar < POLE_PX)) + 1
    holds = [set(tracks.columns["label"][tracks.rows_of(k)].tolist()) for k in tracks.ids.tolist()]
    kept = sum({one} in holds and sum(one in h for h in holds) == 1 for one in crossing.tolist())
    entry = SEAM_BAR.entry(kept / len(crossing), objects=len(crossing))
    return {f"tracks/identity-border-walkers/{seed}": entry}


def spread(count: int) -> np.ndarray:
    """Directions (count, 3), evenly spread over the sphere."""
    number = np.arange(count) + 0.5
    height = 1 - 2 * number / count
    angle = np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - height**2)
    return np.stack([height, flat * np.cos(angle), flat * np.sin(angle)], axis=1)


def walked(rng: np.random.Generator, directions: np.ndarray, size: np.ndarray) -> dict[str, Any]:
    """The table of protrusions that stand in some directions (k, 3) of a ball."""
    feet = BALL_UM * directions + rng.normal(0, NOISE_UM, directions.shape)
    place = direction_to_uv(directions, 256)
    return {
        "label": np.arange(1, len(feet) + 1),
        **dict(zip(("z_um", "y_um", "x_um"), feet.T, strict=True)),
        **dict(zip(FOOT, feet.T, strict=True)),
        **dict(zip(("v_px", "u_px"), place.T, strict=True)),
        "area_um2": size * rng.normal(1, 0.05, len(size)),
        "height_max_um": np.sqrt(size) / 2 * rng.normal(1, 0.05, len(size)),
    }


def with_method(parameters: unwrap3d.Parameters, method: str) -> unwrap3d.Parameters:
    """The defaults of today, whatever they were when the movie was unwrapped."""
    today = unwrap3d.Parameters()
    tracking = today.tracking.model_copy(update={"method": method})
    return parameters.model_copy(update={"tracking": tracking, "boxes": today.boxes})


def trackmate() -> Entries:
    """The links of TrackMate's simple LAP tracker on its own spots."""
    entries: Entries = {}
    for name, gap in (("with", 1), ("without", 0)):
        if not TRACKMATE.is_dir():
            note = "the data are not beside the project"
            entries[f"tracks/trackmate/{name}-gaps"] = TRACKMATE_BAR.entry(None, note=note)
            continue
        stem = f"trackmate_tracks_{name}_gap_closing"
        spots = pd.read_csv(TRACKMATE / f"{stem}_spots.csv")
        edges = pd.read_csv(TRACKMATE / f"{stem}_edges.csv")
        where, when = spots[["position_x", "position_y"]].to_numpy(), spots["frame"].to_numpy()
        found = link(where, when, longest_step_um=TRACKMATE_STEP, gap_timepoints=gap)
        ids = spots["id"].to_numpy()
        made = {(int(ids[a]), int(ids[b])) for a, b in found.links(when)}
        true = set(map(tuple, edges[["spot_source_id", "spot_target_id"]].to_numpy().tolist()))
        shared = len(made & true) / len(made | true)
        entries[f"tracks/trackmate/{name}-gaps"] = TRACKMATE_BAR.entry(shared, links=len(true))
    return entries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--timepoints", type=int, default=TIMEPOINTS)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    options = parser.parse_args()
    entries = measure(tuple(options.seeds), options.timepoints, tuple(options.methods))
    for seed in options.seeds:
        entries |= walkers(seed)
    entries |= trackmate()
    results.show(entries)
    scored = tuple(options.seeds) == SEEDS and options.timepoints == TIMEPOINTS
    if scored and set(options.methods) == set(METHODS):
        results.merge(entries)


if __name__ == "__main__":
    main()
