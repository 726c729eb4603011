"""napari layer → the stack, mask or surface that the pipeline starts from.

The voxel size is read from the layer's scale *and* units. A layer in pixels has
no known voxel size, whatever its scale: the user is asked, it is never guessed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...charts import Mask, Size3, Stack, Surface, check_voxel_size
from ...errors import AxesError, InputError
from ...parameters import StackParameters
from .layers import KEY, SPACE, UNIT

if TYPE_CHECKING:
    from napari.layers import Layer


@dataclass(frozen=True)
class LayerSource:
    """What a layer holds, and where it lies.

    Attributes
    ----------
    data : Stack, Mask or Surface
        With its first voxel, or its coordinate zero, at the origin.
    origin : (float, float, float)
        Where that is in the viewer: (z, y, x) in µm.
    """

    data: Stack | Mask | Surface
    origin: Size3


def is_source(layer: Layer) -> bool:
    """Whether a layer can be unwrapped: an image, labels or mesh that is no chart of ours."""
    return (
        type(layer).__name__ in ("Image", "Labels", "Surface")
        and KEY not in layer.metadata
        and 3 <= layer.ndim <= 5
        and not getattr(layer, "rgb", False)
    )


def layer_voxel_size(layer: Layer) -> Size3 | None:
    """(z, y, x) in µm, or None when the layer's last three axes are not lengths."""
    factors = micrometres(layer)
    if factors is None:
        return None
    return check_voxel_size(np.abs(np.asarray(layer.scale[-3:]) * factors))


def set_voxel_size(layer: Layer, voxel_size: Size3) -> None:
    """Give a layer in pixels the voxel size that the user stated, in µm.

    Without it the charts, which are in µm, would not lie over the image.
    """
    sizes = check_voxel_size(voxel_size)
    scale, translate = np.array(layer.scale), np.array(layer.translate)
    translate[-3:] *= np.asarray(sizes) / scale[-3:]
    scale[-3:] = sizes
    place(layer, scale, translate, (*layer.units[:-3], UNIT, UNIT, UNIT))
    if all(name.lstrip("-").isdigit() for name in layer.axis_labels):
        time = ("t",) if layer.ndim == len(SPACE) + 1 else layer.axis_labels[:-3]
        layer.axis_labels = (*time, *SPACE)


def place(layer: Layer, scale: np.ndarray, translate: np.ndarray, units: tuple[Any, ...]) -> None:
    """Set where a layer lies, in which units.

    napari 0.9 slices with new units only when the extent changes after them: until then a stack
    with time would be black.
    """
    layer.units = units
    layer.scale = 2 * scale
    layer.scale = scale
    layer.translate = translate


def layer_box(layer: Layer) -> np.ndarray:
    """Centres (2, 3) of a layer's first and last voxel in µm (z, y, x)."""
    factors = micrometres(layer)
    world = np.asarray(layer.extent.world)[:, -3:]
    return world if factors is None else world * factors


def layer_axes(layer: Layer) -> str:
    """The axes of an image layer as letters out of ``tczyx``.

    Names that the layer carries are believed. Without names, three axes are
    ``zyx``, a fourth is time (napari puts channels into layers of their own), and
    of five the second is the channel.
    """
    names = "".join(name.lower()[:1] for name in layer.axis_labels)
    if len(names) == layer.ndim and names in ("zyx", "tzyx", "czyx", "tczyx"):
        return names
    axes = {3: "zyx", 4: "tzyx", 5: "tczyx"}.get(layer.ndim)
    if axes is None:
        raise AxesError(
            "The layer has the wrong number of axes.",
            dimensions=layer.ndim,
            hint="A stack has three axes (z, y, x), with time and channel in front.",
        )
    return axes


# How the names of those parameters begin that find a cell in an image.
SEGMENTING = (
    "background",
    "deconvolution",
    "edge",
    "interior",
    "local_contrast",
    "psf",
    "richardson",
    "smoothing",
    "threshold",
    "wiener",
)


def senseless_parameters(layer: Layer | None) -> set[str]:
    """Paths ``"stack.parameter"`` that make no sense for this kind of layer."""
    kind = type(layer).__name__
    names = StackParameters.model_fields
    hidden = {"timepoint", "channel", "label"}
    if layer is not None and kind in ("Image", "Labels"):
        axes = layer_axes(layer)
        hidden -= {"timepoint"} if "t" in axes else set()
        hidden -= {"channel"} if "c" in axes else set()
    if kind == "Labels":
        hidden -= {"label"}
        hidden |= {name for name in names if name.startswith(SEGMENTING)}
    elif kind == "Surface":
        hidden |= {name for name in names if name != "working_voxel_um"}
    return {f"stack.{name}" for name in hidden}


def layer_source(layer: Layer, voxel_size: Size3 | None = None) -> LayerSource:
    """What the pipeline starts from.

    Parameters
    ----------
    layer : Image, Labels or Surface layer
        An image becomes a :class:`Stack`, one of booleans a :class:`Mask`. Labels
        become a stack, of which the parameter ``stack.label`` picks the cell.
    voxel_size : (float, float, float), optional
        (z, y, x) in µm, for a layer in pixels.

    Raises
    ------
    VoxelSizeMissingError
        The layer is in pixels and no voxel size is given.
    AxesError
        The layer has too few or too many axes, or is an RGB image.
    InputError
        The layer is rotated, sheared or mirrored, or of another type.
    """
    if layer.ndim < 3:
        raise AxesError(
            "A flat layer cannot be unwrapped.",
            dimensions=layer.ndim,
            hint="Choose a stack (z, y, x), a label image or a mesh.",
        )
    check_placement(layer)
    known = layer_voxel_size(layer)
    sizes = check_voxel_size(known if known is not None else voxel_size)
    origin = np.asarray(layer.translate[-3:]) / np.asarray(layer.scale[-3:]) * np.asarray(sizes)
    place: Size3 = (float(origin[0]), float(origin[1]), float(origin[2]))
    kind = type(layer).__name__
    if kind == "Surface":
        return LayerSource(_surface(layer, sizes), place)
    if kind not in ("Image", "Labels"):
        raise InputError(
            f"A {kind} layer cannot be unwrapped.",
            hint="Choose an Image, Labels or Surface layer.",
        )
    if getattr(layer, "rgb", False):
        raise AxesError("An RGB image is not a stack.", hint="Split it into its channels.")
    data = layer.data[0] if getattr(layer, "multiscale", False) else layer.data
    axes = layer_axes(layer)
    if kind == "Image" and axes == "zyx" and data.dtype == np.bool_:
        return LayerSource(Mask(np.asarray(data), sizes), place)
    channels = data.shape[axes.index("c")] if "c" in axes else 0
    stack = Stack(
        data,
        axes,
        sizes,
        time_step=layer_time_step(layer),
        channels=tuple(f"channel {i}" for i in range(channels)),
        name=layer.name,
    )
    return LayerSource(stack, place)


def _surface(layer: Any, sizes: Size3) -> Surface:
    vertices = np.asarray(layer.data[0], dtype=float)
    if vertices.shape[1] != 3:
        raise AxesError(
            "The mesh changes with time; unwrap one timepoint.", dimensions=vertices.shape[1]
        )
    return Surface(vertices * sizes, layer.data[1])


def micrometres(layer: Layer) -> np.ndarray | None:
    """What one unit of the last three axes is in µm; None unless all are lengths."""
    units = layer.units[-3:]
    if len(units) != 3 or not all(u.is_compatible_with("metre") for u in units):
        return None
    return np.array([(1 * u).to("micrometre").magnitude for u in units])


def layer_time_step(layer: Layer) -> float | None:
    """Seconds between two timepoints; None without a t axis, or where its unit is no time."""
    axes = "tzyx"[-layer.ndim :] if type(layer).__name__ == "Surface" else layer_axes(layer)
    if "t" not in axes:
        return None
    index = axes.index("t")
    unit = layer.units[index]
    if not unit.is_compatible_with("second"):
        return None
    return float((float(layer.scale[index]) * unit).to("second").magnitude)


def check_placement(layer: Layer) -> None:
    """Only scale and translation: anything else would have to be resampled first."""
    ndim = layer.ndim
    straight = (
        np.allclose(layer.rotate, np.eye(ndim))
        and np.allclose(layer.shear, 0)
        and np.allclose(layer.affine.affine_matrix, np.eye(ndim + 1))
    )
    if not straight:
        raise InputError(
            "The layer is rotated, sheared or transformed.",
            hint="Export it resampled to straight axes, or reset its transform.",
        )
    if (np.asarray(layer.scale) <= 0).any():
        raise InputError(
            "The layer is mirrored.", scale=tuple(layer.scale), hint="Use positive scales."
        )
