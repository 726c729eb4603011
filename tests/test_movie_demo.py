"""``napari-unwrap3d demo --movie``, and the sample movie."""

from __future__ import annotations

from pathlib import Path

import pytest

from napari_unwrap3d import load_movie
from napari_unwrap3d.cli import WRONG_INPUT, main
from napari_unwrap3d.movie_demo import ROWS, demo_parameters
from napari_unwrap3d.parameters import Parameters


def test_it_writes_a_movie_its_stacks_and_pictures(tmp_path: Path) -> None:
    words = ["demo", "--movie", "--timepoints", "2", "--size", "72", "-o", str(tmp_path / "out")]
    quick = ("uv.rows=32", "registration.method=none", "reference.vertices=4000")
    assert main([*words, *(word for value in quick for word in ("--set", value))]) == 0
    movie = load_movie(tmp_path / "out" / "movie.unwrap3d")
    assert len(movie) == 2
    assert movie.channels == ("membrane", "septin")
    assert movie.frame(1).uv["signal_septin"].shape == (32, 64)
    assert len(list((tmp_path / "out" / "pictures").glob("*.png"))) == 2
    assert (tmp_path / "out" / "movie" / "uv" / "height_um.ome.tif").is_file()


def test_an_unknown_kind_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["demo", "--movie", "--kind", "handles", "-o", str(tmp_path / "out")]
    assert main(words) == WRONG_INPUT
    assert "no movie of kind 'handles'" in capsys.readouterr().err


def test_rows_that_were_chosen_stay() -> None:
    assert demo_parameters(Parameters()).uv.rows == ROWS
    assert demo_parameters(Parameters.from_dict({"uv": {"rows": 64}})).uv.rows == 64
