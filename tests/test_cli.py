"""The command line does the whole job, and says what is wrong when it cannot."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from napari_unwrap3d import cli
from napari_unwrap3d.cli import build_parser, interruptible, main
from napari_unwrap3d.console import StepProgress, format_value, print_quality
from napari_unwrap3d.errors import Cancelled, ParameterError
from napari_unwrap3d.files import pictures
from napari_unwrap3d.files.export import FILES
from napari_unwrap3d.files.meshes import read_mesh, write_mesh
from napari_unwrap3d.files.project import load_project, save_project
from napari_unwrap3d.files.stacks import write_image
from napari_unwrap3d.options import chosen_parameters
from napari_unwrap3d.parameters import PRESETS, Parameters
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.quality import quality_rows
from synthetic import RADIUS, height, icosphere, make_atlas, solid

VOXEL = (0.25, 0.25, 0.25)
SMALL = ("--set", "uv.rows=32", "--set", "reference.vertices=4000")


def parsed(*words: str) -> argparse.Namespace:
    return build_parser().parse_args(["run", "cell.tif", "-o", "out", *words])


# Parameters ------------------------------------------------------------------


def test_the_plane_is_asked_for_by_an_option() -> None:
    assert not chosen_parameters(parsed()).plane.compute
    assert chosen_parameters(parsed("--plane")).plane.compute
    assert chosen_parameters(parsed("--plane", "--set", "plane.delta=100")).plane.delta == 100


def test_the_protrusions_are_asked_for_by_an_option() -> None:
    assert not chosen_parameters(parsed()).protrusions.compute
    assert chosen_parameters(parsed("--protrusions")).protrusions.compute
    radius = chosen_parameters(parsed("--protrusions", "--set", "protrusions.radius=0.3"))
    assert (radius.protrusions.compute, radius.protrusions.radius) == (True, 0.3)


def test_later_parameters_win(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text('[uv]\nrows = 128\n[reference]\nstop = "paper"\n')
    base = parsed("--preset", "ruffles")
    assert chosen_parameters(base) == Parameters.preset("ruffles")
    chosen = chosen_parameters(
        parsed(
            "--preset", "ruffles", "--params", str(file), "--set", "uv.rows=64",
            "--set", "topography.depth_um=none", "--set", "reference.stop=fixed",
            "--label", "7", "--timepoint", "2",
        )
    )  # fmt: skip
    assert chosen.uv.rows == 64
    assert chosen.uv.axis_weight == PRESETS["ruffles"]["uv"]["axis_weight"]
    assert chosen.reference.stop == "fixed"
    assert chosen.reference.delta == PRESETS["ruffles"]["reference"]["delta"]
    assert chosen.topography.depth_um is None
    assert (chosen.stack.label, chosen.stack.timepoint) == (7, 2)


def test_none_is_a_word_where_it_is_a_choice_and_else_nothing() -> None:
    chosen = chosen_parameters(
        parsed("--set", "registration.method=none", "--set", "stack.working_voxel_um=none")
    )
    assert chosen.registration.method == "none"
    assert chosen.stack.working_voxel_um is None


@pytest.mark.parametrize("typed", ["[1, 0, 0.5]", "1,0,0.5", "1 0 0.5"])
def test_a_direction_is_set_by_its_three_numbers(typed: str) -> None:
    chosen = chosen_parameters(
        parsed("--set", f"uv.axis_zyx={typed}", "--set", "reference.laplacian=intrinsic-delaunay")
    )
    assert chosen.uv.axis_zyx == (1.0, 0.0, 0.5)
    assert chosen.reference.laplacian == "intrinsic-delaunay"
    with pytest.raises(ParameterError, match="length"):
        chosen_parameters(parsed("--set", "uv.axis_zyx=0,0,0"))


@pytest.mark.parametrize("setting", ["uv", "uv.rows", "rows=3", "uv.=3", ".rows=3"])
def test_a_setting_that_is_none_is_named(setting: str) -> None:
    with pytest.raises(ParameterError, match=r"STEP\.NAME=VALUE"):
        chosen_parameters(parsed("--set", setting))


def test_an_unknown_parameter_is_named() -> None:
    with pytest.raises(ParameterError, match=r"uv\.row: .*got 3"):
        chosen_parameters(parsed("--set", "uv.row=3"))


# Info ------------------------------------------------------------------------


def test_info_lists_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--parameters"]) == 0
    text = capsys.readouterr().out
    for step, group in Parameters.model_fields.items():
        for name in group.annotation.model_fields:  # type: ignore[union-attr]
            assert f"{step}.{name} = " in text


def test_info_of_a_stack(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = np.zeros((2, 5, 6, 7), np.uint16)
    path = write_image(
        tmp_path / "a.ome.tif",
        data,
        "czyx",
        sizes={"z": 0.3, "y": 0.1, "x": 0.1},
        channels=("membrane", "actin"),
    )
    assert main(["info", str(path)]) == 0
    text = capsys.readouterr().out
    for expected in ("axis z", "5", "uint16", "0.3 × 0.1 × 0.1 µm", "membrane, actin"):
        assert expected in text


def test_info_of_a_stack_without_voxel_size_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_image(tmp_path / "a.ome.tif", np.zeros((5, 6, 7), np.uint8), "zyx")
    assert main(["info", str(path)]) == 0
    assert "--voxel-size" in " ".join(capsys.readouterr().out.replace("│", " ").split())


def test_info_of_an_open_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vertices, faces = icosphere(1)
    path = write_mesh(tmp_path / "a.ply", vertices, faces[:-1])
    assert main(["info", str(path)]) == 0
    text = capsys.readouterr().out
    assert "watertight" in text
    assert "no" in text
    assert "3" in text  # open edges


def test_info_of_a_project(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = save_project(make_atlas(1, 32), tmp_path / "cell.unwrap3d")
    assert main(["info", str(path)]) == 0
    text = capsys.readouterr().out
    for expected in ("synthetic (surface)", "one handle was closed", "✔ good"):
        assert expected in text


# Compare -----------------------------------------------------------------------


def test_two_meshes_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vertices, faces = icosphere(2)
    first = write_mesh(tmp_path / "first.stl", 3 * vertices, faces)
    second = write_mesh(tmp_path / "second.obj", 2 * vertices, faces)
    words = ["compare", str(first), str(second), "--samples", "500", "--projections", "10"]
    assert main(words) == 0
    text = capsys.readouterr().out
    for expected in (
        "first.stl against second.obj",
        "Chamfer",
        "noise floor",
        "+125 %",
        "+237.5 %",
    ):
        assert expected in text
    assert main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["area_difference"] == pytest.approx(9 / 4 - 1, rel=1e-5)
    assert found["volume_difference"] == pytest.approx(27 / 8 - 1, rel=1e-5)
    assert found["sliced_wasserstein_vertices_um"] == pytest.approx(0.5, rel=0.1)
    assert main([*words, "--json", "--scale", "0.1", "--seed", "3"]) == 0
    assert json.loads(capsys.readouterr().out)["hausdorff_um"] == pytest.approx(0.1, rel=0.1)


def test_a_project_and_an_open_mesh_are_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    atlas = make_atlas(2, 8)
    project = save_project(atlas, tmp_path / "cell.unwrap3d")
    vertices, faces = atlas.surface.vertices, atlas.surface.faces
    mesh = write_mesh(tmp_path / "open.vtp", vertices, faces[1:])
    assert main(["compare", str(project), str(mesh), "--samples", "500"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "The second mesh is open, or branches: it has no volume." in text
    assert "ΔV │ –" in text


# Errors ----------------------------------------------------------------------


def test_wrong_input_is_two_and_a_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    no_size = write_image(tmp_path / "a.ome.tif", np.zeros((5, 6, 7), np.uint8), "zyx")
    project = tmp_path / "x.unwrap3d"
    project.write_text("no project")
    full = tmp_path / "full"
    full.mkdir()
    (full / "notes.txt").write_text("mine")
    out = str(tmp_path / "out")
    for words, expected in [
        (["run", str(tmp_path / "no.tif"), "-o", out], "no file"),
        (["run", str(tmp_path / "no.ply"), "-o", out], "no file"),
        (["run", str(no_size), "-o", out], "voxel size"),
        (["run", str(project), "-o", out], "unwrapped already"),
        (["run", str(no_size), "-o", str(full)], "not empty"),
        (["run", "cell.ply", "-o", out, "--voxel-size", "1", "1", "1"], "cell.ply is a mesh"),
        (["run", str(no_size), "-o", out, "--scale", "2"], "--scale is for meshes"),
        (["run", str(no_size), "-o", out, "--set", "uv.rows=7"], "uv.rows"),
        (["export", str(project), "-o", out], "no project"),
        (["info", str(project)], "no project"),
        (["info"], "Nothing to look at"),
        (["compare", str(no_size), str(project)], "not a kind of mesh"),
        (["compare", str(project), str(project)], "no project"),
        (["demo", "--kind", "unknown", "-o", out], "There is no kind"),
    ]:
        assert main(words) == cli.WRONG_INPUT, words
        captured = capsys.readouterr()
        text = " ".join(captured.err.split())
        assert text.startswith("Error:"), words
        assert expected in text
        assert "Traceback" not in text
    assert not Path(out).exists()


def test_markup_in_a_message_is_printed_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "[red]cell[/red].tif"]) == cli.WRONG_INPUT
    assert "[red]cell[/red].tif" in capsys.readouterr().err


def test_unexpected_errors_are_not_swallowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(arguments: argparse.Namespace) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(cli, "described", fail)
    with pytest.raises(ZeroDivisionError):
        main(["info", "cell.tif"])


# Cancelling ------------------------------------------------------------------


def test_control_c_cancels_and_a_second_one_stops_at_once() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruptible(Progress()) as progress:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Cancelled):
            progress(0.5)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_control_c_during_a_run_is_130_and_leaves_nothing(tmp_path: Path) -> None:
    path = write_image(
        tmp_path / "cell.ome.tif",
        solid(lambda d: RADIUS + height(d)).data,
        "zyx",
        sizes=dict(zip("zyx", VOXEL, strict=True)),
    )
    code = "import sys; from napari_unwrap3d.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ["run", str(path), "--mask", "-o", str(tmp_path / "out"), "--set", "uv.rows=1024"]
    with subprocess.Popen(
        [sys.executable, "-u", "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        assert run.stdout is not None
        first = run.stdout.readline()  # the first step is done, the others go on
        run.send_signal(signal.SIGINT)
        _, errors = run.communicate(timeout=60)
    assert "stack" in first, errors
    assert run.returncode == cli.INTERRUPTED
    assert "Stopped" in errors
    assert "Traceback" not in errors
    assert not (tmp_path / "out").exists()


# The whole job ---------------------------------------------------------------


def assert_complete(folder: Path, drawn: bool) -> None:
    folders = {"meshes", "pictures"} if drawn else {"meshes"}
    assert {path.name for path in folder.iterdir()} == {*FILES, *folders}


def test_a_mesh_is_unwrapped_and_exported_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    few = {name: pictures.PICTURES[name] for name in ("reference_stop", "uv")}
    monkeypatch.setattr(pictures, "PICTURES", few)  # all are drawn in test_pictures
    vertices, faces = icosphere(4)
    cell = 10 + (RADIUS + height(vertices))[:, None] * vertices
    mesh = write_mesh(tmp_path / "cell.ply", cell, faces)
    out = tmp_path / "out"
    voxel = ("--set", "stack.working_voxel_um=0.3")
    assert main(["run", str(mesh), "-o", str(out), *SMALL, *voxel]) == 0
    text = capsys.readouterr().out
    assert_complete(out, drawn=True)
    assert {path.stem for path in (out / "pictures").iterdir()} == set(few)
    assert "✔ good" in text
    assert "✘ bad" not in text
    atlas = load_project(out / "cell.unwrap3d")
    assert atlas.parameters.uv.rows == 32
    assert atlas.provenance["source"]["name"] == "cell.ply"
    np.testing.assert_allclose(atlas.surface.vertices, cell, atol=1e-5)

    again = tmp_path / "again"
    words = ["export", str(out / "cell.unwrap3d"), "-o", str(again), "--quiet", "--no-pictures"]
    words += ["--format", "ply", "--format", "obj"]
    assert main(words) == 0
    assert capsys.readouterr().out == ""
    assert_complete(again, drawn=False)
    for name in ("meshes/surface.ply", "quality.csv", "quality.json", "parameters.toml"):
        assert (again / name).read_bytes() == (out / name).read_bytes()
    assert (again / "meshes" / "surface.png").is_file()


def test_a_mesh_is_scaled_to_micrometres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vertices, faces = icosphere(4)
    path = write_mesh(tmp_path / "nm.ply", 2000 * vertices, faces)
    assert main(["info", str(path), "--scale", "0.001"]) == 0
    volume = 4 / 3 * np.pi * 2**3
    assert f"{volume:.1f}"[:3] in capsys.readouterr().out


def test_a_mask_and_a_label_are_taken_as_they_are(tmp_path: Path) -> None:
    truth = solid(lambda d: RADIUS + height(d))
    sizes = dict(zip("zyx", VOXEL, strict=True))
    labels = write_image(
        tmp_path / "labels.ome.tif", 5 * truth.data.astype(np.uint16), "zyx", sizes=sizes
    )
    common = ["--no-pictures", "--quiet", *SMALL]
    assert main(["run", str(labels), "--mask", "-o", str(tmp_path / "a"), *common]) == 0
    assert main(["run", str(labels), "--label", "5", "-o", str(tmp_path / "b"), *common]) == 0
    one, other = (load_project(tmp_path / name / "cell.unwrap3d") for name in "ab")
    volume = truth.data.sum() * VOXEL[0] ** 3
    assert one.quality["surface"]["volume_um3"] == pytest.approx(volume, rel=0.02)
    assert other.quality["surface"]["volume_um3"] == pytest.approx(volume, rel=0.02)


def test_signals_become_fields_of_the_surface(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("napari_unwrap3d.pipeline.Pipeline.run", lambda *_: make_atlas(1, 32))
    truth = solid(lambda d: RADIUS + height(d)).data
    light = np.where(truth, 200, 40).astype(np.uint16)
    path = write_image(
        tmp_path / "cell.ome.tif",
        np.stack([light, np.full_like(light, 70)]),
        "czyx",
        sizes=dict(zip("zyx", VOXEL, strict=True)),
        channels=("membrane", "actin (GFP)"),
    )
    out = tmp_path / "out"
    words = ["run", str(path), "-o", str(out), "--no-pictures", "--quiet"]
    assert main([*words, "--signal", "0", "septin"]) == cli.WRONG_INPUT
    assert not out.exists()
    assert main([*words, "--signal", "0", "actin (GFP)"]) == 0
    saved = load_project(out / "cell.unwrap3d").surface
    written = read_mesh(out / "meshes" / "surface.ply")
    for surface in (saved, written):
        np.testing.assert_allclose(surface.fields["signal_actin_GFP_"], 70)
        np.testing.assert_allclose(surface.fields["signal_0"], 200, atol=30)
    mesh = write_mesh(tmp_path / "a.ply", *icosphere(1))
    other = str(tmp_path / "other")
    assert main(["run", str(mesh), "-o", other, "--signal", "0"]) == cli.WRONG_INPUT


def test_the_demo_unwraps_a_simulated_stack(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    (tmp_path / "demo-output").mkdir()
    (tmp_path / "demo-output" / "quality.csv").write_text("of an earlier demo")
    words = ["demo", "--window", "--size", "72", "--no-pictures", *SMALL]
    assert main(words) == 0
    assert "No window" in capsys.readouterr().out
    assert_complete(tmp_path / "demo-output", drawn=False)


def test_the_window_runs_the_demo_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    fake = types.ModuleType("demo")
    fake.open_demo = lambda *args, **options: opened.append((args, options))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "napari_unwrap3d.viewer.demo", fake)
    monkeypatch.setattr(cli, "missing_for_window", lambda: "")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demo-output").mkdir()
    (tmp_path / "demo-output" / "uv.ome.tif").write_text("of an earlier demo")
    assert main(["demo", "--window", "--kind", "mix", "--set", "uv.rows=64"]) == 0
    [((kind, project, parameters), options)] = opened
    assert (kind, options) == ("mix", {"size": 200})
    assert project == Path("demo-output") / "cell.unwrap3d"
    assert parameters.uv.rows == 64
    assert not list((tmp_path / "demo-output").iterdir())


# What is printed -------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (True, "yes"), (12345, "12,345"), (0.00123456, "0.001235"), (2e6, "2,000,000")],
)
def test_values_are_readable(value: object, text: str) -> None:
    assert format_value(value) == text


def test_a_terminal_without_unicode_is_no_error() -> None:
    code = "import sys; from napari_unwrap3d.cli import main; sys.exit(main(sys.argv[1:]))"
    run = subprocess.run(
        [sys.executable, "-c", code, "info", "--parameters"],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert b"uv.rows = 512 pixels" in run.stdout


@pytest.mark.parametrize(("flipped", "verdict"), [(0, "All charts are good"), (2, "Do not rely")])
def test_the_table_ends_with_a_verdict(
    flipped: int, verdict: str, capsys: pytest.CaptureFixture[str]
) -> None:
    print_quality(Console(), quality_rows({"sphere": {"flipped_faces": flipped}}))
    text = " ".join(capsys.readouterr().out.split())
    assert verdict in text
    assert ("not one to one" in text) == (flipped > 0)


@pytest.mark.parametrize("terminal", [True, False])
def test_every_step_is_shown(terminal: bool, capsys: pytest.CaptureFixture[str]) -> None:
    with StepProgress(Console(force_terminal=terminal, width=100)) as bars:
        for step in ("surface", "sphere"):
            bars(step, 0.0, "starting")
            bars(step, 0.5, "[half]")
    text = capsys.readouterr().out
    assert text.index("surface") < text.index("sphere")
