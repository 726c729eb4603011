"""Tracks in files: what goes in comes out, and other programs read what we write."""

import csv
import json
import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import FileFormatError, InputError
from napari_unwrap3d.files.track_graph import graph_of, tracks_of_graph
from napari_unwrap3d.files.tracks import read_tracks, write_tracks
from tracked import assert_same, rich_tracks

SUFFIXES = (".geff", ".csv", ".parquet", ".xml")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_round_trips_lose_nothing(tmp_path: Path, suffix: str) -> None:
    path = write_tracks(tmp_path / f"tracks{suffix}", rich_tracks(), name="protrusions")
    found = read_tracks(path)
    assert_same(found, rich_tracks())
    versions = found.numbers["provenance"]["versions"]
    assert versions["napari-unwrap3d"] == unwrap3d.__version__
    # And again, with what it has been told meanwhile.
    again = read_tracks(write_tracks(tmp_path / f"again{suffix}", found))
    assert_same(again, rich_tracks())
    assert again.numbers["provenance"]["tracks"] == "protrusions"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_tracks_without_rows_are_tracks(tmp_path: Path, suffix: str) -> None:
    none = rich_tracks().kept([])
    assert len(read_tracks(write_tracks(tmp_path / f"none{suffix}", none))) == 0


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_are_the_same_bytes_each_time(tmp_path: Path, suffix: str) -> None:
    paths = [write_tracks(tmp_path / f"{n}{suffix}", rich_tracks()) for n in "ab"]
    files = [
        [entry.read_bytes() for entry in sorted(path.rglob("*")) if entry.is_file()]
        if path.is_dir()
        else [path.read_bytes()]
        for path in paths
    ]
    assert files[0] == files[1]


def test_suffixes_and_missing_files_are_told(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"\.geff, .*\.csv"):
        write_tracks(tmp_path / "tracks.trk", rich_tracks())
    with pytest.raises(InputError, match="There is no"):
        read_tracks(tmp_path / "tracks.csv")
    (tmp_path / "x.xml").write_text("<Other/>")
    (tmp_path / "x.parquet").write_text("no")
    (tmp_path / "x.csv").write_text("a,b\n1,2\n")
    (tmp_path / "x.geff").mkdir()
    for suffix in SUFFIXES:
        with pytest.raises(FileFormatError):
            read_tracks(tmp_path / f"x{suffix}")
    with pytest.raises(InputError, match="no GEFF"):
        write_tracks(tmp_path / "x.geff", rich_tracks())


# The graph -----------------------------------------------------------------------


def test_a_graph_of_tracks_has_an_edge_for_every_link_split_and_merge() -> None:
    tracks = rich_tracks()
    graph = graph_of(tracks)
    kinds = np.bincount(graph.kind).tolist()
    assert kinds == [len(tracks) - len(tracks.ids), 2, 1]
    track, time = tracks.track_id[graph.edges], tracks.timepoint[graph.edges]
    assert (time[:, 1] > time[:, 0]).all()
    assert track[graph.kind == 1].tolist() == [[1, 2], [3, 5]]
    assert track[graph.kind == 2].tolist() == [[4, 1]]
    assert (track[graph.kind == 0][:, 0] == track[graph.kind == 0][:, 1]).all()


def test_tracks_of_a_graph_are_its_unbranched_paths() -> None:
    time = np.array([0, 1, 2, 2, 3, 4, 0])
    edges = np.array([[0, 1], [1, 2], [3, 1], [2, 4], [3, 4], [5, 4]])
    track, splits, merges = tracks_of_graph(time, edges)
    assert track.tolist() == [1, 1, 3, 4, 5, 5, 2]
    assert {tuple(pair) for pair in splits.tolist()} == {(1, 3), (1, 4)}
    assert {tuple(pair) for pair in merges.tolist()} == {(3, 5), (4, 5)}
    with pytest.raises(FileFormatError, match="one timepoint"):
        tracks_of_graph(time, np.array([[2, 3]]))


# GEFF ----------------------------------------------------------------------------


def test_geff_is_valid_in_everything_that_its_validator_knows(tmp_path: Path) -> None:
    from geff import validate_structure
    from geff.core_io import read_to_memory
    from geff.validate.data import ValidationConfig

    path = write_tracks(tmp_path / "tracks.geff", rich_tracks())
    validate_structure(path)
    everything = ValidationConfig(graph=True, lineage=True, tracklet=True)
    found = read_to_memory(path, data_validation=everything)
    axes = {axis.name: axis for axis in found["metadata"].axes}
    assert [axes[name].unit for name in "zyx"] == ["micrometer"] * 3
    assert (axes["t"].unit, axes["t"].scale, axes["t"].scaled_unit) == ("frame", 1.21, "second")
    units = {key: prop.unit for key, prop in found["metadata"].node_props_metadata.items()}
    assert units["area_um2"] == "micrometer^2"
    assert units["v_px"] == "pixel"
    assert units["mean_curvature_per_um"] == "1/micrometer"


def without_record(path: Path) -> Path:
    """A GEFF as another program would write it: what is only ours is taken out."""
    for name in (".zattrs", "zarr.json"):
        if (path / name).is_file():
            attributes = json.loads((path / name).read_text())
            attributes["geff"]["extra"] = {}
            (path / name).write_text(json.dumps(attributes))
    return path


def links_of(tracks: Tracks) -> set[tuple[tuple[float, ...], ...]]:
    """Pairs of places that are linked in any way."""
    position = np.round(np.column_stack([tracks.timepoint, tracks.position_um]), 9)
    return {tuple(map(tuple, position[edge].tolist())) for edge in graph_of(tracks).edges}


def test_a_geff_of_another_program_is_read_by_its_axes(tmp_path: Path) -> None:
    path = without_record(write_tracks(tmp_path / "tracks.geff", rich_tracks()))
    found = read_tracks(path)
    assert found.method == "imported"
    assert found.time_step_s == 1.21
    assert links_of(found) == links_of(rich_tracks())
    # Track 1 ends where 2 comes out of it and where 4 goes into it; 5 is the end of 3.
    assert len(found.ids) == len(rich_tracks().ids) + 2 - 1
    assert sorted(found.columns["area_um2"][~np.isnan(found.columns["area_um2"])]) == sorted(
        rich_tracks().columns["area_um2"][~np.isnan(rich_tracks().columns["area_um2"])]
    )


def test_a_geff_in_pixels_needs_their_size(tmp_path: Path) -> None:
    from geff.core_io import write_dicts
    from geff_spec import Axis, GeffMetadata

    nodes = [(n, {"t": n % 3, "y": 2.0 * n, "x": 1.0}) for n in range(3)]
    axes = [Axis(name=name, type="space", unit="pixel") for name in "yx"]
    none = {"node_props_metadata": {}, "edge_props_metadata": {}}
    metadata = GeffMetadata(axes=[Axis(name="t", type="time"), *axes], directed=True, **none)
    edges = [((0, 1), {}), ((1, 2), {})]
    write_dicts(tmp_path / "flat.geff", nodes, edges, ["t", "y", "x"], [], metadata)
    with pytest.raises(InputError, match="voxel_size"):
        read_tracks(tmp_path / "flat.geff", time_step=1.0)
    with pytest.raises(InputError, match="time_step"):
        read_tracks(tmp_path / "flat.geff", voxel_size=(1, 0.5, 0.5))
    found = read_tracks(tmp_path / "flat.geff", voxel_size=(1, 0.5, 0.5), time_step=2.0)
    assert found.position_um.tolist() == [[0, 0, 0.5], [0, 1, 0.5], [0, 2, 0.5]]
    assert found.times_s.tolist() == [0, 2, 4]


# Tables --------------------------------------------------------------------------


def test_a_csv_is_read_by_anybody(tmp_path: Path) -> None:
    tracks = rich_tracks()
    path = write_tracks(tmp_path / "tracks.csv", tracks)
    found = pd.read_csv(path)
    first = ["track_id", "timepoint", "time_s", "parent_track_id", "into_track_id", "z_um"]
    assert list(found.columns[:6]) == first
    np.testing.assert_array_equal(found["x_um"], tracks.columns["x_um"])
    np.testing.assert_array_equal(found["time_s"], tracks.times_s)
    assert found.groupby("track_id")["parent_track_id"].first().to_dict()[2] == 1
    assert found.groupby("track_id")["into_track_id"].first().to_dict()[4] == 1
    with path.open(newline="") as file:
        assert {len(row) for row in csv.reader(file)} == {len(found.columns)}


def test_a_csv_without_its_json_keeps_rows_times_and_links(tmp_path: Path) -> None:
    tracks = rich_tracks()
    path = write_tracks(tmp_path / "tracks.csv", tracks)
    path.with_suffix(".json").unlink()
    found = read_tracks(path, timepoints=10)
    assert found.time_step_s == pytest.approx(1.21, rel=1e-12)
    assert found.splits.tolist() == tracks.splits.tolist()
    assert found.merges.tolist() == tracks.merges.tolist()
    assert set(tracks.columns) <= set(found.columns)
    for name in ("track_id", "timepoint", "x_um", "v_px", "area_um2", "label", "kind"):
        np.testing.assert_array_equal(found.columns[name], tracks.columns[name], err_msg=name)


def test_a_csv_that_a_spreadsheet_saved_again_is_read(tmp_path: Path) -> None:
    tracks = rich_tracks()
    path = write_tracks(tmp_path / "tracks.csv", tracks)
    table = pd.read_csv(path, keep_default_na=False, na_values={"area_um2": ["nan"]})
    table["label"] = table["label"].astype(float)
    table[table["track_id"] != 2].to_csv(path, index=False)
    found = read_tracks(path)
    assert_same(
        replace(found, splits=tracks.kept([1, 3, 4, 5, 7]).splits), tracks.kept([1, 3, 4, 5, 7])
    )
    assert found.splits.tolist() == [[3, 5]]
    assert found.numbers["provenance"]["links_of_missing_tracks"] == 1
    table["label"] = "three"
    table.to_csv(path, index=False)
    with pytest.raises(FileFormatError, match="label"):
        read_tracks(path)


def test_times_alone_are_timepoints(tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    rows = [f"1,{1.21 * k!r},0,0,0" for k in (2, 3, 4, 7)] + ["2,3.6300000000000003,1,1,1"]
    path.write_text("\n".join(["track_id,time_s,z_um,y_um,x_um", *rows]))
    found = read_tracks(path)
    assert found.timepoint.tolist() == [2, 3, 4, 7, 3]
    assert found.time_step_s == pytest.approx(1.21)
    with pytest.raises(FileFormatError, match="whole number"):
        read_tracks(path, time_step=1.0)


def test_tables_of_other_programs_are_understood(tmp_path: Path) -> None:
    path = tmp_path / "spots.csv"
    lines = [
        "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME",
        "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame",
        "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame",
        ",,,(quality),(micron),(micron),(micron),(sec),",
        "ID1,1,0,5.0,1.5,2.5,3.5,0.0,0",
        "ID2,2,0,5.0,1.6,2.6,3.6,2.0,1",
        "ID3,3,,5.0,9.0,9.0,9.0,2.0,1",
    ]
    path.write_text("\n".join(lines))
    found = read_tracks(path)
    assert found.track_id.tolist() == [1, 1]
    assert found.position_um.tolist() == [[3.5, 2.5, 1.5], [3.6, 2.6, 1.6]]
    assert found.time_step_s == 2.0
    assert found.columns["LABEL"].tolist() == ["ID1", "ID2"]
    napari = tmp_path / "napari.csv"
    napari.write_text("index,ID,t,axis-1,axis-2,axis-3\n0,3,0,1,2,3\n1,3,1,1,2,4\n")
    with pytest.raises(InputError, match="voxel_size"):
        read_tracks(napari, time_step=1.0)
    assert read_tracks(napari, time_step=1.0, voxel_size=(2, 1, 1)).position_um.tolist() == [
        [2, 2, 3],
        [2, 2, 4],
    ]


def test_a_table_of_places_on_the_image_alone_has_none_in_space(tmp_path: Path) -> None:
    path = tmp_path / "uv.csv"
    path.write_text("track_id,timepoint,v_px,u_px\n1,0,3,4\n1,1,3,5\n")
    found = read_tracks(path, time_step=1.0)
    assert np.isnan(found.position_um).all()
    assert found.place_px.tolist() == [[3, 4], [3, 5]]
    path.write_text("track_id,timepoint\n1,0\n")
    with pytest.raises(InputError, match="no places"):
        read_tracks(path, time_step=1.0)


def test_a_track_at_two_places_at_a_time_is_none(tmp_path: Path) -> None:
    path = tmp_path / "twice.csv"
    path.write_text("track_id,timepoint,z_um,y_um,x_um\n1,0,1,1,1\n1,0,2,2,2\n")
    with pytest.raises(FileFormatError, match="no tracks"):
        read_tracks(path, time_step=1.0)


# TrackMate -----------------------------------------------------------------------


def test_trackmate_files_have_the_elements_of_trackmate(tmp_path: Path) -> None:
    root = ET.parse(write_tracks(tmp_path / "tracks.xml", rich_tracks())).getroot()
    assert [element.tag for element in root] == ["Log", "Model", "Settings", "GUIState"]
    model = root.find("Model")
    assert model is not None
    assert dict(model.attrib) == {"spatialunits": "micron", "timeunits": "sec"}
    spots = [int(spot.attrib["ID"]) for spot in model.iter("Spot")]
    assert sorted(spots) == list(range(len(rich_tracks())))
    declared = {
        group.tag: {feature.attrib["feature"] for feature in group}
        for group in model.iterfind("FeatureDeclarations/*")
    }
    for tag, elements in (("SpotFeatures", "Spot"), ("EdgeFeatures", "Edge")):
        told = {key for element in model.iter(elements) for key in element.attrib}
        assert told - {"ID", "name"} <= declared[tag]
    for track in model.iter("Track"):
        assert set(track.attrib) - {"name"} == declared["TrackFeatures"]
    single = {7}
    linked = {row for edge in model.iter("Edge") for row in (int(edge.attrib["SPOT_SOURCE_ID"]),)}
    tracks = rich_tracks()
    assert not single & set(tracks.track_id[list(linked)].tolist())
    # Numbers alone: TrackMate reads every attribute of a spot but its name as one.
    for spot in model.iter("Spot"):
        assert set(spot.attrib) - {"ID", "name"} == declared["SpotFeatures"]
        values = [value for key, value in spot.attrib.items() if key != "name"]
        java = {"NaN", "Infinity"}
        assert np.isfinite([float(value) for value in values if value not in java]).all()
        assert java >= {value for value in values if not np.isfinite(float(value))}


def test_an_independent_reader_finds_the_same_tracks(tmp_path: Path) -> None:
    """The reader of TrackMate's files in the geff library."""
    from geff.convert import from_trackmate_xml_to_geff

    tracks = rich_tracks()
    path = write_tracks(tmp_path / "tracks.xml", tracks)
    with warnings.catch_warnings():
        # It warns that the image's folder is not known.
        warnings.simplefilter("ignore", UserWarning)
        from_trackmate_xml_to_geff(path, tmp_path / "converted.geff")
    found = read_tracks(tmp_path / "converted.geff", time_step=tracks.time_step_s)
    assert links_of(found) == links_of(tracks)
    assert sorted(found.columns["UNWRAP3D_LABEL"]) == sorted(tracks.columns["label"])


def test_links_that_were_changed_in_trackmate_hold(tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "tracks.xml", rich_tracks())
    tree = ET.parse(path)
    track = next(tree.getroot().iter("Track"))
    removed = track.findall("Edge")[0]
    track.remove(removed)
    tree.write(path)
    found = read_tracks(path)
    ends = [int(removed.attrib[f"SPOT_{end}_ID"]) for end in ("SOURCE", "TARGET")]
    position = rich_tracks().position_um[ends]
    gone = {
        pair
        for pair in links_of(rich_tracks())
        if np.allclose([pair[0][1:], pair[1][1:]], position)
    }
    assert len(gone) == 1
    assert links_of(found) == links_of(rich_tracks()) - gone
    assert found.method == "imported"
    assert set(found.columns) == set(rich_tracks().columns)


def test_trackmate_cannot_hold_rows_without_a_place(tmp_path: Path) -> None:
    tracks = rich_tracks()
    place = tracks.columns["z_um"].copy()
    place[0] = np.nan
    with pytest.raises(InputError, match="rows = 1"):
        write_tracks(tmp_path / "tracks.xml", tracks.with_columns(z_um=place))
    # The others can.
    for suffix in (".geff", ".csv", ".parquet"):
        written = write_tracks(tmp_path / f"t{suffix}", tracks.with_columns(z_um=place))
        assert_same(read_tracks(written), tracks.with_columns(z_um=place))


TRACKMATE = """<?xml version="1.0"?>
<TrackMate version="7.9.2"><Log>by hand</Log>
<Model spatialunits="pixel" timeunits="min"><FeatureDeclarations><SpotFeatures>
<Feature feature="QUALITY" name="Quality" shortname="Q" dimension="QUALITY" isint="false" />
</SpotFeatures><EdgeFeatures /><TrackFeatures /></FeatureDeclarations>
<AllSpots nspots="5">
<SpotsInFrame frame="0"><Spot ID="10" name="a" QUALITY="1.5" POSITION_X="1" POSITION_Y="2"
POSITION_Z="3" FRAME="0" /></SpotsInFrame>
<SpotsInFrame frame="1"><Spot ID="11" name="b" POSITION_X="1" POSITION_Y="2" POSITION_Z="3"
FRAME="1" /><Spot ID="12" name="c" QUALITY="1" POSITION_X="5" POSITION_Y="2" POSITION_Z="3"
FRAME="1" /></SpotsInFrame>
<SpotsInFrame frame="3"><Spot ID="13" name="d" QUALITY="1" POSITION_X="5" POSITION_Y="2"
POSITION_Z="3" FRAME="3" /><Spot ID="14" name="e" POSITION_X="0" POSITION_Y="0" POSITION_Z="0"
FRAME="3" /></SpotsInFrame></AllSpots>
<AllTracks><Track name="t" TRACK_ID="0"><Edge SPOT_SOURCE_ID="10" SPOT_TARGET_ID="11" />
<Edge SPOT_SOURCE_ID="12" SPOT_TARGET_ID="10" /></Track>
<Track name="u" TRACK_ID="1"><Edge SPOT_SOURCE_ID="12" SPOT_TARGET_ID="13" /></Track></AllTracks>
<FilteredTracks><TrackID TRACK_ID="{kept}" /></FilteredTracks></Model>
<Settings><ImageData filename="a.tif" nframes="6" timeinterval="0.5" /></Settings></TrackMate>
"""


def test_trackmates_own_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "theirs.xml"
    path.write_text(TRACKMATE.format(kept=0))
    with pytest.raises(InputError, match="voxel_size"):
        read_tracks(path)
    found = read_tracks(path, voxel_size=(2, 1, 0.5))
    # Only the track that was not filtered out; an edge may be written backwards.
    assert found.columns["spot_id"].tolist() == [10, 11, 12]
    assert found.splits.tolist() == [[1, 2], [1, 3]]
    assert found.position_um[0].tolist() == [6, 2, 0.5]
    assert (found.time_step_s, found.timepoints) == (30.0, 6)
    assert np.isnan(found.columns["QUALITY"]).tolist() == [False, True, False]
    assert found.numbers["provenance"]["imported"]["spots_in_no_track"] == 2
    path.write_text(TRACKMATE.format(kept=7))
    with pytest.raises(FileFormatError, match="no tracks"):
        read_tracks(path)


def test_a_gap_is_a_link(tmp_path: Path) -> None:
    path = tmp_path / "theirs.xml"
    path.write_text(TRACKMATE.format(kept=1))
    found = read_tracks(path, voxel_size=(1, 1, 1))
    assert found.track_id.tolist() == [1, 1]
    assert found.timepoint.tolist() == [1, 3]


def test_another_version_is_told(tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "tracks.csv", rich_tracks())
    record = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps({**record, "schema_version": 99}))
    with pytest.raises(FileFormatError, match="Update"):
        read_tracks(path)


def test_numbers_of_an_edit_go_along(tmp_path: Path) -> None:
    tracks = replace(rich_tracks(), numbers={"edits": [{"edit": "cut", "tracks": [1, 8]}]})
    for suffix in SUFFIXES:
        found = read_tracks(write_tracks(tmp_path / f"t{suffix}", tracks))
        assert found.numbers["edits"] == [{"edit": "cut", "tracks": [1, 8]}]


# TrackMate's own data ------------------------------------------------------------


@pytest.fixture(params=["with", "without"])
def theirs(shared_data: Path, request: pytest.FixtureRequest) -> Path:
    path = shared_data / "trackmate" / f"trackmate_tracks_{request.param}_gap_closing.xml"
    if not path.is_file():
        pytest.skip("TrackMate's files are not there")
    return path


def edges_of_spots(tracks: Tracks) -> set[tuple[int, int]]:
    spots = tracks.columns["spot_id"][graph_of(tracks).edges]
    return {tuple(edge) for edge in spots.tolist()}


def test_links_of_trackmates_files_are_those_of_its_tables(theirs: Path, tmp_path: Path) -> None:
    found = read_tracks(theirs, voxel_size=(1, 1, 1))
    edges = pd.read_csv(theirs.with_name(f"{theirs.stem}_edges.csv"))
    wanted = zip(edges["spot_source_id"], edges["spot_target_id"], strict=True)
    assert edges_of_spots(found) == set(wanted)
    assert len(found.ids) == edges["track_id"].nunique()
    assert len(found.splits) == len(found.merges) == 0
    for suffix in SUFFIXES:
        assert_same(read_tracks(write_tracks(tmp_path / f"t{suffix}", found)), found)


def test_our_files_have_what_trackmates_have(theirs: Path, tmp_path: Path) -> None:
    ours = ET.parse(write_tracks(tmp_path / "tracks.xml", rich_tracks())).getroot()
    real = ET.parse(theirs).getroot()
    # Of the settings, those of its own detector and tracker are not ours.
    own = ("DetectorSettings", "TrackerSettings", "AnalyzerCollection", "View")
    for element in real.iter():
        if element.tag in own or element.tag in ("Spot", "Feature", "Analyzer", "TrackID"):
            continue
        same = ours.find(f".//{element.tag}") if element is not real else ours
        inside = ("FeaturePenalties", "Linking", "GapClosing", "TrackSplitting", "TrackMerging")
        if element.tag in inside:
            continue
        assert same is not None, element.tag
        assert set(element.attrib) <= set(same.attrib), element.tag
    for tag in ("DetectorSettings", "TrackerSettings", "AnalyzerCollection"):
        assert ours.find(f".//{tag}") is not None
    measured = ("INTENSITY", "DEVIATION", "DIAMETER", "CONTRAST", "SNR", "COLOR")
    for spot in real.iter("Spot"):
        needed = {key for key in spot.attrib if not any(word in key for word in measured)}
        assert needed <= set(next(ours.iter("Spot")).attrib)
