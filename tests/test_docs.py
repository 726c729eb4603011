"""What docs/ and README.md say exists: pages, parameters, names; the tables are those of today."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.cli import build_parser

PROJECT = Path(__file__).resolve().parents[1]
PAGES = sorted((PROJECT / "docs").glob("*.md"))
LINKING = [*PAGES, PROJECT / "README.md"]
STEPS = "|".join(unwrap3d.Parameters.model_fields)
LINK = re.compile(r"\[[^\]]+\]\(([^)\s]+)\)")
PARAMETER = re.compile(rf"(?:`|--set )({STEPS})\.(?!csv\b)(\w+)(?:`| ?= ?(\S+?)(?:`|\n))")
NAME = re.compile(r"\b(?:unwrap3d|atlas)\.([A-Za-z_]\w*)")


def name_of(path: Path) -> str:
    return path.name


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as GitHub and MkDocs make them."""
    heads = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head).strip().lower().replace(" ", "-") for head in heads}


def load_tables() -> ModuleType:
    path = PROJECT / "benchmarks" / "tables.py"
    spec = importlib.util.spec_from_file_location("benchmark_tables", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


tables = load_tables()


@pytest.mark.parametrize("page", LINKING, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        if link.startswith("https://"):
            continue
        target, _, anchor = link.partition("#")
        file = (page.parent / target).resolve() if target else page
        assert file.is_file(), f"{link} of {page.name}"
        assert not anchor or anchor in anchors(file.read_text(encoding="utf-8")), link


def test_every_page_can_be_reached() -> None:
    linked = {
        (page.parent / link.partition("#")[0]).resolve()
        for page in LINKING
        for link in LINK.findall(page.read_text(encoding="utf-8"))
        if link.partition("#")[0].endswith(".md")
    }
    assert set(PAGES) <= linked
    nav = (PROJECT / "mkdocs.yml").read_text(encoding="utf-8")
    assert set(re.findall(r"(\w+\.md)", nav)) == {page.name for page in PAGES}


@pytest.mark.parametrize("page", LINKING, ids=name_of)
def test_parameters_and_their_values_exist(page: Path) -> None:
    for step, name, value in PARAMETER.findall(page.read_text(encoding="utf-8")):
        group = getattr(unwrap3d.Parameters(), step)
        assert name in type(group).model_fields, f"{step}.{name}"
        if value and step != "stack":
            unwrap3d.Parameters.from_toml(f"[{step}]\n{name} = {value}")


def test_every_parameter_is_described() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for step in unwrap3d.Parameters.model_fields:
        for name in type(getattr(unwrap3d.Parameters(), step)).model_fields:
            assert f"`{step}.{name}`" in text


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_of_the_library_exist(page: Path) -> None:
    for name in NAME.findall(page.read_text(encoding="utf-8")):
        assert hasattr(unwrap3d, name) or hasattr(unwrap3d.Atlas, name) or name in fields(), name


def fields() -> set[str]:
    return set(unwrap3d.Atlas.__dataclass_fields__)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_are_understood(page: Path) -> None:
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        for line in block.splitlines():
            assert callable(build_parser().parse_args(line.split()[1:]).command), line


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_tables_are_in_step(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    places = re.findall(r"<!-- table: (.+?) -->", text)
    assert set(places) <= set(tables.TABLES)
    assert len(places) == len(tables.PLACE.findall(text)) == text.count("<!-- end of table -->")
    assert tables.filled(text, tables.read_results()) == text, "run benchmarks/tables.py"


def test_tables_say_what_is_measured() -> None:
    found = {"value": 2.0, "bar": 1.0, "unit": "voxels", "holds": False}
    good = {"value": 0.5, "bar": 1.0, "unit": "voxels", "holds": True}
    results = {"core/chamfer/one": good, "core/chamfer/other": found}
    assert "| 1 voxels | 1 of 2 | 1.25 | 2 (other) |" in tables.charts_table(results)
    assert "| other | 2 | 1 |" in tables.failures_table(results)
    least = {"value": 0.9, "bar": 0.99, "unit": "IoU", "holds": False}
    most = {"value": 1, "bar": 0.99, "unit": "IoU", "holds": True}
    results = {"core/labels/bad": least, "core/labels/good": most}
    assert "| 0.9 (bad) |" in tables.charts_table(results)


def test_a_table_that_was_changed_by_hand_is_noticed() -> None:
    page = "<!-- table: quality -->\nmine\n<!-- end of table -->"
    assert "mine" not in tables.filled(page, {})
