"""The movie's day in a window: a simulated timelapse, the page Movie, and Run pressed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...charts import Stack
from ...parameters import Parameters
from ..demo import WINDOW
from ..files.samples import timelapse_layer

if TYPE_CHECKING:
    import napari

    from .wizard import MoviePanel


def open_movie_demo(stack: Stack, output: Path, parameters: Parameters) -> None:
    """Open napari with a timelapse and unwrap it; returns when the window is closed.

    Parameters
    ----------
    stack : Stack
        With a t axis.
    output : path
        Where the movie is saved when it is done (``*.unwrap3d``).
    parameters : Parameters
    """
    import napari

    viewer = napari.Viewer(title="napari-unwrap3d")
    start_movie_demo(viewer, stack, output, parameters)
    napari.run()


def start_movie_demo(
    viewer: napari.Viewer,
    stack: Stack,
    output: Path | None,
    parameters: Parameters,
    on_done: Callable[[napari.Viewer], Any] | None = None,
) -> MoviePanel:
    """Do in an open viewer what :func:`open_movie_demo` does; returns the panel."""
    from napari.layers import Layer

    from ..wizard import open_wizard
    from .sections import run_or_tell

    viewer.window.resize(*WINDOW)
    viewer.layers.append(Layer.create(*timelapse_layer(stack)))
    panel = open_wizard(viewer).show_movie()
    panel.run.session.set_parameters(parameters)

    def ended(running: bool) -> None:
        if running:
            return
        panel.run.running_changed.disconnect(ended)
        if output is not None and panel.run.movie is not None and not panel.run.failures:
            panel.save(output)
        if on_done is not None:
            on_done(viewer)

    panel.run.running_changed.connect(ended)
    run_or_tell(panel.run, "frame")
    return panel
