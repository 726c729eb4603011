"""Saving annotations alone into a project that is there: quick, and never at its cost."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..annotations.state import State
from ..errors import InputError
from ..progress import Progress, silent
from .annotated import GROUP, checked_view, state_of, write_annotations
from .archive import NODE, read_node
from .atomic import replacing
from .project import SCHEMA_VERSION, opened

if TYPE_CHECKING:
    from ..annotations import Annotations


def save_annotations(
    path: str | Path,
    annotations: Annotations | State,
    view: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Path:
    """Put annotations in the place of those in a project; its charts stay as they are.

    The file is written anew beside the old one, which it replaces when it is complete: an
    interruption at any time costs nothing of what was there.

    Parameters
    ----------
    path : path
        A project of the same surface.
    annotations : Annotations or their state
        Take ``annotations.state()`` where they are drawn on while this runs in a thread.
    view : mapping, optional
        What the viewer wants back; what is there stays unless given.
    progress : Progress, optional

    Raises
    ------
    InputError
        There is no such file, or it is of another surface.
    FileFormatError
        It is no project, or damaged.
    """
    import zarr
    from zarr.storage import ZipStore

    report, path = progress if progress is not None else silent(), Path(path)
    state = state_of(annotations)
    assert state is not None
    with opened(path) as root:
        _check_same(root, state)
    with replacing(path) as partial:
        _copy(path, partial, checked_view(view) if view is not None else None, report)
        with ZipStore(partial, mode="a") as store:
            root = zarr.open_group(store, mode="r+", zarr_format=3, use_consolidated=False)
            write_annotations(root, state, report)
    report(1.0, "saved")
    return path


def _check_same(root: Any, state: State) -> None:
    """Raise unless the project's surface has a vertex for every label."""
    vertices = root["surface"]["vertices"].shape[0] if "surface" in root else 0
    image = root["uv"]["face"].shape if "uv" in root else None
    for part in state.drawn:
        fits = len(part.labels) == vertices and (part.image is None or part.image.shape == image)
        if not fits:
            raise InputError(
                "The annotations are of another surface than the project.",
                labels=len(part.labels),
                vertices=vertices,
                hint="Save the whole project.",
            )


def _copy(source: Path, target: Path, view: Mapping[str, Any] | None, report: Progress) -> None:
    """Copy a project without its annotations."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        node = read_node(old, NODE)
        node["attributes"]["schema_version"] = SCHEMA_VERSION
        if view is not None:
            node["attributes"]["view"] = view
        new.writestr(NODE, json.dumps(node))
        kept = [entry for entry in old.infolist() if _is_kept(entry.filename)]
        for index, entry in enumerate(kept):
            report(index / len(kept), "copying the charts")
            with old.open(entry) as content, new.open(entry.filename, "w") as copy:
                shutil.copyfileobj(content, copy, 2**20)


def _is_kept(name: str) -> bool:
    return name != NODE and not name.startswith(f"{GROUP}/")
