"""What a window looks like, as small plain data: kept in the project, and put back.

A project may come from anywhere, so everything that is read here is checked, and what makes
no sense is left as it is rather than an error: the view is no part of the result.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ...errors import Unwrap3DError
from ..annotations.annotating import open_annotating
from ..protrusions.instances import open_instances
from ..views.canvas import open_canvas
from ..views.layers import KEY, UNWRAPPED
from ..views.placing import chart_of

if TYPE_CHECKING:
    from napari.layers import Layer

logger = logging.getLogger(__name__)

# What napari, pydantic and we raise on values that make no sense.
NONSENSE = (ValueError, TypeError, KeyError, AttributeError, Unwrap3DError)
CAMERA = ("center", "zoom", "angles", "perspective")


def view_of(viewer: Any) -> dict[str, Any]:
    """What the window of a cell looks like.

    Parameters
    ----------
    viewer : napari.Viewer

    Returns
    -------
    dict
        JSON-able: which layers are visible, the camera, the chart and the depth in the second
        canvas, by what everything is coloured, and which protrusions are selected.
    """
    view: dict[str, Any] = {
        "ndisplay": int(viewer.dims.ndisplay),
        "camera": {name: _plain(getattr(viewer.scene.camera, name)) for name in CAMERA},
        "layers": {
            _name(layer): {"visible": bool(layer.visible), "opacity": float(layer.opacity)}
            for layer in viewer.layers
            if _name(layer)
        },
    }
    canvas = open_canvas(viewer)
    if canvas is not None:
        colouring, depth = canvas.colouring, canvas.depth_bar
        view["canvas"] = {"chart": canvas.chart}
        view["colouring"] = {
            "field": colouring.field,
            "colormap": str(colouring.colormap.name),
            "limits": [float(limit) for limit in colouring.limits],
        }
        view["depth"] = depth.state()
    instances = open_instances(viewer)
    if instances is not None and instances.found is not None:
        view["protrusions"] = instances.state()
    annotating = open_annotating(viewer)
    if annotating is not None:
        view["annotations"] = annotating.state()
    return view


def show_view(viewer: Any, view: Mapping[str, Any]) -> None:
    """Make a window look as it did; what is missing or makes no sense stays as it is."""
    for _ in showing_view(viewer, view):
        pass


def showing_view(viewer: Any, view: Mapping[str, Any]) -> Iterator[None]:
    """Do what :func:`show_view` does in pieces."""
    for part, restore in _PARTS.items():
        if part in view:
            _try(part, restore, viewer, view[part])
            yield


def _try(what: str, restore: Callable[..., None], *arguments: Any) -> None:
    try:
        restore(*arguments)
    except NONSENSE as error:
        logger.warning("The project's view has no usable %s (%s).", what, error)


def _layers(viewer: Any, layers: Mapping[str, Any]) -> None:
    for layer in viewer.layers:
        known = layers.get(_name(layer))
        if known is not None:
            layer.visible = bool(known["visible"])
            layer.opacity = float(known["opacity"])


def _ndisplay(viewer: Any, ndisplay: Any) -> None:
    if ndisplay in (2, 3):
        viewer.dims.ndisplay = ndisplay


def _camera(viewer: Any, camera: Mapping[str, Any]) -> None:
    numbers = [x for name in CAMERA for x in _flat(camera[name])]
    if not all(math.isfinite(number) for number in numbers) or not camera["zoom"] > 0:
        raise ValueError("numbers that are not finite")
    for name in CAMERA:
        value = camera[name]
        setattr(viewer.scene.camera, name, tuple(value) if isinstance(value, list) else value)


def _canvas(viewer: Any, known: Mapping[str, Any]) -> None:
    canvas = open_canvas(viewer)
    if canvas is not None and known["chart"] in UNWRAPPED:
        canvas.show_chart(known["chart"])


def _colouring(viewer: Any, known: Mapping[str, Any]) -> None:
    canvas = open_canvas(viewer)
    if canvas is not None:
        low, high = (float(limit) for limit in known["limits"])
        canvas.colouring.restore(str(known["field"]), str(known["colormap"]), (low, high))


def _depth(viewer: Any, known: Mapping[str, Any]) -> None:
    canvas = open_canvas(viewer)
    if canvas is not None:
        canvas.depth_bar.restore(known)


def _protrusions(viewer: Any, known: Mapping[str, Any]) -> None:
    instances = open_instances(viewer)
    if instances is not None and instances.found is not None:
        instances.restore(known)


def _annotations(viewer: Any, known: Mapping[str, Any]) -> None:
    annotating = open_annotating(viewer)
    if annotating is not None:
        annotating.restore(known)


# In the order in which they are put back.
_PARTS: dict[str, Callable[..., None]] = {
    "layers": _layers,
    "ndisplay": _ndisplay,
    "camera": _camera,
    "canvas": _canvas,
    "colouring": _colouring,
    "depth": _depth,
    "protrusions": _protrusions,
    "annotations": _annotations,
}


def _name(layer: Layer) -> str:
    """What a layer is called by us: the user may have renamed it; empty for others' layers."""
    return str(layer.metadata[KEY]["layer"]) if chart_of(layer) else ""


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, int | float) else [float(number) for number in value]


def _flat(value: Any) -> list[float]:
    return [float(number) for number in value] if isinstance(value, list) else [float(value)]
