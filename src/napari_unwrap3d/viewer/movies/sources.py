"""napari layers → the timelapse that a movie is made from.

A layer with a t axis is a timelapse; so are several layers of one kind without one, in the
order of their names. The seconds between two timepoints are read from the layer's scale and
units, or asked for: they are never guessed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...charts import Mask, Size3, Stack, Surface
from ...errors import InputError
from ...motion.timelapse import Timelapse
from ..views.sources import (
    is_source,
    layer_axes,
    layer_source,
    layer_time_step,
    layer_voxel_size,
    place,
)

if TYPE_CHECKING:
    from napari.layers import Layer

SECOND = "second"
# In a layer's metadata: it is the solid of a movie's common space.
SPACE_LAYER = "common space of a movie"


@dataclass(frozen=True)
class Candidate:
    """One or more layers that can be a timelapse.

    Attributes
    ----------
    title : str
        As it is offered.
    layers : tuple of Layer
        One with a t axis, or one for each timepoint.
    timepoints : int
    """

    title: str
    layers: tuple[Layer, ...]
    timepoints: int

    @property
    def voxel_size(self) -> Size3 | None:
        """(z, y, x) in µm, or None where a layer is in pixels."""
        found = [layer_voxel_size(layer) for layer in self.layers]
        return found[0] if all(found) else None

    @property
    def time_step(self) -> float | None:
        """Seconds, where the layer tells."""
        return layer_time_step(self.layers[0]) if len(self.layers) == 1 else None

    @property
    def is_of_labels(self) -> bool:
        return type(self.layers[0]).__name__ == "Labels"

    @property
    def has_channels(self) -> bool:
        """Whether a layer has a c axis."""
        first = self.layers[0]
        return type(first).__name__ != "Surface" and "c" in layer_axes(first)


def candidates(layers: Any) -> list[Candidate]:
    """What of some layers can be a timelapse.

    Parameters
    ----------
    layers : sequence of Layer
        Of a viewer.
    """
    own = [layer for layer in layers if is_source(layer) and SPACE_LAYER not in layer.metadata]
    found = []
    for layer in own:
        count = timepoints_of(layer)
        if count > 1:
            found.append(Candidate(f"{layer.name} ({count} timepoints)", (layer,), count))
    groups: dict[tuple[str, int], list[Layer]] = {}
    for layer in own:
        if kind := _kind(layer):
            groups.setdefault((kind, layer.ndim), []).append(layer)
    for (kind, _), members in groups.items():
        if len(members) > 1:
            ordered = tuple(sorted(members, key=lambda layer: natural(layer.name)))
            title = f"{len(ordered)} {kind}: {ordered[0].name} … {ordered[-1].name}"
            found.append(Candidate(title, ordered, len(ordered)))
    return found


def timepoints_of(layer: Layer) -> int:
    """How many timepoints a layer has; 1 without a t axis."""
    if type(layer).__name__ == "Surface":
        vertices = layer.data[0]
        return len(np.unique(vertices[:, 0])) if vertices.shape[1] == 4 else 1
    axes = layer_axes(layer)
    if "t" not in axes:
        return 1
    data = layer.data[0] if getattr(layer, "multiscale", False) else layer.data
    return int(data.shape[axes.index("t")])


def natural(name: str) -> list[Any]:
    """A key that sorts numbers in names as numbers."""
    return [int(part) if part.isdigit() else part.lower() for part in re.split(r"(\d+)", name)]


def _kind(layer: Layer) -> str:
    """What several layers are together, one for each timepoint; empty where they cannot be."""
    if type(layer).__name__ == "Surface":
        return "meshes" if layer.data[0].shape[1] == 3 else ""
    if "t" in layer_axes(layer):
        return ""
    if type(layer).__name__ == "Labels":
        return "label images"
    return "masks" if layer.dtype == np.bool_ else "stacks"


def timelapse_of(
    chosen: Candidate, voxel_size: Size3 | None, time_step: float | None
) -> tuple[Timelapse, Size3]:
    """The timelapse in some layers, and where its coordinate zero lies in the viewer.

    Parameters
    ----------
    chosen : Candidate
    voxel_size : (float, float, float) or None
        (z, y, x) in µm, for layers in pixels.
    time_step : float or None
        Seconds between two timepoints, where the layer does not tell.

    Returns
    -------
    (Timelapse, (z, y, x) in µm)

    Raises
    ------
    Unwrap3DError
        As :func:`~..views.sources.layer_source` and :meth:`Timelapse.of`.
    """
    first = chosen.layers[0]
    step = time_step if chosen.time_step is None else chosen.time_step
    if len(chosen.layers) == 1:
        if type(first).__name__ == "Surface":
            return Timelapse.of(_meshes(first, voxel_size), step, first.name), (0.0, 0.0, 0.0)
        source = layer_source(first, voxel_size)
        assert isinstance(source.data, Stack)
        return Timelapse.of(source.data, step), source.origin
    sources = [layer_source(layer, voxel_size) for layer in chosen.layers]
    origins = {source.origin for source in sources}
    name = _common_name([layer.name for layer in chosen.layers])
    if len(origins) == 1:
        return Timelapse.of([source.data for source in sources], step, name), sources[0].origin
    placed = [_placed(source.data, source.origin) for source in sources]
    return Timelapse.of(placed, step, name), (0.0, 0.0, 0.0)


def _placed(data: Stack | Mask | Surface, origin: Size3) -> Stack | Mask | Surface:
    """A source in the viewer's coordinates."""
    if isinstance(data, Surface):
        return Surface(data.vertices + np.asarray(origin), data.faces)
    if isinstance(data, Mask):
        return Mask(data.data, data.voxel_size, origin)
    raise InputError(
        "The stacks of the timepoints lie at different places.",
        hint="Move the layers onto one another, and let the registration find the drift.",
    )


def _meshes(layer: Any, voxel_size: Size3 | None) -> list[Surface]:
    """The mesh of every timepoint of a surface whose vertices are (t, z, y, x)."""
    sizes = layer_voxel_size(layer) or voxel_size
    vertices, faces = np.asarray(layer.data[0], float), np.asarray(layer.data[1])
    place = np.asarray(layer.translate[-3:]) / np.asarray(layer.scale[-3:])
    found = []
    for time in np.unique(vertices[:, 0]):
        own = np.flatnonzero(vertices[:, 0] == time)
        index = np.full(len(vertices), -1)
        index[own] = np.arange(len(own))
        mine = index[faces]
        points = (vertices[own, 1:] + place) * np.asarray(sizes)
        found.append(Surface(points, mine[(mine >= 0).all(axis=1)]))
    return found


def _common_name(names: list[str]) -> str:
    """What names have in common at their beginning."""
    length = 0
    while all(len(name) > length and name[length] == names[0][length] for name in names):
        length += 1
    return names[0][:length].rstrip(" _-.0123456789([") or "movie"


def set_time_step(layer: Layer, seconds: float) -> None:
    """Give a layer the seconds between two timepoints that the user stated."""
    index = layer.ndim - 4 if type(layer).__name__ == "Surface" else layer_axes(layer).index("t")
    scale, translate = np.array(layer.scale), np.array(layer.translate)
    translate[index] *= seconds / scale[index]
    scale[index] = seconds
    units = list(layer.units)
    units[index] = SECOND
    place(layer, scale, translate, tuple(units))
