"""The mean flow over a movie as layers on the common surface: speed, direction, divergence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...tracking.flow_fields import DIRECTION, DIVERGENCE
from ...tracking.velocities import SPEED
from ..views.layers import CELL_AT_T, mesh_layer
from ..views.placing import same_view
from .layers import origin_of

if TYPE_CHECKING:
    from ...charts import Surface

NAMES = {
    SPEED: "flow: speed (µm/min)",
    DIRECTION: "flow: direction (°)",
    DIVERGENCE: "flow: divergence (1/min)",
}
# They lie where the flow is shown.
HIDDEN = (CELL_AT_T, "surface")
# Between these percentiles colours change.
SHOWN_PERCENT = 98.0


def show_flow(viewer: Any, surface: Surface) -> None:
    """Show the fields of a flow, each as a layer of its own; the first one is visible.

    Layers of an earlier flow give place, and the cell itself is hidden.

    Parameters
    ----------
    viewer : napari.Viewer
    surface : Surface
        From :func:`~napari_unwrap3d.tracking.flow_fields.flow_surface`.
    """
    from napari.layers import Layer

    active = viewer.layers.selection.active
    for name in HIDDEN:
        if name in viewer.layers:
            viewer.layers[name].visible = False
    with same_view(viewer):
        for field, name in NAMES.items():
            if name in viewer.layers:
                viewer.layers.remove(name)
            data, attributes, kind = mesh_layer(surface, name, field)
            attributes |= _colours(field, np.asarray(surface.fields[field]))
            # Without shading a colour is a value wherever the light comes from.
            attributes |= {"shading": "none", "visible": field == SPEED}
            attributes["translate"] = origin_of(viewer)
            viewer.layers.append(Layer.create(data, attributes, kind))
    viewer.layers.selection.active = active


def _colours(field: str, values: Any) -> dict[str, Any]:
    """A colour per direction; speeds from 0; what gathers and what spreads around 0."""
    if field == DIRECTION:
        return {"colormap": "hsv", "contrast_limits": (-180.0, 180.0)}
    known = np.abs(values[np.isfinite(values)])
    end = float(np.percentile(known, SHOWN_PERCENT)) if len(known) else 1.0
    end = end or 1.0
    if field == DIVERGENCE:
        return {"colormap": "coolwarm", "contrast_limits": (-end, end)}
    return {"colormap": "viridis", "contrast_limits": (0.0, end)}
