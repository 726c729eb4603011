"""Options that several commands share, and how the parameters follow from them."""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Any, get_args

from .errors import ParameterError
from .files.formats import NAMES
from .parameters import PRESETS, Parameters


def add_reading(parser: argparse._ActionsContainer) -> None:
    """Options that say how a file is read."""
    parser.add_argument(
        "--voxel-size", type=float, nargs=3, metavar=("Z", "Y", "X"), help="voxel size in µm"
    )
    parser.add_argument("--scale", type=float, help="µm per unit of a mesh file (default: 1)")
    parser.add_argument("--axes", help="axes of the stack, letters out of tczyx, e.g. tzyx")
    parser.add_argument("--dataset", help="which dataset of an HDF5 file")


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Options that set parameters."""
    parser.add_argument("--preset", choices=sorted(PRESETS), help="the paper's values for a kind")
    parser.add_argument("--params", type=Path, metavar="FILE", help="parameters in a TOML file")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="STEP.NAME=VALUE",
        help="one parameter, e.g. uv.rows=256; `info --parameters` lists them",
    )


def add_charts(parser: argparse.ArgumentParser, movies: str = "") -> None:
    """Options for charts that are not always made; `movies`: what they are of movies."""
    parser.add_argument(
        "--direct",
        action="store_true",
        help="also make the direct chart: the whole surface on one image, one to one",
    )
    parser.add_argument(
        "--plane", action="store_true", help="also flatten the surface to a plane (Step 7)"
    )
    parser.add_argument(
        "--protrusions",
        action="store_true",
        help=f"also find and measure every bleb, lamellipodium and filopodium{movies}",
    )


def add_comparing(parser: argparse.ArgumentParser) -> None:
    """Options that say how two meshes are compared, and how the result is shown."""
    parser.add_argument("--scale", type=float, help="µm per unit of mesh files (default: 1)")
    parser.add_argument(
        "--projections", type=int, default=50, help="directions of the sliced distances (50)"
    )
    parser.add_argument(
        "--samples", type=int, default=20_000, help="points on each surface, by area (20000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of directions and points (0)")
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")


def add_output(parser: argparse.ArgumentParser, default: Path | None) -> None:
    """Options that say what is written and where."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=default,
        required=default is None,
        metavar="FOLDER",
        help="where to write" + (f" (default: {default})" if default else ""),
    )
    parser.add_argument(
        "--format",
        action="append",
        default=[],
        choices=NAMES,
        help="format of meshes, images or tables instead of ply, ome-tiff and csv; several can be "
        "given (obj has a texture, parquet needs pyarrow)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier export")
    parser.add_argument("--no-pictures", action="store_true", help="write no PNG pictures")
    parser.add_argument("--quiet", action="store_true", help="print errors only")


def chosen_parameters(arguments: argparse.Namespace) -> Parameters:
    """Preset, then the file, then single options: the later ones win."""
    return Parameters.from_dict(set_values(arguments))


def set_values(arguments: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The parameters that the options set, by their groups; the others are not there."""
    values: dict[str, Any] = {}
    if arguments.preset:
        _merge(values, PRESETS[arguments.preset])
    if arguments.params is not None:
        _merge(values, Parameters.from_toml(arguments.params).model_dump(exclude_unset=True))
    single = {
        name: getattr(arguments, name)
        for name in ("channel", "timepoint", "label")
        if getattr(arguments, name, None) is not None
    }
    _merge(values, {"stack": single} if single else {})
    for setting in arguments.set:
        _merge(values, _parsed_setting(setting))
    for chart in ("direct", "plane", "protrusions"):
        if getattr(arguments, chart, False):
            _merge(values, {chart: {"compute": True}})
    return values


def _merge(values: dict[str, Any], more: dict[str, Any]) -> None:
    for step, group in more.items():
        values[step] = {**values.get(step, {}), **group}


def _parsed_setting(setting: str) -> dict[str, Any]:
    name, equals, text = setting.partition("=")
    step, dot, key = name.strip().partition(".")
    if not (equals and dot and step and key):
        raise ParameterError(
            f"{setting!r} is no setting.", hint="Write STEP.NAME=VALUE, e.g. --set uv.rows=256."
        )
    if text.strip() in _choices(step, key):
        return {step: {key: text.strip()}}
    return {step: {key: _parsed_value(text.strip())}}


def _choices(step: str, key: str) -> tuple[Any, ...]:
    """The words that a parameter may be; of some, ``none`` is one."""
    group: Any = Parameters.model_fields.get(step)
    field = group and group.annotation.model_fields.get(key)
    return get_args(field.annotation) if field else ()


def _parsed_value(text: str) -> Any:
    """A TOML value; a bare word is text; nothing and ``none`` mean empty."""
    if text.lower() in ("", "none"):
        return None
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
