"""A canvas that draws nothing with what layers left behind that are gone.

vispy tells the graphics card where each vertex attribute of a layer is (positions, texture
coordinates, …), and never that it is over. When a layer is removed its buffers are deleted, and
the next layer with fewer attributes makes the driver read where they were: Mesa's ends the
process. Before every frame all attributes are therefore taken back; each layer sets its own.
"""

from __future__ import annotations

import logging
from typing import Any

from vispy.gloo import gl

logger = logging.getLogger(__name__)

# As many as any context has.
FEWEST = 8


def begin_afresh(qt_viewer: Any) -> None:
    """Let a canvas take back all vertex attributes before each frame.

    Parameters
    ----------
    qt_viewer : napari.qt.QtViewer
        Asked more than once it does the same.
    """
    try:
        draw = qt_viewer.canvas._scene_canvas.events.draw
    except AttributeError:
        logger.warning("napari keeps its canvas elsewhere: attributes are not taken back.")
        return
    if _take_back not in draw.callbacks:
        draw.connect(_take_back, position="first")


def _take_back(_: Any = None) -> None:
    import sys; print('TB', gl.glGetParameter(gl.GL_MAX_VERTEX_ATTRIBS), file=sys.stderr, flush=True)
    for attribute in range(max(int(gl.glGetParameter(gl.GL_MAX_VERTEX_ATTRIBS)), FEWEST)):
        gl.glDisableVertexAttribArray(attribute)
