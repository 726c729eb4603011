"""What README.md shows exists: every name of the library, every command, every target and room."""

import re
import shlex
from pathlib import Path

import pytest

import napari_unwrap3d
from napari_unwrap3d.cli import build_parser

PROJECT = Path(__file__).resolve().parents[1]
TEXT = (PROJECT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


COMMANDS = [
    line
    for block in blocks("sh")
    for line in block.splitlines()
    if line.startswith("napari-unwrap3d ")
]
NAMES = sorted(set(re.findall(r"\bunwrap3d\.([A-Za-z_]\w*)", TEXT)))
TARGETS = sorted(set(re.findall(r"\bmake (\w+)(?= |`|\n)", "\n".join(blocks("sh")))))


@pytest.mark.parametrize("code", blocks("python"))
def test_python_is_valid(code: str) -> None:
    compile(code, "README.md", "exec")


@pytest.mark.parametrize("name", NAMES)
def test_names_are_public(name: str) -> None:
    assert name in napari_unwrap3d.__all__
    assert getattr(napari_unwrap3d, name) is not None


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_are_understood(line: str) -> None:
    words = shlex.split(line, comments=True)[1:]
    assert callable(build_parser().parse_args(words).command)


@pytest.mark.parametrize("target", TARGETS)
def test_targets_exist(target: str) -> None:
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_something_is_shown_of_each_kind() -> None:
    assert len(NAMES) >= 6
    assert len(COMMANDS) >= 5
    assert {"demo", "test", "lint", "bench"} <= set(TARGETS)
