"""Tracks in files: is anything lost, and do other programs read what we write.

    .venv/bin/python benchmarks/tracks_files.py
    .venv/bin/python benchmarks/tracks_files.py --seeds 10    # to try something

The blebs of simulated movies are tracked with gaps, splits and merges allowed, written in every
format and read again: whatever is not the same bit for bit counts (columns and their types, links,
times, numbers, where they come from). GEFF is checked by its own validator with everything that it
can check. TrackMate's XML is read by two readers that are not ours, that of the geff library and,
where it is installed (pip install pytrackmate), pytrackmate; and TrackMate's own files are read by
ours and compared with the tables that TrackMate made of them.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from common import results
from common.results import Bar, Entries
from common.unwrapped import unwrapped

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.files.track_graph import graph_of

SEEDS = (0, 1, 2)
TIMEPOINTS = 50
SUFFIXES = (".geff", ".csv", ".parquet", ".xml")
OWN = Path(__file__).resolve().parents[2] / "shared" / "data" / "trackmate"

NOTHING_BAR = Bar(0, "differences after a round trip")
VALID_BAR = Bar(0, "errors of the geff validator")
READ_BAR = Bar(1.0, "of spots and links as written", at_least=True)
LINKS_BAR = Bar(0.995, "of the links in TrackMate's tables", at_least=True)


def tracked(seed: int) -> tuple[unwrap3d.Movie, Tracks]:
    """The tracks of a simulated movie, some of which come out of or go into others."""
    movie = unwrapped("blebs", seed, TIMEPOINTS, protrusions=False).movie
    parameters = unwrap3d.Parameters.from_dict(
        {"tracking": {"split_um": 2.0, "merge_um": 2.0, "gap_s": 3.0}}
    )
    kept = movie.folder.tracks("protrusions")
    key = movie.folder.tracks_key("protrusions")
    tracks = unwrap3d.track_protrusions(movie, parameters)
    if kept is not None:
        movie.keep_tracks("protrusions", kept, key or "")
    return movie, tracks


def differences(found: Tracks, expected: Tracks) -> list[str]:
    """What is not the same in two tracks."""
    lost = [
        name
        for name in ("time_step_s", "timepoints", "rows", "method")
        if getattr(found, name) != getattr(expected, name)
    ]
    lost += [f"column {name}" for name in set(found.columns) ^ set(expected.columns)]
    for name in set(found.columns) & set(expected.columns):
        one, other = found.columns[name], expected.columns[name]
        same = one.dtype == other.dtype and len(one) == len(other)
        if not same or not np.array_equal(one, other, equal_nan=one.dtype.kind == "f"):
            lost.append(f"column {name}")
    for name in ("splits", "merges"):
        if getattr(found, name).tolist() != getattr(expected, name).tolist():
            lost.append(name)
    own, given = (without_provenance(tracks) for tracks in (found, expected))
    lost += [f"number {key}" for key in given if repr(own.get(key)) != repr(given[key])]
    told = found.numbers.get("provenance", {})
    lost += [
        f"provenance {key}"
        for key in ("versions", "movie", "parameters", "tracks")
        if not told.get(key)
    ]
    return lost


def without_provenance(tracks: Tracks) -> dict[str, Any]:
    """Numbers as JSON has them: lists for tuples."""
    from napari_unwrap3d.files.atomic import from_plain, plain

    numbers = {key: value for key, value in tracks.numbers.items() if key != "provenance"}
    plain_numbers: dict[str, Any] = from_plain(plain(numbers))
    return plain_numbers


def measure(seed: int) -> Entries:
    """The entries of one movie."""
    movie, tracks = tracked(seed)
    told = {
        "tracks": len(tracks.ids),
        "rows": len(tracks),
        "columns": len(tracks.columns),
        "splits": len(tracks.splits),
        "merges": len(tracks.merges),
    }
    entries: Entries = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for suffix in SUFFIXES:
            start = time.process_time()
            path = unwrap3d.write_tracks(folder / f"t{suffix}", tracks, movie, name="protrusions")
            lost = differences(unwrap3d.read_tracks(path), tracks)
            seconds = time.process_time() - start
            entries[f"tracks/files-{suffix[1:]}/blebs-{seed}"] = NOTHING_BAR.entry(
                len(lost), lost=", ".join(lost), cpu_s=results.significant(seconds, 2), **told
            )
        error = geff_error(folder / "t.geff")
        entries[f"tracks/files-geff-valid/blebs-{seed}"] = VALID_BAR.entry(
            int(bool(error)), error=error
        )
        for reader, share in read_by_others(folder, tracks).items():
            entries[f"tracks/files-xml-{reader}/blebs-{seed}"] = READ_BAR.entry(share)
    return entries


def geff_error(path: Path) -> str:
    """What the validator says, empty if nothing."""
    from geff import validate_structure
    from geff.core_io import read_to_memory
    from geff.validate.data import ValidationConfig

    everything = ValidationConfig(
        graph=True, sphere=True, ellipsoid=True, lineage=True, tracklet=True
    )
    try:
        validate_structure(path)
        read_to_memory(path, data_validation=everything)
    except ValueError as error:
        return str(error)
    return ""


def read_by_others(folder: Path, tracks: Tracks) -> dict[str, float]:
    """Which share of the spots and links other readers find in the XML."""
    from geff.convert import from_trackmate_xml_to_geff
    from geff.core_io import read_to_memory

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the image's folder is not known
        from_trackmate_xml_to_geff(folder / "t.xml", folder / "theirs.geff")
        theirs = read_to_memory(folder / "theirs.geff")
    spots = pd.DataFrame(
        {name: prop["values"] for name, prop in theirs["node_props"].items() if name != "name"}
    )
    spots["ID"] = theirs["node_ids"].astype(int)
    links = {tuple(edge) for edge in theirs["edge_ids"].astype(int).tolist()}
    found = {"geff": share(spots, links, tracks)}
    if importlib.util.find_spec("pytrackmate") is not None:
        import pytrackmate

        read = pytrackmate.trackmate_peak_import(str(folder / "t.xml"))
        names = {"spot_id": "ID", "t_stamp": "FRAME"}
        names |= {axis: f"POSITION_{axis.upper()}" for axis in "zyx"}
        found["pytrackmate"] = share(read.rename(columns=names), None, tracks)
    return found


def share(spots: pd.DataFrame, links: set[Any] | None, tracks: Tracks) -> float:
    """Which share of spots has its place and time, and of links is there (None: not asked)."""
    spots = spots.set_index(spots["ID"].astype(int)).reindex(range(len(tracks)))
    columns = ["FRAME", "POSITION_Z", "POSITION_Y", "POSITION_X"]
    written = np.column_stack([tracks.timepoint, tracks.position_um])
    good = (spots[columns].to_numpy(float) == written).all(axis=1)
    wanted = {tuple(edge) for edge in graph_of(tracks).edges.tolist()}
    if links is None:
        return float(good.mean())
    both = len(wanted & links) / max(len(wanted | links), 1)
    return float(min(good.mean(), both))


def trackmates_own() -> Entries:
    """Our reader on TrackMate's files."""
    entries: Entries = {}
    for path in sorted(OWN.glob("*.xml")):
        found = unwrap3d.read_tracks(path, voxel_size=(1, 1, 1))
        edges = pd.read_csv(path.with_name(f"{path.stem}_edges.csv"))
        wanted = set(zip(edges["spot_source_id"], edges["spot_target_id"], strict=True))
        spots = found.columns["spot_id"][graph_of(found).edges]
        ours = {tuple(edge) for edge in spots.tolist()}
        which = path.stem.removeprefix("trackmate_tracks_").replace("_", "-")
        entries[f"tracks/files-xml-read/{which}"] = LINKS_BAR.entry(
            len(wanted & ours) / len(wanted | ours), links=len(wanted)
        )
    return entries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    options = parser.parse_args()
    scored = tuple(options.seeds) == SEEDS
    entries = trackmates_own()
    results.show(entries)
    if scored:
        results.merge(entries)
    for seed in options.seeds:
        entries = measure(seed)
        results.show(entries)
        if scored:
            results.merge(entries)


if __name__ == "__main__":
    main()
