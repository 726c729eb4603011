"""A window that shows an atlas, without a run of the pipeline."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Stack
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.viewer.session import session_of
from napari_unwrap3d.viewer.steps.computing import Known
from napari_unwrap3d.viewer.views.canvas import UnwrappedCanvas, canvas_of
from napari_unwrap3d.viewer.views.layers import Layout, atlas_charts, chart_layers

SECONDS = 60_000


def ramp_stack(atlas: Atlas) -> Stack:
    """Two channels from the corner at zero: ten times the number of the z slice, and of y."""
    reach = np.subtract(atlas.mask.shape, atlas.mask.to_index(np.zeros(3)))
    z, y, _ = np.indices(np.ceil(reach).astype(int))
    ramps = np.stack([10 * z, 10 * y]).astype(np.uint16)
    return Stack(ramps, "czyx", atlas.mask.voxel_size, channels=("actin", "septin"))


def open_atlas(
    viewer: Any,
    atlas: Atlas,
    qtbot: Any,
    source: Any = None,
    names: Collection[str] = ("surface", "uv", "topography"),
) -> UnwrappedCanvas:
    """Do what the end of a run does; returns the second canvas when everything is drawn.

    Parameters
    ----------
    names : collection of str
        The layers that are shown; napari needs a quarter of a second for each.
    """
    session = session_of(viewer)
    pipeline = Pipeline.resumed(atlas, atlas.mask if source is None else source)
    charts = atlas_charts(atlas)
    layout = Layout.of(charts)
    layers = [layer for name in reversed(charts) for layer in chart_layers(name, charts, layout)]
    known = Known(pipeline, (), shown=charts)
    chosen = [each for each in layers if each[1]["name"] in names]
    session.adopt(known, atlas, session.source, chosen)
    qtbot.waitUntil(lambda: session.atlas is atlas, timeout=SECONDS)
    canvas = canvas_of(viewer)
    settle(canvas, qtbot)
    qtbot.waitUntil(lambda: canvas.cursor.ready, timeout=SECONDS)
    return canvas


def settle(canvas: UnwrappedCanvas, qtbot: Any) -> None:
    """Wait until the field is on every layer."""
    colouring = canvas.colouring
    qtbot.waitUntil(lambda: not colouring.busy, timeout=SECONDS)


def coarsely_direct(atlas: Atlas) -> Atlas:
    """A copy of an atlas with a direct chart as small as its uv image.

    Another test may have asked the shared atlas for a finer one; a plane stays.
    """
    parameters = atlas.parameters
    coarse = parameters.direct.model_copy(update={"rows": atlas.uv.shape[0]})
    others = {name: chart for name, chart in atlas.on_request.items() if name != "direct"}
    copy = atlas.replaced(
        parameters=parameters.model_copy(update={"direct": coarse}), on_request=others
    )
    assert copy.direct.shape == copy.uv.shape
    return copy
