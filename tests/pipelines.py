"""What several test modules do with a pipeline: change, copy and cancel."""

from __future__ import annotations

from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.progress import Progress
from shapes import QUICK


def changed(group: str, **values: object) -> Parameters:
    step = getattr(QUICK, group).model_copy(update=values)
    return QUICK.model_copy(update={group: step})


def copy_of(pipeline: Pipeline) -> Pipeline:
    return Pipeline(pipeline.source, dict(pipeline.kept))


def cancelling_after(moment: int) -> Progress:
    """A reporter that cancels itself at its n-th report."""
    reports = iter(range(1, 10**6))

    def callback(step: str, fraction: float, message: str) -> None:
        if next(reports) == moment:
            progress.cancel()

    progress = Progress(callback)
    return progress
