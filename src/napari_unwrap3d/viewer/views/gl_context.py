"""Two canvases in one window: what one of them deletes is its own."""

from __future__ import annotations

import weakref
from typing import Any


def finish_in_own_context(qt_viewer: Any) -> None:
    """Let napari delete what drew a layer in the OpenGL context that it was made in.

    When a layer is removed, napari 0.9 has vispy carry out what is left to do for its canvas,
    in whichever context is current. After the other canvas was drawn that is the other one's,
    where buffers, textures and programs of the same numbers are deleted instead; what draws with
    them then reads memory that is no longer there, and the process can end.

    Parameters
    ----------
    qt_viewer : napari.qt.QtViewer
        Of one of several canvases in a process.
    """
    scene = qt_viewer.canvas._scene_canvas
    context, seen = scene.context, weakref.ref(scene)
    if getattr(context.finish, "own", False):
        return
    finish = context.finish

    def in_own_context() -> None:
        canvas = seen()
        if canvas is not None:
            canvas.set_current()
        finish()

    in_own_context.own = True  # type: ignore[attr-defined]
    context.finish = in_own_context
