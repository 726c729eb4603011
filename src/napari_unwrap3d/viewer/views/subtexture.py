"""Showing changed parts of a layer's texture at once.

napari has no public way to change a part of a texture: its event sends all of it to the
graphics card, and the texture coordinates with it, 15 ms for a large mesh. This module
knows where napari keeps the texture; where a version of napari keeps it elsewhere, the
event is used.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...textured import Box, Colours

if TYPE_CHECKING:
    from napari.layers import Surface

# The texture of ours that each of vispy's filters shows.
_TEXTURES: weakref.WeakKeyDictionary[Any, Any] = weakref.WeakKeyDictionary()


def show_boxes(viewer: Any, layer: Surface, pixels: Colours, boxes: Sequence[Box]) -> bool:
    """Show some boxes of a layer's texture, which were changed in place.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : Surface
        Its texture is `pixels`.
    pixels : ndarray, (rows, columns, 3) uint8
    boxes : sequence of Box

    Returns
    -------
    bool
        Whether only the boxes had to be sent.
    """
    if not boxes:
        return True
    try:
        visual = viewer.window._qt_viewer.canvas.layer_to_visual[layer]
        texture_filter = visual._texture_filter
        shader, node = texture_filter.fshader, visual.node
    except (AttributeError, KeyError):
        layer.events.texture(value=pixels)
        return False
    texture = _TEXTURES.get(texture_filter)
    if texture is None or _shown(shader) is not texture:
        _TEXTURES[texture_filter] = _take_over(shader, pixels)
    else:
        rows = len(pixels)
        for first, last, left, right in boxes:
            # Rows are counted from below on the graphics card.
            part = np.ascontiguousarray(pixels[first:last, left:right][::-1])
            texture.set_data(part, offset=(rows - last, left))
    node.update()
    return True


def _shown(shader: Any) -> Any:
    variable = shader["u_texture"]
    return getattr(variable, "value", variable)


def _take_over(shader: Any, pixels: Colours) -> Any:
    """Show a texture that can be changed in part."""
    from vispy.gloo import Texture2D

    texture = Texture2D(np.ascontiguousarray(pixels[::-1]))
    shader["u_texture"] = texture
    return texture
