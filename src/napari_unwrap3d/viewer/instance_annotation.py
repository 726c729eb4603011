"""What was found becomes the annotation "protrusions"; what a person had edited is kept."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from napari.utils.notifications import show_info

from ..annotations.state import Drawn
from ..protrusions.editing import NAME

if TYPE_CHECKING:
    from ..annotations import Annotations
    from ..charts import Protrusions

KEPT = "protrusions, edited"


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
