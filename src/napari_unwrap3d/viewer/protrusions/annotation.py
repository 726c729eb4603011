"""What is found becomes the annotation "protrusions"; what is done with it in threads."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.utils.notifications import show_info

from ...annotations.state import Drawn
from ...errors import ParameterError
from ...protrusions.editing import NAME, ProtrusionEdits

if TYPE_CHECKING:
    from ...annotations import Annotations
    from ...charts import Protrusions
    from ...pipeline import Pipeline

KEPT = "protrusions, edited"
PARTS = 2


def put_labels(annotations: Annotations, found: Protrusions, *, keep: bool = False) -> str:
    """Make what was found the annotation; what was drawn before cannot be undone any more.

    Else the first that a person takes back would be the run. `keep` what was the annotation
    before, by another name, which is returned; empty where nothing was kept.
    """
    kept = _put_away(annotations) if keep else ""
    if NAME in annotations.names:
        annotations.remove(NAME)
    state = annotations.state()
    drawn = Drawn(NAME, found.labels.astype(np.uint16))
    annotations.restore(replace(state, drawn=(*state.drawn, drawn)))
    return kept


def _put_away(annotations: Annotations) -> str:
    name, number = KEPT, 2
    while name in annotations.names:
        name, number = f"{KEPT} ({number})", number + 1
    annotations.rename(NAME, name)
    show_info(f"What you had edited is kept as the annotation “{name}”.")
    return name


def parted(edits: ProtrusionEdits, label: int, seeds: Any) -> tuple[ProtrusionEdits, Any]:
    """The parts of a protrusion; None where its peaks do not part it."""
    try:
        return edits, edits.parts_of(label, seeds, PARTS)
    except ParameterError:
        if seeds is None:
            return edits, None
        raise


def measured(
    edits: ProtrusionEdits, pipeline: Pipeline | None
) -> tuple[ProtrusionEdits, Protrusions]:
    """Measure what changed, and put it in the place of what was found."""
    return edits, edits.keep(pipeline)
