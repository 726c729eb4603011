"""A single cell of a batch: the pipeline and the files that `run` writes, kept and resumed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..atlas import Atlas
from ..charts import Stack
from ..errors import Unwrap3DError
from ..files.atomic import write_json
from ..files.export import PROJECT_NAME, export_atlas
from ..files.project import load_project
from ..motion.timelapse import Source, Timelapse
from ..parameters import Parameters
from ..pipeline import STEP_VERSION, Pipeline
from ..progress import silent
from ..provenance import content_hash
from ..sampling import with_signals
from .jobs import Job

RECORD = "batch.json"


def unwrap_cell(job: Job) -> tuple[bool, dict[str, Any]]:
    """Unwrap a cell and write its files, unless that was done with the same input.

    Steps whose parameters did not change since are not run again.

    Returns
    -------
    bool
        Whether something was done.
    dict
        What was measured.

    Raises
    ------
    Unwrap3DError
        A step could not do its work.
    """
    folder = Path(job.folder)
    source = job.source()
    source_key = _source_key(source, job.parameters)
    key = content_hash(
        STEP_VERSION, source_key, job.parameters.to_toml(), job.exports.model_dump_json()
    )
    record = record_of(folder)
    if record.get("key") == key and (folder / PROJECT_NAME).is_file():
        return False, dict(record["numbers"])
    pipeline = Pipeline(source)
    if record.get("source") == source_key and record.get("step_version") == STEP_VERSION:
        pipeline = _resumed(folder / PROJECT_NAME, source)
    atlas = _named(pipeline.run(job.parameters), job)
    stack = source if isinstance(source, Stack) else None
    if stack is not None and job.exports.signals:
        atlas = with_signals(atlas, stack, job.exports.signals, silent())
    # Until the record is there anew, the files are not all of one run.
    (folder / RECORD).unlink(missing_ok=True)
    export_atlas(
        atlas,
        folder,
        stack=stack,
        pictures=job.exports.pictures,
        formats=job.exports.chosen_formats(),
        overwrite=True,
    )
    numbers = measured(atlas)
    write_json(
        folder / RECORD,
        {"key": key, "source": source_key, "step_version": STEP_VERSION, "numbers": numbers},
    )
    return True, numbers


def measured(atlas: Atlas) -> dict[str, Any]:
    """The numbers of a cell's row."""
    surface = atlas.quality.get("surface", {})
    return {name: surface.get(name) for name in ("volume_um3", "area_um2")}


def _source_key(source: Source, parameters: Parameters) -> str:
    """Hash of all that is unwrapped; reads it."""
    if isinstance(source, Stack) and source.timepoints > 1:
        return Timelapse(source, 1.0).key(parameters.stack.timepoint)
    return Timelapse((source,), 1.0).key(0)


def record_of(folder: Path) -> dict[str, Any]:
    """What the batch noted when everything in a folder was written; empty where it did not."""
    try:
        found = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _resumed(project: Path, source: Source) -> Pipeline:
    """With the steps of an earlier run, where its project can be read."""
    try:
        return Pipeline.resumed(load_project(project), source)
    except (Unwrap3DError, OSError):
        return Pipeline(source)


def _named(atlas: Atlas, job: Job) -> Atlas:
    """Masks and meshes have no name of their own."""
    if atlas.provenance["source"]["name"]:
        return atlas
    named = {**atlas.provenance["source"], "name": Path(job.file).name}
    return atlas.replaced(provenance={**atlas.provenance, "source": named})
