"""The layer of a movie's surface: its mesh is swapped at every timepoint, as one change."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...textured import PaintedTexture
from ..views.layers import KEY, MISSING

if TYPE_CHECKING:
    from napari.layers import Surface

SHADES = 256
WHITE = np.full((2, 2, 3), 255, np.uint8)


def swap_mesh(
    layer: Surface,
    vertices: npt.NDArray[Any],
    faces: npt.NDArray[Any],
    values: npt.NDArray[Any],
    texture: npt.NDArray[np.uint8] | None = None,
    coordinates: npt.NDArray[np.float32] | None = None,
) -> None:
    """Give a layer another mesh, its values and its texture at once.

    napari would show each of them by itself, with the others of the last mesh, and look at all
    layers again for the new extent. Here it shows all of them once, and the viewer keeps the
    extent of the first mesh.

    Parameters
    ----------
    layer : Surface
    vertices : ndarray, (p, 3)
    faces : ndarray, (m, 3)
    values : ndarray, (p,)
        Of the field; NaN where it has none.
    texture : ndarray, (rows, columns, 3) uint8, optional
        Shown in the place of the values.
    coordinates : ndarray, (p, 2), optional
        Of the vertices in the texture.
    """
    missing = np.isnan(values)
    textured = texture is not None
    if texture is None and layer.texture is not None:
        # napari keeps the coordinates of a texture that is taken away, and the graphics card
        # reads beyond their end when the next mesh is larger: white leaves the values as they are.
        texture, coordinates = WHITE, np.zeros((len(vertices), 2), np.float32)
    events = layer.events
    with ExitStack() as blocked:
        for event in (events.set_data, events.data, events.texture, events.texcoords):
            blocked.enter_context(event.blocker())
        layer.texture = layer.texcoords = None
        if layer.vertex_colors is not None:
            layer.vertex_colors = None
        layer.data = (vertices, faces, np.where(missing, 0.0, values).astype(np.float32))
        if textured:
            layer.vertex_colors = np.ones((len(vertices), 4), np.float32)
        if texture is not None:
            layer.texcoords = coordinates
            layer.texture = texture
    layer.metadata[KEY][MISSING] = missing
    layer.refresh(extent=False)


def draw_field(texture: PaintedTexture, image: npt.NDArray[Any], layer: Surface) -> None:
    """Draw an image of a field into a texture, in the colours of a layer."""
    colours = layer.colormap.map(np.linspace(0.0, 1.0, SHADES))[:, :3]
    table = np.rint(255 * np.asarray(colours)).astype(np.uint8)
    texture.set_field(image, table, tuple(layer.contrast_limits), layer.gamma)
