"""Sample data: one simulated light-sheet cell per kind, with its truth; and a movie of one."""

from __future__ import annotations

import numpy as np

from .. import simulate
from ..charts import Stack
from ..movie_demo import demo_stack
from .layers import SPACE, UNIT, LayerData


def sample(kind: str, size: int = 200, seed: int = 0) -> list[LayerData]:
    """A simulated cell as layers.

    Parameters
    ----------
    kind : str
        One of :data:`napari_unwrap3d.simulate.KINDS`.
    size : int
        Edge of the field of view in voxels of the working grid.
    seed : int

    Returns
    -------
    list of (data, attributes, type)
        The stack as the microscope recorded it, and, hidden, a label per protrusion.
    """
    cell = simulate.cell(kind, seed=seed, size=size)
    title = kind.replace("_", " ")
    common = {"units": (UNIT,) * 3, "axis_labels": SPACE}
    stack = common | {"name": title, "scale": cell.stack.voxel_size}
    labels = cell.truth.labels
    truth = common | {
        "name": f"{title}: true protrusions",
        "scale": labels.voxel_size,
        "translate": labels.origin,
        "visible": False,
    }
    return [(cell.stack.data, stack, "image"), (labels.data, truth, "labels")]


def blebs() -> list[LayerData]:
    """A cell with round blebs."""
    return sample("blebs")


def lamellipodia() -> list[LayerData]:
    """A cell with thin curved sheets."""
    return sample("lamellipodia")


def filopodia() -> list[LayerData]:
    """A cell with thin tubes."""
    return sample("filopodia")


def touching_filopodia() -> list[LayerData]:
    """A cell whose filopodia touch, so that its surface has handles."""
    return sample("touching_filopodia")


def handles() -> list[LayerData]:
    """A cell with arches, tunnels and sheets with pinholes."""
    return sample("handles")


def mix() -> list[LayerData]:
    """A cell with sheets, filopodia and blebs."""
    return sample("mix")


def blebbing() -> list[LayerData]:
    """A movie of a cell whose blebs come and go, and which drifts."""
    return [timelapse_layer(demo_stack("blebs", 0))]


def timelapse_layer(stack: Stack) -> LayerData:
    """A timelapse as a layer, with its seconds and micrometres; it is read as a whole."""
    scale = {
        "t": stack.time_step or 1.0,
        "c": 1.0,
        **dict(zip(SPACE, stack.voxel_size, strict=True)),
    }
    units = {
        "t": "second" if stack.time_step else "pixel",
        "c": "pixel",
        **dict.fromkeys(SPACE, UNIT),
    }
    attributes = {
        "name": stack.name,
        "scale": tuple(scale[axis] for axis in stack.axes),
        "units": tuple(units[axis] for axis in stack.axes),
        "axis_labels": tuple(stack.axes),
    }
    return np.asarray(stack.data), attributes, "image"
