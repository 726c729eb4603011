"""The rules of the house: which room may import which, and what the package depends on."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import napari_unwrap3d

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "src" / "napari_unwrap3d"
NAME = PACKAGE.name

INTERFACE = {
    "napari",
    "qtpy",
    "PyQt5",
    "PyQt6",
    "PySide2",
    "PySide6",
    "vispy",
    "magicgui",
    "superqt",
}
SLOW_TO_IMPORT = {"dask", "h5py", "matplotlib", "trimesh", "vtk", "vtkmodules", "zarr"}

FOUNDATION = {"errors", "progress", "charts", "parameters"}
STEPS = {"imaging", "geometry", "unwrapping"}
CALLERS = {"atlas", "pipeline", "cli", "viewer"}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = sorted(path for path in PACKAGE.rglob("*.py"))
CORE = [path for path in SOURCES if PACKAGE / "viewer" not in path.parents]


def room(module: str) -> str:
    """The room of a module of ours: the first name below the package, '' for the package."""
    return module.split(".")[1] if "." in module else ""


def imports(path: Path) -> Iterator[tuple[str, bool]]:
    """Every module that a file imports, by its full name, and whether at module level."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for node in ast.walk(function)
    }
    package = module_name(path).split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, id(node) not in inside
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            base = [*start, *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                yield ".".join([*base, alias.name]), id(node) not in inside


def rooms_imported(path: Path) -> set[str]:
    ours = {name for name, _ in imports(path) if name.split(".")[0] == NAME}
    return {room(name) for name in ours} - {room(module_name(path))}


def run_fresh(code: str) -> list[str]:
    """Run code in a new interpreter, warnings as errors, and return the list it prints as JSON."""
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result: list[str] = json.loads(done.stdout)
    return result


LOADED_AFTER = """
import importlib, json, sys
for name in {names!r}:
    importlib.import_module(name)
print(json.dumps(sorted({{name.split(".")[0] for name in sys.modules}})))
"""


def test_the_core_runs_without_the_interface() -> None:
    names = [module_name(path) for path in CORE]
    assert f"{NAME}.charts" in names
    assert not INTERFACE & set(run_fresh(LOADED_AFTER.format(names=names)))


def test_importing_the_package_loads_nothing_slow() -> None:
    assert not SLOW_TO_IMPORT & set(run_fresh(LOADED_AFTER.format(names=[NAME])))


@pytest.mark.parametrize("path", CORE, ids=module_name)
def test_the_core_names_no_module_of_the_interface(path: Path) -> None:
    assert not INTERFACE & {name.split(".")[0] for name, _ in imports(path)}


@pytest.mark.parametrize("path", CORE, ids=module_name)
def test_a_room_imports_earlier_rooms_only(path: Path) -> None:
    here, imported = room(module_name(path)), rooms_imported(path)
    if here == "geometry":
        assert imported <= {"errors", "progress"}
    elif here in FOUNDATION:
        assert imported <= FOUNDATION
    elif here == "imaging":
        assert not imported & ({"unwrapping"} | CALLERS)
    elif here == "unwrapping":
        assert not imported & CALLERS
    elif here == "atlas":
        assert not imported & (CALLERS - {"atlas"})
    elif here == "pipeline":
        assert not imported & {"cli", "viewer"}


@pytest.mark.parametrize("path", CORE, ids=module_name)
def test_only_the_command_opens_the_viewer_and_late(path: Path) -> None:
    viewer = f"{NAME}.viewer"
    found = [top for name, top in imports(path) if f"{name}.".startswith(f"{viewer}.")]
    assert not any(found), "the viewer is imported when this module is"
    assert not found or room(module_name(path)) in ("cli", "movie_demo")


def test_the_common_parts_of_the_viewer_know_nothing_of_the_rest() -> None:
    viewer = f"{NAME}.viewer."
    paths = list((PACKAGE / "viewer" / "common").glob("*.py"))
    assert paths
    for path in paths:
        ours = {name for name, _ in imports(path) if name.startswith(viewer)}
        assert all(name.startswith(f"{viewer}common.") for name in ours), path


def test_the_rules_see_relative_and_absolute_imports(tmp_path: Path, monkeypatch) -> None:
    package = tmp_path / NAME
    (package / "geometry").mkdir(parents=True)
    monkeypatch.setitem(globals(), "PACKAGE", package)
    path = package / "geometry" / "probe.py"
    path.write_text(
        "from .. import charts\nfrom ..imaging.stack import crop\nfrom . import distance\n"
        f"import {NAME}.errors\ndef f():\n    from {NAME} import viewer\n"
    )
    assert rooms_imported(path) == {"charts", "imaging", "errors", "viewer"}
    assert dict(imports(path))[f"{NAME}.viewer"] is False


def test_the_part_of_libigl_that_is_gpl_is_not_used() -> None:
    for path in SOURCES:
        assert "copyleft" not in path.read_text(encoding="utf-8"), path


def test_the_version_is_the_installed_one() -> None:
    assert napari_unwrap3d.__version__ == metadata.version("napari-unwrap3d")
    assert re.match(r"\d+\.\d+", napari_unwrap3d.__version__)


# What the package depends on ---------------------------------------------------------


def requirements(distribution: str, extras: frozenset[str]) -> Iterator[Requirement]:
    """What a distribution needs on this machine, with those extras of it."""
    for line in metadata.requires(distribution) or []:
        requirement = Requirement(line)
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in {"", *extras}):
            yield requirement


def hard_dependencies() -> set[str]:
    """Everything that installing the core brings along, however far down."""
    found: set[str] = set()
    todo = [Requirement("napari-unwrap3d")]
    while todo:
        requirement = todo.pop()
        for needed in requirements(requirement.name, frozenset(requirement.extras)):
            if needed.name not in found:
                found.add(needed.name)
                todo.append(needed)
    return found


def licence(distribution: str) -> str:
    """What a distribution says its licence is: expression, else classifiers, else a line."""
    about = metadata.metadata(distribution)
    classifiers = [c for c in about.get_all("Classifier", []) if c.startswith("License ::")]
    stated = about.get("License-Expression") or "; ".join(classifiers) or about.get("License", "")
    return stated.strip()


def is_copyleft(stated: str) -> bool:
    """Whether a licence is of the GPL family; GCC's runtime libraries are excepted from it."""
    without_runtime = re.sub(r"GPL-[\w.-]+ WITH GCC-exception[\w.-]*", "", stated)
    return bool(re.search(r"GPL|GNU.*General Public", without_runtime, re.IGNORECASE))


def test_the_core_installs_without_the_interface() -> None:
    declared = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    names = {Requirement(line).name.lower() for line in declared["project"]["dependencies"]}
    interface = {name.lower() for name in INTERFACE}
    assert {"numpy", "scipy", "numba"} <= names
    assert not names & interface
    assert not {name.lower() for name in hard_dependencies()} & interface


def test_no_hard_dependency_is_copyleft() -> None:
    licences = {name: licence(name) for name in hard_dependencies()}
    assert not [name for name, stated in licences.items() if not stated]
    assert not {name: stated for name, stated in licences.items() if is_copyleft(stated)}


@pytest.mark.parametrize(
    ("stated", "copyleft"),
    [
        ("GPL-3.0-only", True),
        ("License :: OSI Approved :: GNU Lesser General Public License v3 (LGPLv3)", True),
        ("BSD-3-Clause AND GPL-3.0-or-later WITH GCC-exception-3.1", False),
        ("License :: OSI Approved :: Mozilla Public License 2.0 (MPL 2.0)", False),
    ],
)
def test_copyleft_is_recognised(stated: str, copyleft: bool) -> None:
    assert is_copyleft(stated) is copyleft
