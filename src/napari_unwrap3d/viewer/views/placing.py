"""Put layers into a viewer, or the new chart into the layer that showed the old one."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .layers import COPIES, KEY, LayerData

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer


def chart_of(layer: Layer) -> str:
    """The chart that a layer shows; empty for a layer that is not ours."""
    return str(layer.metadata.get(KEY, {}).get("chart", ""))


def set_vertices(layer: Layer, vertices: npt.NDArray[Any]) -> bool:
    """Give a mesh other positions, also one that was cut; False if they are too few or many."""
    copies = layer.metadata.get(KEY, {}).get(COPIES)
    whole = vertices if copies is None or len(vertices) <= copies.max() else vertices[copies]
    if len(whole) != len(layer.vertices):
        return False
    if not np.array_equal(whole, layer.vertices):
        layer.vertices = whole
    return True


def place_layers(viewer: ViewerModel, layers: Collection[LayerData]) -> None:
    """Do all of :func:`placing` at once."""
    for _ in placing(viewer, layers):
        pass


def show_unmirrored(viewer: ViewerModel) -> None:
    """Let z point away from the viewer, so that (x, y, z) is right-handed on the screen.

    napari's own choice, z towards the viewer, shows the mirror image of the cell; the uv
    image and mesh files are as the cell is, and so should be the view beside them.
    """
    viewer.scene.camera.orientation = ("away", "down", "right")


def placing(viewer: ViewerModel, layers: Collection[LayerData]) -> Iterator[None]:
    """Show the layers of some charts, in place of what was shown of them before.

    Yields when a layer is made, when it is there, and when it is seen: napari needs up to a
    tenth of a second for each, and the caller can let the window breathe in between.

    A layer that is there already keeps its position in the list, its colormap and,
    if the user changed them, its visibility and contrast limits. What the charts no
    longer have is removed. A new layer goes above its chart's other layers. A new chart
    goes below the other charts: the viewer takes its axis labels from the topmost
    volume or mesh, and with the charts in the order of the pipeline that is the
    surface in (z, y, x).
    """
    if not any(chart_of(layer) for layer in viewer.layers):
        show_unmirrored(viewer)
    new = {_name(attributes): (data, attributes, kind) for data, attributes, kind in layers}
    charts = {attributes["metadata"][KEY]["chart"] for _, attributes, _ in layers}
    for layer in [each for each in viewer.layers if chart_of(each) in charts]:
        name = layer.metadata[KEY]["layer"]
        if name in new:
            data, attributes, _ = new.pop(name)
            _update(layer, data, attributes)
        else:
            viewer.layers.remove(layer)
        yield
    chosen = set(viewer.layers.selection)
    added = []
    for chart, group in _by_chart(new.values()).items():
        for place, (data, attributes, kind) in enumerate(group, start=_place(viewer, chart)):
            shown = kind == "surface" and attributes.get("visible", True)
            # napari prepares a visible mesh three times while it inserts it, a hidden one never.
            layer = _made(data, attributes | {"visible": False} if shown else attributes, kind)
            yield
            # napari asks for it while it inserts the layer, and remembers it.
            _ = layer.extent
            yield
            with undisturbed(viewer):
                viewer.layers.insert(place, layer)
            added.append(layer)
            yield
            if shown:
                layer.visible = True
                _remember(layer)
                yield
    if chosen and viewer.layers.selection.active in added:
        viewer.layers.selection = chosen


def remove_charts(viewer: ViewerModel) -> None:
    """Take every chart out of the viewer."""
    ours = [each for each in viewer.layers if chart_of(each)]
    if not ours:
        return
    with viewer.layers.batched_update():
        for layer in ours:
            viewer.layers.remove(layer)


def _by_chart(layers: Collection[LayerData]) -> dict[str, list[LayerData]]:
    """Layers by chart, the chart that belongs on top first."""
    groups: dict[str, list[LayerData]] = {}
    for data, attributes, kind in layers:
        groups.setdefault(attributes["metadata"][KEY]["chart"], []).append((data, attributes, kind))
    return dict(reversed(groups.items()))


def _place(viewer: ViewerModel, chart: str) -> int:
    """Where the new layers of a chart go in the list."""
    charts = [chart_of(layer) for layer in viewer.layers]
    if chart in charts:
        return len(charts) - charts[::-1].index(chart)
    return next((index for index, each in enumerate(charts) if each), len(charts))


def _name(attributes: dict[str, Any]) -> str:
    return str(attributes["metadata"][KEY]["layer"])


@contextmanager
def undisturbed(viewer: ViewerModel) -> Iterator[None]:
    """Keep napari from preparing all visible meshes anew because another layer moved a slider.

    A mesh whose axes are all displayed looks the same wherever the sliders are.
    """
    with ExitStack() as blocked:
        for layer in viewer.layers:
            if type(layer).__name__ == "Surface" and layer.ndim <= viewer.dims.ndisplay:
                blocked.enter_context(layer.events.set_data.blocker())
        yield


@contextmanager
def same_view(viewer: ViewerModel) -> Iterator[None]:
    """Keep the camera where it is: napari fits the view anew when a layer brings another axis."""
    camera = viewer.scene.camera
    before = {name: getattr(camera, name) for name in ("center", "zoom", "angles")}
    yield
    for name, value in before.items():
        setattr(camera, name, value)


def _made(data: Any, attributes: dict[str, Any], kind: str) -> Layer:
    from napari.layers import Layer

    layer = Layer.create(data, attributes, kind)
    _remember(layer)
    return layer


def _update(layer: Layer, data: Any, attributes: dict[str, Any]) -> None:
    shown = layer.metadata[KEY]["shown"]
    seen, limits = _seen(layer)
    if not _same(layer.data, data):
        _take_texture_off(layer)
        layer.data = data
    for name in ("scale", "translate"):
        # Setting what is there already makes napari look at all layers again.
        if name in attributes and not np.array_equal(getattr(layer, name), attributes[name]):
            setattr(layer, name, attributes[name])
    for name in ("features", "size"):
        if name in attributes:
            setattr(layer, name, attributes[name])
    layer.metadata = attributes["metadata"]
    if seen == shown[0]:
        layer.visible = attributes.get("visible", True)
    if limits == shown[1] and "contrast_limits" in attributes:
        layer.contrast_limits = attributes["contrast_limits"]
    _remember(layer)


def _take_texture_off(layer: Layer) -> None:
    """A texture, and the white below it, belong to the mesh that the layer had."""
    if getattr(layer, "texture", None) is not None:
        with layer.events.set_data.blocker():
            layer.vertex_colors = None
            layer.texture = None
        layer.texcoords = None


def _same(old: Any, new: Any) -> bool:
    """Whether data are equal; the comparison is much faster than showing them anew."""
    if isinstance(new, tuple):
        return all(_same(a, b) for a, b in zip(old, new, strict=True))
    return type(old) is type(new) and bool(np.array_equal(old, new))


def _seen(layer: Layer) -> tuple[bool, tuple[float, ...]]:
    limits = getattr(layer, "contrast_limits", ())
    return layer.visible, tuple(float(limit) for limit in np.ravel(limits))


def _remember(layer: Layer) -> None:
    """What we set, so that what the user changed is told from it."""
    layer.metadata[KEY]["shown"] = _seen(layer)
