"""The main job in a window: a sample cell, the dock widget, and Run pressed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..parameters import Parameters
from .files.samples import sample

if TYPE_CHECKING:
    import napari

    from ..atlas import Atlas

WINDOW = (1600, 1000)


def open_demo(
    kind: str = "blebs",
    output: str | Path | None = None,
    parameters: Parameters | None = None,
    on_done: Callable[[napari.Viewer], Any] | None = None,
    *,
    size: int = 200,
    seed: int = 0,
) -> None:
    """Open napari with a simulated cell and unwrap it; returns when the window is closed.

    Parameters
    ----------
    kind : str
        One of :data:`napari_unwrap3d.simulate.KINDS`.
    output : path, optional
        Save the atlas there (``*.unwrap3d``) when it is done.
    parameters : Parameters, optional
        Shown in the form and used for the run.
    on_done : callable, optional
        Called with the viewer when the run has ended, well or not.
    size : int
        Edge of the simulated field of view in voxels.
    seed : int
        Which random cell.
    """
    import napari

    viewer = napari.Viewer(title="napari-unwrap3d")
    start_demo(viewer, kind, output, parameters, on_done, size=size, seed=seed)
    napari.run()


def start_demo(
    viewer: napari.Viewer,
    kind: str = "blebs",
    output: str | Path | None = None,
    parameters: Parameters | None = None,
    on_done: Callable[[napari.Viewer], Any] | None = None,
    *,
    size: int = 200,
    seed: int = 0,
) -> Any:
    """Do in an open viewer what :func:`open_demo` does; returns the dock widget."""
    from napari.layers import Layer

    from .wizard import Wizard

    viewer.window.resize(*WINDOW)
    stack, *others = [Layer.create(*layer) for layer in sample(kind, size=size, seed=seed)]
    viewer.layers.extend([stack, *others])
    viewer.layers.selection.active = stack
    widget = Wizard(viewer)
    widget.session.set_source(stack)
    viewer.window.add_dock_widget(widget, name="Unwrap", area="right")
    if parameters is not None:
        widget.session.set_parameters(parameters)

    def done(atlas: Atlas | None) -> None:
        if atlas is not None and output is not None:
            widget.save(output)
        if on_done is not None:
            on_done(viewer)

    widget.session.finished.connect(done)
    widget.session.stopped.connect(lambda _: done(None))
    widget.run()
    return widget
