"""The commands track, measure and analyse, on a small movie."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile

from moving import TIME_STEP_S, VOXEL_UM, blebbing, blebbing_movie
from napari_unwrap3d import load_movie
from napari_unwrap3d.analyses import Analysis, over
from napari_unwrap3d.cli import main
from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.files.tracks import read_tracks, write_tracks
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.tracking.edits import TrackEdits

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.toml"))
# Bumps that jump from one place to the next every 2 s.
SLOW = "tracking.longest_step_um=1.0"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("movie")
    blebbing_movie(folder)
    return folder


@pytest.fixture
def movie(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "movie"))


def run(*words: str | Path) -> int:
    return main([str(word) for word in words])


def test_track_keeps_and_writes_the_same_tracks(movie: Path, tmp_path: Path) -> None:
    files = [tmp_path / f"p{suffix}" for suffix in (".geff", ".csv", ".xml")]
    outputs = [word for file in files for word in ("-o", file)]
    assert run("track", movie, "--set", SLOW, *outputs) == 0
    kept = load_movie(movie).tracks("protrusions")
    assert len(kept.ids) >= 4
    for file in files:
        found = read_tracks(file)
        assert found.track_id.tolist() == kept.track_id.tolist()
        told = found.numbers["provenance"]
        assert told["tracks"] == "protrusions"
        assert "longest_step_um" in told["parameters"]
        assert told["key"] == load_movie(movie).folder.tracks_key("protrusions")


def test_regions_are_followed_by_flow(movie: Path, tmp_path: Path) -> None:
    words = ("--of", "flow", "--set", "flow.regions=60", "-o", tmp_path / "f.parquet")
    assert run("track", movie, *words) == 0
    kept = load_movie(movie).tracks("flow")
    assert kept.method == "flow"
    np.testing.assert_array_equal(read_tracks(tmp_path / "f.parquet").place_px, kept.place_px)


def test_track_of_a_packed_movie_is_saved_in_it(movie: Path, tmp_path: Path) -> None:
    packed = load_movie(movie).save(tmp_path / "packed.unwrap3d")
    assert run("track", packed, "--set", SLOW, "--name", "slow ones") == 0
    assert "slow ones" in load_movie(packed).track_names


def test_tracks_of_a_file_are_laid_on_the_surface(movie: Path, tmp_path: Path) -> None:
    frame = load_movie(movie).frame(1)
    points = frame.surface.vertices[[5, 99]] / VOXEL_UM
    rows = [f"{k},1,{z},{y},{x}" for k, (z, y, x) in enumerate(points.tolist(), 1)]
    (tmp_path / "t.csv").write_text("\n".join(["track_id,frame,z,y,x", *rows]))
    words = ("track", movie, "--import", tmp_path / "t.csv")
    assert run(*words) == 2  # nobody said how large a voxel is
    assert run(*words, "--voxel-size", *[str(VOXEL_UM)] * 3, "--name", "by hand") == 0
    laid = load_movie(movie).tracks("by hand")
    np.testing.assert_allclose(laid.place_px, frame.topography[[5, 99], 1:], atol=1e-6)
    assert laid.numbers["provenance"]["imported"]["file"] == "t.csv"


def test_tracks_that_a_person_edited_are_not_replaced(movie: Path) -> None:
    assert run("track", movie, "--set", SLOW) == 0
    opened = load_movie(movie)
    edits = TrackEdits(opened.tracks("protrusions"))
    edits.delete(1)
    opened.keep_tracks("protrusions", edits.tracks)
    assert run("track", movie, "--set", SLOW) == 2
    assert load_movie(movie).tracks("protrusions").method == "edited"
    assert run("track", movie, "--set", SLOW, "--overwrite") == 0
    assert load_movie(movie).tracks("protrusions").method == "surface"


def test_wrong_words_are_told_before_anything_is_made(movie: Path, tmp_path: Path, capsys) -> None:
    assert run("track", movie, "-o", tmp_path / "t.txt") == 2
    assert run("track", tmp_path / "none") == 2
    assert run("track", movie, "--set", "tracking.nothing=1") == 2
    assert load_movie(movie).track_names == ()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    assert run("measure", movie, "-o", tmp_path / "full") == 2
    assert "mine.txt" in capsys.readouterr().err


def test_measure_writes_tracks_tables_and_a_report(movie: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    words = ("measure", movie, "-o", output, "--set", SLOW, "--formats", ".csv")
    assert run(*words) == 0
    tracks = read_tracks(output / "tracks" / "protrusions.csv")
    series = pd.read_csv(output / "protrusions" / "tables" / "series.csv")
    assert set(series["track_id"]) == set(tracks.ids.tolist())
    assert np.isfinite(series["area_um2"]).any()
    page = (output / "protrusions" / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 2
    assert not any(word in page for word in ("<script", "<link", "src=", 'href="http'))
    assert "protrusions/report.html" in (output / "index.html").read_text(encoding="utf-8")
    told = json.loads((output / "provenance.json").read_text())
    assert told["measured"]["protrusions"]["parameters"]["tracking"]["longest_step_um"] == 1.0
    # Again: what was tracked is used again, and mine stays.
    (output / "mine.txt").write_text("mine")
    assert run(*words) == 2
    assert run(*words, "--overwrite", "--no-report", "--tables", "parquet") == 0
    assert (output / "mine.txt").exists()
    again = pd.read_parquet(output / "protrusions" / "tables" / "series.parquet")
    np.testing.assert_allclose(again["area_um2"], series["area_um2"])


ANALYSIS = """
title = "Bumps"

[source]
stack = "masks.tif"
mask = true

[[regions]]
name = "side"
facing = [0, 1, 0]
within_deg = 40

[parameters.uv]
rows = 64
[parameters.registration]
method = "none"
[parameters.reference]
vertices = 4000
[parameters.tracking]
longest_step_um = 1.0

[[measure]]
tracks = "protrusions"
[[measure]]
name = "elsewhere"
tracks = "protrusions"
outside = "side"
[measure.tracking]
gap_s = 2.0
"""


def test_one_file_is_a_whole_analysis(tmp_path: Path) -> None:
    masks = np.stack([mask.data for mask in blebbing(3)]).astype(np.uint8)
    tifffile.imwrite(
        tmp_path / "masks.tif",
        masks,
        imagej=True,
        resolution=(1 / VOXEL_UM,) * 2,
        metadata={
            "axes": "TZYX",
            "spacing": VOXEL_UM,
            "unit": "um",
            "finterval": TIME_STEP_S,
        },
    )
    (tmp_path / "a.toml").write_text(ANALYSIS)
    output = tmp_path / "out"
    assert run("analyse", tmp_path / "a.toml", "-o", output) == 0
    made = load_movie(output / "movie")
    assert len(made) == 3
    side = made.common.annotations.labels("side") > 0
    assert 0.02 < side.mean() < 0.5
    assert made.common.surface.vertices[side, 1].min() > made.common.surface.vertices[:, 1].mean()
    everything = read_tracks(output / "tracks" / "protrusions.geff")
    outside = read_tracks(output / "tracks" / "elsewhere.geff")
    assert 0 < len(outside.ids) < len(everything.ids)
    assert set(made.track_names) == {"protrusions", "elsewhere"}
    assert (output / "analysis.toml").read_text() == ANALYSIS
    told = json.loads((output / "provenance.json").read_text())["measured"]
    gaps = [told[name]["parameters"]["tracking"]["gap_s"] for name in ("protrusions", "elsewhere")]
    assert gaps == [Parameters().tracking.gap_s, 2.0]
    assert (output / "elsewhere" / "report.html").is_file()
    before = {path: path.stat().st_mtime_ns for path in (output / "movie" / "frames").iterdir()}
    assert run("analyse", tmp_path / "a.toml", "-o", output) == 2
    assert run("analyse", tmp_path / "a.toml", "-o", output, "--overwrite") == 0
    after = {path: path.stat().st_mtime_ns for path in (output / "movie" / "frames").iterdir()}
    assert after == before


def test_a_wrong_analysis_says_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    for text, word in (
        ("[source]\n", "name one of stack, movie and simulated"),
        ("[source]\nstack = 'a.tif'\nmovie = 'b'\n", "name one of"),
        ("[source]\nsimulated = 'blebs'\ncolour = 1\n", "colour"),
        ("[source]\nsimulated = 'blebs'\n[parameters.uv]\nrow = 1\n", "uv.row"),
        ("[source]\nsimulated = 'blebs'\n[[measure]]\nnothing = 1\n", "measurement.nothing"),
        (
            "[source]\nsimulated = 'blebs'\n[[measure]]\nname = 'a'\n[[measure]]\nname = 'a'\n",
            "same name",
        ),
        ("[source", "TOML"),
    ):
        path.write_text(text)
        with pytest.raises(ParameterError, match=word):
            Analysis.from_toml(path)


def test_parameters_over_others_keep_what_is_not_said() -> None:
    base = Parameters.from_dict({"uv": {"rows": 64}, "tracking": {"gap_s": 1.0}})
    found = over(base, {"tracking": {"longest_step_um": 2.0}})
    assert (found.uv.rows, found.tracking.gap_s, found.tracking.longest_step_um) == (64, 1.0, 2.0)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_analyses(path: Path) -> None:
    analysis = Analysis.from_toml(path)
    _, measured = analysis.chosen()
    assert measured
    assert analysis.source.simulated is not None


def test_there_are_examples() -> None:
    assert {path.stem for path in EXAMPLES} >= {"blebs", "ruffles"}


def test_written_tracks_name_their_movie(movie: Path, tmp_path: Path) -> None:
    opened = load_movie(movie)
    assert run("track", movie, "--set", SLOW) == 0
    path = write_tracks(tmp_path / "t.xml", opened.tracks("protrusions"), opened)
    text = path.read_text(encoding="utf-8")
    assert f'filename="{opened.name}"' in text
    # An image in which every place of the cell lies.
    found = re.search(r'nslices="(\d+)" height="(\d+)" width="(\d+)"', text)
    assert found is not None
    extent = np.array([int(size) for size in found.groups()]) * VOXEL_UM
    assert (extent >= opened.common.surface.vertices.max(axis=0)).all()
    assert (extent <= opened.common.surface.vertices.max(axis=0) + 10).all()
