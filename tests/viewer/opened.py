"""A window that shows an atlas, without a run of the pipeline."""

from __future__ import annotations

from typing import Any

import numpy as np

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Stack
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.viewer.canvas import UnwrappedCanvas, canvas_of
from napari_unwrap3d.viewer.computing import Known
from napari_unwrap3d.viewer.layers import Layout, atlas_charts, chart_layers
from napari_unwrap3d.viewer.session import session_of
from synthetic import VOXEL

SECONDS = 20_000


def ramp_stack(atlas: Atlas) -> Stack:
    """Two channels on the grid of the mask: twenty times z in µm, and then y."""
    shape = atlas.mask.shape
    z = np.broadcast_to(20 * VOXEL * np.arange(shape[0])[:, None, None], shape)
    return Stack(
        np.stack([z, z.transpose(1, 0, 2)]).astype(np.uint16),
        "czyx",
        (VOXEL,) * 3,
        channels=("actin", "septin"),
    )


def open_atlas(viewer: Any, atlas: Atlas, qtbot: Any, source: Any = None) -> UnwrappedCanvas:
    """Do what the end of a run does; returns the second canvas when everything is drawn."""
    session = session_of(viewer)
    session._known = Known(Pipeline(atlas.mask if source is None else source), ())
    session._turn_to_3d = session._fit_at_end = True
    charts = atlas_charts(atlas)
    layout = Layout.of(charts)
    layers = [layer for name in reversed(charts) for layer in chart_layers(name, charts, layout)]
    for _ in session._place(layers):
        pass
    session._finish(atlas)
    canvas = canvas_of(viewer)
    settle(canvas, qtbot)
    qtbot.waitUntil(lambda: canvas.cursor.ready, timeout=SECONDS)
    return canvas


def settle(canvas: UnwrappedCanvas, qtbot: Any) -> None:
    """Wait until the field is on every layer."""
    colouring = canvas.colouring
    qtbot.waitUntil(lambda: not colouring.busy, timeout=SECONDS)
