"""The lines that tracks are drawn as, in space and on the uv image.

A step of a track that goes over the seam or over a pole of the image is no line from one of its
borders to the other: it leaves the image at a border, and comes in again where the sphere goes
on. Tracks that come out of another one, or go into one, are joined to it by a line of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Tracks
from ..errors import InputError
from ..geometry.padding import wrap_uv


@dataclass(frozen=True, eq=False)
class TrackLines:
    """Lines through places at times, a row per vertex, sorted by (`line`, `time`).

    Attributes
    ----------
    line : ndarray, (m,) int64
        From 1. A track that is not cut is the line of its own number; the others come after.
    time : ndarray, (m,) float64
        In timepoints. At the border of the image a line is between two of them.
    place : ndarray, (m, 3) or (m, 2)
        (z, y, x) in µm, or (v, u) in pixels.
    row : ndarray, (m,) int64
        The row of the tracks whose properties hold there.
    track : ndarray, (m,) int64
        Whose line it is.
    """

    line: Ints
    time: Floats
    place: Floats
    row: Ints
    track: Ints

    def __len__(self) -> int:
        return len(self.line)

    def joined(self) -> npt.NDArray[np.bool_]:
        """(m − 1,): whether a vertex and the next one are ends of one segment."""
        same: npt.NDArray[np.bool_] = self.line[1:] == self.line[:-1]
        return same


@dataclass(frozen=True, eq=False)
class _Chains:
    """Rows of tracks one after the other; those of one chain are joined."""

    chain: Ints
    row: Ints
    track: Ints

    def kept(self, which: npt.NDArray[np.bool_]) -> _Chains:
        return _Chains(self.chain[which], self.row[which], self.track[which])


def lines_in_space(tracks: Tracks) -> TrackLines:
    """The lines of tracks through their positions, with those that join splits and merges.

    Lines of splits and merges are numbered after the last track.
    """
    chains = _chains(tracks)
    place = tracks.position_um[chains.row]
    time = tracks.timepoint[chains.row].astype(np.float64)
    return TrackLines(chains.chain, time, place, chains.row, chains.track)


def lines_on_uv(tracks: Tracks) -> TrackLines:
    """The lines of tracks on the uv image, cut where they go over the seam or a pole.

    Rows whose place is not known are left out.

    Parameters
    ----------
    tracks : Tracks

    Raises
    ------
    InputError
        The tracks do not lie on a uv image.
    """
    if tracks.rows < 1:
        raise InputError(
            "These tracks do not lie on a uv image.", hint="Lay them on the surface first."
        )
    place = wrap_uv(tracks.place_px, tracks.rows)
    chains = _chains(tracks)
    known = np.asarray(np.isfinite(place[chains.row]).all(axis=1))
    chains = chains.kept(known)
    start = _starts(chains)
    here, there = place[chains.row[start]], place[chains.row[start + 1]]
    ahead = _image_near(there, here, tracks.rows)
    cut = np.abs(ahead - there).max(axis=1) > 1e-6 if len(start) else np.zeros(0, bool)
    leaves = _leaving(here[cut], ahead[cut], tracks.rows)
    back = _image_near(here[cut], there[cut], tracks.rows)
    comes = _leaving(there[cut], back, tracks.rows)
    return _with_borders(tracks, place, chains, start[cut], leaves, comes)


def _chains(tracks: Tracks) -> _Chains:
    """Tracks, then a chain of two rows for every split and merge."""
    pairs, owners = [], []
    for whole, part in tracks.splits.tolist():
        own, first = tracks.rows_of(whole), tracks.rows_of(part).start
        before = own.start + np.searchsorted(tracks.timepoint[own], tracks.timepoint[first])
        if before > own.start:
            pairs.append((before - 1, first))
            owners.append(part)
    for part, whole in tracks.merges.tolist():
        own, last = tracks.rows_of(whole), tracks.rows_of(part).stop - 1
        time = tracks.timepoint[own]
        after = own.start + np.searchsorted(time, tracks.timepoint[last], side="right")
        if after < own.stop:
            pairs.append((last, after))
            owners.append(part)
    last_track = int(tracks.ids[-1]) if len(tracks.ids) else 0
    extra = last_track + 1 + np.arange(len(pairs), dtype=np.int64)
    ends = np.array(pairs, np.int64).reshape(-1, 2)
    return _Chains(
        np.concatenate([tracks.track_id, np.repeat(extra, 2)]),
        np.concatenate([np.arange(len(tracks), dtype=np.int64), ends.ravel()]),
        np.concatenate([tracks.track_id, np.repeat(np.array(owners, np.int64), 2)]),
    )


def _starts(chains: _Chains) -> Ints:
    """Where the next vertex is of the same chain."""
    starts: Ints = np.flatnonzero(chains.chain[1:] == chains.chain[:-1])
    return starts


def _image_near(place: Floats, other: Floats, rows: int) -> Floats:
    """The same places, written beyond the borders of the image where they are nearer there.

    Both (k, 2) in (v, u).
    """
    v, u = place[:, 0], place[:, 1]
    candidates = np.stack(
        [
            np.stack([v, u], axis=1),
            np.stack([-1.0 - v, u + rows], axis=1),
            np.stack([2.0 * rows - 1.0 - v, u + rows], axis=1),
        ]
    )
    turn = 2.0 * rows
    candidates[..., 1] -= turn * np.rint((candidates[..., 1] - other[:, 1]) / turn)
    nearest = np.argmin(np.linalg.norm(candidates - other, axis=2), axis=0)
    found: Floats = candidates[nearest, np.arange(len(place))]
    return found


def _leaving(here: Floats, ahead: Floats, rows: int) -> tuple[Floats, Floats]:
    """Where straight lines leave the image: which part (k,) of the way, and the place (k, 2)."""
    low, high = np.array([-0.5, -0.5]), np.array([rows - 0.5, 2 * rows - 0.5])
    step = ahead - here
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(step > 0, (high - here) / step, (low - here) / step)
    shares = np.where(np.isfinite(shares), shares, 1.0)
    share = np.clip(shares.min(axis=1, initial=1.0), 0.0, 1.0)
    return share, here + share[:, None] * step


def _with_borders(
    tracks: Tracks,
    place: Floats,
    chains: _Chains,
    cut: Ints,
    leaves: tuple[Floats, Floats],
    comes: tuple[Floats, Floats],
) -> TrackLines:
    """Put the two places at the border behind every vertex where a line is cut."""
    time = tracks.timepoint[chains.row].astype(np.float64)
    first, gap = time[cut], time[cut + 1] - time[cut]
    size = len(chains.row)
    # Where each belongs in the order of all: a vertex, the way out, the way in, the next vertex.
    key = np.concatenate([np.arange(size), cut + 1 / 3, cut + 2 / 3])
    order = np.argsort(key, kind="stable")
    times = np.concatenate([time, first + leaves[0] * gap, first + (1 - comes[0]) * gap])
    source = np.concatenate([np.arange(size), cut, cut + 1])[order]
    places = np.concatenate([place[chains.row], leaves[1], comes[1]])[order]
    begins = np.concatenate([np.zeros(size + len(cut), bool), np.ones(len(cut), bool)])[order]
    chain = chains.chain[source]
    lines = TrackLines(
        _numbered(chain, begins), times[order], places, chains.row[source], chains.track[source]
    )
    # What was cut off goes behind the lines that keep their number.
    moved = np.lexsort((np.arange(len(lines)), lines.line))
    return TrackLines(
        lines.line[moved],
        lines.time[moved],
        lines.place[moved],
        lines.row[moved],
        lines.track[moved],
    )


def _numbered(chain: Ints, begins: npt.NDArray[np.bool_]) -> Ints:
    """A number per line: the chain's own for its first part, then those after all chains."""
    if not len(chain):
        return chain
    part = np.cumsum(begins)
    first = np.r_[True, chain[1:] != chain[:-1]]
    # The count of cuts where each chain begins, then of those within it.
    before: Ints = np.maximum.accumulate(np.where(first, part - begins, 0))
    within: Ints = part - before
    return np.where(within == 0, chain, chain.max() + part)
