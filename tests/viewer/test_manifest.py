"""The manifest is valid, and what it names exists."""

from __future__ import annotations

import importlib
from pathlib import Path

import npe2
import pytest
from napari._app_model.constants._menus import is_menu_contributable
from npe2 import PluginManager

from napari_unwrap3d import simulate
from napari_unwrap3d.files.meshes import MESH_SUFFIXES

PROJECT = Path(__file__).resolve().parents[2]
MANIFEST = PROJECT / "src" / "napari_unwrap3d" / "napari.yaml"


@pytest.fixture(scope="module")
def manifest() -> npe2.PluginManifest:
    return npe2.PluginManifest.from_file(MANIFEST)


def test_the_top_level_link_leads_to_it() -> None:
    assert (PROJECT / "napari.yaml").resolve() == MANIFEST


def test_every_command_can_be_imported(manifest: npe2.PluginManifest) -> None:
    commands = manifest.contributions.commands or []
    assert commands
    for command in commands:
        module, name = str(command.python_name).split(":")
        assert callable(getattr(importlib.import_module(module), name))


def test_the_menus_lead_to_our_docks(manifest: npe2.PluginManifest) -> None:
    docks = {widget.command for widget in manifest.contributions.widgets or ()}
    assert manifest.contributions.menus
    for menu, items in manifest.contributions.menus.items():
        assert is_menu_contributable(menu)
        assert {item.command for item in items} <= docks


def test_every_kind_of_cell_is_a_sample_and_a_movie(manifest: npe2.PluginManifest) -> None:
    found = {sample.key for sample in manifest.contributions.sample_data or ()}
    assert found == {*simulate.KINDS, "blebbing", "tracked_blebs"}


def test_readers_take_our_files_and_leave_tiff_alone(
    manifest: npe2.PluginManifest, npe2pm: PluginManager
) -> None:
    with npe2pm.tmp_plugin(manifest=manifest):
        for name in (*(f"cell{suffix}" for suffix in MESH_SUFFIXES), "cell.unwrap3d", "movie.json"):
            found = [r.command for r in npe2pm.iter_compatible_readers([name])]
            assert len(found) == 1
        for name in ("stack.tif", "stack.ome.tiff", "stack.zarr", "table.csv"):
            assert not list(npe2pm.iter_compatible_readers([name]))


def test_the_writer_saves_surface_layers(
    manifest: npe2.PluginManifest, npe2pm: PluginManager
) -> None:
    with npe2pm.tmp_plugin(manifest=manifest):
        (writer,) = npe2pm.iter_compatible_writers(["surface"])
        assert set(writer.filename_extensions) == set(MESH_SUFFIXES)
        assert not list(npe2pm.iter_compatible_writers(["image"]))
