"""Splits and merges of tracks under edits: pairs of tracks, and when they happened."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ..charts import Ints, Tracks

Spans = Mapping[int, tuple[int, int]]
NEVER = (-1, -1)
# The method of tracks that a person has edited.
EDITED = "edited"


def spans(track: Ints, timepoint: Ints) -> dict[int, tuple[int, int]]:
    """The first and the last timepoint of every track, of rows (n,) in any order."""
    order = np.lexsort((timepoint, track))
    ids, first = np.unique(track[order], return_index=True)
    last = np.append(first[1:], len(track)) - 1
    times = timepoint[order]
    pairs = zip(times[first].tolist(), times[last].tolist(), strict=True)
    return dict(zip(ids.tolist(), pairs, strict=True))


def possible(pairs: Ints, lives: Spans, end: int) -> Ints:
    """Pairs of tracks that are there, of which the first begins (end 0), or ends (1), earlier."""
    kept = [
        one in lives and other in lives and lives[one][end] < lives[other][end]
        for one, other in pairs.tolist()
    ]
    found: Ints = pairs[np.array(kept, bool)]
    return found


def renamed(pairs: Ints, names: Mapping[int, int]) -> Ints:
    """Pairs under other numbers, each once, without those of a track with itself."""
    found = _renamed_where(pairs, names, np.ones(pairs.shape, bool))
    unique: Ints = np.unique(found[~_same(found)[:, 0]], axis=0)
    return unique


def exchanged(
    tracks: Tracks, one: int, other: int, timepoint: int, lives: Spans
) -> tuple[Ints, Ints]:
    """Splits and merges after what two tracks are from a timepoint on has changed hands.

    Parameters
    ----------
    tracks : Tracks
        Before.
    one, other : int
    timepoint : int
    lives : mapping
        The :func:`spans` of the tracks after.
    """
    names = {one: other, other: one}
    begun, ended = _split_times(tracks), _merge_times(tracks)
    splits = _renamed_where(tracks.splits, names, begun >= timepoint)
    merges = _renamed_where(tracks.merges, names, ended >= timepoint)
    # Where one came out of the other just here, it still does: the branches change places.
    splits = np.where(_same(splits), tracks.splits, splits)
    merges = np.where(_same(merges), tracks.merges[:, ::-1], merges)
    # A track that begins earlier than it did comes out of none, one that goes on ends in none.
    begins = np.array([lives.get(child, NEVER)[0] for child in splits[:, 1].tolist()], np.int64)
    ends = np.array([lives.get(track, NEVER)[1] for track in merges[:, 0].tolist()], np.int64)
    return splits[begins == begun[:, 1]], merges[ends == ended[:, 0]]


def _split_times(tracks: Tracks) -> Ints:
    """When each end (k, 2) of a split is: the parent before its child begins."""
    found = []
    for parent, child in tracks.splits.tolist():
        begin = int(_times(tracks, child)[0])
        times = _times(tracks, parent)
        earlier = times[times < begin]
        found.append((int(earlier[-1] if len(earlier) else times[0]), begin))
    return np.array(found, np.int64).reshape(-1, 2)


def _merge_times(tracks: Tracks) -> Ints:
    """When each end (k, 2) of a merge is: the track it goes into after it has ended."""
    found = []
    for track, into in tracks.merges.tolist():
        end = int(_times(tracks, track)[-1])
        times = _times(tracks, into)
        later = times[times > end]
        found.append((end, int(later[0] if len(later) else times[-1])))
    return np.array(found, np.int64).reshape(-1, 2)


def _times(tracks: Tracks, track: int) -> Ints:
    return tracks.timepoint[tracks.rows_of(track)]


def _renamed_where(pairs: Ints, names: Mapping[int, int], where: npt.NDArray[np.bool_]) -> Ints:
    others = [[names.get(track, track) for track in pair] for pair in pairs.tolist()]
    found: Ints = np.where(where, np.array(others, np.int64).reshape(-1, 2), pairs)
    return found


def _same(pairs: Ints) -> npt.NDArray[np.bool_]:
    """Which pairs (k, 1) are of a track with itself."""
    same: npt.NDArray[np.bool_] = pairs[:, :1] == pairs[:, 1:]
    return same
